//! Nonlinear least squares within bounds (Levenberg, 1944; Marquardt, 1963).
//!
//! A bound is a wall, not a fold of the coordinates: what would leave goes to its wall, and
//! the other unknowns make up for it in the same step. A parameter whose best value is none
//! (a stiffness beside the gravity that does its work) would otherwise slow down all others.
//! The damping follows the ratio of the gain to the predicted one (Nielsen, 1999), so that
//! hardly a step in a curved valley is in vain.
//!
//! No library's solver knows both bounds and the arrow shape of the normal equations
//! ([`Normal`]), without which a step is cubic in the number of recordings.

use nalgebra::DVector;

use super::normal::Normal;

/// Damping of the first step, relative to the curvature.
const FIRST: f64 = 1e-3;

/// The damping falls to a third at most after a step, and grows faster and faster after
/// steps that did not help.
const CALMER: f64 = 1.0 / 3.0;
const STRONGER: f64 = 2.0;

/// Above this damping a small gain says nothing of how near the minimum is.
const SHORT: f64 = 1.0;

/// Moves that together gain less than the tolerance after which none is hoped to.
const PATIENCE: usize = 15;

/// A sum of squares to minimise.
pub trait Bounded {
    /// Where it is.
    fn position(&self) -> DVector<f64>;

    /// Least and largest position of the first unknowns; the others have no bounds.
    fn bounds(&self) -> Vec<[f64; 2]>;

    /// Moves, and linearises there; none where that cannot be evaluated.
    fn move_to(&mut self, position: &DVector<f64>) -> Option<Normal>;
}

/// How a descent ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Descent {
    /// Another step would gain less than the tolerance.
    Converged,
    /// The moves were used up, or no step led down.
    Unconverged,
    /// It was interrupted; where the problem is then means nothing.
    Interrupted,
}

/// Moves to a minimum in at most `evaluations` moves after the first, until another step would
/// gain less than the share `tolerance` of the cost, or until it is interrupted, which is asked
/// before every move.
pub fn descend(
    problem: &mut impl Bounded,
    evaluations: usize,
    tolerance: f64,
    is_interrupted: &dyn Fn() -> bool,
) -> Descent {
    if is_interrupted() {
        return Descent::Interrupted;
    }
    let bounds = problem.bounds();
    let mut position = problem.position();
    let Some(mut normal) = problem.move_to(&position) else {
        return Descent::Unconverged;
    };
    let (mut damping, mut stronger) = (FIRST, STRONGER);
    let (mut is_done, mut is_there) = (false, true);
    let (mut reference, mut in_vain) = (normal.cost(), 0);
    for _ in 0..evaluations {
        if is_interrupted() {
            return Descent::Interrupted;
        }
        let Some(step) = bounded_step(&normal, &position, &bounds, damping) else {
            break;
        };
        let cost = normal.cost();
        let predicted = normal.predicted_gain(&step);
        let trial = &position - step;
        let moved = problem.move_to(&trial);
        let gain = moved.as_ref().map_or(f64::NAN, |it| cost - it.cost());
        is_done = gain.abs().max(predicted) < tolerance * cost && damping < SHORT;
        if let Some(better) = moved.filter(|_| gain > 0.0) {
            let ratio = gain / predicted;
            damping *= (1.0 - (2.0 * ratio - 1.0).powi(3)).max(CALMER);
            stronger = STRONGER;
            (position, normal, is_there) = (trial, better, true);
        } else {
            damping *= stronger;
            stronger *= STRONGER;
            is_there = false;
        }
        if normal.cost() < (1.0 - tolerance) * reference {
            (reference, in_vain) = (normal.cost(), 0);
        } else {
            in_vain += 1;
        }
        if is_done || in_vain >= PATIENCE {
            break;
        }
    }
    if !is_there {
        problem.move_to(&position);
    }
    if is_done {
        Descent::Converged
    } else {
        Descent::Unconverged
    }
}

/// The damped step from `position` that stays within `bounds`; none where the equations are
/// singular.
fn bounded_step(
    normal: &Normal,
    position: &DVector<f64>,
    bounds: &[[f64; 2]],
    damping: f64,
) -> Option<DVector<f64>> {
    let slope = normal.slope();
    let at_wall = |place: usize| {
        let [lower, upper] = bounds[place];
        (position[place] <= lower && slope[place] >= 0.0)
            || (position[place] >= upper && slope[place] <= 0.0)
    };
    let mut fixed: Vec<(usize, f64)> = (0..bounds.len())
        .filter(|&place| at_wall(place))
        .map(|place| (place, 0.0))
        .collect();
    loop {
        let mut rest = normal.clone();
        for &(place, by) in &fixed {
            rest.fix(place, by);
        }
        let mut step = rest.step(damping)?;
        for &(place, by) in &fixed {
            step[place] = by;
        }
        let leaving: Vec<(usize, f64)> = (0..bounds.len())
            .filter(|place| fixed.iter().all(|(other, _)| other != place))
            .filter_map(|place| {
                let [lower, upper] = bounds[place];
                let to = position[place] - step[place];
                (to < lower || to > upper)
                    .then(|| (place, position[place] - to.clamp(lower, upper)))
            })
            .collect();
        if leaving.is_empty() {
            return Some(step);
        }
        fixed.extend(leaving);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;
    use proptest::prelude::*;

    use super::*;
    use crate::estimate::nuisance::UNKNOWNS;

    /// Residuals as a function of the position, with derivatives by differences.
    struct Plain<F> {
        residuals: F,
        position: DVector<f64>,
        bounds: Vec<[f64; 2]>,
        moves: usize,
    }

    impl<F: Fn(&DVector<f64>) -> Vec<f64>> Bounded for Plain<F> {
        fn position(&self) -> DVector<f64> {
            self.position.clone()
        }

        fn bounds(&self) -> Vec<[f64; 2]> {
            self.bounds.clone()
        }

        fn move_to(&mut self, position: &DVector<f64>) -> Option<Normal> {
            const BY: f64 = 1e-6;
            self.moves += 1;
            self.position = position.clone();
            let here = (self.residuals)(position);
            let mut rows = DMatrix::zeros(here.len(), position.len() + 1);
            for place in 0..position.len() {
                let mut moved = [position.clone(), position.clone()];
                moved[0][place] += BY;
                moved[1][place] -= BY;
                let [above, below] = moved.map(|it| (self.residuals)(&it));
                for (row, (above, below)) in above.into_iter().zip(below).enumerate() {
                    rows[(row, place)] = (above - below) / (2.0 * BY);
                }
            }
            rows.set_column(position.len(), &DVector::from_vec(here));
            let mut normal = Normal::new(position.len(), position.len());
            normal.session(&rows, None, [None; UNKNOWNS]);
            Some(normal)
        }
    }

    /// A curved valley (Rosenbrock, 1960) whose floor leads along a parabola.
    fn valley() -> Plain<impl Fn(&DVector<f64>) -> Vec<f64>> {
        Plain {
            residuals: |at: &DVector<f64>| vec![10.0 * (at[1] - at[0] * at[0]), 1.0 - at[0], 1.0],
            position: DVector::from_vec(vec![-1.2, 1.0]),
            bounds: Vec::new(),
            moves: 0,
        }
    }

    #[test]
    fn a_curved_valley_is_followed_to_its_end() {
        let mut valley = valley();
        assert_eq!(
            descend(&mut valley, 60, 1e-12, &|| false),
            Descent::Converged
        );
        assert!(
            (valley.position[0] - 1.0).abs() < 1e-4,
            "{}",
            valley.position
        );
        assert!(valley.moves < 40, "{} moves", valley.moves);
    }

    #[test]
    fn an_interrupted_descent_ends_before_its_next_move() {
        let mut valley = valley();
        let asked = std::cell::Cell::new(0);
        let is_interrupted = || {
            asked.set(asked.get() + 1);
            asked.get() > 3
        };
        assert_eq!(
            descend(&mut valley, 60, 1e-12, &is_interrupted),
            Descent::Interrupted
        );
        assert_eq!(valley.moves, 3);
    }

    /// Minima at a wall: every set of walls is tried, and the best of the minima inside is
    /// the reference.
    fn by_enumeration(jacobian: &DMatrix<f64>, right: &DVector<f64>, bounds: &[[f64; 2]]) -> f64 {
        let count = bounds.len();
        let mut least = f64::INFINITY;
        for choice in 0..3usize.pow(u32::try_from(count).unwrap()) {
            let walls: Vec<Option<f64>> = (0..count)
                .scan(choice, |left, place| {
                    let which = *left % 3;
                    *left /= 3;
                    Some((which < 2).then(|| bounds[place][which]))
                })
                .collect();
            let inside: Vec<usize> = (0..count).filter(|k| walls[*k].is_none()).collect();
            let mut at = DVector::from_fn(count, |k, _| walls[k].unwrap_or(0.0));
            let left = right - jacobian * &at;
            if !inside.is_empty() {
                let some = jacobian.select_columns(&inside);
                let Some(found) = (some.tr_mul(&some)).cholesky() else {
                    continue;
                };
                let found = found.solve(&some.tr_mul(&left));
                for (value, &place) in found.iter().zip(&inside) {
                    at[place] = *value;
                }
            }
            let is_inside =
                (0..count).all(|k| at[k] >= bounds[k][0] - 1e-9 && at[k] <= bounds[k][1] + 1e-9);
            if is_inside {
                least = least.min((right - jacobian * at).norm_squared());
            }
        }
        least
    }

    proptest! {
        #[test]
        fn walls_are_kept_and_the_best_point_within_is_found(
            entries in proptest::collection::vec(-1.0..1.0, 21),
            right in proptest::collection::vec(-3.0..3.0, 7),
            start in proptest::collection::vec(0.0..1.0, 3),
        ) {
            let jacobian = DMatrix::from_vec(7, 3, entries);
            let right = DVector::from_vec(right);
            let bounds = [[0.0, 1.0]; 3];
            let mut problem = Plain {
                residuals: |at: &DVector<f64>| (&jacobian * at - &right).iter().copied().collect(),
                position: DVector::from_vec(start),
                bounds: bounds.to_vec(),
                moves: 0,
            };
            descend(&mut problem, 100, 1e-12, &|| false);
            let at = &problem.position;
            prop_assert!(at.iter().all(|it| (0.0..=1.0).contains(it)), "{at}");
            let found = (&right - &jacobian * at).norm_squared();
            let least = by_enumeration(&jacobian, &right, &bounds);
            prop_assert!(found <= least * (1.0 + 1e-6) + 1e-12, "{found} {least}");
        }
    }
}
