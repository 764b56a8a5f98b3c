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
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::Dataset;
use super::filter::Level;
use super::information::Information;
use super::nuisance::Nuisance;
use super::problem::{Compared, Problem};
use super::transform::{ParameterTransform, bounds};
use crate::estimate::checkpoint::{Checkpoint, Ended, fingerprint};
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

/// Fits models to data.
#[derive(Clone, Copy, Debug)]
pub struct Fitter<'a> {
    /// The nominal model, around which base parameters are searched.
    pub nominal: &'a Model<f64>,
    /// The sessions and their segments.
    pub data: &'a Dataset,
    /// The level of the prediction horizon; none for output error.
    pub level: Option<&'a Level>,
}

impl<'a> Fitter<'a> {
    /// A fitter by output error.
    pub const fn new(nominal: &'a Model<f64>, data: &'a Dataset) -> Self {
        Self {
            nominal,
            data,
            level: None,
        }
    }

    /// The same at a level of the prediction horizon; none for output error.
    pub const fn at(self, level: Option<&'a Level>) -> Self {
        Self { level, ..self }
    }

    /// Fits the parameters in `free`, from their values in `start`.
    ///
    /// If no parameter is free, only zeros and initial states are estimated: a plain
    /// comparison.
    pub fn fit(&self, start: &Model<f64>, free: &[ParameterId], effort: Effort) -> Fit {
        let (problem, converged) = self.problem(start, free).solved(effort);
        problem.into_fit(converged, effort)
    }

    fn problem(&self, start: &Model<f64>, free: &[ParameterId]) -> Problem<'a> {
        Problem::new(self, start, free, Compared::Fitted).at_level(self.level)
    }

    /// Like [`Fitter::fit`], or the fit that `checkpoint` has kept; none if it is interrupted,
    /// which is asked at every step.
    pub fn fit_unless(
        &self,
        start: &Model<f64>,
        free: &[ParameterId],
        effort: Effort,
        checkpoint: &Checkpoint,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Option<Fit> {
        let key = if checkpoint.is_used() {
            self.fingerprint(start, free, effort)
        } else {
            0
        };
        let problem = self.problem(start, free);
        if let Some(ended) = checkpoint.recall(key)
            && ended.position.len() == problem.unknowns()
        {
            let fit = problem
                .at(&ended.position)
                .into_fit(ended.converged, effort);
            return Some(fit);
        }
        let (problem, converged) = problem.solved_unless(effort, is_interrupted)?;
        if problem.unknowns() > 0 {
            let position = problem.position().to_vec();
            checkpoint.keep(
                key,
                &Ended {
                    position,
                    converged,
                },
            );
        }
        Some(problem.into_fit(converged, effort))
    }

    /// A fingerprint of everything a fit depends on: data, priors, nominal model, initial
    /// guess, free parameters, effort and version.
    fn fingerprint(&self, start: &Model<f64>, free: &[ParameterId], effort: Effort) -> u64 {
        let version = env!("CARGO_PKG_VERSION");
        let text = format!(
            "{version} {:?} {:?} {start:?} {free:?} {effort:?}",
            self.nominal, self.level
        );
        let sessions = self.data.sessions().iter().enumerate();
        let data = sessions.flat_map(|(index, session)| {
            let recording = session.recording();
            let about = format!(
                "{:?} {:?} {} {} {:?} {:?} {:?}",
                session.prior(),
                session.guess(),
                session.is_estimated(),
                session.clock(),
                session.placement(),
                session.silent(),
                self.data.fitted_ranges(index),
            );
            let samples = recording
                .time
                .iter()
                .chain(session.signal().values())
                .chain(&recording.angle)
                .flat_map(|sample| sample.to_le_bytes());
            about.into_bytes().into_iter().chain(samples)
        });
        fingerprint(text.into_bytes().into_iter().chain(data))
    }

    /// The same fit with the information of the recordings about its parameters.
    pub fn informed(&self, fit: &Fit) -> Fit {
        Problem::new(self, &fit.model, &fit.free, Compared::Fitted)
            .at_level(self.level)
            .with_nuisances(&fit.nuisances)
            .into_fit(fit.converged, Effort::Full)
    }

    /// Simulates a model over the held-out segments. Zeros and initial state come from
    /// the fitted segments of the same session, or if there are none, from the session
    /// itself. Series are in the order of [`Dataset::held_out`].
    pub fn validate(&self, model: &Model<f64>) -> Validation {
        let (problem, _) =
            Problem::new(self, model, &[], Compared::Validated).solved(Effort::Coarse);
        Validation {
            residuals: problem.residual_series(false),
            nuisances: problem.nuisances(),
        }
    }

    /// Like [`Fitter::validate`], but keeps the guesses of zeros and initial states where a
    /// session is fitted in part: a few segments hardly change them.
    pub fn validate_near(&self, model: &Model<f64>) -> Validation {
        let held_out = |index: &usize| !self.data.ranges(*index, false).is_empty();
        let sessions = 0..self.data.sessions().len();
        let partly = |index: usize| !self.data.fitted_ranges(index).is_empty();
        if !sessions.clone().filter(held_out).all(partly) {
            return self.validate(model);
        }
        let nuisances: Vec<Nuisance> = self
            .data
            .sessions()
            .iter()
            .map(|session| session.guess())
            .collect();
        let residuals = sessions
            .filter(held_out)
            .flat_map(|index| {
                let session = &self.data.sessions()[index];
                let residual = session.residual_of(&session.simulate(model, &nuisances[index]));
                let ranges = self.data.ranges(index, false);
                ranges
                    .into_iter()
                    .map(move |range| residual[range].to_vec())
                    .collect::<Vec<_>>()
            })
            .collect();
        Validation {
            residuals,
            nuisances,
        }
    }

    /// Widens the standard errors of a fit by the uncertainty of parameters that it
    /// held.
    pub fn allow_for(&self, fit: &mut Fit, held: &[ParameterId]) {
        // At a bound the derivatives are not those of the interior.
        if (0..fit.free.len()).any(|index| fit.at_bound(index)) {
            return;
        }
        let free = [fit.free.as_slice(), held].concat();
        let wider = Problem::new(self, &fit.model, &free, Compared::Fitted)
            .at_level(self.level)
            .with_nuisances(&fit.nuisances)
            .into_fit(fit.converged, Effort::Full);
        for (error, wider) in fit.standard_errors.iter_mut().zip(wider.standard_errors) {
            if wider.is_finite() {
                *error = error.max(wider);
            }
        }
    }

    /// Simulates `model` as it is and compares.
    pub fn compare(&self, model: &Model<f64>) -> Fit {
        self.fit(model, &[], Effort::Full)
    }

    /// Like [`Fitter::compare`], by a few steps from nearly right zeros and initial states.
    /// For errors only: the result has no standard errors.
    pub fn compare_near(&self, model: &Model<f64>, nuisances: &[Nuisance]) -> Fit {
        const NEAR: Effort = Effort::Steps(3);
        let (problem, converged) = Problem::new(self, model, &[], Compared::Fitted)
            .with_nuisances(nuisances)
            .solved(NEAR);
        problem.into_fit(converged, NEAR)
    }

    /// Derivatives of the simulated angles by the free parameters of a fit to
    /// other recordings, in that fit's solver coordinates. What zeros and initial states
    /// can compensate is projected out. One row per fitted sample.
    pub fn derivatives(&self, fit: &Fit) -> DMatrix<f64> {
        let blocks = Problem::new(self, &fit.model, &fit.free, Compared::Fitted)
            .at_level(self.level)
            .with_transforms(&fit.transforms, &fit.position)
            .with_nuisances(&fit.nuisances)
            .projected();
        let free = fit.free.len();
        let rows = blocks.iter().map(|(block, _)| block.nrows()).sum();
        let mut all = DMatrix::zeros(rows, free);
        let mut first = 0;
        for (block, _) in &blocks {
            all.rows_mut(first, block.nrows()).copy_from(block);
            first += block.nrows();
        }
        all
    }

    /// The predicted sum of squares (rad²) after one Gauss–Newton step from `start`: a
    /// score test that costs one simulation with derivatives. Not finite if the model
    /// cannot be simulated.
    pub fn predicted_sse(&self, start: &Model<f64>, free: &[ParameterId]) -> f64 {
        Problem::new(self, start, free, Compared::Fitted)
            .at_level(self.level)
            .predicted_sse()
    }

    /// Residuals (rad) of a model at every fitted sample, and their derivatives by the
    /// solver's coordinates: the parameters in `free`, then zeros and initial states of
    /// the sessions, at `nuisances`. None if the model cannot be simulated.
    pub fn linearised(
        &self,
        model: &Model<f64>,
        free: &[ParameterId],
        nuisances: &[Nuisance],
    ) -> Option<(DVector<f64>, DMatrix<f64>)> {
        Problem::new(self, model, free, Compared::Fitted)
            .at_level(self.level)
            .with_nuisances(nuisances)
            .dense()
    }

    /// The `count` initial guesses with the least predicted SSE.
    pub fn least_predicted(
        &self,
        starts: &[Model<f64>],
        free: &[ParameterId],
        count: usize,
    ) -> Vec<(f64, Model<f64>)> {
        let mut ranked: Vec<(f64, Model<f64>)> = starts
            .par_iter()
            .map(|start| (self.predicted_sse(start, free), *start))
            .collect();
        ranked.retain(|(sse, _)| sse.is_finite());
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked.truncate(count);
        ranked
    }
}

/// Errors of a model on the held-out segments.
#[derive(Clone, Debug)]
pub struct Validation {
    /// Simulated minus measured angle (rad), one series per held-out segment.
    pub residuals: Vec<Vec<f64>>,
    /// Zeros and initial state of each session.
    pub nuisances: Vec<Nuisance>,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::Session;
    use crate::estimate::dataset::Mark;
    use model_core::dynamics::Dynamics;
    use softrig_formats::recording::{CalibrationMeta, Recording};

    fn swing() -> Recording {
        let time: Vec<f64> = (0..200).map(|k| f64::from(k) * 0.01).collect();
        Recording {
            pressure: time.iter().map(|t| 20e3 * (1.0 - t.cos())).collect(),
            angle: time.iter().map(|t| 0.5 * (1.0 - t.cos())).collect(),
            time,
            ..Recording::default()
        }
    }

    /// What an interrupted run has left must not be taken for the fit to samples that
    /// are now left out, or with zeros that are now better known.
    #[test]
    fn fits_under_other_knowledge_are_not_the_same() {
        let dynamics = Dynamics {
            inertia: 0.3,
            damping: 1.6,
            stiffness: 3.8,
            exponent: 1.7,
            input_gain: 1.2e-4,
        };
        let model = Model::new(dynamics, &[]).unwrap();
        let mut dated = swing();
        dated.meta.started = Some("2024-05-01T12:00:00Z".into());
        let mut calibrated = dated.clone();
        calibrated.meta.calibration = Some(CalibrationMeta {
            pressure_zero_sd_kpa: Some(0.1),
            angle_zero_sd_deg: None,
        });
        let data = |recording: Recording, silent: Vec<std::ops::Range<usize>>| {
            let mark = Mark {
                range: 0..recording.len(),
                about: Recording::default(),
                fitted: true,
            };
            let mut data = Dataset::default();
            data.push(Session::new(recording, 0.0, silent), vec![mark]);
            data
        };
        let beyond = std::iter::once(100..120).collect();
        let mut found: Vec<u64> = [
            data(swing(), Vec::new()),
            data(swing(), beyond),
            data(dated, Vec::new()),
            data(calibrated, Vec::new()),
        ]
        .map(|data| {
            let fitter = Fitter::new(&model, &data);
            fitter.fingerprint(&model, &[ParameterId::Damping], Effort::Full)
        })
        .into();
        found.sort_unstable();
        found.dedup();
        assert_eq!(found.len(), 4);
    }
}
