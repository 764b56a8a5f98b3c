//! Forces that these recordings cannot distinguish: two different formulas that push alike wherever
//! the actuator went.
//!
//! Up to 40°, θ² and 1 − cos θ are one curve. No fit can tell them apart, and no answer needs to.
//! The same holds for two forces whose difference the fitted base takes up: without its linear
//! part, a slow wave sin kθ is the cube of the angle.

use model_core::actuator::ParameterId;
use model_core::catalogue::Effect;
use model_core::dynamics::Dynamics;

use crate::diagnose::fit::candidates::Candidate;
use crate::diagnose::score::{base_along, force_along, product};
use crate::estimate::Dataset;
use crate::statistics::mean;

/// Correlation of two forces along the recorded motion from which they count as one: then 2 % of
/// one's variance, a seventh of its size, is not the other's, and the base takes up most of that.
pub const ALIKE: f64 = 0.99;

/// Whether the last effects of two structures push alike along the fitted recordings: by
/// themselves, or apart from what the free parameters of the base take up.
pub fn push_alike(a: &Candidate, b: &Candidate, data: &Dataset) -> bool {
    let bases = [a, b].map(|it| it.fit.model.dynamics());
    let effects = [a, b].map(|it| it.fit.model.effects().last());
    let [Some(first), Some(second)] = &effects else {
        return false;
    };
    let forces = forces([(bases[0], first), (bases[1], second)], data);
    let beside_base = || correlation(&forces, &movable(bases[0], &a.fit.free, data));
    correlation(&forces, &[]) >= ALIKE || beside_base() >= ALIKE
}

/// Correlation, 0 to 1, of the forces of two effects, each beside its base, along the motion of the
/// fitted recordings. Of an effect that adds no force it is 0.
pub fn force_correlation(
    a: (&Dynamics<f64>, &Effect<f64>),
    b: (&Dynamics<f64>, &Effect<f64>),
    data: &Dataset,
) -> f64 {
    correlation(&forces([a, b], data), &[])
}

fn forces(of: [(&Dynamics<f64>, &Effect<f64>); 2], data: &Dataset) -> [Vec<f64>; 2] {
    of.map(|(base, effect)| {
        data.fitted()
            .flat_map(|segment| force_along(base, effect, &segment.recording))
            .collect()
    })
}

/// The forces by which the free parameters of the base change it along the motion.
fn movable(base: &Dynamics<f64>, free: &[ParameterId], data: &Dataset) -> Vec<Vec<f64>> {
    let of = [
        ParameterId::Damping,
        ParameterId::Stiffness,
        ParameterId::InputGain,
    ];
    let along = data
        .fitted()
        .map(|segment| base_along(base, &segment.recording));
    let mut columns: [Vec<f64>; 3] = Default::default();
    for segment in along {
        for (column, more) in columns.iter_mut().zip(segment) {
            column.extend(more);
        }
    }
    let columns = columns.into_iter().zip(of);
    columns
        .filter(|(_, id)| free.contains(id))
        .map(|(column, _)| column)
        .collect()
}

/// Correlation of two lines beside others: of what is left of each without its mean and them.
fn correlation([a, b]: &[Vec<f64>; 2], beside: &[Vec<f64>]) -> f64 {
    let mut known: Vec<Vec<f64>> = Vec::new();
    let left_of = |values: &[f64], known: &[Vec<f64>]| {
        let mean = mean(values);
        let mut left: Vec<f64> = values.iter().map(|value| value - mean).collect();
        // Twice is enough (Gram and Schmidt, after Kahan).
        for column in known.iter().chain(known) {
            let share = product(&left, column);
            for (left, column) in left.iter_mut().zip(column) {
                *left -= share * column;
            }
        }
        left
    };
    for column in beside {
        let mut left = left_of(column, &known);
        let size = product(&left, &left).sqrt();
        if size > 0.0 {
            for value in &mut left {
                *value /= size;
            }
            known.push(left);
        }
    }
    let (a, b) = (left_of(a, &known), left_of(b, &known));
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

    fn line() -> Vec<f64> {
        (0..50).map(|k| 0.02 * f64::from(k)).collect()
    }

    fn of(line: &[f64], f: impl Fn(f64) -> f64) -> Vec<f64> {
        line.iter().map(|&x| f(x)).collect()
    }

    #[test]
    fn a_line_is_alike_with_itself_shifted_and_turned_over() {
        let line = line();
        let other = of(&line, |x| 3.0 - 2.0 * x);
        let square = of(&line, |x| (x - 0.49).powi(2));
        assert!(correlation(&[line.clone(), other], &[]) > 1.0 - 1e-12);
        assert!(correlation(&[line, square], &[]) < 1e-9);
        assert!(correlation(&[vec![], vec![]], &[]).abs() < 1e-9);
    }

    /// sin kθ = kθ − (kθ)³/6 + …
    #[test]
    fn a_slow_wave_beside_a_line_is_a_cube() {
        let line = line();
        let cube = of(&line, |x| x.powi(3));
        let wave = of(&line, |x| (1.2 * x).sin());
        let fast = of(&line, |x| (9.0 * x).sin());
        let beside = [line];
        assert!(correlation(&[cube.clone(), wave.clone()], &[]) < ALIKE);
        assert!(correlation(&[cube.clone(), wave], &beside) > ALIKE);
        assert!(correlation(&[cube, fast], &beside) < ALIKE);
    }
}
