//! Fits of single effects by output error.
//!
//! 1. A coarse fit, on a subsample, of the effects that the [`crate::diagnose::score`] puts first, from where
//!    it says, and of the neighbours of the best in the catalogue.
//! 2. If the best may leave only noise, final fits of the best to all data.
//! 3. If none does, the same with all effects, from wherever the catalogue says. Then
//!    [`crate::diagnose::search::grade`] takes over.

use model_core::catalogue::Kind;
use rayon::prelude::*;

use crate::diagnose::evidence::measure::excess;
use crate::diagnose::fit::candidates::{
    Candidate, FitContext, Starts, coarse_fit, final_fit, predicted,
};
use crate::diagnose::recordings::noise::NoiseFloor;
use crate::diagnose::work::budget::SearchPart;
use crate::diagnose::work::policy::{Policy, Search};
use crate::diagnose::work::progress::Stage;
use crate::estimate::fit::Effort;

/// Number of structures with a final fit.
const FINISHED: usize = 12;

/// Candidates whose squared error in the coarse fit exceeds this multiple of the best get
/// no final fit, except those shown as rivals.
pub const HOPELESS: f64 = 6.0;

/// Effects that are fitted first: the first four of each view of the score. In nine of ten of 81
/// drawn cases and 54 sessions, the effect was among this many.
const LEADING: usize = 8;

/// Number of rivals that get a final fit in any case.
const RIVALS_SHOWN: usize = 3;

/// Every structure with a final fit; the first is the refit.
pub type Pool = Vec<Candidate>;

/// The refit with each effect alone: coarse fits to the subsample, best first, and final
/// fits of those that may leave only noise.
pub struct Singles {
    /// Coarse fits, the best first.
    pub coarse: Vec<Candidate>,
    /// The refit, then final fits.
    pub pool: Pool,
}

/// Fits the refit with each effect alone: those that the score puts first, and what is easily
/// taken for the best of them; where that does not settle the matter, all from everywhere.
pub fn singles(
    context: &FitContext<'_>,
    floor: &NoiseFloor,
    kinds: &[Kind],
    refit: &Candidate,
) -> Singles {
    let job = context.executor.job();
    let mut singles = Singles {
        coarse: Vec::new(),
        pool: vec![refit.clone()],
    };
    let ranked = context.guesses.ranked();
    let first: Vec<Kind> = ranked.into_iter().take(LEADING).collect();
    job.progress
        .knows(|known| known.leads = first.first().copied());
    job.progress.stage(Stage::Leading, first.len());
    singles.fit(context, refit, &first, Starts::Scored);
    let near = singles.neighbours(kinds);
    job.progress
        .step("fits of what looks like the best", near.len());
    singles.fit(context, refit, &near, Starts::Scored);
    singles.finish(context, floor);
    if !is_settled(&singles.pool, floor) {
        job.progress.stage(Stage::Everywhere, kinds.len());
        singles.fit(context, refit, kinds, Starts::Everywhere);
        singles.finish(context, floor);
    }
    singles
}

impl Singles {
    /// Coarse fits of these effects, each alone.
    fn fit(&mut self, context: &FitContext<'_>, refit: &Candidate, kinds: &[Kind], from: Starts) {
        let executor = &context.executor;
        let fitted: Vec<Candidate> = kinds
            .par_iter()
            .filter_map(|&kind| {
                let fitted = predicted(context, refit, kind, from)
                    .and_then(|predicted| coarse_fit(context, &predicted));
                executor.reached(SearchPart::Alone(kind), fitted)
            })
            .inspect(|candidate| executor.job().progress.offer(candidate.so_far()))
            .collect();
        // Of two fits of an effect the better one counts, and what was made of the other is
        // dropped.
        for candidate in fitted {
            let known = self
                .coarse
                .iter_mut()
                .find(|it| it.added == candidate.added);
            match known {
                None => self.coarse.push(candidate),
                Some(known) if candidate.fit.sse() < known.fit.sse() => {
                    self.pool.retain(|it| it.added != candidate.added);
                    *known = candidate;
                }
                Some(_) => {}
            }
        }
        self.coarse
            .sort_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()));
    }

    /// What is a special case of the best, or has it as one, can be imitated by it, or is of its
    /// family, and was not fitted.
    fn neighbours(&self, kinds: &[Kind]) -> Vec<Kind> {
        let Some(&best) = self.coarse.first().and_then(|it| it.added.last()) else {
            return Vec::new();
        };
        let is_near = |kind: Kind| {
            kind.info().special_case == Some(best)
                || best.info().special_case == Some(kind)
                || best.info().imitates.contains(&kind)
                || kind.info().imitates.contains(&best)
                || kind.info().family == best.info().family
        };
        let fitted = |kind: Kind| self.coarse.iter().any(|it| it.added.contains(&kind));
        kinds
            .iter()
            .copied()
            .filter(|&kind| is_near(kind) && !fitted(kind))
            .collect()
    }

    /// Final fits of the best, if one of them may leave only noise.
    fn finish(&mut self, context: &FitContext<'_>, floor: &NoiseFloor) {
        let job = context.executor.job();
        let most = Search::STANDARD.may_settle * floor.total();
        let Some(best) = self.coarse.first().filter(|best| best.fit.rmse() <= most) else {
            return;
        };
        let hopeless = HOPELESS * best.fit.sse();
        let near = self
            .coarse
            .partition_point(|it| it.fit.sse() <= hopeless)
            .clamp(RIVALS_SHOWN, FINISHED);
        let is_unfinished = |candidate: &&Candidate| {
            let mut pool = self.pool.iter();
            pool.all(|known| known.added != candidate.added)
        };
        let near = self.coarse.iter().take(near);
        let planned: Vec<&Candidate> = near.filter(is_unfinished).collect();
        job.progress.stage(Stage::Final, planned.len());
        let final_fits = |candidates: Vec<&Candidate>, effort: Effort| -> Vec<Candidate> {
            candidates
                .par_iter()
                .filter_map(|candidate| {
                    let part = SearchPart::of(&candidate.added);
                    let fitted = final_fit(context, candidate, effort);
                    context.executor.reached(part, fitted)
                })
                .inspect(|candidate| job.progress.offer(candidate.so_far()))
                .collect()
        };
        let nearly = final_fits(planned, Effort::Coarse);
        let most = most_of_rivals(nearly.iter().chain(&self.pool[1..]), floor);
        let (near, far): (Vec<Candidate>, Vec<Candidate>) =
            nearly.into_iter().partition(|it| it.fit.rmse() <= most);
        let informed = |far: Candidate| Candidate {
            fit: context.fitter.informed(&far.fit),
            ..far
        };
        job.progress.step("to their ends", near.len());
        let mut finished = final_fits(near.iter().collect(), Effort::Full);
        finished.extend(far.into_iter().map(informed));
        self.pool.extend(finished);
    }
}

/// The RMS error (rad) up to which a structure may still be a rival of the best of `fitted`: a
/// rival leaves at most [`Policy::comparable`] times its error beyond the noise, and what leaves
/// more than twice that factor after a few steps on everything will not be one.
pub fn most_of_rivals<'a>(fitted: impl Iterator<Item = &'a Candidate>, floor: &NoiseFloor) -> f64 {
    let policy = &Policy::STANDARD;
    let noise = floor.total();
    let least = fitted.map(|it| it.fit.rmse()).fold(f64::INFINITY, f64::min);
    libm::hypot(
        noise,
        policy.comparable.powi(2) * excess(least, noise, policy),
    )
}

/// Whether a structure of the pool leaves nothing for another effect to explain.
pub fn is_settled(pool: &[Candidate], floor: &NoiseFloor) -> bool {
    pool.iter()
        .skip(1)
        .any(|candidate| is_done(candidate, floor))
}

/// Whether nothing is left for another effect to explain, or so little that the formula
/// may be to blame.
pub fn is_done(candidate: &Candidate, floor: &NoiseFloor) -> bool {
    leaves_noise(candidate, floor)
        || candidate.fit.rmse() <= Search::STANDARD.done * with_repeats(candidate, floor).total()
}

/// Whether what a structure leaves may be noise alone.
pub fn leaves_noise(candidate: &Candidate, floor: &NoiseFloor) -> bool {
    with_repeats(candidate, floor).covers(candidate.fit.rmse())
}

/// No effect explains the rig's repeatability.
fn with_repeats(candidate: &Candidate, floor: &NoiseFloor) -> NoiseFloor {
    floor.clone().with_repeats(&candidate.fit.residuals)
}
