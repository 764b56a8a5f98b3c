//! Selects the answer: named, cannot tell, unexplained, or only the parameters.
//!
//! Two questions decide, in this order. Does the structure hold on held-out runs: how
//! much of the gap between refit and noise does it close? And is it better than every
//! rival by more than correlated residuals can feign? A ranking of rivals alone would name
//! something on any data.

use std::collections::BTreeSet;

use model_core::actuator::MAX_EFFECTS;
use model_core::catalogue::Kind;
use model_core::effects::table::Variable;
use rayon::prelude::*;

use super::bootstrap::chance;
use super::candidates::{Candidate, FitContext, released};
use super::decide::Strength;
use super::noise::{NoiseFloor, adequate};
use super::policy::Exact;
use super::ranking::{NestedComparison, Ranked, Scoring, required_evidence};
use super::validation::CrossValidator;
use super::verdict::{Alternative, Answer};
use crate::family::Family;

/// The multiple of the noise that a structure may leave before it has to close more of
/// the gap.
fn left_allowed(effects: usize, only_repeats: bool) -> f64 {
    if only_repeats {
        Exact::STANDARD.leaves_on_repeats
    } else if effects > 1 {
        Exact::STANDARD.leaves_several
    } else {
        Exact::STANDARD.leaves
    }
}

/// The share of the held-out gap that `effects` effects have to close to be named, if
/// they leave `left` times the noise.
fn share_needed(effects: usize, left: f64, only_repeats: bool) -> f64 {
    if left > left_allowed(effects, only_repeats) {
        Exact::STANDARD.closes_large
    } else if effects > 1 {
        Exact::STANDARD.closes_several
    } else {
        Exact::STANDARD.closes
    }
}

/// Number of rivals that are shown.
pub const RIVALS_SHOWN: usize = 3;

/// Number of rivals in the bootstrap test.
const RIVALS_DRAWN: usize = 8;

/// Number of rivals for which a run is planned.
pub const RIVALS_PLANNED: usize = 3;

/// A structure with a final fit, as shown in the report.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedStructure {
    /// The effects that were added.
    pub kinds: Vec<Kind>,
    /// RMS residual (rad).
    pub rmse: f64,
    /// RMS error on held-out runs (rad), and the share of the held-out gap that it closes;
    /// none for structures far behind.
    pub held_out: Option<(f64, f64)>,
    /// Difference of the information criterion to the best of its size.
    pub delta_bic: f64,
    /// Vuong statistic against the best of its size.
    pub vuong_statistic: f64,
    /// Probability among the structures of its size.
    pub probability: f64,
    /// Whether it is rejected against the best of its size.
    pub rejected: bool,
    /// Parameters that ended at a bound of their search range.
    pub at_bound: Vec<String>,
}

/// The selection of a search.
#[derive(Clone, Debug)]
pub struct Selection {
    /// The answer.
    pub answer: Answer,
    /// The effects that are named, in the order of the repaired model.
    pub named: Vec<Kind>,
    /// The strength of the name; none where nothing is named.
    pub strength: Option<Strength>,
    /// The families that all rivals share; empty if they differ or there are none.
    pub families: Vec<Family>,
    /// The variable, if a family is named for its variable alone: a table over it follows
    /// the missing force, and no formula does.
    pub shape: Option<Variable>,
    /// The model that predicts held-out segments best, named or not; the refit where none
    /// is better.
    pub repaired: Candidate,
    /// Probability of each named effect.
    pub probability: Vec<f64>,
    /// Rivals, best first.
    pub alternatives: Vec<Alternative>,
    /// Every structure with a final fit.
    pub tried: Vec<FittedStructure>,
    /// Rivals to separate by a further run, best first.
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

/// The context of a selection.
pub struct Selector<'a> {
    /// The context of the fits.
    pub context: FitContext<'a>,
    /// The held-out runs.
    pub validator: &'a CrossValidator<'a>,
    /// The noise floor.
    pub floor: &'a NoiseFloor,
    /// The tried effects.
    pub kinds: &'a [Kind],
    /// Random seed.
    pub seed: u64,
}

impl Selector<'_> {
    /// Selects from a pool of structures, of which the first is the refit.
    pub fn selection(&self, refit: &Candidate, pool: &[Candidate]) -> Selection {
        let scoring = Scoring::of(pool, self.context.scales, self.floor);
        let ranked: Vec<Vec<Ranked>> = (0..=MAX_EFFECTS)
            .map(|size| scoring.rank(pool, size))
            .collect();
        // The errors of the report, found in parallel and kept.
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
    ) -> FittedStructure {
        let fit = &candidate.fit;
        FittedStructure {
            kinds: candidate.added.clone(),
            rmse: fit.rmse(),
            held_out: (place < RIVALS_SHOWN).then(|| {
                (
                    self.validator.error_of(candidate),
                    self.validator.gap_closed(refit, candidate),
                )
            }),
            delta_bic: entry.delta,
            vuong_statistic: entry.vuong_statistic,
            probability: entry.probability,
            rejected: entry.rejected,
            at_bound: candidate.at_bound(),
        }
    }

    /// Whether a structure closes enough of the gap to be named.
    fn explains(&self, refit: &Candidate, candidate: &Candidate) -> bool {
        let left = self.validator.error_of(candidate) / self.validator.floor();
        let needed = share_needed(
            candidate.added.len(),
            left,
            self.validator.has_only_repeats(),
        );
        self.validator.gap_closed(refit, candidate) >= needed
    }

    /// Decides from the ranks of the structures of each size.
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
            // A trace of correlation within the sensor noise that no effect explains.
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

    /// The selected structure: starting from the refit, a larger structure replaces a
    /// smaller one if its evidence exceeds the price of its effects and it is better on
    /// held-out runs. Where two effects explain the gap, a third would only mend their
    /// formulas.
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
                && self.comparison(smaller, larger).accepts_larger()
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

    fn comparison(&self, smaller: &Candidate, larger: &Candidate) -> NestedComparison {
        NestedComparison {
            before: smaller.added.len(),
            smaller: self.validator.error_of(smaller),
            larger: self.validator.error_of(larger),
            floor: self.validator.floor(),
            adequate: adequate(&larger.fit, self.floor),
            only_repeats: self.validator.has_only_repeats(),
        }
    }

    /// The effects common to all remaining structures, if they alone explain most of the
    /// gap.
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

    /// Frees parameters that were held at first, if the evidence exceeds their price and
    /// held-out runs do not get worse. Otherwise they stay held, and the intervals of the
    /// others allow for their uncertainty: the direction of gravity is not known exactly.
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
