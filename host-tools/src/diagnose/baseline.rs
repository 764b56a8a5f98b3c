//! The model before any effect is added: the nominal one, and its structure refitted.
//!
//! Every candidate is compared with the refit, since a wrong parameter is not a missing
//! effect. If the refit leaves only noise, nothing is missing.

use model_core::actuator::Model;

use super::candidates::Candidate;
use super::identifiability::{self, Identifiability, Refitted};
use super::noise::{NoiseFloor, adequate};
use super::policy::Exact;
use super::validation::CrossValidator;
use super::verdict::Answer;
use super::{Progress, Request};
use crate::estimate::Dataset;
use crate::estimate::fit::{Effort, Fit, Fitter};
use crate::estimate::usable::Concern;
use crate::io::error::InputError;
use crate::io::model_file::ModelFile;
use crate::statistics::{correlation_time, rms};

/// The model before any effect is added.
#[derive(Clone, Debug)]
pub struct Baseline {
    /// The data, with guesses of zeros and initial states from the refit.
    pub data: Dataset,
    /// The model file, with the parameters that are still free.
    pub file: ModelFile,
    /// The comparison of the nominal model with the recordings.
    pub nominal: Fit,
    /// The nominal structure, refitted.
    pub refit: Candidate,
    /// Which of its parameters the recordings determine.
    pub identified: Identifiability,
    /// What a person should know of the refit.
    pub remarks: Vec<Concern>,
    /// The noise floor, with the error from noise of the pressure.
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
        let Refitted {
            refit,
            file,
            identified,
            remarks,
        } = identifiability::refit(request.file, &fitter)
            .filter(|it| it.refit.fit.sse().is_finite())
            .ok_or_else(|| {
                InputError::new(
                    "the model cannot be simulated over these recordings: it diverges",
                    "check units and signs of its parameters",
                )
                .in_file(&request.file.path)
            })?;
        let data = with_guesses(data, &refit.fit);
        let guessed = Fitter::new(nominal, &data);
        Ok(Self {
            floor: floor.clone().with_input(&guessed, &refit.fit),
            nominal: fitter.compare(nominal),
            refit,
            file,
            identified,
            remarks,
            data,
        })
    }

    /// The same baseline with zeros weighed against the error of the `best` model (see
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
        let fit = fitter.fit(&self.refit.fit.model, &self.file.free, Effort::Full);
        let refit = Candidate::of(Vec::new(), fit);
        Some(Self {
            nominal: fitter.compare(&self.nominal.model),
            data: with_guesses(&data, &refit.fit),
            refit,
            ..self.clone()
        })
    }

    /// The answer if only noise is left without any effect.
    pub fn quiet(&self, validator: &CrossValidator<'_>) -> Option<Answer> {
        if adequate(&self.nominal, &self.floor) {
            return Some(Answer::NoDiscrepancy);
        }
        // Parameters that do not help on held-out segments were not off.
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

/// The data with the zeros and initial states of a fit, unless the fit is so poor
/// that they mean nothing.
fn with_guesses(data: &Dataset, fit: &Fit) -> Dataset {
    if in_step(data, fit) {
        data.guessing(&fit.nuisances)
    } else {
        data.clone()
    }
}

/// Whether simulation and recordings stay in phase: the residual is small
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::recording::Recording;
    use crate::synth::example::{Hidden, make};
    use model_core::catalogue::Kind;
    use std::path::Path;

    /// The zero of the pressure sensor (Pa).
    const PRESSURE_ZERO: f64 = 300.0;

    /// The weight of a zero's deviation.
    const WEIGHT: f64 = 30.0;

    fn example(hidden: Hidden) -> (ModelFile, Dataset) {
        let example = make(hidden, 0.05, 3).unwrap();
        let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
        let recordings: Vec<Recording> = example
            .recordings
            .into_iter()
            .map(|(_, mut recording, _)| {
                recording
                    .pressure
                    .iter_mut()
                    .for_each(|p| *p += PRESSURE_ZERO);
                recording
            })
            .collect();
        (file, Dataset::of(&recordings))
    }

    fn pressure_zeros(file: &ModelFile, data: &Dataset) -> Vec<f64> {
        let fitter = Fitter::new(&file.model, data);
        let fit = fitter.fit(&file.model, &file.free, Effort::Full);
        fit.nuisances.iter().map(|it| it.pressure_zero).collect()
    }

    /// The recordings say so much of a zero that a weight does not move it.
    #[test]
    fn the_right_structure_finds_true_zeros_whatever_they_weigh() {
        let (file, data) = example(Hidden::Nothing);
        for zero in pressure_zeros(&file, &data.weighing_zeros(WEIGHT)) {
            assert!(
                (zero - PRESSURE_ZERO).abs() < 0.1 * PRESSURE_ZERO,
                "{zero} Pa"
            );
        }
    }

    /// A refit that lacks an effect bends zeros to hide it; less so where they weigh more.
    #[test]
    fn zeros_that_weigh_hide_less() {
        let (file, data) = example(Hidden::Effect(Kind::CubicStiffness));
        let spread = |data: &Dataset| {
            let zeros = pressure_zeros(&file, data);
            let mean = zeros.iter().sum::<f64>() / zeros.len() as f64;
            rms(&zeros.iter().map(|zero| zero - mean).collect::<Vec<_>>())
        };
        let (free, weighed) = (spread(&data), spread(&data.weighing_zeros(WEIGHT)));
        assert!(weighed < 0.5 * free, "{weighed} Pa and {free} Pa");
    }
}
