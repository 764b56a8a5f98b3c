//! The judgement: named, cannot tell, unexplained, or only the parameters.
//!
//! Two questions decide, in this order. Does the structure hold on runs that
//! were not fitted (how much of the gap between refit and noise does it
//! close)? And is it better than every rival beyond what correlated residuals
//! can pretend? The ranking of rivals alone names something on any data.

use std::collections::BTreeSet;

use model_core::actuator::MAX_EFFECTS;
use model_core::catalogue::Kind;
use rayon::prelude::*;

use super::RMS_FACTOR;
use super::candidates::{Candidate, Ground, released};
use super::holdout::Judge;
use super::noise::NoiseFloor;
use super::select::{
    REJECTED, Ranked, better_held_out, independent_samples, rank, required_evidence, score,
};
use super::verdict::{Alternative, Answer};
use crate::model_file::parameter_name;

/// A repair that removes less than this share of the held-out gap explains
/// nothing. In the trials that the design rests on, known effects removed 78 %
/// and more, unknown ones 26 % at most.
const GAP_CUT: f64 = 0.75;

/// As many rivals are shown.
const RIVALS_SHOWN: usize = 3;

/// As many rivals are held against each other when a run is planned.
const RIVALS_PLANNED: usize = 3;

/// A structure that was fitted to the end.
#[derive(Clone, Debug, PartialEq)]
pub struct Tried {
    /// The effects that were added.
    pub kinds: Vec<Kind>,
    /// RMS residual (rad).
    pub rmse: f64,
    /// RMS error on runs that were not fitted (rad).
    pub held_out: f64,
    /// Share of the held-out gap that it closes.
    pub gap_closed: f64,
    /// Difference of the information criterion to the best of its size.
    pub delta_bic: f64,
    /// How far its squared residuals are from those of the best of its size, in
    /// standard errors.
    pub separation: f64,
    /// Probability among the structures of its size.
    pub probability: f64,
    /// Parameters that ended at the edge of the range that was searched.
    pub at_bound: Vec<String>,
}

/// What a search came to.
#[derive(Clone, Debug)]
pub struct Findings {
    /// The answer.
    pub answer: Answer,
    /// The named structure; the refit where nothing is named.
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

impl Findings {
    /// An answer that names nothing.
    pub fn nothing(answer: Answer, refit: &Candidate) -> Self {
        Self {
            answer,
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

/// Whether the catalogue lists two effects as look-alikes, either way.
pub fn look_alike(a: Kind, b: Kind) -> bool {
    a.info().look_alikes.contains(&b.name()) || b.info().look_alikes.contains(&a.name())
}

/// What a judgement rests on.
pub struct Court<'a, 'r> {
    /// What candidates were fitted to.
    pub ground: Ground<'a, 'r>,
    /// The held-out runs.
    pub judge: &'a Judge<'a, 'r>,
    /// The noise floor.
    pub floor: &'a NoiseFloor,
    /// The effects that were tried.
    pub kinds: &'a [Kind],
}

impl Court<'_, '_> {
    /// Judges a pool of structures, of which the first is the refit.
    pub fn findings(&self, refit: &Candidate, pool: &[Candidate]) -> Findings {
        let independent = independent_samples(pool);
        // The errors are found side by side and kept.
        pool.par_iter().for_each(|candidate| {
            self.judge.error_of(candidate);
        });
        let best = pool
            .iter()
            .min_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()))
            .cloned();
        Findings {
            tried: self.tried(refit, pool, independent),
            best,
            ..self.decide(refit, pool, independent)
        }
    }

    fn tried(&self, refit: &Candidate, pool: &[Candidate], independent: f64) -> Vec<Tried> {
        (0..=MAX_EFFECTS)
            .flat_map(|size| rank(pool, self.ground.scales, independent, size))
            .map(|entry| {
                let candidate = &pool[entry.index];
                let fit = &candidate.fit;
                Tried {
                    kinds: candidate.added.clone(),
                    rmse: fit.rmse(),
                    held_out: self.judge.error_of(candidate),
                    gap_closed: self.judge.gap_closed(refit, candidate),
                    delta_bic: entry.delta,
                    separation: entry.separation,
                    probability: entry.probability,
                    at_bound: fit
                        .free
                        .iter()
                        .enumerate()
                        .filter(|(index, _)| fit.at_bound(*index))
                        .map(|(_, &id)| parameter_name(&fit.model, id))
                        .collect(),
                }
            })
            .collect()
    }

    fn decide(&self, refit: &Candidate, pool: &[Candidate], independent: f64) -> Findings {
        let chosen = self.choose(pool, independent);
        let size = pool[chosen].added.len();
        let ranked = rank(pool, self.ground.scales, independent, size.max(1));
        let alternative = |entry: &Ranked| Alternative {
            kinds: names(&pool[entry.index].added),
            probability: entry.probability,
            delta_bic: entry.delta,
        };
        if size == 0 && refit.fit.rmse() <= RMS_FACTOR * self.floor.white.hypot(self.floor.input) {
            // A trace of correlation that no effect accounts for, within the
            // noise of the sensors.
            return Findings::nothing(Answer::ParametersOnly, refit);
        }
        if size == 0 || self.judge.gap_closed(refit, &pool[chosen]) < GAP_CUT {
            return Findings {
                alternatives: ranked.iter().take(RIVALS_SHOWN).map(alternative).collect(),
                ..Findings::nothing(Answer::Unexplained, refit)
            };
        }
        let surviving: Vec<&Ranked> = ranked
            .iter()
            .filter(|entry| entry.probability >= REJECTED)
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
            self.common_core(pool, &surviving, independent)
                .filter(|core| self.judge.gap_closed(refit, core) >= GAP_CUT)
        };
        let Some(named) = named else {
            return Findings {
                alternatives: surviving.iter().map(|entry| alternative(entry)).collect(),
                rivals,
                ..Findings::nothing(Answer::CannotTell, refit)
            };
        };
        let repaired = self.with_released(named, independent);
        Findings {
            answer: Answer::EffectFound,
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
            ..Findings::nothing(Answer::EffectFound, &repaired)
        }
    }

    /// The structure that the evidence asks for: from none upwards, a larger
    /// one replaces a smaller one if it brings what its effects cost and is
    /// better on runs that were not fitted.
    fn choose(&self, pool: &[Candidate], independent: f64) -> usize {
        let mut chosen = 0;
        let mut chosen_error = None;
        for size in 1..=MAX_EFFECTS {
            let Some(best) = rank(pool, self.ground.scales, independent, size)
                .first()
                .map(|first| first.index)
            else {
                break;
            };
            let more = size - pool[chosen].added.len();
            let evidence = score(&pool[chosen], self.ground.scales, independent)
                - score(&pool[best], self.ground.scales, independent);
            if evidence < required_evidence(more, self.kinds.len()) {
                continue;
            }
            let before = *chosen_error.get_or_insert_with(|| self.judge.error_of(&pool[chosen]));
            let after = self.judge.error_of(&pool[best]);
            if better_held_out(before, after, pool[chosen].added.len()) {
                chosen = best;
                chosen_error = Some(after);
            }
        }
        chosen
    }

    /// What all surviving structures have in common, if that alone explains
    /// most of the gap.
    fn common_core(
        &self,
        pool: &[Candidate],
        surviving: &[&Ranked],
        independent: f64,
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
        let evidence = score(pool.first()?, self.ground.scales, independent)
            - score(candidate, self.ground.scales, independent);
        (evidence >= required_evidence(core.len(), self.kinds.len())).then(|| candidate.clone())
    }

    /// Frees parameters that are held at first, where the evidence asks for it.
    fn with_released(&self, candidate: Candidate, independent: f64) -> Candidate {
        let Some(freed) = released(&self.ground, &candidate) else {
            return candidate;
        };
        let evidence = score(&candidate, self.ground.scales, independent)
            - score(&freed, self.ground.scales, independent);
        let before = self.judge.error_of(&candidate);
        if evidence >= required_evidence(1, 1)
            && better_held_out(before, self.judge.error_of(&freed), candidate.added.len())
        {
            freed
        } else {
            candidate
        }
    }
}
