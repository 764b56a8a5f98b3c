//! A table as a repair, where no known effect explains the missing force.
//!
//! The missing force may be a function of the angle, the rate, the pressure or the time
//! although no formula of the catalogue has its shape. A table, piecewise linear over one
//! of them, follows any shape, and the board runs it like any other effect. It is a repair
//! and is never named.
//!
//! A table of the angle can replace the spring, one of the rate the damper, one of the
//! pressure the gain: that parameter is held at its value from the fit without the table.

use model_core::actuator::{MAX_EFFECTS, Model, ParameterId};
use model_core::catalogue::Effect;
use model_core::effects::table::{FIRST_FORCE, Table, Variable};
use rayon::prelude::*;
use statrs::statistics::{Data, OrderStatistics};

use crate::diagnose::fit::candidates::{Candidate, FitContext};
use crate::diagnose::work::budget::SearchPart;
use crate::diagnose::work::executor::NoFit;
use crate::estimate::fit::Effort;
use crate::estimate::fitter::Fitter;
use crate::estimate::smooth::motions;

/// Nodes of a table of anything but the rate.
const NODES: usize = 8;

/// Steps of a fit of a table.
const FITTED: Effort = Effort::Steps(8);

/// A structure with the table that leaves the least error, fitted to everything. None if
/// there is no room for a table, or nothing to put in it, or no time.
pub fn with_table(context: &FitContext<'_>, base: &Candidate) -> Option<Candidate> {
    let from = &base.fit.model;
    if from.effects().count() >= MAX_EFFECTS || from.table().is_some() {
        return None;
    }
    let fits: Vec<Candidate> = Variable::ALL
        .par_iter()
        .filter_map(|&of| {
            let fitted = fitted(context, base, of)?;
            context.executor.reached(SearchPart::Table, fitted)
        })
        .collect();
    let best = fits
        .into_iter()
        .filter(|candidate| candidate.fit.sse().is_finite())
        .min_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()))?;
    let whole = context.fitter;
    let fitted = context.executor.begin().and_then(|_job| {
        let fit = &best.fit;
        context.executor.fit(whole, &fit.model, &fit.free, FITTED)
    });
    let fit = context.executor.reached(SearchPart::Table, fitted)?;
    Some(Candidate::of(best.added.len(), whole.informed(&fit)))
}

/// A structure with a table of this variable, fitted to the subsample; none if there is
/// nothing to put in it.
fn fitted(
    context: &FitContext<'_>,
    base: &Candidate,
    of: Variable,
) -> Option<Result<Candidate, NoFit>> {
    let from = &base.fit.model;
    let slot = from.effects().count();
    let nodes = nodes(context.fitter, of)?;
    let table = Table::new(of, &nodes, &vec![0.0; nodes.len()]).ok()?;
    let effects: Vec<Effect<f64>> = from.effects().chain([Effect::Table(table)]).collect();
    let model = Model::new(*from.dynamics(), &effects).ok()?;
    let forces = (0..nodes.len()).map(|node| ParameterId::Effect {
        slot,
        parameter: FIRST_FORCE + node,
    });
    let free: Vec<ParameterId> = base
        .fit
        .free
        .iter()
        .copied()
        .filter(|id| !does_the_same(of, *id))
        .chain(forces)
        .collect();
    let count = base.added.len() + 1;
    let executor = &context.executor;
    Some(executor.begin().and_then(|_job| {
        let fit = executor.fit(context.subsample, &model, &free, FITTED)?;
        Ok(Candidate::of(count, fit))
    }))
}

/// Whether a table can replace a parameter of the base equation.
fn does_the_same(of: Variable, id: ParameterId) -> bool {
    match of {
        Variable::Angle => matches!(id, ParameterId::Stiffness | ParameterId::Exponent),
        Variable::Rate => id == ParameterId::Damping,
        Variable::Pressure => id == ParameterId::InputGain,
        Variable::Time => false,
    }
}

/// Nodes (SI units) over the range of a variable in the fitted recordings; none if it
/// hardly changes.
fn nodes(fitter: &Fitter<'_>, of: Variable) -> Option<Vec<f32>> {
    /// Shares of the samples between which the outermost nodes lie.
    const ENDS: [f64; 2] = [0.01, 0.99];
    /// Nodes of a table of the rate, as shares of the fastest: the two innermost let it
    /// jump where the motion turns.
    const OF_RATE: [f64; 6] = [-1.0, -0.33, -0.03, 0.03, 0.33, 1.0];
    let mut values: Vec<f64> = Vec::new();
    for segment in fitter.data.fitted() {
        let recording = &segment.recording;
        let clock = fitter.data.sessions()[segment.session].clock();
        match of {
            Variable::Angle => values.extend(&recording.angle),
            Variable::Pressure => values.extend(&recording.pressure),
            Variable::Time => values.extend(recording.time.iter().map(|time| clock + time)),
            Variable::Rate => values.extend(motions(recording).map(|it| it.rate.abs())),
        }
    }
    let mut values = Data::new(values);
    let [low, high] = ENDS.map(|share| values.quantile(share));
    let wide = (high - low).is_finite() && high - low > 1e-6 * high.abs().max(low.abs());
    // Single precision, as in files and on the board.
    #[allow(clippy::cast_possible_truncation)]
    let single = |value: f64| value as f32;
    wide.then(|| match of {
        Variable::Rate => OF_RATE.map(|share| single(share * high)).to_vec(),
        _ => (0..NODES)
            .map(|node| single(low + (high - low) * node as f64 / (NODES - 1) as f64))
            .collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::Job;
    use crate::diagnose::score::Guesses;
    use crate::diagnose::score::scales::Scales;
    use crate::diagnose::work::executor::Executor;
    use crate::estimate::Dataset;
    use crate::estimate::checkpoint::Checkpoint;
    use crate::synth::example::{Hidden, make};
    use model_core::catalogue::Kind;
    use softrig_formats::model_file::ModelFile;
    use std::path::Path;

    /// A cubic spring is a table of the angle, a drag one of the rate: each closes most of
    /// what is missing, by the variable that it is of.
    #[test]
    fn a_table_follows_a_force_whose_formula_is_not_known() {
        for (kind, of) in [
            (Kind::CubicStiffness, Variable::Angle),
            (Kind::QuadraticDamping, Variable::Rate),
        ] {
            let example = make(Hidden::Effect(kind), 0.05, 3).unwrap();
            let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
            let recordings: Vec<_> = example.recordings.into_iter().map(|it| it.1).collect();
            let data = Dataset::of(&recordings);
            let fitter = Fitter::new(&file.model, &data);
            let refit = Candidate::of(0, fitter.fit(&file.model, &file.free, Effort::Full));
            let scales = Scales::of(&fitter, &refit.fit);
            let (job, checkpoint) = (Job::default(), Checkpoint::default());
            let context = FitContext {
                guesses: &Guesses::default(),
                file: &file,
                fitter: &fitter,
                short_segments: None,
                subsample: &fitter,
                scales: &scales,
                executor: Executor::new(&job, &checkpoint),
            };
            let repaired = with_table(&context, &refit).unwrap();
            let table = repaired.fit.model.table().unwrap();
            assert_eq!(table.of(), of, "{kind:?}");
            assert!(
                repaired.fit.rmse() < 0.5 * refit.fit.rmse(),
                "{kind:?}: {} of {}",
                repaired.fit.rmse(),
                refit.fit.rmse()
            );
        }
    }
}
