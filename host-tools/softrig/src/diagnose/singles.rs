//! Fits of single effects by output error.
//!
//! 1. A score test of every effect at each of its initial guesses, on a subsample (one
//!    simulation with derivatives each).
//! 2. A coarse fit of each effect on the subsample.
//! 3. If the best may leave only noise, final fits of the best to all data. If none does,
//!    [`super::grade`] takes over.

use model_core::catalogue::Kind;
use rayon::prelude::*;

use super::budget::SearchPart;
use super::candidates::{Candidate, FitContext, coarse_fit, final_fit, predicted};
use super::noise::{NoiseFloor, adequate};
use super::policy::Search;

/// Number of structures with a final fit.
const FINISHED: usize = 12;

/// Candidates whose squared error in the coarse fit exceeds this multiple of the best get
/// no final fit, except those shown as rivals.
const HOPELESS: f64 = 6.0;

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

/// Fits the refit with each effect alone.
pub fn singles(
    context: &FitContext<'_>,
    floor: &NoiseFloor,
    kinds: &[Kind],
    refit: &Candidate,
) -> Singles {
    let progress = context.executor.progress();
    let what = format!("coarse fits of {} effects, one at a time", kinds.len());
    progress.stage(what, kinds.len());
    let mut coarse: Vec<Candidate> = kinds
        .par_iter()
        .filter_map(|&kind| {
            let fitted = predicted(context, refit, kind)
                .and_then(|predicted| coarse_fit(context, &predicted));
            context.executor.reached(SearchPart::Alone(kind), fitted)
        })
        .inspect(|candidate| progress.fitted(candidate))
        .collect();
    coarse.sort_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()));
    let may_settle = |candidate: &&Candidate| {
        candidate.fit.rmse() <= Search::STANDARD.may_settle * floor.total()
    };
    let mut pool = vec![refit.clone()];
    if coarse.iter().take(1).any(|best| may_settle(&best)) {
        let hopeless = HOPELESS * coarse.first().map_or(0.0, |best| best.fit.sse());
        let near = coarse.partition_point(|it| it.fit.sse() <= hopeless);
        let planned = near.clamp(RIVALS_SHOWN, FINISHED).min(coarse.len());
        progress.stage("final fits of the best single effects", planned);
        let finished: Vec<Candidate> = coarse
            .par_iter()
            .take(FINISHED)
            .enumerate()
            .filter(|(place, candidate)| *place < RIVALS_SHOWN || candidate.fit.sse() <= hopeless)
            .filter_map(|(_, candidate)| {
                let part = SearchPart::of(&candidate.added);
                context
                    .executor
                    .reached(part, final_fit(context, candidate))
            })
            .inspect(|candidate| progress.fitted(candidate))
            .collect();
        pool.extend(finished);
    }
    Singles { coarse, pool }
}

/// Whether a structure of the pool leaves nothing for another effect to explain.
pub fn is_settled(pool: &[Candidate], floor: &NoiseFloor) -> bool {
    pool.iter()
        .skip(1)
        .any(|candidate| is_done(candidate, floor))
}

/// Whether nothing is left for another effect to explain, or so little that the formula
/// may be to blame: the right effect by another formula leaves up to a fifth more than
/// the noise.
fn is_done(candidate: &Candidate, floor: &NoiseFloor) -> bool {
    // No effect explains the rig's repeatability.
    let floor = floor.clone().with_repeats(&candidate.fit.residuals);
    let noise = floor.total();
    adequate(&candidate.fit, &floor) || candidate.fit.rmse() <= Search::STANDARD.done * noise
}
