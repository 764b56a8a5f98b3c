//! Pair screening: effects that help only together.
//!
//! Drag and dry friction each bend the decay of a pendulum the wrong way, and neither
//! alone gains anything, so a search that adds one effect at a time never finds the two.
//! One simulation with derivatives gives the first-order change of the simulated angle by
//! each effect. The predicted SSE of every pair then follows by linear algebra, without
//! another simulation.

use std::collections::BTreeSet;

use model_core::actuator::{MAX_EFFECTS, Model, ParameterId};
use model_core::catalogue::Kind;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::estimate::Nuisance;
use crate::estimate::fitter::Fitter;
use crate::portable::product;

use crate::diagnose::fit::candidates::{
    Candidate, Extension, FitContext, free_parameters, starts_from,
};
use crate::diagnose::score::Guesses;

/// Initial guesses of each effect that are combined with those of every other.
const STARTS: usize = 2;

/// Relative ridge weight, for nearly collinear columns.
const RIDGE: f64 = 1e-6;

/// The influence of one effect at one of its initial guesses.
struct Direction {
    kind: Kind,
    start: Model<f64>,
    /// The change of the residual and its derivatives by the effect's own parameters, one
    /// column each, with the base's own parameters projected out.
    columns: DMatrix<f64>,
}

/// The predicted SSE of every pair of effects added to `base`, least first. Empty if the
/// model has no room for two more.
pub fn ranked(context: &FitContext<'_>, base: &Candidate, kinds: &[Kind]) -> Vec<Extension> {
    let known = context.file.model.effects().count() + base.added.len();
    if known + 2 > MAX_EFFECTS {
        return Vec::new();
    }
    let Some(at) = Point::of(context, base) else {
        return Vec::new();
    };
    let directions: Vec<Direction> = kinds
        .par_iter()
        .filter(|kind| !base.added.contains(kind))
        .flat_map_iter(|&kind| directions(context, base, kind, &at))
        .collect();
    let mut predicted: Vec<(f64, usize, usize)> = (0..directions.len())
        .into_par_iter()
        .flat_map_iter(|a| (0..a).map(move |b| (a, b)))
        .filter(|&(a, b)| directions[a].kind != directions[b].kind)
        .filter_map(|(a, b)| {
            let [first, second] = [a, b].map(|index| &directions[index].columns);
            Some((left_by(&at.residual, first, second)?, a, b))
        })
        .collect();
    predicted.sort_by(|x, y| x.0.total_cmp(&y.0));
    let mut seen = BTreeSet::new();
    predicted
        .into_iter()
        .filter_map(|(_, a, b)| {
            let (a, b) = (&directions[a], &directions[b]);
            let predicted = Extension::of_start(base, [a.kind, b.kind], both(base, a, b)?);
            seen.insert(predicted.set()).then_some(predicted)
        })
        .collect()
}

/// The influence of an effect at its best initial guesses.
fn directions(
    context: &FitContext<'_>,
    base: &Candidate,
    kind: Kind,
    at: &Point,
) -> Vec<Direction> {
    let mut added = base.added.clone();
    added.push(kind);
    let own = free_parameters(context.file, &added).split_off(base.fit.free.len());
    let free = [at.free.as_slice(), &own].concat();
    let mut found: Vec<(f64, Direction)> = starts_from(context, base, kind, &Guesses::default())
        .par_iter()
        .filter_map(|start| {
            let direction = at.direction(context.subsample, kind, start, &free)?;
            let none = DMatrix::zeros(at.residual.nrows(), 0);
            Some((left_by(&at.residual, &direction.columns, &none)?, direction))
        })
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.truncate(STARTS);
    found.into_iter().map(|(_, direction)| direction).collect()
}

/// The linearisation point: the base and its residual.
struct Point {
    /// Zeros and initial states of the sessions, as fitted.
    nuisances: Vec<Nuisance>,
    /// Free parameters of the base, except those at a bound.
    free: Vec<ParameterId>,
    /// The residual.
    whole: DVector<f64>,
    /// An orthonormal basis of the changes that the base's own parameters can make.
    reachable: DMatrix<f64>,
    /// The residual with that basis projected out.
    residual: DMatrix<f64>,
}

impl Point {
    fn of(context: &FitContext<'_>, base: &Candidate) -> Option<Self> {
        let movable = |(index, &id)| (!base.fit.at_bound(index)).then_some(id);
        let free: Vec<ParameterId> = base
            .fit
            .free
            .iter()
            .enumerate()
            .filter_map(movable)
            .collect();
        let nuisances = context.subsample.compare(&base.fit.model).nuisances;
        let (whole, jacobian) = context
            .subsample
            .linearised(&base.fit.model, &free, &nuisances)?;
        let reachable = jacobian.qr().q();
        let residual = beyond(
            &reachable,
            &DMatrix::from_columns(std::slice::from_ref(&whole)),
        );
        Some(Self {
            nuisances,
            free,
            whole,
            reachable,
            residual,
        })
    }

    /// The influence of an effect, its force scaled down until it changes the angle by no
    /// more than the residual: beyond that the linearisation fails.
    fn direction(
        &self,
        fitter: &Fitter<'_>,
        kind: Kind,
        start: &Model<f64>,
        free: &[ParameterId],
    ) -> Option<Direction> {
        /// Most reductions of a force.
        const ATTEMPTS: usize = 4;
        let mut start = *start;
        for attempt in 1.. {
            let (changed, jacobian) = fitter.linearised(&start, free, &self.nuisances)?;
            let change = changed - &self.whole;
            let excess = change.norm() / self.whole.norm();
            if excess > 1.0 && attempt < ATTEMPTS {
                start = weaker(&start, 1.0 / excess)?;
                continue;
            }
            let own = jacobian.columns(self.free.len(), free.len() - self.free.len());
            let mut columns = DMatrix::zeros(change.len(), own.ncols() + 1);
            columns.set_column(0, &change);
            columns.columns_mut(1, own.ncols()).copy_from(&own);
            return Some(Direction {
                kind,
                start,
                columns: beyond(&self.reachable, &columns),
            });
        }
        None
    }
}

/// The part of the columns that is orthogonal to a basis.
fn beyond(basis: &DMatrix<f64>, columns: &DMatrix<f64>) -> DMatrix<f64> {
    columns - product(basis, &basis.tr_mul(columns))
}

/// A model with the forces of its last effect multiplied by `factor`.
fn weaker(model: &Model<f64>, factor: f64) -> Option<Model<f64>> {
    let last = model.effects().last()?;
    let slot = model.effects().count() - 1;
    let mut weaker = *model;
    for (parameter, row) in last.parameters().iter().enumerate() {
        let id = ParameterId::Effect { slot, parameter };
        if row.held.is_none() && row.unit.is_force() {
            weaker = weaker.with_value(id, factor * model.value(id)?);
        }
    }
    Some(weaker)
}

/// The sum of squares that the columns of two effects leave of a residual.
fn left_by(residual: &DMatrix<f64>, a: &DMatrix<f64>, b: &DMatrix<f64>) -> Option<f64> {
    let (n, m) = (a.ncols(), b.ncols());
    let mut normal = DMatrix::zeros(n + m, n + m);
    normal.view_mut((0, 0), (n, n)).copy_from(&a.tr_mul(a));
    normal.view_mut((n, n), (m, m)).copy_from(&b.tr_mul(b));
    let mixed = a.tr_mul(b);
    normal.view_mut((0, n), (n, m)).copy_from(&mixed);
    normal
        .view_mut((n, 0), (m, n))
        .copy_from(&mixed.transpose());
    for k in 0..n + m {
        normal[(k, k)] += RIDGE * normal[(k, k)] + f64::MIN_POSITIVE;
    }
    let mut slope = DVector::zeros(n + m);
    slope.rows_mut(0, n).copy_from(&a.tr_mul(residual));
    slope.rows_mut(n, m).copy_from(&b.tr_mul(residual));
    let step = normal.cholesky()?.solve(&slope);
    let left = residual.norm_squared() - slope.dot(&step);
    left.is_finite().then_some(left)
}

/// The base with both effects at their initial guesses.
fn both(base: &Candidate, a: &Direction, b: &Direction) -> Option<Model<f64>> {
    let last = |model: &Model<f64>| model.effects().last();
    let effects: Vec<_> = base
        .fit
        .model
        .effects()
        .chain([last(&a.start)?, last(&b.start)?])
        .collect();
    Model::new(*base.fit.model.dynamics(), &effects).ok()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::diagnose::score::scales::Scales;
    use crate::diagnose::work::executor::Executor;
    use crate::diagnose::work::job::Job;
    use crate::estimate::Dataset;
    use crate::estimate::checkpoint::Checkpoint;
    use crate::estimate::fit::Effort;
    use crate::sim::simulate::{InitialState, Signal, run};
    use softrig_formats::model_file::ModelFile;
    use softrig_formats::recording::Recording;

    const SWING: &str = r#"
        schema = 1
        name = "swing"
        [dynamics]
        inertia_kg_m = 1.0
        damping_n_s_per_rad = 0.2
        stiffness_n_per_rad_n = 60.0
        exponent = 1.0
        input_gain_n_per_kpa = 0.1
        [fit]
        free = ["damping", "stiffness"]
    "#;

    /// A free swing from each angle (rad), of which the model does not know the
    /// effects.
    fn swings(file: &ModelFile, effects: &[(Kind, &[f64])], from: &[f64]) -> Vec<Recording> {
        let effects: Vec<_> = effects
            .iter()
            .map(|(kind, values)| kind.build(values).unwrap())
            .collect();
        let truth: Model<f64> = Model::new(*file.model.dynamics(), &effects).unwrap();
        let time: Vec<f64> = (0..600).map(|k| f64::from(k) * 0.01).collect();
        let pressure = vec![0.0; time.len()];
        from.iter()
            .map(|&angle| Recording {
                angle: run(
                    &truth,
                    &Signal::new(time.clone(), pressure.clone()),
                    InitialState { angle, rate: 0.0 },
                    8,
                )
                .reading,
                time: time.clone(),
                pressure: pressure.clone(),
                ..Recording::default()
            })
            .collect()
    }

    /// The sets of effects that are predicted for the refit of a spring, best first.
    fn predicted(effects: &[(Kind, &[f64])]) -> Vec<Vec<Kind>> {
        let file = ModelFile::parse(SWING, Path::new("swing.toml")).unwrap();
        let recordings = swings(&file, effects, &[1.1, 0.7, 0.3]);
        let data = Dataset::of(&recordings);
        let fitter = Fitter::new(&file.model, &data);
        let base = Candidate::of(0, fitter.fit(&file.model, &file.free, Effort::Full));
        let (job, checkpoint) = (Job::default(), Checkpoint::default());
        let context = FitContext {
            file: &file,
            fitter: &fitter,
            short_segments: None,
            subsample: &fitter,
            scales: &Scales::of(&fitter, &base.fit),
            guesses: &Guesses::default(),
            executor: Executor::new(&job, &checkpoint),
        };
        let kinds = [
            Kind::CoulombFriction,
            Kind::QuadraticDamping,
            Kind::AngleDependentDamping,
            Kind::CubicStiffness,
            Kind::SensorOffset,
            Kind::AsymmetricDamping,
        ];
        ranked(&context, &base, &kinds)
            .iter()
            .map(Extension::set)
            .collect()
    }

    /// The decay that friction makes straight and drag steep looks viscous: each
    /// alone leaves what the other does.
    #[test]
    fn drag_and_dry_friction_are_predicted_together() {
        let predicted = predicted(&[
            (Kind::CoulombFriction, &[0.4, 0.05]),
            (Kind::QuadraticDamping, &[0.05]),
        ]);
        assert_eq!(
            predicted[0],
            [Kind::CoulombFriction, Kind::QuadraticDamping],
            "{predicted:?}"
        );
    }

    #[test]
    fn every_two_are_predicted_once() {
        let mut predicted = predicted(&[
            (Kind::CubicStiffness, &[-6.0]),
            (Kind::AsymmetricDamping, &[0.5]),
        ]);
        assert_eq!(
            predicted[0],
            [Kind::AsymmetricDamping, Kind::CubicStiffness]
        );
        assert_eq!(predicted.len(), 15);
        predicted.sort();
        predicted.dedup();
        assert_eq!(predicted.len(), 15);
    }
}
