//! The model before any effect is added: the nominal one, and its structure refitted.
//!
//! Every candidate is held against the refit, for a wrong parameter is not a missing
//! effect. If it leaves only noise, nothing is missing.

use model_core::actuator::Model;

use super::candidates::Candidate;
use super::identifiability::{self, Identifiability};
use super::noise::{NoiseFloor, adequate};
use super::policy::Exact;
use super::validation::CrossValidator;
use super::verdict::Answer;
use super::{Progress, Request};
use crate::error::InputError;
use crate::estimate::Dataset;
use crate::estimate::fit::{Effort, Fit, Fitter};
use crate::model_file::ModelFile;
use crate::statistics::{correlation_time, rms};

/// The model before any effect is added.
#[derive(Clone, Debug)]
pub struct Baseline {
    /// The data, with guesses of zeros and starts from the refit.
    pub data: Dataset,
    /// The model file with what may still move.
    pub file: ModelFile,
    /// The nominal model against the recordings.
    pub nominal: Fit,
    /// The nominal structure, refitted.
    pub refit: Candidate,
    /// Which of its parameters the recordings determine.
    pub identified: Identifiability,
    /// The noise floor, with what the pressure's noise leaves.
    pub floor: NoiseFloor,
}

impl Baseline {
    /// Refits the nominal structure.
    ///
    /// # Errors
    ///
    /// Refuses a model that diverges over the recordings.
    pub fn of(
        request: &Request<'_>,
        data: &Dataset,
        floor: &NoiseFloor,
        progress: &Progress,
    ) -> Result<Self, InputError> {
        progress.stage("refit of the nominal structure", 0);
        let nominal = &request.file.model;
        let fitter = Fitter::new(nominal, data);
        let (refit, file, identified) = identifiability::refit(request.file, &fitter);
        if !refit.fit.sse().is_finite() {
            return Err(InputError::new(
                "the model cannot be simulated over these recordings: it diverges",
                "check units and signs of its parameters",
            )
            .in_file(&file.path));
        }
        let data = with_guesses(data, &refit.fit);
        let guessed = Fitter::new(nominal, &data);
        Ok(Self {
            floor: floor.clone().with_input(&guessed, &refit.fit, request.seed),
            nominal: fitter.compare(nominal),
            refit,
            file,
            identified,
            data,
        })
    }

    /// The same with zeros that are weighed against what the `best` model leaves (see
    /// [`crate::estimate::nuisance`]); none where that is hardly more than noise.
    pub fn weighing_zeros(&self, best: &Model<f64>) -> Option<Self> {
        let residuals = Fitter::new(&self.file.model, &self.data)
            .compare(best)
            .residuals;
        let left = rms(&residuals.concat());
        if left
            <= Exact::STANDARD.rms_factor
                * self
                    .floor
                    .rms
                    .hypot(Exact::STANDARD.input_factor * self.floor.input)
        {
            return None;
        }
        let weight = left / self.floor.white * correlation_time(&residuals).sqrt();
        let data = self.data.weighing_zeros(weight.max(1.0));
        let fitter = Fitter::new(&self.file.model, &data);
        let starts = [self.refit.fit.model, self.file.model];
        let fit = fitter.best_of(&starts, &self.file.free, Effort::Full)?;
        let refit = Candidate::of(Vec::new(), fit);
        Some(Self {
            data: with_guesses(&data, &refit.fit),
            refit,
            ..self.clone()
        })
    }

    /// The answer where nothing but noise is left without any effect.
    pub fn quiet(&self, validator: &CrossValidator<'_>) -> Option<Answer> {
        if adequate(&self.nominal, &self.floor) {
            return Some(Answer::NoDiscrepancy);
        }
        // Parameters that do not help where they were not fitted were not off.
        let helps = || {
            validator.error_of(&self.refit)
                < Exact::STANDARD.first_leaves * validator.nominal_error()
        };
        adequate(&self.refit.fit, &self.floor).then(|| {
            if helps() {
                Answer::ParametersOnly
            } else {
                Answer::NoDiscrepancy
            }
        })
    }
}

/// The data with zeros and starts as a fit found them, unless it is so far off
/// that they mean nothing.
fn with_guesses(data: &Dataset, fit: &Fit) -> Dataset {
    if in_step(data, fit) {
        data.guessing(&fit.nuisances)
    } else {
        data.clone()
    }
}

/// Whether simulation and recordings keep in step: what is left is small
/// against the motion.
pub fn in_step(data: &Dataset, fit: &Fit) -> bool {
    const SMALL: f64 = 0.15;
    let measured: f64 = data
        .fitted()
        .flat_map(|segment| &segment.recording.angle)
        .map(|angle| angle * angle)
        .sum();
    fit.sse() <= SMALL * SMALL * measured
}
