//! Output-error fits: the parameters whose simulation is nearest to the measurement.
//!
//! The model is *simulated* over each recording and compared with the measured
//! angle. No measured signal is differentiated, so noise is not amplified. Dual numbers
//! through the shared core ([`crate::sim::dual`]) give exact derivatives of every
//! simulated sample, and a library solves the least-squares problem
//! (Levenberg–Marquardt, the MINPACK algorithm).
//!
//! Each session has unknowns of its own: the zeros of its sensors and its initial
//! state ([`crate::estimate::nuisance`]). They are estimated in the same fit.

use std::sync::Arc;

use model_core::actuator::{Model, ParameterId};
use nalgebra::DMatrix;
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::information::Information;
use super::nuisance::Nuisance;
use super::transform::{ParameterTransform, bounds};
use crate::statistics::{correlation_time, rms};

/// Series of residuals (rad), one a segment; shared, since fits are passed on and compared.
pub type Residuals = Arc<[Vec<f64>]>;

/// The result of a fit.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The model with the fitted parameters.
    pub model: Model<f64>,
    /// Which parameters were free.
    pub free: Vec<ParameterId>,
    /// Zeros and initial state of each session; guesses where nothing of it was fitted.
    pub nuisances: Vec<Nuisance>,
    /// Penalty of zeros and initial states: minus twice the log of their prior density,
    /// relative to its maximum.
    pub departure: f64,
    /// The same in rad², as it enters the objective, with the soft bounds of the zeros.
    pub penalty: f64,
    /// Simulated minus measured angle (rad), one series per fitted segment.
    pub residuals: Residuals,
    /// Standard error of each free parameter, in SI units; infinite for a
    /// parameter that the recordings do not determine.
    pub standard_errors: Vec<f64>,
    /// Whether the solver met its tolerance.
    pub converged: bool,
    /// Information of each segment about the free parameters; empty after a
    /// coarse fit.
    pub(super) information: Information,
    pub(super) transforms: Vec<ParameterTransform>,
    pub(super) position: Vec<f64>,
}

/// A practically unidentifiable direction: a combination of free parameters that the
/// recordings hardly determine.
#[derive(Clone, Debug, PartialEq)]
pub struct UnidentifiableDirection {
    /// Standard error along the direction, relative to the size of the parameters;
    /// infinite if nothing determines it.
    pub standard_error: f64,
    /// The parameters involved, with their relative change, largest first.
    pub shares: Vec<(ParameterId, f64)>,
}

impl Fit {
    /// Sum of squared residuals (rad²).
    pub fn sse(&self) -> f64 {
        self.residuals
            .iter()
            .flatten()
            .map(|residual| residual * residual)
            .sum()
    }

    /// What the fit minimises (rad²): the sum of squares with the penalty of zeros and
    /// initial states.
    pub fn cost(&self) -> f64 {
        self.sse() + self.penalty
    }

    /// Whether a free parameter at a bound came out as nothing, next to the size that its
    /// range has.
    pub fn is_nothing(&self, index: usize) -> bool {
        self.transforms[index].to_value(self.position[index]).abs()
            < 1e-2 * self.transforms[index].scale()
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.residuals.iter().map(Vec::len).sum()
    }

    /// RMS residual (rad).
    pub fn rmse(&self) -> f64 {
        (self.sse() / self.samples().max(1) as f64).sqrt()
    }

    /// Integrated autocorrelation time of the residual (samples).
    pub fn correlation_time(&self) -> f64 {
        correlation_time(&self.residuals)
    }

    /// The model of a leave-out fit, without the segments at the places in
    /// `left_out`, by one Gauss–Newton step; none where the step cannot be trusted.
    pub fn without(&self, left_out: &[usize]) -> Option<Model<f64>> {
        if self.free.is_empty() {
            return Some(self.model);
        }
        if self.information.unknowns() != self.free.len() {
            return None;
        }
        let step = self.information.step_without(left_out)?;
        let mut model = self.model;
        for (k, (&id, transform)) in self.free.iter().zip(&self.transforms).enumerate() {
            model = model.with_value(id, transform.to_value(self.position[k] + step[k]));
        }
        Some(model)
    }

    /// JᵀJ of all recordings in the coordinates of the solver; none after a
    /// coarse fit.
    pub fn curvature(&self) -> Option<DMatrix<f64>> {
        (self.information.unknowns() == self.free.len() && !self.free.is_empty())
            .then(|| self.information.total(&[]))
    }

    /// Combinations of free parameters with a relative standard error above one half,
    /// from the singular values of the Jacobian by relative changes.
    pub fn unidentifiable_directions(&self) -> Vec<UnidentifiableDirection> {
        /// Standard error along a direction, relative to the parameters.
        const LIMIT: f64 = 0.5;
        /// Smallest share of a parameter that counts as involved.
        const SHARE: f64 = 0.2;
        if self.information.unknowns() != self.free.len() {
            return Vec::new();
        }
        let sizes: Vec<f64> = self
            .free
            .iter()
            .zip(&self.transforms)
            .zip(&self.position)
            .map(|((&id, transform), &u)| {
                let value = self.model.value(id).unwrap_or(1.0);
                transform.slope(u) / value.abs().max(1e-9)
            })
            .collect();
        self.information
            .unidentifiable_directions(&sizes, LIMIT)
            .into_iter()
            .map(|(standard_error, direction)| {
                let mut shares: Vec<(ParameterId, f64)> = self
                    .free
                    .iter()
                    .copied()
                    .zip(direction)
                    .filter(|(_, share)| share.abs() > SHARE)
                    .collect();
                shares.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
                UnidentifiableDirection {
                    standard_error,
                    shares,
                }
            })
            .collect()
    }

    /// Half the 95 % interval of the ratio of two free parameters, relative to the ratio, by
    /// the delta method. Where an inertia does not show, all forces can grow together, and
    /// their ratios are all that the recordings determine.
    pub fn ratio_within95(&self, index: usize, other: usize) -> Option<f64> {
        let covariance = self.information.covariance()?;
        let relative = |place: usize| {
            let value = self.model.value(*self.free.get(place)?)?;
            Some(
                self.transforms
                    .get(place)?
                    .slope(*self.position.get(place)?)
                    / value,
            )
        };
        let (a, b) = (relative(index)?, relative(other)?);
        let entry = |row: usize, column: usize| covariance.get((row, column)).copied();
        let variance = a * a * entry(index, index)? + b * b * entry(other, other)?
            - 2.0 * a * b * entry(index, other)?;
        let within = student95(self.information.degrees_of_freedom()) * variance.max(0.0).sqrt();
        within.is_finite().then_some(within)
    }

    /// Whether the free parameter at `index` ended at a bound of its search range.
    pub fn at_bound(&self, index: usize) -> bool {
        self.transforms
            .get(index)
            .zip(self.position.get(index))
            .is_some_and(|(transform, &u)| transform.is_at_edge(u))
    }

    /// Whether the free parameter at `index` cannot be distinguished from a bound of its
    /// range: it ended there, or its 95 % interval includes it.
    pub fn reaches_bound(&self, index: usize) -> bool {
        self.at_bound(index)
            || self
                .interval95(index)
                .zip(self.free.get(index))
                .is_some_and(|((low, high), &id)| {
                    let (lower, upper) = bounds(&self.model, id);
                    low <= lower || high >= upper
                })
    }

    /// 95 % interval of the free parameter at `index` in SI units, by Student's
    /// distribution, clipped to the parameter's bounds.
    pub fn interval95(&self, index: usize) -> Option<(f64, f64)> {
        let id = *self.free.get(index)?;
        let value = self.model.value(id)?;
        let half =
            student95(self.information.degrees_of_freedom()) * self.standard_errors.get(index)?;
        let (lower, upper) = bounds(&self.model, id);
        Some(((value - half).max(lower), (value + half).min(upper)))
    }
}

/// The effort of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// A fixed number of damped Gauss–Newton steps, to rank initial guesses and levels.
    Steps(usize),
    /// A few steps, to rank initial guesses.
    Coarse,
    /// Until another step would change the sum of squares by less than a
    /// hundred-thousandth: far below what any test of significance resolves.
    Full,
}

impl Effort {
    /// Whether initial guesses are compared after a few steps.
    pub const fn is_long(self) -> bool {
        match self {
            Self::Steps(steps) => steps >= 8,
            Self::Coarse | Self::Full => true,
        }
    }
}

/// The two-sided 95 % quantile of Student's distribution.
pub(super) fn student95(degrees_of_freedom: usize) -> f64 {
    StudentsT::new(0.0, 1.0, degrees_of_freedom.max(1) as f64)
        .map_or(f64::INFINITY, |student| student.inverse_cdf(0.975))
}

/// RMS of each recording's residual (rad), in order.
pub fn rms_each(fit: &Fit) -> Vec<f64> {
    fit.residuals.iter().map(|residual| rms(residual)).collect()
}
