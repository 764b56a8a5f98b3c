//! What recordings say about the parameters of a fit, to second order.
//!
//! Near its minimum the sum of squares is a parabola whose curvature JᵀJ adds
//! up over recordings. Kept for each recording, it answers three questions
//! without another simulation: how uncertain a parameter is, which
//! combinations of parameters nothing determines, and what the fit would have
//! been without some of the recordings.
//!
//! Zeros and start of a session are eliminated before ([`without_nuisance`]), so
//! that only the free parameters are left.

use nalgebra::{DMatrix, DMatrixView, DVector, DVectorView};

use crate::estimate::statistics::independent_stretch;

/// Curvature and slope of the sum of squares of each recording, in the
/// coordinates in which the solver moves.
#[derive(Clone, Debug, Default)]
pub struct Information {
    /// JᵀJ of each recording.
    curvature: Vec<DMatrix<f64>>,
    /// Jᵀr of each recording.
    slope: Vec<DVector<f64>>,
    /// Σ (Jᵀr)(Jᵀr)ᵀ over blocks of samples: how much the slope scatters.
    scatter: DMatrix<f64>,
    /// Number of those blocks.
    blocks: usize,
    /// Mean square of the residual (rad²).
    variance: f64,
}

/// Fewer recordings say little about their own scatter.
const FEWEST_RECORDINGS: usize = 5;

/// What one recording adds.
#[derive(Clone, Debug)]
pub struct Recorded {
    curvature: DMatrix<f64>,
    slope: DVector<f64>,
    scatter: DMatrix<f64>,
    stretches: usize,
    squares: f64,
    samples: usize,
}

impl Recorded {
    /// Of derivatives by the free parameters, a row a sample, without what the session's
    /// zeros and start can follow, and residuals (simulated minus measured, rad) that are
    /// correlated over `correlation` samples.
    pub fn of(
        parameters: DMatrixView<'_, f64>,
        residual: DVectorView<'_, f64>,
        correlation: f64,
    ) -> Self {
        /// Slopes are summed over independent stretches, and over such a part of
        /// the recording at least. What the noise of the pressure leaves is small
        /// beside the noise of the angle and lasts for seconds: the correlation time
        /// does not show it, and it moves parameters most.
        const PART: usize = 4;
        let unknowns = parameters.ncols();
        let samples = residual.len();
        let length = independent_stretch(correlation).max(samples.div_ceil(PART));
        let mut scatter = DMatrix::zeros(unknowns, unknowns);
        let (mut first, mut stretches) = (0, 0);
        while first < samples {
            let height = length.min(samples - first);
            let sum = parameters
                .rows(first, height)
                .tr_mul(&residual.rows(first, height));
            scatter += &sum * sum.transpose();
            first += height;
            stretches += 1;
        }
        Self {
            curvature: parameters.tr_mul(&parameters),
            slope: parameters.tr_mul(&residual),
            scatter,
            stretches,
            squares: residual.norm_squared(),
            samples,
        }
    }
}

impl Information {
    /// Adds up recordings whose derivatives and residuals lack a factor of `scale`.
    pub fn sum(
        unknowns: usize,
        recordings: impl IntoIterator<Item = Recorded>,
        scale: f64,
    ) -> Self {
        let square = scale * scale;
        let mut this = Self {
            scatter: DMatrix::zeros(unknowns, unknowns),
            ..Self::default()
        };
        let (mut squares, mut samples) = (0.0, 0usize);
        for recorded in recordings {
            this.curvature.push(recorded.curvature * square);
            this.slope.push(recorded.slope * square);
            this.scatter += recorded.scatter * (square * square);
            this.blocks += recorded.stretches;
            squares += recorded.squares * square;
            samples += recorded.samples;
        }
        // Each parameter takes the scatter of one block away.
        if this.blocks > unknowns {
            this.scatter *= this.blocks as f64 / (this.blocks - unknowns) as f64;
        }
        this.variance = squares / samples.saturating_sub(unknowns).max(1) as f64;
        this
    }

    /// Number of free parameters.
    pub fn unknowns(&self) -> usize {
        self.scatter.nrows()
    }

    /// How many independent differences the covariance rests on: of recordings,
    /// or of blocks where there are few recordings.
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

    /// Covariance of the free parameters: none if nothing determines some of
    /// them.
    ///
    /// Correlated residuals and residuals that are larger here than there are
    /// allowed for by their own scatter (the sandwich estimate, summed over
    /// blocks). No variance is less than white noise of the same size would give,
    /// nor less than the fits without one recording each scatter (the jackknife):
    /// what a wrong formula or the pressure's noise does to a recording as a whole
    /// shows only there.
    pub fn covariance(&self) -> Option<DMatrix<f64>> {
        let bread = inverse(&self.total(&[]))?;
        let white = &bread * self.variance;
        let robust = &bread * &self.scatter * &bread;
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

    /// Variance of the free parameters from the fits without one recording each
    /// (Tukey 1958). None if there are too few recordings, or one without which
    /// nothing determines them.
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
        let scatter = moved
            .iter()
            .map(|step| (step - &mean).map(|by| by * by))
            .sum::<DVector<f64>>();
        Some(scatter * ((count - 1) as f64 / count as f64))
    }

    /// Directions in which the parameters can move by more than `limit` times
    /// their own size before the recordings notice: unit vectors of relative
    /// changes, flattest first, with how far they can move. `sizes` are dp/du
    /// over p for each parameter.
    pub fn flat_directions(&self, sizes: &[f64], limit: f64) -> Vec<(f64, Vec<f64>)> {
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
        let mut flat: Vec<(f64, Vec<f64>)> = eigen
            .eigenvalues
            .iter()
            .zip(eigen.eigenvectors.column_iter())
            .filter_map(|(&curvature, direction)| {
                let reach = (self.variance / curvature.max(f64::MIN_POSITIVE)).sqrt();
                (reach > limit).then(|| (reach, direction.iter().copied().collect()))
            })
            .collect();
        flat.sort_by(|a, b| b.0.total_cmp(&a.0));
        flat
    }

    /// How the solver's coordinates move if the recordings in `left_out` are
    /// left out: one Gauss–Newton step, exact for a model that is linear in
    /// its parameters. None if the others do not determine the parameters, or
    /// if the step leads farther than the parabola can be trusted.
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

/// The part of `parameters` that no change of a session's own unknowns can
/// imitate, of which `known` says how strongly each is held by what was known
/// before.
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

/// The inverse of a symmetric positive matrix, scaled to a unit diagonal so
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
            Recorded::of(parameters.as_view(), residual, 1.0)
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
        let flat = information.flat_directions(&[1.0, 1.0], 0.5);
        assert_eq!(flat.len(), 1);
        let direction = &flat[0].1;
        assert!((direction[0] + direction[1]).abs() < 1e-6);
    }
}
