//! The search over structures: which effects, alone and together, are fitted.
//!
//! Three sieves, from cheap to dear. A score test of every effect at each of
//! its starts on an excerpt (one simulation with derivatives each); a fit at a
//! glance of the promising ones on the excerpt; a fit to everything of the
//! best. Effects are added to the best structures of one effect less; each effect
//! of the best structure is exchanged for every other one; and two effects that
//! promise most together are added to the best structure of two less, for some help
//! only beside each other ([`together`]). Then the search looks back: what is left
//! of the best structure without each of its effects is fitted once more.

use std::collections::BTreeSet;

use model_core::actuator::MAX_EFFECTS;
use model_core::catalogue::Kind;
use rayon::prelude::*;

use super::candidates::{Candidate, Ground, Promise, finish, glance, promise, without};
use super::noise::NoiseFloor;
use super::{Progress, adequate, together};

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

/// Two effects that promise most together are followed so many times.
const JOINED: usize = 12;

/// Where no combination removes this share of the gap at a glance, none will be
/// named, …
const WORTH_FINISHING: f64 = 0.4;

/// … and only so many are fitted to the end, to be shown.
const SHOWN_ANYHOW: usize = 2;

/// A pair that removes less than this share of the gap is not extended: with a
/// third effect it would not be named either.
const WORTH_A_THIRD: f64 = 0.5;

/// Times the noise that a coarse fit may leave for its final fit to leave only noise.
const MAY_SETTLE: f64 = 3.0;

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
    ground: &Ground<'_>,
    floor: &NoiseFloor,
    kinds: &[Kind],
    refit: &Candidate,
    progress: Progress<'_>,
) -> Singles {
    progress(&format!("{} effects, one at a time", kinds.len()));
    let mut coarse: Vec<Candidate> = kinds
        .par_iter()
        .filter_map(|&kind| glance(ground, &promise(ground, refit, kind)?))
        .collect();
    coarse.sort_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()));
    let may_settle = |candidate: &&Candidate| {
        candidate.fit.rmse() <= MAY_SETTLE * floor.rms.hypot(floor.input)
    };
    let mut pool = vec![refit.clone()];
    if coarse.iter().take(1).any(|best| may_settle(&best)) {
        let hopeless = HOPELESS * coarse.first().map_or(0.0, |best| best.fit.sse());
        let finished: Vec<Candidate> = coarse
            .par_iter()
            .take(FINISHED[0])
            .enumerate()
            .filter(|(place, candidate)| {
                *place < RIVALS_SHOWN || candidate.fit.sse() <= hopeless
            })
            .map(|(_, candidate)| finish(ground, candidate))
            .collect();
        pool.extend(finished);
    }
    Singles { coarse, pool }
}

/// Adds the best combinations of two and three effects, until the residual is noise.
pub fn combinations(
    ground: &Ground<'_>,
    floor: &NoiseFloor,
    kinds: &[Kind],
    refit: &Candidate,
    mut pool: Pool,
    progress: Progress<'_>,
) -> Pool {
    let before = ground.excerpt.compare(&refit.fit.model).rmse();
    // The error on the excerpt from which finishing is worth while.
    let worth = before - WORTH_FINISHING * (before - floor.rms).max(0.0);
    let room = MAX_EFFECTS - ground.file.model.effects().count();
    for size in 2..=room {
        let best = smallest(&pool, size - 1, BEAM[size - 1]);
        if best.is_empty() || best.iter().any(|&k| is_done(&pool[k], floor)) {
            break;
        }
        if size > 2
            && best
                .iter()
                .all(|&k| !is_worth_a_third(refit, &pool[k], floor))
        {
            break;
        }
        progress(&format!("combinations of {size} effects"));
        let bases: Vec<&Candidate> = best.iter().map(|&k| &pool[k]).collect();
        let width = Width {
            followed: FOLLOWED[size - 1],
            finished: FINISHED[size - 1],
            worth,
        };
        let found = extend(ground, kinds, &bases, width);
        pool.extend(found);
        let finished = SWAPPED;
        let swapped = swap(ground, kinds, &pool, size, Width { finished, ..width });
        pool.extend(swapped);
        let joined = join(ground, kinds, &pool, size, width);
        pool.extend(joined);
        look_back(ground, &mut pool, size);
    }
    pool
}

/// Whether a structure of the pool leaves nothing that another effect could explain.
pub fn settles(pool: &[Candidate], floor: &NoiseFloor) -> bool {
    pool.iter().skip(1).any(|candidate| is_done(candidate, floor))
}

/// What the best structure of `size` effects becomes with one of them
/// exchanged, as far as it was not fitted before.
fn swap(
    ground: &Ground<'_>,
    kinds: &[Kind],
    pool: &[Candidate],
    size: usize,
    width: Width,
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
        let better = extend(ground, &others, &[rest], width);
        known.extend(better.iter().map(Candidate::set));
        found.extend(better);
    }
    found
}

/// Fits what the best structure of `size` effects has without each of them again,
/// from where it stands: with an effect too many, a fit sometimes finds the
/// valley that it missed without.
fn look_back(ground: &Ground<'_>, pool: &mut Pool, size: usize) {
    let Some(best) = smallest(pool, size, 1).first().map(|&k| pool[k].clone()) else {
        return;
    };
    let rests: Vec<Candidate> = best
        .added
        .par_iter()
        .filter_map(|&out| without(ground, &best, out))
        .collect();
    for rest in rests {
        match pool
            .iter_mut()
            .find(|candidate| candidate.set() == rest.set())
        {
            Some(known) if known.fit.sse() <= rest.fit.sse() => {}
            Some(known) => *known = rest,
            None => pool.push(rest),
        }
    }
}

/// What the best structure of two effects less becomes with two that promise
/// most together, as far as it was not fitted before.
fn join(
    ground: &Ground<'_>,
    kinds: &[Kind],
    pool: &[Candidate],
    size: usize,
    width: Width,
) -> Vec<Candidate> {
    let Some(base) = smallest(pool, size - 2, 1).first().map(|&k| &pool[k]) else {
        return Vec::new();
    };
    let known: BTreeSet<Vec<Kind>> = pool.iter().map(Candidate::set).collect();
    let mut promises = together::promises(ground, base, kinds);
    promises.retain(|promise| !known.contains(&promise.set()));
    follow(
        ground,
        promises,
        Width {
            followed: JOINED,
            finished: SWAPPED,
            ..width
        },
    )
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
    // What the rig itself does not repeat, no effect explains.
    let floor = floor.clone().with_repeats(&candidate.fit.residuals);
    let noise = floor.rms.hypot(floor.input);
    adequate(&candidate.fit, &floor) || candidate.fit.rmse() <= FORMULA * noise
}

/// How many structures each sieve lets through.
#[derive(Clone, Copy)]
struct Width {
    /// Fitted at a glance.
    followed: usize,
    /// Fitted to the end …
    finished: usize,
    /// … if one of them is below this error on the excerpt (rad).
    worth: f64,
}

/// The best structures that have one effect more than `bases`.
fn extend(
    ground: &Ground<'_>,
    kinds: &[Kind],
    bases: &[&Candidate],
    width: Width,
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
    follow(ground, promises, width)
}

/// Fits the best of some promises, sorted, at a glance, and the best of those
/// to the end.
fn follow(ground: &Ground<'_>, mut promises: Vec<Promise>, width: Width) -> Vec<Candidate> {
    promises.truncate(width.followed);
    let mut glances: Vec<Candidate> = promises
        .par_iter()
        .filter_map(|promise| glance(ground, promise))
        .collect();
    glances.sort_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()));
    glances.truncate(width.finished);
    if glances
        .first()
        .is_some_and(|best| best.fit.rmse() > width.worth)
    {
        glances.truncate(SHOWN_ANYHOW);
    }
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
