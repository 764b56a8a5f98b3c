//! The search over structures: which effects, alone and together, are fitted.
//!
//! Three sieves, from cheap to dear. A score test of every effect at each of
//! its starts on an excerpt (one simulation with derivatives each); a fit at a
//! glance of the promising ones on the excerpt; a fit to everything of the
//! best. Effects are added to the best structures of one effect less, so that a
//! pair that only helps together is found as long as one of the two is among
//! the best single effects. Then the search goes backward: each effect of the
//! best structure is taken out, and every other one tried in its place.

use std::collections::BTreeSet;

use model_core::actuator::MAX_EFFECTS;
use model_core::catalogue::Kind;
use rayon::prelude::*;

use super::candidates::{Candidate, Ground, finish, glance, promise, without};
use super::noise::NoiseFloor;
use super::{Progress, adequate};

/// Structures that are expanded at the first, second and third effect.
const BEAM: [usize; MAX_EFFECTS] = [1, 4, 3];

/// Promises that are followed at each size.
const FOLLOWED: [usize; MAX_EFFECTS] = [27, 10, 6];

/// Structures that are fitted to the end at each size.
const FINISHED: [usize; MAX_EFFECTS] = [12, 6, 3];

/// Candidates whose squared error at a glance is this many times that of the
/// best are not fitted to the end …
const HOPELESS: f64 = 6.0;

/// … except for as many as are shown as rivals.
const RIVALS_SHOWN: usize = 3;

/// Structures that are fitted to the end in the place of one effect of the best.
const SWAPPED: usize = 3;

/// A pair that removes less than this share of the gap is not extended: with a
/// third effect it would not be named either.
const WORTH_A_THIRD: f64 = 0.5;

/// Every structure that was fitted to the end; the first is the refit.
pub type Pool = Vec<Candidate>;

/// Fits the refit with each effect alone, then the best of them with each
/// other effect, up to three, until the residual is noise.
pub fn search(
    ground: &Ground<'_, '_>,
    floor: &NoiseFloor,
    kinds: &[Kind],
    refit: &Candidate,
    progress: Progress<'_>,
) -> Pool {
    let mut pool = vec![refit.clone()];
    let room = MAX_EFFECTS - ground.file.model.effects().count();
    for size in 1..=room {
        let best = smallest(&pool, size - 1, BEAM[size - 1]);
        if size > 1 && (best.is_empty() || best.iter().any(|&k| is_done(&pool[k], floor))) {
            break;
        }
        if size > 2
            && best
                .iter()
                .all(|&k| !is_worth_a_third(refit, &pool[k], floor))
        {
            break;
        }
        progress(&match size {
            1 => format!("{} effects, one at a time", kinds.len()),
            _ => format!("combinations of {size} effects"),
        });
        let bases: Vec<&Candidate> = best.iter().map(|&k| &pool[k]).collect();
        let found = extend(
            ground,
            kinds,
            &bases,
            FOLLOWED[size - 1],
            FINISHED[size - 1],
        );
        pool.extend(found);
        if size > 1 {
            let swapped = swap(ground, kinds, &pool, size);
            pool.extend(swapped);
        }
    }
    pool
}

/// What the best structure of `size` effects becomes with one of them
/// exchanged, as far as it was not fitted before.
fn swap(
    ground: &Ground<'_, '_>,
    kinds: &[Kind],
    pool: &[Candidate],
    size: usize,
) -> Vec<Candidate> {
    let Some(best) = smallest(pool, size, 1).first().map(|&k| &pool[k]) else {
        return Vec::new();
    };
    let rests: Vec<Candidate> = best
        .added
        .iter()
        .filter_map(|&out| {
            let rest: Vec<Kind> = best.set().into_iter().filter(|&kind| kind != out).collect();
            let known = pool.iter().find(|candidate| candidate.set() == rest);
            known.cloned().or_else(|| without(ground, best, out))
        })
        .collect();
    let mut known: BTreeSet<Vec<Kind>> = pool.iter().map(Candidate::set).collect();
    let mut found = Vec::new();
    for rest in &rests {
        let others: Vec<Kind> = kinds
            .iter()
            .copied()
            .filter(|&kind| {
                let mut set = rest.added.clone();
                set.push(kind);
                set.sort_unstable();
                !known.contains(&set)
            })
            .collect();
        let better = extend(ground, &others, &[rest], FOLLOWED[size - 1], SWAPPED);
        known.extend(better.iter().map(Candidate::set));
        found.extend(better);
    }
    found
}

/// Whether a structure removes enough of the gap to be extended.
fn is_worth_a_third(refit: &Candidate, candidate: &Candidate, floor: &NoiseFloor) -> bool {
    let gap = refit.fit.rmse() - floor.rms;
    refit.fit.rmse() - candidate.fit.rmse() >= WORTH_A_THIRD * gap
}

/// Whether nothing is left that another effect could explain, or so little that
/// the formula may be to blame: the right effect by another formula leaves up to
/// a fifth more than the noise.
fn is_done(candidate: &Candidate, floor: &NoiseFloor) -> bool {
    const FORMULA: f64 = 1.2;
    adequate(&candidate.fit, floor) || candidate.fit.rmse() <= FORMULA * floor.rms
}

/// The best structures that have one effect more than `bases`: as many as
/// `followed` are fitted at a glance, and of those `finished` to the end.
fn extend(
    ground: &Ground<'_, '_>,
    kinds: &[Kind],
    bases: &[&Candidate],
    followed: usize,
    finished: usize,
) -> Vec<Candidate> {
    let pairs: Vec<(&Candidate, Kind)> = bases
        .iter()
        .flat_map(|&base| {
            kinds
                .iter()
                .filter(move |kind| !base.added.contains(kind))
                .map(move |&kind| (base, kind))
        })
        .collect();
    let mut promises: Vec<_> = pairs
        .par_iter()
        .filter_map(|(base, kind)| promise(ground, base, *kind))
        .collect();
    promises.sort_by(|a, b| a.sse.total_cmp(&b.sse));
    let mut seen = BTreeSet::new();
    promises.retain(|promise| seen.insert(promise.set()));
    promises.truncate(followed);
    let mut glances: Vec<Candidate> = promises
        .par_iter()
        .filter_map(|promise| glance(ground, promise))
        .collect();
    glances.sort_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()));
    glances.truncate(finished);
    let hopeless = HOPELESS * glances.first().map_or(0.0, |best| best.fit.sse());
    let least = glances.len().min(RIVALS_SHOWN);
    let keep = glances.partition_point(|candidate| candidate.fit.sse() <= hopeless);
    glances.truncate(keep.max(least));
    glances
        .par_iter()
        .map(|candidate| finish(ground, candidate))
        .collect()
}

/// The `count` structures of `size` effects with the smallest residual.
fn smallest(pool: &[Candidate], size: usize, count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..pool.len())
        .filter(|&k| pool[k].added.len() == size)
        .collect();
    order.sort_by(|&a, &b| pool[a].fit.sse().total_cmp(&pool[b].fit.sse()));
    order.truncate(count);
    order
}
