//! Which structure the recordings ask for.
//!
//! Three things make a plain comparison of squared errors lie, and each is
//! answered here. Residuals are correlated in time, so they are counted as the
//! smaller number of independent ones that they are worth. A bigger model fits
//! better, so each parameter costs ln(N) (the Bayesian information criterion)
//! and each choice among many candidates costs as well. And two large forces
//! that cancel can imitate anything, so an effect whose size is far beyond
//! every force in the runs pays for it.

use model_core::actuator::ParameterId;

use super::candidates::{Candidate, Scales};

/// Evidence that a larger structure has to bring for each effect, on top of
/// the cost of its parameters: 10 is "very strong" on the scale of Kass and
/// Raftery (1995).
const VERY_STRONG: f64 = 10.0;

/// The first effect also has to be better than this factor on runs that were
/// not fitted, …
const FIRST_EFFECT: f64 = 0.97;

/// … and each further structure better than this factor: no term without need.
const FURTHER_EFFECTS: f64 = 0.9;

/// Structures less probable than this, relative to all of their size, are
/// rejected.
pub const REJECTED: f64 = 0.05;

/// The count of independent samples that a pool of fits is judged with: that
/// of the residual of its best fit, in which the least is left unmodelled.
pub fn independent_samples(pool: &[Candidate]) -> f64 {
    pool.iter()
        .min_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()))
        .map_or(1.0, |best| {
            best.fit.samples() as f64 / best.fit.correlation_time()
        })
        .max(2.0)
}

/// Score of a structure; smaller is better, differences are twice the logarithm
/// of a Bayes factor.
pub fn score(candidate: &Candidate, scales: &Scales, independent: f64) -> f64 {
    let fit = &candidate.fit;
    let variance = (fit.sse() / fit.samples().max(1) as f64).max(f64::MIN_POSITIVE);
    independent * variance.ln()
        + fit.free.len() as f64 * independent.ln()
        + implausibility(candidate, scales)
}

/// The price of effects larger than anything in the recordings: −2 ln of a
/// Cauchy prior whose width is the natural size of the parameter.
fn implausibility(candidate: &Candidate, scales: &Scales) -> f64 {
    let model = &candidate.fit.model;
    let first = model.effects().count() - candidate.added.len();
    let mut price = 0.0;
    for (offset, kind) in candidate.added.iter().enumerate() {
        for (parameter, row) in kind.parameters().iter().enumerate() {
            let id = ParameterId::Effect {
                slot: first + offset,
                parameter,
            };
            if let (Some(value), Some(size)) = (model.value(id), scales.plausible(row)) {
                price += 2.0 * (value / size).powi(2).ln_1p();
            }
        }
    }
    price
}

/// A structure with its standing in the pool.
#[derive(Clone, Debug)]
pub struct Ranked {
    /// Index into the pool.
    pub index: usize,
    /// Score, smaller is better.
    pub score: f64,
    /// Probability among the structures of the same size.
    pub probability: f64,
}

/// Ranks the structures of `size` effects, best first.
pub fn rank(pool: &[Candidate], scales: &Scales, independent: f64, size: usize) -> Vec<Ranked> {
    let mut ranked: Vec<Ranked> = pool
        .iter()
        .enumerate()
        .filter(|(_, candidate)| candidate.added.len() == size)
        .map(|(index, candidate)| Ranked {
            index,
            score: score(candidate, scales, independent),
            probability: 0.0,
        })
        .collect();
    ranked.sort_by(|a, b| a.score.total_cmp(&b.score));
    let best = ranked.first().map_or(0.0, |first| first.score);
    let total: f64 = ranked.iter().map(|r| (-(r.score - best) / 2.0).exp()).sum();
    for entry in &mut ranked {
        entry.probability = (-(entry.score - best) / 2.0).exp() / total;
    }
    ranked
}

/// The evidence that `effects` more effects have to bring when the best of
/// `choices` was taken for each.
pub fn required_evidence(effects: usize, choices: usize) -> f64 {
    effects as f64 * (VERY_STRONG + 2.0 * (choices.max(1) as f64).ln())
}

/// Whether a held-out error is enough better to pay for more effects than the
/// `before` that are there.
pub fn better_held_out(smaller: f64, larger: f64, before: usize) -> bool {
    let factor = if before == 0 {
        FIRST_EFFECT
    } else {
        FURTHER_EFFECTS
    };
    larger < factor * smaller
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

    #[test]
    fn equal_held_out_errors_do_not_pay() {
        assert!(!better_held_out(1.0, 0.99, 0));
        assert!(better_held_out(1.0, 0.95, 0));
        assert!(!better_held_out(1.0, 0.95, 1));
        assert!(better_held_out(1.0, 0.8, 2));
    }
}
