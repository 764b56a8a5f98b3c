//! Searches structures where some model error always remains.
//!
//! On a real rig no structure leaves only noise. Structures are fitted at several
//! horizons and measured: single effects first, then the best of them with each other
//! effect.

use std::collections::BTreeSet;

use model_core::catalogue::Kind;
use rayon::prelude::*;

use crate::diagnose::evidence::measure::{MeasureContext, Reference, StructureFit};
use crate::diagnose::evidence::validation::CrossValidator;
use crate::diagnose::fit::candidates::{Candidate, FitContext, coarse_fit, final_fit};
use crate::diagnose::fit::levels::{Base, Estimate, Levels};
use crate::diagnose::fit::pairs;
use crate::diagnose::recordings::noise::NoiseFloor;
use crate::diagnose::score::Guesses;
use crate::diagnose::work::budget::SearchPart;
use crate::diagnose::work::policy::{Policy, Search};
use crate::diagnose::work::progress::Stage;
use crate::estimate::fit::{Effort, Fit};

/// Number of structures of each size to which another effect is added.
const LEADS: usize = 2;

/// The graded structures.
pub struct Grades {
    /// Every structure that was measured.
    pub measured: Vec<StructureFit>,
}

/// Number of pairs that are fitted for their predicted SSE: some effects help only together.
const JOINED: usize = 4;

/// Folds of the cross-validation while structures are measured.
const FOLDS: usize = 4;

/// Number of combinations with a final fit by output error, in case one leaves only
/// noise.
const FINISHED: usize = 3;

impl Grades {
    /// Whether any structure may leave only noise after its final fit.
    pub fn may_leave_noise(&self, floor: &NoiseFloor) -> bool {
        let Some(best) = self.nearest() else {
            return true;
        };
        let floor = floor
            .clone()
            .with_repeats(&best.row.candidate.fit.residuals);
        let left = best.estimate.fits.last().map_or(0.0, Fit::rmse);
        left <= Search::STANDARD.may_leave * floor.total()
    }

    /// The structure with the least output error.
    fn nearest(&self) -> Option<&StructureFit> {
        let left = |row: &StructureFit| row.estimate.fits.last().map_or(f64::INFINITY, Fit::sse);
        self.measured
            .iter()
            .min_by(|a, b| left(a).total_cmp(&left(b)))
    }

    /// The same structure, if its residuals are those of a simulation.
    pub fn simulated(&self) -> Option<&Candidate> {
        self.nearest()
            .map(|it| &it.row.candidate)
            .filter(|candidate| candidate.level.is_none())
    }

    /// The combinations with the least output error, by final fits.
    pub fn finished(&self, context: &FitContext<'_>) -> Vec<Candidate> {
        let mut rows: Vec<(f64, &StructureFit)> = self
            .measured
            .iter()
            .filter(|row| row.estimate.added.len() > 1)
            .filter_map(|row| Some((row.estimate.fits.last()?.sse(), row)))
            .collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        rows.truncate(FINISHED);
        let executor = &context.executor;
        executor
            .job()
            .progress
            .stage(Stage::FinalCombinations, rows.len());
        rows.par_iter()
            .filter_map(|(_, row)| {
                let fit = row.estimate.fits.last()?.clone();
                let candidate = Candidate::of(row.estimate.added.len(), fit);
                executor.reached(
                    SearchPart::Combinations,
                    final_fit(context, &candidate, Effort::Full),
                )
            })
            .collect()
    }
}

/// Measures single effects and combinations; none if nothing could be measured.
pub fn grade(
    context: &FitContext<'_>,
    validator: &CrossValidator<'_>,
    floor: &NoiseFloor,
    kinds: &[Kind],
    refit: &Candidate,
    coarse: &[Candidate],
) -> Option<Grades> {
    let executor = &context.executor;
    let job = executor.job();
    let policy = &Policy::STANDARD;
    let noise = floor.total();
    let levels = Levels::of(*context, refit, noise);
    job.progress.stage(Stage::Horizons, 0);
    let base = executor.reached(SearchPart::Horizons, levels.base(refit))?;
    let in_turn = validator
        .in_turn()
        .then(|| CrossValidator::with_folds(context.file, context.fitter, floor.input, FOLDS));
    let measuring = MeasureContext {
        levels: &levels,
        subsample: context.subsample,
        validator: in_turn.as_ref().unwrap_or(validator),
        noise,
        policy,
    };
    job.progress.step("validation", base.fits.len());
    let baseline = measuring.baseline(base.clone());
    let baseline = executor.reached(SearchPart::Horizons, baseline)?;
    let screened = vec![0, levels.output_error().saturating_sub(1)];
    let mut search = Growth {
        levels: &levels,
        measuring: &measuring,
        baseline: &baseline,
        kinds,
        measured: Vec::new(),
    };
    job.progress.stage(Stage::Effects, 0);
    let nothing = Base {
        estimate: &base,
        at: screened,
        beside: Guesses::default(),
    };
    search.extend(&[nothing], coarse);
    if !search.leaves_noise(1, noise) && job.may_begin(SearchPart::Combinations) {
        job.progress.stage(Stage::Combinations, 0);
        let leads = search.leads(1);
        let leads: Vec<Base<'_>> = leads
            .iter()
            .map(|(estimate, at)| levels.lead(estimate, at.clone(), kinds))
            .collect();
        job.progress.step("pair screening", JOINED);
        let joined: Vec<Candidate> = pairs::ranked(context, refit, kinds)
            .par_iter()
            .take(JOINED)
            .filter_map(|predicted| {
                executor.reached(SearchPart::Combinations, coarse_fit(context, predicted))
            })
            .collect();
        search.extend(&leads, &joined);
    }
    let measured = search.measured;
    (!measured.is_empty()).then_some(Grades { measured })
}

/// A search under way.
struct Growth<'a> {
    levels: &'a Levels<'a>,
    measuring: &'a MeasureContext<'a>,
    baseline: &'a Reference,
    kinds: &'a [Kind],
    measured: Vec<StructureFit>,
}

impl Growth<'_> {
    /// Extends each base by one further effect.
    fn extend(&mut self, bases: &[Base<'_>], coarse: &[Candidate]) {
        let known: BTreeSet<Vec<Kind>> =
            self.measured.iter().map(|row| row.estimate.set()).collect();
        let found = self.levels.extended(bases, self.kinds, coarse, &known);
        // A structure hardly better than a single effect is neither named nor a repair.
        let single = self
            .measured
            .iter()
            .map(|row| row.leaves_on_subsample)
            .fold(f64::INFINITY, f64::min);
        let most = self.measuring.policy.worth_writing * single;
        let measured = self.measuring.measure(self.baseline, found, most);
        self.measured.extend(measured);
    }

    fn of_size(&self, size: usize) -> Vec<&StructureFit> {
        let mut rows: Vec<&StructureFit> = self
            .measured
            .iter()
            .filter(|row| row.estimate.added.len() == size)
            .collect();
        rows.sort_by(|a, b| a.leaves.total_cmp(&b.leaves));
        rows
    }

    /// The structures of a size with the least error, and the one with the most evidence,
    /// with the levels at which further effects are screened.
    fn leads(&self, size: usize) -> Vec<(Estimate, Vec<usize>)> {
        let rows = self.of_size(size);
        let mut leads: Vec<&StructureFit> = rows.iter().take(LEADS).copied().collect();
        let evidence = rows.iter().max_by(|a, b| a.evidence.total_cmp(&b.evidence));
        if let Some(row) = evidence
            && leads
                .iter()
                .all(|lead| lead.estimate.added != row.estimate.added)
        {
            leads.push(row);
        }
        leads
            .into_iter()
            .map(|row| {
                let mut at = vec![row.level, self.levels.output_error()];
                at.dedup();
                (row.estimate.clone(), at)
            })
            .collect()
    }

    /// Whether the best structure of a size leaves hardly more than the noise.
    fn leaves_noise(&self, size: usize, noise: f64) -> bool {
        self.of_size(size)
            .first()
            .is_some_and(|row| row.row.held_out.full <= self.measuring.policy.at_noise * noise)
    }
}
