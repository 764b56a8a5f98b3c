//! Bootstrap test: could noise alone have asked for another effect?
//!
//! Scores that count parameters assume that an unneeded parameter is as likely to come
//! out above as below its neutral value. But friction is never negative, a time constant
//! means nothing without its stiffness, and the best of 27 effects was taken. So the
//! usual distributions do not hold, and the distribution is simulated: blocks of the
//! larger structure's residual get random signs, are added to the smaller structure, and
//! every rival is fitted to that, to first order. The result is how often the best of
//! them gains as much as was observed.
//!
//! This is the block wild bootstrap (Shao, J. Am. Stat. Assoc. 105, 2010). Blocks are
//! longer than the correlation time of the residual, so slow noise stays slow. A
//! parameter whose neutral value is the end of its range gains on one side only.

use model_core::actuator::ParameterId;
use nalgebra::{DMatrix, DVector, DVectorView};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::candidates::Candidate;
use crate::estimate::fit::{Fit, Fitter};
use crate::statistics::independent_block;

/// Number of draws: a probability of one in a hundred is known to a tenth of itself.
const DRAWS: usize = 9_999;

/// The longest block is a recording divided by this.
const LONGEST: usize = 4;

/// The shortest block (samples).
const SHORTEST: usize = 50;

/// Fewest blocks that can show a probability of one in a hundred.
const FEWEST: usize = 8;

/// The probability that noise alone lets the best of `rivals` gain as much over `smaller`
/// as the first of them does. At least 1/10 000; 1 if the recordings are too short.
pub fn chance(fitter: &Fitter<'_>, smaller: &Candidate, rivals: &[&Candidate], seed: u64) -> f64 {
    let Some(best) = rivals.first() else {
        return 1.0;
    };
    let gained = smaller.fit.sse() - best.fit.sse();
    let blocks = Blocks::of(&best.fit);
    if blocks.count() < FEWEST {
        return 1.0;
    }
    let base = fitter.derivatives(&smaller.fit);
    let directions: Vec<Direction> = rivals
        .iter()
        .map(|rival| Direction::of(fitter, smaller, rival, &base, &blocks))
        .collect();
    let as_much = (0..DRAWS)
        .into_par_iter()
        .filter(|draw| {
            let mut random = Pcg64Mcg::seed_from_u64(seed);
            random.advance(blocks.count() as u128 * *draw as u128);
            let signs: Vec<f64> = (0..blocks.count())
                .map(|_| if random.random_bool(0.5) { 1.0 } else { -1.0 })
                .collect();
            let gains = directions.iter().map(|direction| direction.gain(&signs));
            gains.fold(0.0, f64::max) >= gained
        })
        .count();
    (1 + as_much) as f64 / (1 + DRAWS) as f64
}

/// A residual cut into blocks of one sign each.
struct Blocks {
    /// Ends of the blocks, in samples of all recordings.
    ends: Vec<usize>,
    residual: Vec<f64>,
}

impl Blocks {
    fn of(fit: &Fit) -> Self {
        let independent = independent_block(fit.correlation_time());
        let mut ends = Vec::new();
        let mut first = 0;
        for run in &fit.residuals {
            let length = independent.min(run.len() / LONGEST).max(SHORTEST);
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

    /// The contribution of each block to the product of `column` with the residual.
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

/// The part of `columns` that is orthogonal to `known` and to each other, as
/// orthonormal columns; columns that nearly vanish are dropped.
fn perpendicular(columns: &[DVector<f64>], known: &[DVector<f64>]) -> Vec<DVector<f64>> {
    /// Smallest relative remainder that is not rounding.
    const NEW: f64 = 1e-6;
    let mut basis: Vec<DVector<f64>> = Vec::new();
    let mut given = 0;
    for (index, column) in known.iter().chain(columns).enumerate() {
        let mut left = column.clone();
        // Twice is enough (Kahan).
        for _ in 0..2 {
            for other in &basis {
                let along = other.dot(&left);
                left.axpy(-along, other, 1.0);
            }
        }
        let size = left.norm();
        if size.is_finite() && size > NEW * column.norm() {
            basis.push(left / size);
            given += usize::from(index < known.len());
        }
    }
    basis.split_off(given)
}

/// The directions in which a structure can move away from a smaller one: those
/// of the parameters of its new effects, with all others projected out.
struct Direction {
    /// For each column, the contribution of each block to its product with the noise.
    products: Vec<Vec<f64>>,
    /// Whether there is one column, of a one-sided parameter.
    one_sided: bool,
}

impl Direction {
    fn of(
        fitter: &Fitter<'_>,
        smaller: &Candidate,
        rival: &Candidate,
        base: &DMatrix<f64>,
        blocks: &Blocks,
    ) -> Self {
        let is_new = |id: &ParameterId| parameter_is_new(smaller, rival, *id);
        let (new, old): (Vec<_>, Vec<_>) = fitter
            .derivatives(&rival.fit)
            .column_iter()
            .map(DVectorView::into_owned)
            .zip(&rival.fit.free)
            .partition(|(_, id)| is_new(id));
        let columns = |list: Vec<(DVector<f64>, &ParameterId)>| {
            list.into_iter().map(|(column, _)| column).collect()
        };
        let known: Vec<DVector<f64>> = base
            .column_iter()
            .map(DVectorView::into_owned)
            .chain::<Vec<_>>(columns(old))
            .collect();
        let new: Vec<DVector<f64>> = columns(new);
        let products: Vec<Vec<f64>> = perpendicular(&new, &known)
            .iter()
            .map(|column| blocks.products(column.as_slice()))
            .collect();
        Self {
            one_sided: products.len() == 1 && is_one_sided(smaller, rival),
            products,
        }
    }

    /// The drop of the sum of squares (rad²) for noise with these signs.
    fn gain(&self, signs: &[f64]) -> f64 {
        self.products
            .iter()
            .map(|products| {
                let along: f64 = products.iter().zip(signs).map(|(a, b)| a * b).sum();
                // The noise is symmetric, so either side will do.
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

/// Whether a parameter belongs to an effect that the smaller structure lacks.
fn parameter_is_new(smaller: &Candidate, rival: &Candidate, id: ParameterId) -> bool {
    let first = rival.fit.model.effects().count() - rival.added.len();
    match id {
        ParameterId::Effect { slot, .. } => slot
            .checked_sub(first)
            .and_then(|added| rival.added.get(added))
            .is_some_and(|kind| !smaller.added.contains(kind)),
        _ => false,
    }
}

/// Whether the only new parameter is bounded by its neutral value, zero.
fn is_one_sided(smaller: &Candidate, rival: &Candidate) -> bool {
    let new: Vec<ParameterId> = rival
        .fit
        .free
        .iter()
        .copied()
        .filter(|&id| parameter_is_new(smaller, rival, id))
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
    use crate::diagnose::policy::Exact;
    use crate::estimate::Dataset;
    use crate::estimate::fit::Effort;
    use crate::io::model_file::ModelFile;
    use crate::io::recording::Recording;
    use crate::synth::example::{Hidden, make};

    /// How likely chance lets friction gain what it gains on an example.
    fn chance_of_friction(hidden: Hidden, seed: u64) -> f64 {
        let example = make(hidden, 0.4, seed).unwrap();
        let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
        let recordings: Vec<Recording> = example
            .recordings
            .into_iter()
            .map(|(_, recording, _)| recording)
            .collect();
        let data = Dataset::of(&recordings);
        let fitter = Fitter::new(&file.model, &data);
        let fitted = |added: &[Kind], start: &Model<f64>| {
            Candidate::of(
                added.to_vec(),
                fitter.fit(start, &free_parameters(&file, added), Effort::Full),
            )
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
            assert!(absent > Exact::STANDARD.chance, "{absent}");
        }
    }

    #[test]
    fn what_is_perpendicular_is_orthonormal_and_leaves_out_what_is_known() {
        let vector = |entries: [f64; 3]| DVector::from_column_slice(&entries);
        let known = [vector([1.0, 0.0, 0.0]), vector([2.0, 0.0, 0.0])];
        let columns = [
            vector([2.0, 0.0, 0.0]),
            vector([5.0, 1.0, 0.0]),
            vector([1.0, 1.0, 2.0]),
        ];
        let found = perpendicular(&columns, &known);
        assert_eq!(found.len(), 2);
        assert!(found[0].dot(&found[1]).abs() < 1e-12);
        for column in found {
            assert!((column.norm() - 1.0).abs() < 1e-12 && column[0].abs() < 1e-12);
        }
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
