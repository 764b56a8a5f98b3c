//! The judgement: named, cannot tell, unexplained, or only the parameters.
//!
//! Two questions decide, in this order. Does the structure hold on runs that
//! were not fitted (how much of the gap between refit and noise does it
//! close)? And is it better than every rival beyond what correlated residuals
//! can pretend? The ranking of rivals alone names something on any data.

use std::collections::BTreeSet;

use model_core::actuator::MAX_EFFECTS;
use model_core::catalogue::Kind;
use model_core::effects::table::Variable;
use rayon::prelude::*;

use super::bootstrap::chance;
use super::candidates::{Candidate, FitContext, released};
use super::decide::Strength;
use super::family::Family;
use super::noise::{NoiseFloor, adequate};
use super::policy::Exact;
use super::ranking::{Growth, Ranked, Scoring, required_evidence};
use super::validation::CrossValidator;
use super::verdict::{Alternative, Answer};

/// How many times the noise so many effects may leave before more is asked of
/// them.
fn left_allowed(effects: usize, only_repeats: bool) -> f64 {
    if only_repeats {
        Exact::STANDARD.leaves_on_repeats
    } else if effects > 1 {
        Exact::STANDARD.leaves_several
    } else {
        Exact::STANDARD.leaves
    }
}

/// The share of the held-out gap that so many effects have to remove for a name
/// if they leave `left` times the noise.
fn share_needed(effects: usize, left: f64, only_repeats: bool) -> f64 {
    if left > left_allowed(effects, only_repeats) {
        Exact::STANDARD.closes_large
    } else if effects > 1 {
        Exact::STANDARD.closes_several
    } else {
        Exact::STANDARD.closes
    }
}

/// As many rivals are shown.
pub const RIVALS_SHOWN: usize = 3;

/// As many rivals can gain by chance.
const RIVALS_DRAWN: usize = 8;

/// As many rivals are held against each other when a run is planned.
pub const RIVALS_PLANNED: usize = 3;

/// A structure that was fitted to the end.
#[derive(Clone, Debug, PartialEq)]
pub struct Tried {
    /// The effects that were added.
    pub kinds: Vec<Kind>,
    /// RMS residual (rad).
    pub rmse: f64,
    /// RMS error on runs that were not fitted (rad), and the share of the
    /// held-out gap that it closes; none for those far behind.
    pub held_out: Option<(f64, f64)>,
    /// Difference of the information criterion to the best of its size.
    pub delta_bic: f64,
    /// How far its squared residuals are from those of the best of its size, in
    /// standard errors.
    pub separation: f64,
    /// Probability among the structures of its size.
    pub probability: f64,
    /// Whether the recordings reject it against the best of its size.
    pub rejected: bool,
    /// Parameters that ended at the edge of the range that was searched.
    pub at_bound: Vec<String>,
}

/// What a search came to.
#[derive(Clone, Debug)]
pub struct Selection {
    /// The answer.
    pub answer: Answer,
    /// The effects that are named, in the order of the repaired model.
    pub named: Vec<Kind>,
    /// How strongly; none where nothing is named.
    pub strength: Option<Strength>,
    /// The families that all rivals are of; empty where they differ, or none is left.
    pub families: Vec<Family>,
    /// Where a family is named for its variable alone: over that a table follows the
    /// missing force and no formula does.
    pub shape: Option<Variable>,
    /// The model that predicts best where it was not fitted, named or not; the refit
    /// where none is better.
    pub repaired: Candidate,
    /// Probability of each named effect.
    pub probability: Vec<f64>,
    /// Rivals, best first.
    pub alternatives: Vec<Alternative>,
    /// Every structure that was fitted to the end.
    pub tried: Vec<Tried>,
    /// Rivals that a further run should separate, best first.
    pub rivals: Vec<Candidate>,
    /// The structure with the smallest residual, named or not.
    pub best: Option<Candidate>,
}

impl Selection {
    /// An answer that names nothing.
    pub fn nothing(answer: Answer, refit: &Candidate) -> Self {
        Self {
            answer,
            named: Vec::new(),
            strength: None,
            families: Vec::new(),
            shape: None,
            repaired: refit.clone(),
            probability: Vec::new(),
            alternatives: Vec::new(),
            tried: Vec::new(),
            rivals: Vec::new(),
            best: None,
        }
    }
}

/// The names of effects, as in files.
pub fn names(kinds: &[Kind]) -> Vec<String> {
    kinds.iter().map(|kind| kind.name().to_owned()).collect()
}

/// What a judgement rests on.
pub struct Selector<'a> {
    /// What candidates were fitted to.
    pub context: FitContext<'a>,
    /// The held-out runs.
    pub validator: &'a CrossValidator<'a>,
    /// The noise floor.
    pub floor: &'a NoiseFloor,
    /// The effects that were tried.
    pub kinds: &'a [Kind],
    /// Seed of the noise that is drawn.
    pub seed: u64,
}

impl Selector<'_> {
    /// Judges a pool of structures, of which the first is the refit.
    pub fn selection(&self, refit: &Candidate, pool: &[Candidate]) -> Selection {
        let scoring = Scoring::of(pool, self.context.scales, self.floor);
        let ranked: Vec<Vec<Ranked>> = (0..=MAX_EFFECTS)
            .map(|size| scoring.rank(pool, size))
            .collect();
        // The errors that are shown, found side by side and kept.
        ranked
            .iter()
            .flat_map(|ranked| ranked.iter().take(RIVALS_SHOWN))
            .collect::<Vec<_>>()
            .par_iter()
            .for_each(|entry| {
                self.validator.error_of(&pool[entry.index]);
            });
        let best = pool
            .iter()
            .min_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()))
            .cloned();
        let tried = ranked
            .iter()
            .flat_map(|ranked| ranked.iter().enumerate())
            .map(|(place, entry)| self.tried(refit, &pool[entry.index], entry, place))
            .collect();
        Selection {
            tried,
            best,
            ..self.decide(refit, pool, &scoring, &ranked)
        }
    }

    fn tried(
        &self,
        refit: &Candidate,
        candidate: &Candidate,
        entry: &Ranked,
        place: usize,
    ) -> Tried {
        let fit = &candidate.fit;
        Tried {
            kinds: candidate.added.clone(),
            rmse: fit.rmse(),
            held_out: (place < RIVALS_SHOWN).then(|| {
                (
                    self.validator.error_of(candidate),
                    self.validator.gap_closed(refit, candidate),
                )
            }),
            delta_bic: entry.delta,
            separation: entry.separation,
            probability: entry.probability,
            rejected: entry.rejected,
            at_bound: candidate.at_bound(),
        }
    }

    /// Whether a structure explains enough of the gap to be given as a cause.
    fn explains(&self, refit: &Candidate, candidate: &Candidate) -> bool {
        let left = self.validator.error_of(candidate) / self.validator.floor();
        let needed = share_needed(
            candidate.added.len(),
            left,
            self.validator.has_only_repeats(),
        );
        self.validator.gap_closed(refit, candidate) >= needed
    }

    /// Decides from the standing of the structures of each size in `ranked`.
    fn decide(
        &self,
        refit: &Candidate,
        pool: &[Candidate],
        scoring: &Scoring<'_>,
        ranked: &[Vec<Ranked>],
    ) -> Selection {
        let chosen = self.choose(refit, pool, scoring, ranked);
        let size = pool[chosen].added.len();
        let ranked = &ranked[size.max(1)];
        let alternative = |entry: &Ranked| Alternative {
            kinds: names(&pool[entry.index].added),
            probability: entry.probability,
            delta_bic: entry.delta,
        };
        if size == 0
            && refit.fit.rmse()
                <= Exact::STANDARD.rms_factor * self.floor.white.hypot(self.floor.input)
        {
            // A trace of correlation that no effect accounts for, within the
            // noise of the sensors.
            return Selection::nothing(Answer::ParametersOnly, refit);
        }
        if size == 0 || !self.explains(refit, &pool[chosen]) {
            return Selection {
                alternatives: ranked.iter().take(RIVALS_SHOWN).map(alternative).collect(),
                ..Selection::nothing(Answer::Unexplained, refit)
            };
        }
        let closed = self.validator.gap_closed(refit, &pool[chosen]);
        let surviving: Vec<&Ranked> = ranked
            .iter()
            .filter(|entry| !entry.rejected)
            .filter(|entry| {
                let rival = &pool[entry.index];
                closed - self.validator.gap_closed(refit, rival) < Exact::STANDARD.falls_short
                    || self.explains(refit, rival)
            })
            .collect();
        let probability_of = |kind: Kind| {
            ranked
                .iter()
                .filter(|entry| pool[entry.index].added.contains(&kind))
                .map(|entry| entry.probability)
                .sum::<f64>()
        };
        let rivals: Vec<Candidate> = if surviving.len() > 1 {
            surviving
                .iter()
                .take(RIVALS_PLANNED)
                .map(|entry| pool[entry.index].clone())
                .collect()
        } else {
            Vec::new()
        };
        let named = if surviving.len() == 1 {
            Some(pool[chosen].clone())
        } else {
            self.common_core(pool, &surviving, scoring)
                .filter(|core| self.explains(refit, core))
        };
        let Some(named) = named else {
            let families = Family::of_all(&pool[chosen].added);
            let one = surviving
                .iter()
                .all(|entry| Family::of_all(&pool[entry.index].added) == families);
            return Selection {
                alternatives: surviving.iter().map(|entry| alternative(entry)).collect(),
                rivals,
                families: if one { families } else { Vec::new() },
                ..Selection::nothing(Answer::CannotTell, &pool[surviving[0].index])
            };
        };
        let repaired = self.with_released(named, scoring);
        Selection {
            answer: Answer::EffectFound,
            named: repaired.added.clone(),
            strength: Some(Strength::Explains),
            probability: repaired
                .added
                .iter()
                .map(|&kind| probability_of(kind))
                .collect(),
            alternatives: ranked
                .iter()
                .filter(|entry| pool[entry.index].set() != repaired.set())
                .take(RIVALS_SHOWN)
                .map(alternative)
                .collect(),
            rivals,
            ..Selection::nothing(Answer::EffectFound, &repaired)
        }
    }

    /// The structure that the evidence asks for: from none upwards, a larger
    /// one replaces a smaller one if it brings what its effects cost and is
    /// better on runs that were not fitted. Where two explain the gap, a third would
    /// only mend their formulas.
    fn choose(
        &self,
        refit: &Candidate,
        pool: &[Candidate],
        scoring: &Scoring<'_>,
        ranked: &[Vec<Ranked>],
    ) -> usize {
        let mut chosen = 0;
        for (size, ranked) in ranked.iter().enumerate().skip(1) {
            let Some(best) = ranked.first().map(|first| first.index) else {
                break;
            };
            let (smaller, larger) = (&pool[chosen], &pool[best]);
            if smaller.added.len() > 1 && self.explains(refit, smaller) {
                break;
            }
            let more = size - smaller.added.len();
            let evidence = scoring.score(smaller) - scoring.score(larger);
            if evidence >= required_evidence(more, self.kinds.len())
                && self.growth(smaller, larger).pays()
                && self.chance(pool, smaller, ranked) <= Exact::STANDARD.chance
            {
                chosen = best;
            }
        }
        chosen
    }

    /// The probability that noise alone lets the best of its size gain as much.
    fn chance(&self, pool: &[Candidate], smaller: &Candidate, ranked: &[Ranked]) -> f64 {
        let rivals: Vec<&Candidate> = ranked
            .iter()
            .take(RIVALS_DRAWN)
            .map(|entry| &pool[entry.index])
            .collect();
        chance(self.context.fitter, smaller, &rivals, self.seed)
    }

    fn growth(&self, smaller: &Candidate, larger: &Candidate) -> Growth {
        Growth {
            before: smaller.added.len(),
            smaller: self.validator.error_of(smaller),
            larger: self.validator.error_of(larger),
            floor: self.validator.floor(),
            adequate: adequate(&larger.fit, self.floor),
            only_repeats: self.validator.has_only_repeats(),
        }
    }

    /// What all surviving structures have in common, if that alone explains
    /// most of the gap.
    fn common_core(
        &self,
        pool: &[Candidate],
        surviving: &[&Ranked],
        scoring: &Scoring<'_>,
    ) -> Option<Candidate> {
        let mut core: BTreeSet<Kind> = pool[surviving.first()?.index].set().into_iter().collect();
        for entry in surviving {
            let set = pool[entry.index].set();
            core.retain(|kind| set.contains(kind));
        }
        let core: Vec<Kind> = core.into_iter().collect();
        let candidate = pool
            .iter()
            .find(|candidate| !core.is_empty() && candidate.set() == core)?;
        let evidence = scoring.score(pool.first()?) - scoring.score(candidate);
        (evidence >= required_evidence(core.len(), self.kinds.len())).then(|| candidate.clone())
    }

    /// Frees parameters that are held at first, where that pays for itself and runs
    /// that were not fitted do not speak against it. Where it does not, they stay as
    /// they are, and the intervals of all others allow for it: nobody knows that
    /// gravity pulls just so.
    fn with_released(&self, mut candidate: Candidate, scoring: &Scoring<'_>) -> Candidate {
        let Some(freed) = released(&self.context, &candidate) else {
            return candidate;
        };
        if scoring.score(&freed) <= scoring.score(&candidate)
            && self.validator.error_of(&freed) < self.validator.error_of(&candidate)
        {
            return freed;
        }
        let held = &freed.fit.free[candidate.fit.free.len()..];
        self.context.fitter.allow_for(&mut candidate.fit, held);
        candidate
    }
}
