//! Which structure the recordings ask for.
//!
//! Three things make a plain comparison of squared errors lie, and each is
//! answered here. Residuals are correlated in time, so they are counted as the
//! smaller number of independent ones that they are worth. A bigger model fits
//! better, so each parameter costs ln(N) (the Bayesian information criterion)
//! and each choice among many candidates costs as well. And two large forces
//! that cancel can imitate anything, so an effect whose size is far beyond
//! every force in the runs pays for it.
//!
//! A fourth is that no formula is exact. A score that believes in formulas calls
//! LuGre friction a hysteresis; see [`Scoring::rank`] for what is believed.

use model_core::actuator::ParameterId;
use model_core::catalogue::Kind;

use super::candidates::{Candidate, Scales};
use super::noise::{NoiseFloor, adequate};
use super::policy::Exact;
use crate::estimate::fit::Fit;
use crate::estimate::statistics::independent_stretch;

/// What structures are compared by.
#[derive(Clone, Copy, Debug)]
pub struct Scoring<'a> {
    /// Sizes of forces, angles and rates.
    pub scales: &'a Scales,
    /// The noise floor.
    pub floor: &'a NoiseFloor,
    /// Independent samples that the residuals are worth.
    pub independent: f64,
}

impl<'a> Scoring<'a> {
    /// Takes the count of independent samples from the residual of the best fit
    /// of a pool, in which the least is left unmodelled.
    pub fn of(pool: &[Candidate], scales: &'a Scales, floor: &'a NoiseFloor) -> Self {
        let independent = pool
            .iter()
            .min_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()))
            .map_or(1.0, |best| {
                best.fit.samples() as f64 / best.fit.correlation_time()
            })
            .max(2.0);
        Self {
            scales,
            floor,
            independent,
        }
    }

    /// Score of a structure; smaller is better, differences are twice the
    /// logarithm of a Bayes factor.
    pub fn score(&self, candidate: &Candidate) -> f64 {
        let fit = &candidate.fit;
        let variance = (fit.sse() / fit.samples().max(1) as f64).max(f64::MIN_POSITIVE);
        self.independent * variance.ln()
            + fit.free.len() as f64 * self.independent.ln()
            + fit.departure
            + implausibility(candidate, self.scales)
    }

    /// The mean square that noise leaves (rad²), that of the pressure included.
    fn noise(&self) -> f64 {
        self.floor.rms.hypot(self.floor.input).powi(2)
    }

    /// What a fit leaves beyond the noise (rad²).
    fn excess(&self, fit: &Fit) -> f64 {
        let noise = self.noise();
        (fit.rmse().powi(2) - noise).max(Exact::STANDARD.noise_share * noise)
    }

    /// The evidence against `rival`, whose score is `delta` behind that of
    /// `best`, and how many standard errors its squared residuals are behind.
    ///
    /// Where both leave only noise, formulas decide, so the difference has to be
    /// large. Where the rival leaves far more beyond the noise than the best, no
    /// other formula would save it, and the score is believed. In between the
    /// best may be right only in kind: its residual is correlated, the score
    /// over-confident, and what the residuals say is no more than the separation
    /// squared, one way or the other. What parameters cost is not in doubt, but
    /// does not put the rival before the best.
    fn against(&self, best: &Fit, rival: &Fit, delta: f64) -> (f64, f64) {
        let separation = separation(best, rival);
        let evidence = if delta < Exact::STANDARD.told_apart && adequate(rival, self.floor) {
            delta.min(Exact::STANDARD.doubt)
        } else if self.excess(rival) > Exact::STANDARD.far_worse * self.excess(best) {
            delta
        } else {
            let by_residuals = self.independent * (rival.sse() / best.sse()).ln();
            let most = separation.powi(2);
            (delta - by_residuals + by_residuals.clamp(-most, most)).max(0.0)
        };
        (evidence, separation)
    }

    /// Whether a structure lives on forces that cancel: with an effect many
    /// times larger than anything in the recordings it can follow any curve.
    fn is_strained(&self, candidate: &Candidate) -> bool {
        /// Times the natural size.
        const MANY: f64 = 10.0;
        relative_sizes(candidate, self.scales).any(|size| size > MANY)
    }

    /// Ranks the structures of `size` effects, best first. Where one leaves only
    /// noise without forces that cancel, those that need them are left out.
    pub fn rank(&self, pool: &[Candidate], size: usize) -> Vec<Ranked> {
        let of_size = || {
            pool.iter()
                .enumerate()
                .filter(|(_, candidate)| candidate.added.len() == size)
        };
        let settled = of_size().any(|(_, candidate)| {
            adequate(&candidate.fit, self.floor) && !self.is_strained(candidate)
        });
        let mut scored: Vec<(usize, f64)> = of_size()
            .filter(|(_, candidate)| !(settled && self.is_strained(candidate)))
            .map(|(index, candidate)| (index, self.score(candidate)))
            .collect();
        scored.sort_by(|a, b| a.1.total_cmp(&b.1));
        let Some(&(best, best_score)) = scored.first() else {
            return Vec::new();
        };
        let mut ranked: Vec<Ranked> = scored
            .iter()
            .map(|&(index, score)| {
                let delta = score - best_score;
                let (evidence, separation) = self.against(&pool[best].fit, &pool[index].fit, delta);
                Ranked {
                    index,
                    delta,
                    separation,
                    probability: (-evidence / 2.0).exp(),
                    rejected: false,
                }
            })
            .collect();
        self.prefer_special_cases(pool, &mut ranked);
        self.keep_imitated(pool, &mut ranked);
        let total: f64 = ranked.iter().map(|entry| entry.probability).sum();
        let most = ranked
            .iter()
            .fold(0.0, |most: f64, entry| most.max(entry.probability));
        for entry in &mut ranked {
            entry.rejected = entry.probability < Exact::STANDARD.rejected * most;
            entry.probability /= total;
        }
        ranked.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        ranked
    }

    /// The squares beyond the noise (rad²) that a structure leaves in the mean.
    fn beyond(&self, candidate: &Candidate) -> f64 {
        candidate.fit.rmse().powi(2) - self.noise()
    }

    /// As many of them as the right effect leaves by another formula, at most.
    fn by_another_formula(&self, pool: &[Candidate]) -> f64 {
        pool.first()
            .map_or(0.0, |refit| Exact::STANDARD.imitated * self.beyond(refit))
    }

    /// Keeps the nearest effect that the best one may only imitate: the difference
    /// between the two is no larger than one between formulas.
    fn keep_imitated(&self, pool: &[Candidate], ranked: &mut [Ranked]) {
        let Some(best) = ranked
            .iter()
            .max_by(|a, b| a.probability.total_cmp(&b.probability))
        else {
            return;
        };
        let (most, imitator) = (best.probability, &pool[best.index]);
        let allowed = self.by_another_formula(pool);
        let imitated = ranked
            .iter_mut()
            .filter(|entry| {
                let candidate = &pool[entry.index];
                self.beyond(candidate) <= allowed && imitates(&imitator.added, &candidate.added)
            })
            .min_by(|a, b| a.delta.total_cmp(&b.delta));
        if let Some(imitated) = imitated {
            let doubted = most * (-Exact::STANDARD.doubt / 2.0).exp();
            imitated.probability = imitated.probability.max(doubted);
        }
    }

    /// Gives the probability of an effect to its special case where that leaves
    /// only noise as well, or where the effect ended as the special case and that leaves
    /// hardly more: no parameter without need.
    fn prefer_special_cases(&self, pool: &[Candidate], ranked: &mut [Ranked]) {
        for general in 0..ranked.len() {
            let special = ranked.iter().position(|entry| {
                let (wide, narrow) = (&pool[ranked[general].index], &pool[entry.index]);
                let as_good = || {
                    entry.delta - ranked[general].delta < Exact::STANDARD.effect_evidence
                        && adequate(&narrow.fit, self.floor)
                };
                let the_same =
                    || wide.is_degenerate() && self.beyond(narrow) <= self.by_another_formula(pool);
                is_special_case(&narrow.added, &wide.added)
                    && narrow.fit.free.len() < wide.fit.free.len()
                    && (as_good() || the_same())
            });
            if let Some(special) = special {
                let moved = std::mem::take(&mut ranked[general].probability);
                ranked[special].probability = ranked[special].probability.max(moved);
            }
        }
    }
}

/// Whether `narrow` is `wide` with one effect replaced by its special case.
pub fn is_special_case(narrow: &[Kind], wide: &[Kind]) -> bool {
    exchanged(wide, narrow)
        .is_some_and(|(general, special)| general.special_case() == Some(special))
}

/// Whether `true_set` is `set` with one effect replaced by one that it imitates.
fn imitates(set: &[Kind], true_set: &[Kind]) -> bool {
    exchanged(set, true_set).is_some_and(|(imitator, other)| imitator.imitates().contains(&other))
}

/// The effect of one structure that another has not, and the one in its place;
/// none where they differ by more or by less.
fn exchanged(from: &[Kind], to: &[Kind]) -> Option<(Kind, Kind)> {
    let only = |these: &[Kind], those: &[Kind]| -> Vec<Kind> {
        these
            .iter()
            .copied()
            .filter(|kind| !those.contains(kind))
            .collect()
    };
    match (only(from, to).as_slice(), only(to, from).as_slice()) {
        (&[out], &[into]) => Some((out, into)),
        _ => None,
    }
}

/// The sizes of the added effects' parameters, relative to what is natural.
fn relative_sizes<'a>(
    candidate: &'a Candidate,
    scales: &'a Scales,
) -> impl Iterator<Item = f64> + 'a {
    let model = &candidate.fit.model;
    let first = model.effects().count() - candidate.added.len();
    candidate
        .added
        .iter()
        .enumerate()
        .flat_map(move |(offset, kind)| {
            let slot = first + offset;
            let rows = kind.parameters().iter().enumerate();
            rows.filter_map(move |(parameter, row)| {
                let value = model.value(ParameterId::Effect { slot, parameter })?;
                Some((value / scales.plausible(row)?).abs())
            })
        })
}

/// The price of effects larger than anything in the recordings: −2 ln of a
/// Cauchy prior whose width is the natural size of the parameter.
fn implausibility(candidate: &Candidate, scales: &Scales) -> f64 {
    relative_sizes(candidate, scales)
        .map(|size| 2.0 * size.powi(2).ln_1p())
        .sum()
}

/// How far the squares of two residuals are apart, in standard errors: the test
/// of Vuong (Econometrica 57, 1989) for models of which none has to be true,
/// with the scatter of sums over blocks that are longer than the correlation.
/// Positive where `rival` is worse; zero where there are too few blocks to say.
pub fn separation(best: &Fit, rival: &Fit) -> f64 {
    let correlation = best.correlation_time().max(rival.correlation_time());
    let length = independent_stretch(correlation);
    let mut sums: Vec<f64> = Vec::new();
    for (best, rival) in best.residuals.iter().zip(&rival.residuals) {
        for (best, rival) in best.chunks(length).zip(rival.chunks(length)) {
            let sum = |block: &[f64]| block.iter().map(|r| r * r).sum::<f64>();
            sums.push(sum(rival) - sum(best));
        }
    }
    let total: f64 = sums.iter().sum();
    let average = total / sums.len().max(1) as f64;
    let scatter: f64 = sums.iter().map(|sum| (sum - average).powi(2)).sum();
    if scatter > 0.0 {
        total / scatter.sqrt()
    } else {
        0.0
    }
}

/// A structure with its standing in the pool.
#[derive(Clone, Debug)]
pub struct Ranked {
    /// Index into the pool.
    pub index: usize,
    /// Score behind the best of its size.
    pub delta: f64,
    /// Standard errors behind the best of its size, see [`separation`].
    pub separation: f64,
    /// Probability among the structures of the same size.
    pub probability: f64,
    /// Whether the recordings reject it against the best of its size.
    pub rejected: bool,
}

/// The evidence that `effects` more effects have to bring when the best of
/// `choices` was taken for each.
pub fn required_evidence(effects: usize, choices: usize) -> f64 {
    effects as f64 * (Exact::STANDARD.effect_evidence + 2.0 * (choices.max(1) as f64).ln())
}

/// Held-out errors (rad) of a structure and of a larger one.
#[derive(Clone, Copy, Debug)]
pub struct Growth {
    /// Effects of the smaller one.
    pub before: usize,
    /// Error of the smaller one.
    pub smaller: f64,
    /// Error of the larger one.
    pub larger: f64,
    /// What nothing can remove.
    pub floor: f64,
    /// Whether the larger one leaves nothing but noise.
    pub adequate: bool,
    /// Whether all these runs are repeats of runs that were fitted.
    pub only_repeats: bool,
}

impl Growth {
    /// Whether the errors pay for more effects.
    ///
    /// A further effect that removes neither most of what is left beyond the noise
    /// nor all of it only mends the formula of the first. Repeats of what was
    /// fitted cannot tell the two apart, so there it has to be all.
    pub fn pays(&self) -> bool {
        if self.before == 0 {
            return self.larger < Exact::STANDARD.first_leaves * self.smaller;
        }
        let beyond = |error: f64| (error.powi(2) - self.floor.powi(2)).max(0.0);
        let most = beyond(self.larger) <= Exact::STANDARD.further_excess * beyond(self.smaller);
        self.larger < Exact::STANDARD.further_leaves * self.smaller
            && (self.adequate || (most && !self.only_repeats))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evidence_grows_with_effects_and_choices() {
        assert!(required_evidence(2, 9) > 2.0 * required_evidence(1, 1));
        assert!(required_evidence(1, 27) > required_evidence(1, 9));
        assert!(required_evidence(0, 9).abs() < 1e-12);
    }

    fn growth(before: usize, larger: f64) -> Growth {
        Growth {
            before,
            smaller: 1.0,
            larger,
            floor: 0.6,
            adequate: false,
            only_repeats: false,
        }
    }

    #[test]
    fn equal_held_out_errors_do_not_pay() {
        assert!(!growth(0, 0.99).pays());
        assert!(growth(0, 0.95).pays());
        assert!(!growth(1, 0.95).pays());
    }

    #[test]
    fn a_further_effect_has_to_do_more_than_mend_a_formula() {
        let mends = growth(1, 0.85);
        assert!(!mends.pays());
        let adequate = true;
        assert!(Growth { adequate, ..mends }.pays());
        assert!(growth(1, 0.65).pays());
    }

    #[test]
    fn repeats_alone_ask_for_all_that_is_left() {
        let only_repeats = true;
        let most = Growth {
            only_repeats,
            ..growth(1, 0.65)
        };
        assert!(!most.pays());
        let adequate = true;
        assert!(Growth { adequate, ..most }.pays());
        assert!(
            Growth {
                only_repeats,
                ..growth(0, 0.65)
            }
            .pays()
        );
    }

    #[test]
    fn an_imitator_stands_for_one_effect() {
        use Kind::{BoucWenHysteresis, CoulombFriction, DeadTime, Leak, PneumaticLag};
        assert!(imitates(&[DeadTime], &[PneumaticLag]));
        assert!(!imitates(&[PneumaticLag], &[DeadTime]));
        assert!(imitates(
            &[Leak, BoucWenHysteresis],
            &[CoulombFriction, Leak]
        ));
        assert!(!imitates(
            &[Leak, BoucWenHysteresis],
            &[CoulombFriction, PneumaticLag]
        ));
    }

    #[test]
    fn special_cases_replace_one_effect_and_keep_the_others() {
        use Kind::{CoulombFriction, Gravity, Leak, StribeckFriction};
        assert!(is_special_case(&[CoulombFriction], &[StribeckFriction]));
        assert!(!is_special_case(&[StribeckFriction], &[CoulombFriction]));
        assert!(is_special_case(
            &[Gravity, CoulombFriction],
            &[StribeckFriction, Gravity]
        ));
        assert!(!is_special_case(
            &[Leak, CoulombFriction],
            &[StribeckFriction, Gravity]
        ));
        assert!(!is_special_case(&[Gravity], &[StribeckFriction, Gravity]));
    }
}
