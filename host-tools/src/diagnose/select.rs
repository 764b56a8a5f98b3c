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
use crate::fit::Fit;

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

/// How far the squares of two residuals are apart, in standard errors: the test
/// of Vuong (Econometrica 57, 1989) for models of which none has to be true,
/// with the scatter of sums over blocks that are longer than the correlation.
/// Positive where `rival` is worse.
pub fn separation(best: &Fit, rival: &Fit) -> f64 {
    /// Blocks are so many correlation times long, …
    const CORRELATION_TIMES: f64 = 4.0;
    /// … and at least so many samples.
    const SHORTEST: f64 = 50.0;
    let correlation = best.correlation_time().max(rival.correlation_time());
    // A correlation time is at most some thousand samples.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let length = (CORRELATION_TIMES * correlation).max(SHORTEST) as usize;
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
}

/// Ranks the structures of `size` effects, best first.
///
/// The evidence against a rival is what its score is behind, but no more than
/// its separation squared: where the best is right only in kind, its residual
/// is correlated, the score is over-confident, and the separation is not.
pub fn rank(pool: &[Candidate], scales: &Scales, independent: f64, size: usize) -> Vec<Ranked> {
    let mut scored: Vec<(usize, f64)> = pool
        .iter()
        .enumerate()
        .filter(|(_, candidate)| candidate.added.len() == size)
        .map(|(index, candidate)| (index, score(candidate, scales, independent)))
        .collect();
    scored.sort_by(|a, b| a.1.total_cmp(&b.1));
    let Some(&(best, best_score)) = scored.first() else {
        return Vec::new();
    };
    let mut ranked: Vec<Ranked> = scored
        .iter()
        .map(|&(index, score)| {
            let delta = score - best_score;
            let separation = separation(&pool[best].fit, &pool[index].fit);
            let evidence = if separation > 0.0 {
                delta.min(separation.powi(2))
            } else {
                delta
            };
            Ranked {
                index,
                delta,
                separation,
                probability: (-evidence / 2.0).exp(),
            }
        })
        .collect();
    let total: f64 = ranked.iter().map(|entry| entry.probability).sum();
    for entry in &mut ranked {
        entry.probability /= total;
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
