//! Could chance have asked for another effect?
//!
//! A score that counts parameters takes for granted that a parameter which is not
//! needed is as likely to come out above as below its neutral value. Friction is
//! never negative, a time constant is nothing without its stiffness, and the best
//! of 27 effects was taken: the usual distributions do not hold. So the
//! distribution is made: the noise that the larger structure leaves is dealt out
//! again, each stretch of it with a random sign, on top of the smaller structure,
//! and every rival is fitted to it, to first order. How often does the best of
//! them gain as much as was gained?
//!
//! Stretches are longer than the correlation of the residual, so what is slow in
//! the noise stays slow (the wild bootstrap by blocks; Shao, J. Am. Stat. Assoc.
//! 105, 2010). A parameter with a neutral value at the end of its range gains
//! only on the side on which it can be.

use model_core::actuator::ParameterId;
use nalgebra::{DMatrix, DVector, DVectorView};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::candidates::Candidate;
use crate::fit::{Fit, Fitter};

/// How often noise is dealt out again.
const DRAWS: usize = 499;

/// Blocks are so many correlation times long, …
const CORRELATION_TIMES: f64 = 4.0;

/// … and at least so many samples.
const SHORTEST: usize = 50;

/// A larger structure is not believed if chance does as well more often.
pub const SIGNIFICANT: f64 = 0.01;

/// The probability that noise alone lets the best of `rivals` gain on `smaller` as
/// much as the first of them does. At least 1/500.
pub fn chance(
    fitter: &Fitter<'_, '_>,
    smaller: &Candidate,
    rivals: &[&Candidate],
    seed: u64,
) -> f64 {
    let Some(best) = rivals.first() else {
        return 1.0;
    };
    let gained = smaller.fit.sse() - best.fit.sse();
    let blocks = Blocks::of(&best.fit);
    let base = Basis::of(&fitter.derivatives(&smaller.fit), &DMatrix::zeros(0, 0));
    let directions: Vec<Direction> = rivals
        .iter()
        .map(|rival| Direction::of(fitter, smaller, rival, &base, &blocks))
        .collect();
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let as_much = (0..DRAWS)
        .filter(|_| {
            let signs: Vec<f64> = (0..blocks.count())
                .map(|_| if random.random_bool(0.5) { 1.0 } else { -1.0 })
                .collect();
            let gains = directions.iter().map(|direction| direction.gain(&signs));
            gains.fold(0.0, f64::max) >= gained
        })
        .count();
    (1 + as_much) as f64 / (1 + DRAWS) as f64
}

/// A residual cut into stretches that keep their sign together.
struct Blocks {
    /// Ends of the stretches, in samples of all recordings.
    ends: Vec<usize>,
    residual: Vec<f64>,
}

impl Blocks {
    fn of(fit: &Fit) -> Self {
        // A correlation time is at most some thousand samples.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let length = ((CORRELATION_TIMES * fit.correlation_time()) as usize).max(SHORTEST);
        let mut ends = Vec::new();
        let mut first = 0;
        for run in &fit.residuals {
            let mut end = 0;
            while end < run.len() {
                end = (end + length).min(run.len());
                ends.push(first + end);
            }
            first += run.len();
        }
        Self {
            ends,
            residual: fit.residuals.concat(),
        }
    }

    fn count(&self) -> usize {
        self.ends.len()
    }

    /// What each stretch adds to the product of `column` with the residual.
    fn products(&self, column: &[f64]) -> Vec<f64> {
        let mut first = 0;
        self.ends
            .iter()
            .map(|&end| {
                let range = first..end;
                first = end;
                column[range.clone()]
                    .iter()
                    .zip(&self.residual[range])
                    .map(|(a, b)| a * b)
                    .sum()
            })
            .collect()
    }
}

/// Orthonormal columns.
struct Basis(Vec<DVector<f64>>);

impl Basis {
    /// The part of `columns` that is perpendicular to `other` and to each other;
    /// columns of which next to nothing is left are dropped.
    fn of(columns: &DMatrix<f64>, other: &DMatrix<f64>) -> Self {
        let mut found: Vec<DVector<f64>> =
            other.column_iter().map(DVectorView::into_owned).collect();
        let given = found.len();
        for column in columns.column_iter() {
            extend(&mut found, column.into_owned());
        }
        Self(found.split_off(given))
    }

    fn matrix(&self) -> DMatrix<f64> {
        if self.0.is_empty() {
            DMatrix::zeros(0, 0)
        } else {
            DMatrix::from_columns(&self.0)
        }
    }
}

fn extend(basis: &mut Vec<DVector<f64>>, mut column: DVector<f64>) {
    /// A smaller part that is new is rounding.
    const NEW: f64 = 1e-6;
    let before = column.norm();
    // Twice is enough (Kahan).
    for _ in 0..2 {
        for known in basis.iter() {
            let along = known.dot(&column);
            column.axpy(-along, known, 1.0);
        }
    }
    let left = column.norm();
    if left.is_finite() && left > NEW * before {
        basis.push(column / left);
    }
}

/// The directions in which a structure can move away from a smaller one.
struct Direction {
    /// For each column, what each stretch of noise adds to its product.
    products: Vec<Vec<f64>>,
    /// Whether there is one column, of a parameter that is on one side of its
    /// neutral value only.
    one_sided: bool,
}

impl Direction {
    fn of(
        fitter: &Fitter<'_, '_>,
        smaller: &Candidate,
        rival: &Candidate,
        base: &Basis,
        blocks: &Blocks,
    ) -> Self {
        let own = Basis::of(&fitter.derivatives(&rival.fit), &base.matrix());
        let products: Vec<Vec<f64>> = own
            .0
            .iter()
            .map(|column| blocks.products(column.as_slice()))
            .collect();
        Self {
            one_sided: products.len() == 1 && is_one_sided(smaller, rival),
            products,
        }
    }

    /// The drop of the sum of squares (rad²) that noise with these signs gives.
    fn gain(&self, signs: &[f64]) -> f64 {
        self.products
            .iter()
            .map(|products| {
                let along: f64 = products.iter().zip(signs).map(|(a, b)| a * b).sum();
                // Residuals are simulated minus measured, and the sign of the noise
                // is as likely as its opposite: either side will do.
                let along = if self.one_sided {
                    along.max(0.0)
                } else {
                    along
                };
                along * along
            })
            .sum()
    }
}

/// Whether the only new parameter is bounded by its neutral value, zero.
fn is_one_sided(smaller: &Candidate, rival: &Candidate) -> bool {
    let new: Vec<ParameterId> = rival
        .fit
        .free
        .iter()
        .copied()
        .filter(|id| !smaller.fit.free.contains(id))
        .collect();
    let [ParameterId::Effect { slot, parameter }] = new.as_slice() else {
        return false;
    };
    rival
        .fit
        .model
        .effects()
        .nth(*slot)
        .and_then(|effect| effect.parameters().get(*parameter))
        .is_some_and(|row| row.lower == 0.0 || row.upper == 0.0)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use model_core::actuator::Model;
    use model_core::catalogue::Kind;

    use super::*;
    use crate::diagnose::candidates::free_parameters;
    use crate::example::{Hidden, make};
    use crate::fit::{Effort, Run};
    use crate::model_file::ModelFile;
    use crate::recording::Recording;

    /// How likely chance lets friction gain what it gains on an example.
    fn chance_of_friction(hidden: Hidden, seed: u64) -> f64 {
        let example = make(hidden, 0.4, seed).unwrap();
        let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
        let recordings: Vec<Recording> = example
            .recordings
            .into_iter()
            .map(|(_, recording, _)| recording)
            .collect();
        let runs = Run::all(&recordings);
        let fitter = Fitter {
            nominal: &file.model,
            runs: &runs,
        };
        let fitted = |added: &[Kind], start: &Model<f64>| Candidate {
            added: added.to_vec(),
            fit: fitter.fit(start, &free_parameters(&file, added), Effort::Full),
        };
        let refit = fitted(&[], &file.model);
        let friction = Kind::CoulombFriction.build(&[0.05, 0.02]).unwrap();
        let start = Model::new(*refit.fit.model.dynamics(), &[friction]).unwrap();
        let with = fitted(&[Kind::CoulombFriction], &start);
        chance(&fitter, &refit, &[&with], 1)
    }

    #[test]
    fn friction_that_is_there_is_no_chance_and_friction_that_is_not_may_be() {
        let there = Hidden::Effect(Kind::CoulombFriction);
        for seed in 1..=3 {
            assert!(chance_of_friction(there, seed) < 0.005);
            let absent = chance_of_friction(Hidden::Nothing, seed);
            assert!(absent > SIGNIFICANT, "{absent}");
        }
    }

    #[test]
    fn bases_are_orthonormal_and_leave_out_what_is_known() {
        let known = DMatrix::from_row_slice(3, 1, &[1.0, 0.0, 0.0]);
        let columns = DMatrix::from_row_slice(3, 3, &[2.0, 5.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0]);
        let basis = Basis::of(&columns, &known);
        assert_eq!(basis.0.len(), 2);
        let gram = basis.matrix().transpose() * basis.matrix();
        assert!((gram - DMatrix::identity(2, 2)).norm() < 1e-12);
        assert!(basis.0.iter().all(|column| column[0].abs() < 1e-12));
    }

    #[test]
    fn a_column_gains_what_noise_has_along_it() {
        let both = Direction {
            products: vec![vec![1.0, 2.0], vec![0.5, 0.0]],
            one_sided: false,
        };
        assert!((both.gain(&[1.0, -1.0]) - 1.25).abs() < 1e-12);
        let one = Direction {
            products: vec![vec![1.0, 2.0]],
            one_sided: true,
        };
        assert!((one.gain(&[1.0, 1.0]) - 9.0).abs() < 1e-12);
        assert!(one.gain(&[-1.0, -1.0]).abs() < 1e-12);
    }
}
