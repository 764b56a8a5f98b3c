//! Ranks structures by a score.
//!
//! A plain comparison of squared errors misleads in four ways, and each has a remedy here.
//! Residuals are correlated in time, so the effective number of independent samples
//! counts. A larger model fits better, so each parameter costs ln(N) (Bayesian information
//! criterion), and each choice among many candidates costs as well. Two large forces that
//! cancel can imitate anything, so an effect far larger than every force in the runs pays
//! a penalty. And no formula is exact: a score that takes formulas as exact calls LuGre
//! friction a hysteresis; see [`Scoring::rank`].

use model_core::actuator::ParameterId;
use model_core::catalogue::Kind;

use super::candidates::{Candidate, Scales};
use super::noise::{NoiseFloor, adequate};
use super::policy::Exact;
use crate::estimate::fit::Fit;
use crate::statistics::independent_block;

/// The context of scores.
#[derive(Clone, Copy, Debug)]
pub struct Scoring<'a> {
    /// Scales of forces, angles and rates.
    pub scales: &'a Scales,
    /// The noise floor.
    pub floor: &'a NoiseFloor,
    /// Effective number of independent samples.
    pub independent: f64,
}

impl<'a> Scoring<'a> {
    /// Takes the effective number of samples from the residual of the best fit of a pool,
    /// which has the least model error.
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

    /// Score of a structure. Smaller is better; differences are 2 ln of a Bayes factor.
    pub fn score(&self, candidate: &Candidate) -> f64 {
        let fit = &candidate.fit;
        let variance = (fit.sse() / fit.samples().max(1) as f64).max(f64::MIN_POSITIVE);
        self.independent * variance.ln()
            + fit.free.len() as f64 * self.independent.ln()
            + fit.departure
            + log_prior_penalty(candidate, self.scales)
    }

    /// The mean square of the noise (rad²), including that from the pressure.
    fn noise(&self) -> f64 {
        self.floor.rms.hypot(self.floor.input).powi(2)
    }

    /// The mean square of a fit beyond the noise (rad²).
    fn excess(&self, fit: &Fit) -> f64 {
        let noise = self.noise();
        (fit.rmse().powi(2) - noise).max(Exact::STANDARD.noise_share * noise)
    }

    /// The evidence against `rival`, whose score is `delta` behind that of `best`, and the
    /// Vuong statistic of the two.
    ///
    /// Where both leave only noise, formulas decide, so the difference has to be large.
    /// Where the rival leaves far more beyond the noise than the best, no other formula
    /// would save it, and the score holds. In between, the best may be right only in
    /// kind: its residual is correlated and the score is over-confident, so the evidence
    /// of the residuals is at most the square of the Vuong statistic. The price of
    /// parameters is not in doubt, but does not put the rival before the best.
    fn against(&self, best: &Fit, rival: &Fit, delta: f64) -> (f64, f64) {
        let vuong_statistic = vuong_statistic(best, rival);
        let evidence = if delta < Exact::STANDARD.told_apart && adequate(rival, self.floor) {
            delta.min(Exact::STANDARD.doubt)
        } else if self.excess(rival) > Exact::STANDARD.far_worse * self.excess(best) {
            delta
        } else {
            let by_residuals = self.independent * (rival.sse() / best.sse()).ln();
            let most = vuong_statistic.powi(2);
            (delta - by_residuals + by_residuals.clamp(-most, most)).max(0.0)
        };
        (evidence, vuong_statistic)
    }

    /// Whether a structure relies on forces that cancel: with an effect many times larger
    /// than any force in the recordings it can follow any curve.
    fn is_strained(&self, candidate: &Candidate) -> bool {
        /// Multiple of the natural scale.
        const MANY: f64 = 10.0;
        relative_sizes(candidate, self.scales).any(|size| size > MANY)
    }

    /// Ranks the structures of `size` effects, best first. If one leaves only noise
    /// without forces that cancel, structures that rely on them are left out.
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
                let (evidence, vuong_statistic) =
                    self.against(&pool[best].fit, &pool[index].fit, delta);
                Ranked {
                    index,
                    delta,
                    vuong_statistic,
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

    /// The mean square of a structure beyond the noise (rad²).
    fn beyond(&self, candidate: &Candidate) -> f64 {
        candidate.fit.rmse().powi(2) - self.noise()
    }

    /// The largest such excess of the right effect with another formula.
    fn by_another_formula(&self, pool: &[Candidate]) -> f64 {
        pool.first()
            .map_or(0.0, |refit| Exact::STANDARD.imitated * self.beyond(refit))
    }

    /// Keeps the nearest effect that the best one may only imitate, if they differ by no
    /// more than two formulas of one effect do.
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

    /// Gives the probability of an effect to its special case if that leaves only noise as
    /// well, or if the effect ended as the special case and that leaves hardly more: no
    /// parameter without need.
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

/// The one effect in which two structures differ, and the one in its place; none if they
/// do not differ in exactly one.
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

/// The sizes of the added effects' parameters, relative to their natural scales.
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

/// The log-prior penalty of effects larger than any force in the recordings: −2 ln of a
/// Cauchy prior whose width is the natural scale of the parameter.
fn log_prior_penalty(candidate: &Candidate, scales: &Scales) -> f64 {
    relative_sizes(candidate, scales)
        .map(|size| 2.0 * size.powi(2).ln_1p())
        .sum()
}

/// The statistic of Vuong's test (Econometrica 57, 1989), for models none of which has to
/// be true: the difference of the squared residuals in standard errors, from sums over
/// blocks that are longer than the correlation time. Positive where `rival` is worse; zero
/// if there are too few blocks.
pub fn vuong_statistic(best: &Fit, rival: &Fit) -> f64 {
    let correlation = best.correlation_time().max(rival.correlation_time());
    let length = independent_block(correlation);
    let mut sums: Vec<f64> = Vec::new();
    for (best, rival) in best.residuals.iter().zip(&rival.residuals) {
        for (best, rival) in best.chunks(length).zip(rival.chunks(length)) {
            let sum = |block: &[f64]| block.iter().map(|r| r * r).sum::<f64>();
            sums.push(sum(rival) - sum(best));
        }
    }
    let total: f64 = sums.iter().sum();
    let average = total / sums.len().max(1) as f64;
    let squares: f64 = sums.iter().map(|sum| (sum - average).powi(2)).sum();
    if squares > 0.0 {
        total / squares.sqrt()
    } else {
        0.0
    }
}

/// A structure with its rank in the pool.
#[derive(Clone, Debug)]
pub struct Ranked {
    /// Index into the pool.
    pub index: usize,
    /// Difference of the score to the best of its size.
    pub delta: f64,
    /// Vuong statistic against the best of its size, see [`vuong_statistic`].
    pub vuong_statistic: f64,
    /// Probability among the structures of the same size.
    pub probability: f64,
    /// Whether it is rejected against the best of its size.
    pub rejected: bool,
}

/// The evidence required of `effects` further effects, if each is the best of `choices`.
pub fn required_evidence(effects: usize, choices: usize) -> f64 {
    effects as f64 * (Exact::STANDARD.effect_evidence + 2.0 * (choices.max(1) as f64).ln())
}

/// Held-out errors (rad) of a structure and of a larger one.
#[derive(Clone, Copy, Debug)]
pub struct NestedComparison {
    /// Effects of the smaller one.
    pub before: usize,
    /// Error of the smaller one.
    pub smaller: f64,
    /// Error of the larger one.
    pub larger: f64,
    /// The noise floor.
    pub floor: f64,
    /// Whether the larger one leaves only noise.
    pub adequate: bool,
    /// Whether all held-out runs repeat fitted ones.
    pub only_repeats: bool,
}

impl NestedComparison {
    /// Whether the held-out errors accept the larger structure.
    ///
    /// A further effect that does not remove most of the error beyond the noise only mends
    /// the formula of the first. Repeats of fitted runs cannot show that, so on repeats it
    /// has to remove all of it.
    pub fn accepts_larger(&self) -> bool {
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

    fn comparison(before: usize, larger: f64) -> NestedComparison {
        NestedComparison {
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
        assert!(!comparison(0, 0.99).accepts_larger());
        assert!(comparison(0, 0.95).accepts_larger());
        assert!(!comparison(1, 0.95).accepts_larger());
    }

    #[test]
    fn a_further_effect_has_to_do_more_than_mend_a_formula() {
        let mends = comparison(1, 0.85);
        assert!(!mends.accepts_larger());
        let adequate = true;
        assert!(NestedComparison { adequate, ..mends }.accepts_larger());
        assert!(comparison(1, 0.65).accepts_larger());
    }

    #[test]
    fn repeats_alone_ask_for_all_that_is_left() {
        let only_repeats = true;
        let most = NestedComparison {
            only_repeats,
            ..comparison(1, 0.65)
        };
        assert!(!most.accepts_larger());
        let adequate = true;
        assert!(NestedComparison { adequate, ..most }.accepts_larger());
        assert!(
            NestedComparison {
                only_repeats,
                ..comparison(0, 0.65)
            }
            .accepts_larger()
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
