//! Forces that these recordings make one: two formulas of other letters that push alike wherever the
//! actuator went.
//!
//! Up to 40°, θ² and 1 − cos θ are one curve. No fit tells them apart, and neither need an answer.

use model_core::catalogue::Effect;
use model_core::dynamics::Dynamics;

use crate::diagnose::fit::candidates::Candidate;
use crate::diagnose::score::force_along;
use crate::estimate::Dataset;
use crate::statistics::mean;

/// Correlation of two forces along the recorded motion from which they are one: then 2 % of one's
/// variance, a seventh of its size, is not the other's, and most of that the base takes up.
pub const ALIKE: f64 = 0.99;

/// Whether the last effects of two structures push alike along the fitted recordings.
pub fn push_alike(a: &Candidate, b: &Candidate, data: &Dataset) -> bool {
    let [a, b] = [a, b].map(|it| (it.fit.model.dynamics(), it.fit.model.effects().last()));
    match (a, b) {
        ((base, Some(a)), (of_other, Some(b))) => {
            force_correlation((base, &a), (of_other, &b), data) >= ALIKE
        }
        _ => false,
    }
}

/// Correlation, 0 to 1, of the forces of two effects, each beside its base, along the motion of the
/// fitted recordings. Of an effect that adds no force it is 0.
pub fn force_correlation(
    a: (&Dynamics<f64>, &Effect<f64>),
    b: (&Dynamics<f64>, &Effect<f64>),
    data: &Dataset,
) -> f64 {
    let along = |(base, effect): (&Dynamics<f64>, &Effect<f64>)| -> Vec<f64> {
        data.fitted()
            .flat_map(|segment| force_along(base, effect, &segment.recording))
            .collect()
    };
    correlation(&along(a), &along(b))
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let centred = |values: &[f64]| -> Vec<f64> {
        let mean = mean(values);
        values.iter().map(|value| value - mean).collect()
    };
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (a, b) = (centred(a), centred(b));
    let sizes = product(&a, &a) * product(&b, &b);
    if sizes > 0.0 {
        (product(&a, &b) / sizes.sqrt()).abs()
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_alike_with_itself_shifted_and_turned_over() {
        let line: Vec<f64> = (0..50).map(f64::from).collect();
        let other: Vec<f64> = line.iter().map(|x| 3.0 - 2.0 * x).collect();
        let square: Vec<f64> = line.iter().map(|x| (x - 24.5).powi(2)).collect();
        assert!(correlation(&line, &other) > 1.0 - 1e-12);
        assert!(correlation(&line, &square) < 1e-9);
        assert!(correlation(&line, &[]).abs() < 1e-9);
    }
}
