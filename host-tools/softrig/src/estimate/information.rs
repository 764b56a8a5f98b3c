//! The information matrix of a fit, recording by recording.
//!
//! Near its minimum the sum of squares is quadratic with the curvature JᵀJ, a sum over
//! recordings. Kept for each recording, it answers three questions without another
//! simulation: how uncertain a parameter is, which directions are unidentifiable, and
//! what a fit without some of the recordings gives.
//!
//! Zeros and initial state of a session are eliminated first ([`without_nuisance`]), so
//! that only the free parameters remain.

use nalgebra::{DMatrix, DMatrixView, DVector, DVectorView};

use crate::portable::product;
use crate::statistics::independent_block;

/// Curvature and gradient of the sum of squares of each recording, in the solver's
/// coordinates.
#[derive(Clone, Debug, Default)]
pub struct Information {
    /// JᵀJ of each recording.
    curvature: Vec<DMatrix<f64>>,
    /// Jᵀr of each recording.
    slope: Vec<DVector<f64>>,
    /// Σ (Jᵀr)(Jᵀr)ᵀ over blocks of samples: the meat of the sandwich estimate.
    meat: DMatrix<f64>,
    /// Number of those blocks.
    blocks: usize,
    /// Mean square of the residual (rad²).
    variance: f64,
}

/// Fewest recordings for a jackknife variance.
const FEWEST_RECORDINGS: usize = 5;

/// The contribution of one recording.
#[derive(Clone, Debug)]
pub struct Contribution {
    curvature: DMatrix<f64>,
    slope: DVector<f64>,
    meat: DMatrix<f64>,
    blocks: usize,
    squares: f64,
    samples: usize,
}

impl Contribution {
    /// From derivatives by the free parameters (one row per sample, with the session's
    /// zeros and initial state projected out) and residuals (simulated minus measured,
    /// rad) with a correlation time of `correlation` samples.
    pub fn of(
        parameters: DMatrixView<'_, f64>,
        residual: DVectorView<'_, f64>,
        correlation: f64,
    ) -> Self {
        /// A block is at least this part of the recording. The error from noise of the
        /// pressure is small beside the noise of the angle and lasts for seconds: the
        /// correlation time does not show it, and it moves the parameters most.
        const PART: usize = 4;
        let unknowns = parameters.ncols();
        let samples = residual.len();
        let length = independent_block(correlation).max(samples.div_ceil(PART));
        let mut meat = DMatrix::zeros(unknowns, unknowns);
        let (mut first, mut blocks) = (0, 0);
        while first < samples {
            let height = length.min(samples - first);
            let sum = parameters
                .rows(first, height)
                .tr_mul(&residual.rows(first, height));
            meat += &sum * sum.transpose();
            first += height;
            blocks += 1;
        }
        Self {
            curvature: parameters.tr_mul(&parameters),
            slope: parameters.tr_mul(&residual),
            meat,
            blocks,
            squares: residual.norm_squared(),
            samples,
        }
    }
}

impl Information {
    /// Sums the contributions of recordings; derivatives and residuals are multiplied by
    /// `scale`.
    pub fn sum(
        unknowns: usize,
        recordings: impl IntoIterator<Item = Contribution>,
        scale: f64,
    ) -> Self {
        let square = scale * scale;
        let mut this = Self {
            meat: DMatrix::zeros(unknowns, unknowns),
            ..Self::default()
        };
        let (mut squares, mut samples) = (0.0, 0usize);
        for recorded in recordings {
            this.curvature.push(recorded.curvature * square);
            this.slope.push(recorded.slope * square);
            this.meat += recorded.meat * (square * square);
            this.blocks += recorded.blocks;
            squares += recorded.squares * square;
            samples += recorded.samples;
        }
        // Each parameter takes one degree of freedom of the blocks.
        if this.blocks > unknowns {
            this.meat *= this.blocks as f64 / (this.blocks - unknowns) as f64;
        }
        this.variance = squares / samples.saturating_sub(unknowns).max(1) as f64;
        this
    }

    /// Number of free parameters.
    pub fn unknowns(&self) -> usize {
        self.meat.nrows()
    }

    /// Degrees of freedom of the covariance: from recordings, or from blocks where there
    /// are few recordings.
    pub fn degrees_of_freedom(&self) -> usize {
        let recordings = self.curvature.len();
        if recordings < FEWEST_RECORDINGS {
            self.blocks.saturating_sub(self.unknowns()).max(1)
        } else {
            recordings - 1
        }
    }

    /// JᵀJ of all recordings but those in `left_out`.
    pub fn total(&self, left_out: &[usize]) -> DMatrix<f64> {
        let unknowns = self.unknowns();
        self.curvature
            .iter()
            .enumerate()
            .filter(|(index, _)| !left_out.contains(index))
            .fold(DMatrix::zeros(unknowns, unknowns), |sum, (_, one)| {
                sum + one
            })
    }

    /// Covariance of the free parameters: none if some of them are not determined.
    ///
    /// The sandwich estimate over blocks allows for correlated and heteroscedastic
    /// residuals. Each variance is at least that of white noise of the same size, and at
    /// least the jackknife variance over recordings: only that shows what a wrong formula
    /// or the noise of the pressure does to a recording as a whole.
    pub fn covariance(&self) -> Option<DMatrix<f64>> {
        let bread = inverse(&self.total(&[]))?;
        let white = &bread * self.variance;
        let robust = product(&product(&bread, &self.meat), &bread);
        let jackknife = self.jackknife();
        let mut covariance = robust;
        for k in 0..covariance.nrows() {
            let found = covariance[(k, k)];
            let least = white[(k, k)].max(jackknife.as_ref().map_or(0.0, |variance| variance[k]));
            if found < least && found > 0.0 {
                let factor = (least / found).sqrt();
                covariance.row_mut(k).scale_mut(factor);
                covariance.column_mut(k).scale_mut(factor);
            }
        }
        Some(covariance)
    }

    /// Jackknife variance of the free parameters, from fits without one recording each
    /// (Tukey 1958). None if there are too few recordings, or if one of them alone
    /// determines a parameter.
    fn jackknife(&self) -> Option<DVector<f64>> {
        let count = self.curvature.len();
        if count < FEWEST_RECORDINGS {
            return None;
        }
        let whole = self.total(&[]);
        let moved: Vec<DVector<f64>> = self
            .curvature
            .iter()
            .zip(&self.slope)
            .map(|(curvature, slope)| Some(inverse(&(&whole - curvature))? * slope))
            .collect::<Option<_>>()?;
        let mean = moved.iter().sum::<DVector<f64>>() / count as f64;
        let meat = moved
            .iter()
            .map(|step| (step - &mean).map(|by| by * by))
            .sum::<DVector<f64>>();
        Some(meat * ((count - 1) as f64 / count as f64))
    }

    /// Directions whose relative standard error exceeds `limit`: the standard error and
    /// the unit vector of relative changes, largest first. `sizes` are dp/du over p for
    /// each parameter.
    pub fn unidentifiable_directions(&self, sizes: &[f64], limit: f64) -> Vec<(f64, Vec<f64>)> {
        let unknowns = self.unknowns();
        let mut relative = self.total(&[]);
        for row in 0..unknowns {
            for column in 0..unknowns {
                let scale = sizes[row] * sizes[column];
                relative[(row, column)] = if scale.abs() > 0.0 {
                    relative[(row, column)] / scale
                } else {
                    0.0
                };
            }
        }
        if unknowns == 0 || !relative.iter().all(|entry| entry.is_finite()) {
            return Vec::new();
        }
        let eigen = relative.symmetric_eigen();
        let mut directions: Vec<(f64, Vec<f64>)> = eigen
            .eigenvalues
            .iter()
            .zip(eigen.eigenvectors.column_iter())
            .filter_map(|(&curvature, direction)| {
                let standard_error = (self.variance / curvature.max(f64::MIN_POSITIVE)).sqrt();
                (standard_error > limit)
                    .then(|| (standard_error, direction.iter().copied().collect()))
            })
            .collect();
        directions.sort_by(|a, b| b.0.total_cmp(&a.0));
        directions
    }

    /// The Gauss–Newton step, in the solver's coordinates, if the recordings in
    /// `left_out` are left out: exact for a model that is linear in its parameters. None
    /// if the others do not determine the parameters, or if the step is too long for the
    /// quadratic approximation.
    pub fn step_without(&self, left_out: &[usize]) -> Option<DVector<f64>> {
        let rest = self.total(left_out);
        let slope = self
            .slope
            .iter()
            .enumerate()
            .filter(|(index, _)| !left_out.contains(index))
            .fold(DVector::zeros(self.unknowns()), |sum, (_, one)| sum + one);
        let step = -(inverse(&rest)? * slope);
        step.iter()
            .all(|move_by| move_by.is_finite() && move_by.abs() < 0.2)
            .then_some(step)
    }
}

/// Projects a session's own unknowns out of the derivatives `parameters`. `known` is the
/// prior precision of each.
pub fn without_nuisance(
    parameters: &DMatrix<f64>,
    own: &DMatrix<f64>,
    known: &[f64],
) -> DMatrix<f64> {
    let mut normal = own.tr_mul(own);
    for (k, slope) in known.iter().enumerate() {
        normal[(k, k)] += slope * slope;
    }
    match inverse(&normal) {
        Some(inverse) => parameters - own * (inverse * own.tr_mul(parameters)),
        None => parameters.clone(),
    }
}

/// The inverse of a symmetric positive definite matrix, scaled to a unit diagonal so
/// that the test for singularity does not depend on units.
fn inverse(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let count = matrix.nrows();
    let lengths: Vec<f64> = (0..count).map(|k| matrix[(k, k)].sqrt()).collect();
    if lengths
        .iter()
        .any(|length| !length.is_finite() || *length <= 0.0)
    {
        return None;
    }
    let scaled = DMatrix::from_fn(count, count, |row, column| {
        matrix[(row, column)] / (lengths[row] * lengths[column])
    });
    let mut inverse = scaled.cholesky()?.inverse();
    for row in 0..count {
        for column in 0..count {
            inverse[(row, column)] /= lengths[row] * lengths[column];
        }
    }
    inverse
        .iter()
        .all(|entry| entry.is_finite())
        .then_some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A straight line through four short series.
    fn line(series: &[Vec<f64>]) -> (Vec<DMatrix<f64>>, Vec<Vec<f64>>, Vec<f64>) {
        let blocks: Vec<DMatrix<f64>> = series
            .iter()
            .enumerate()
            .map(|(run, values)| {
                DMatrix::from_fn(values.len(), 2, |row, column| {
                    if column == 0 {
                        1.0
                    } else {
                        (row as f64 * 0.1 + run as f64) * 0.3
                    }
                })
            })
            .collect();
        let mut normal = DMatrix::zeros(2, 2);
        let mut right = DVector::zeros(2);
        for (block, values) in blocks.iter().zip(series) {
            normal += block.tr_mul(block);
            right += block.tr_mul(&DVector::from_column_slice(values));
        }
        let solved = normal.cholesky().unwrap().solve(&right);
        let residuals = blocks
            .iter()
            .zip(series)
            .map(|(block, values)| {
                (block * &solved - DVector::from_column_slice(values))
                    .iter()
                    .copied()
                    .collect()
            })
            .collect();
        (blocks, residuals, solved.iter().copied().collect())
    }

    fn collect(blocks: &[DMatrix<f64>], residuals: &[Vec<f64>]) -> Information {
        let recorded = blocks.iter().zip(residuals).map(|(parameters, residual)| {
            let residual = DVectorView::from_slice(residual, residual.len());
            Contribution::of(parameters.as_view(), residual, 1.0)
        });
        Information::sum(2, recorded, 1.0)
    }

    fn series() -> Vec<Vec<f64>> {
        (0..4)
            .map(|run| {
                (0..20)
                    .map(|k| 0.02 * f64::from((k * 7 + run * 3) % 11) + 0.01 * f64::from(run))
                    .collect()
            })
            .collect()
    }

    #[test]
    fn a_step_without_some_is_the_fit_to_the_others() {
        let all = series();
        let (blocks, residuals, whole) = line(&all);
        let step = collect(&blocks, &residuals).step_without(&[0, 1]).unwrap();
        // The design depends on the number of the run, so the rest is refitted
        // with its own blocks.
        let mut normal = DMatrix::zeros(2, 2);
        let mut right = DVector::zeros(2);
        for run in [2, 3] {
            normal += blocks[run].tr_mul(&blocks[run]);
            right += blocks[run].tr_mul(&DVector::from_column_slice(&all[run]));
        }
        let rest = normal.cholesky().unwrap().solve(&right);
        for k in 0..2 {
            assert!((whole[k] + step[k] - rest[k]).abs() < 1e-9);
        }
    }

    #[test]
    fn a_doubled_column_is_a_flat_direction() {
        let block = DMatrix::from_fn(30, 2, |row, _| (row as f64 * 0.2).sin());
        let residual: Vec<f64> = (0..30).map(|k| 0.01 * f64::from(k % 3 - 1)).collect();
        let information = collect(&[block], &[residual]);
        assert!(information.covariance().is_none());
        let directions = information.unidentifiable_directions(&[1.0, 1.0], 0.5);
        assert_eq!(directions.len(), 1);
        let direction = &directions[0].1;
        assert!((direction[0] + direction[1]).abs() < 1e-6);
    }
}
