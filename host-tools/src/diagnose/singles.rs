//! The single effects, by output error.
//!
//! A score test of every effect at each of its starts on a subsample (one simulation with
//! derivatives each); a coarse fit of each on the subsample; where the best may leave only
//! noise, final fits to everything of the best. Where none does, [`super::grade`] goes on.

use model_core::catalogue::Kind;
use rayon::prelude::*;

use super::Progress;
use super::budget::Part;
use super::candidates::{Candidate, FitContext, coarse_fit, final_fit, predicted};
use super::noise::{NoiseFloor, adequate};
use super::policy::Exact;

/// Structures that are fitted to the end.
const FINISHED: usize = 12;

/// Candidates whose squared error in the coarse fit is this many times that of the
/// best are not fitted to the end, except for as many as are shown as rivals.
const HOPELESS: f64 = 6.0;

/// Rivals that are fitted to the end in any case.
const RIVALS_SHOWN: usize = 3;

/// Every structure that was fitted to the end; the first is the refit.
pub type Pool = Vec<Candidate>;

/// The refit with each effect alone: coarse fits to the subsample, the best first, and
/// those that may leave only noise fitted to everything.
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
    progress: &Progress,
) -> Singles {
    let what = format!("coarse fits of {} effects, one at a time", kinds.len());
    progress.stage(what, kinds.len());
    let mut coarse: Vec<Candidate> = kinds
        .par_iter()
        .filter(|kind| progress.has_time_for(Part::Alone(**kind)))
        .filter_map(|&kind| coarse_fit(context, &predicted(context, refit, kind)?))
        .inspect(|candidate| progress.fitted(candidate))
        .collect();
    coarse.sort_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()));
    let may_settle = |candidate: &&Candidate| {
        candidate.fit.rmse() <= Exact::STANDARD.may_settle * floor.rms.hypot(floor.input)
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
            .filter(|(_, candidate)| progress.has_time_for(Part::of(&candidate.added)))
            .map(|(_, candidate)| final_fit(context, candidate))
            .inspect(|candidate| progress.fitted(candidate))
            .collect();
        pool.extend(finished);
    }
    Singles { coarse, pool }
}

/// Whether a structure of the pool leaves nothing that another effect could explain.
pub fn settles(pool: &[Candidate], floor: &NoiseFloor) -> bool {
    pool.iter()
        .skip(1)
        .any(|candidate| is_done(candidate, floor))
}

/// Whether nothing is left that another effect could explain, or so little that
/// the formula may be to blame: the right effect by another formula leaves up to
/// a fifth more than the noise.
fn is_done(candidate: &Candidate, floor: &NoiseFloor) -> bool {
    // What the rig itself does not repeat, no effect explains.
    let floor = floor.clone().with_repeats(&candidate.fit.residuals);
    let noise = floor.rms.hypot(floor.input);
    adequate(&candidate.fit, &floor) || candidate.fit.rmse() <= Exact::STANDARD.done * noise
}
