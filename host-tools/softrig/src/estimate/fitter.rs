//! Fits: what is fitted, to which data, at which horizon.

use model_core::actuator::{Model, ParameterId};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::Dataset;
use super::filter::Level;
use super::fit::{Effort, Fit};
use super::nuisance::Nuisance;
use super::problem::{Problem, SampleSet};
use crate::estimate::checkpoint::{Checkpoint, SolverEnd, fingerprint};

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
        Problem::new(self.data, start, free, SampleSet::Fitted).at_level(self.level)
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
                &SolverEnd {
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
        Problem::new(self.data, &fit.model, &fit.free, SampleSet::Fitted)
            .at_level(self.level)
            .with_nuisances(&fit.nuisances)
            .into_fit(fit.converged, Effort::Full)
    }

    /// Simulates a model over the held-out segments. Zeros and initial state come from
    /// the fitted segments of the same session, or if there are none, from the session
    /// itself. Series are in the order of [`Dataset::held_out`].
    pub fn validate(&self, model: &Model<f64>) -> Validation {
        let (problem, _) =
            Problem::new(self.data, model, &[], SampleSet::Validated).solved(Effort::Coarse);
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
        let wider = Problem::new(self.data, &fit.model, &free, SampleSet::Fitted)
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
        let (problem, converged) = Problem::new(self.data, model, &[], SampleSet::Fitted)
            .with_nuisances(nuisances)
            .solved(NEAR);
        problem.into_fit(converged, NEAR)
    }

    /// Derivatives of the simulated angles by the free parameters of a fit to
    /// other recordings, in that fit's solver coordinates. What zeros and initial states
    /// can compensate is projected out. One row per fitted sample.
    pub fn derivatives(&self, fit: &Fit) -> DMatrix<f64> {
        let blocks = Problem::new(self.data, &fit.model, &fit.free, SampleSet::Fitted)
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
        Problem::new(self.data, start, free, SampleSet::Fitted)
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
        Problem::new(self.data, model, free, SampleSet::Fitted)
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
