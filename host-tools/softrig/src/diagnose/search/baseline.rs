//! The model before any effect is added: the nominal one, and its structure refitted.
//!
//! Every candidate is compared with the refit, since a wrong parameter is not a missing
//! effect. If the refit leaves only noise, nothing is missing.

use model_core::actuator::Model;

use crate::diagnose::decide::Remains;
use crate::diagnose::evidence::measure::leaves_beyond;
use crate::diagnose::evidence::validation::CrossValidator;
use crate::diagnose::fit::candidates::Candidate;
use crate::diagnose::fit::identifiability::{self, Identifiability, NominalRefit};
use crate::diagnose::recordings::noise::NoiseFloor;
use crate::diagnose::work::job::Job;
use crate::diagnose::work::policy::{Policy, Search};
use crate::diagnose::work::progress::Stage;
use crate::diagnose::work::request::Request;
use crate::estimate::Dataset;
use crate::estimate::fit::{Effort, Fit};
use crate::estimate::fitter::Fitter;
use crate::estimate::identify::{EXPONENTS, identify};
use crate::estimate::usable::Concern;
use crate::statistics::{correlation_time, rms, swing};
use softrig_formats::error::InputError;
use softrig_formats::model_file::ModelFile;

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

/// Multiple of the largest angle beyond which a simulation has left the recordings.
const FAR: f64 = 100.0;

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
        job: &Job,
    ) -> Result<Self, InputError> {
        job.progress.stage(Stage::Refit, 0);
        let nominal = &request.file.model;
        let fitter = Fitter::new(nominal, data);
        let supplied = fitter.compare(nominal);
        // A simulation that diverges misses by nothing that means anything.
        let misses = Some(supplied.rmse()).filter(|it| *it < FAR * data.largest_angle());
        job.progress.shows(data.measurand());
        job.progress.knows(|known| known.supplied = misses);
        let NominalRefit {
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
        job.progress
            .knows(|known| known.refit = Some(refit.fit.rmse()));
        let data = with_guesses(data, &refit.fit);
        let guessed = Fitter::new(nominal, &data);
        Ok(Self {
            floor: floor
                .clone()
                .seen_by(&refit.fit, &data)
                .at_most(refit.fit.rmse())
                .with_input(&guessed, &refit.fit),
            nominal: supplied,
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
        if self.floor.covers(left) {
            return None;
        }
        let weight = left / self.floor.white * correlation_time(&residuals).sqrt();
        let data = self.data.weighing_zeros(weight.max(1.0));
        let fitter = Fitter::new(&self.file.model, &data);
        let free = &self.file.free;
        let near = fitter.fit(&self.refit.fit.model, free, Effort::Full);
        // Zeros that may not move any more ask for another base model.
        let fit = identify(&self.refit.fit.model, free, &EXPONENTS, &data)
            .map(|it| it.released)
            .filter(|anew| anew.cost() < near.cost())
            .unwrap_or(near);
        let refit = Candidate::of(0, fit);
        Some(Self {
            nominal: fitter.compare(&self.nominal.model),
            data: with_guesses(&data, &refit.fit),
            refit,
            ..self.clone()
        })
    }

    /// Validation of structures beside the model as supplied, with the floor of all recordings.
    pub fn validator<'a>(&'a self, fitter: &'a Fitter<'a>) -> CrossValidator<'a> {
        let mut validator =
            CrossValidator::new(&self.file, fitter, self.floor.input).beside(self.nominal.model);
        validator.raise_floor(self.floor.rms);
        validator
    }

    /// Whether only noise is left without any effect.
    pub fn find_quiet(&self, validator: &CrossValidator<'_>) -> Option<Remains> {
        let refitted = if self.floor.is_all_that_remains(&self.nominal) {
            false
        } else if self.floor.is_all_that_remains(&self.refit.fit) {
            self.were_parameters_off(validator)
        } else {
            return None;
        };
        Some(Remains::Noise { refitted })
    }

    /// Whether nothing that no effect explains matters: the refit leaves less than the
    /// tolerance beyond the noise, fitted and held out.
    pub fn immaterial(&self, validator: &CrossValidator<'_>) -> Option<Remains> {
        let errors = [self.refit.fit.rmse(), validator.error_of(&self.refit)];
        let left = leaves_beyond(errors, self.floor.total());
        (left <= tolerance(&self.data)).then(|| Remains::Little {
            refitted: self.were_parameters_off(validator),
        })
    }

    /// Whether the parameters were off: those that do not help on held-out segments were not.
    fn were_parameters_off(&self, validator: &CrossValidator<'_>) -> bool {
        let most = Search::STANDARD.first_leaves * validator.nominal_error();
        validator.error_of(&self.refit) < most
    }
}

/// What a model may be off without it mattering (rad): as the metadata say, or a share of the
/// range of the angle.
pub fn tolerance(data: &Dataset) -> f64 {
    let said = data
        .sessions()
        .iter()
        .filter_map(|session| session.recording().meta.tolerance_deg)
        .reduce(f64::min);
    said.map_or_else(
        || Policy::STANDARD.tolerance * swing_of_all(data),
        f64::to_radians,
    )
}

/// The range of the angle over all sessions (rad).
pub fn swing_of_all(data: &Dataset) -> f64 {
    let all = data.sessions().iter();
    let angles: Vec<f64> = all.flat_map(|it| it.recording().angle.clone()).collect();
    swing(&angles)
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
    use crate::synth::example::{Hidden, make};
    use model_core::catalogue::Kind;
    use softrig_formats::recording::Recording;
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

    /// What may remain is a share of the range, or what the metadata say: the strictest of them.
    #[test]
    fn what_may_remain_is_a_share_of_the_range_unless_it_is_said() {
        let ramp = |tolerance_deg| {
            let time: Vec<f64> = (0..500).map(|k| 0.01 * f64::from(k)).collect();
            let mut recording = Recording {
                pressure: time.iter().map(|t| 1e4 * t).collect(),
                angle: time.iter().map(|t| 0.2 * t).collect(),
                time,
                ..Recording::default()
            };
            recording.meta.tolerance_deg = tolerance_deg;
            recording
        };
        let of = |recordings: &[Recording]| tolerance(&Dataset::of(recordings));
        let range = 0.2 * 4.99;
        assert!((of(&[ramp(None)]) - 0.01 * range).abs() < 1e-9);
        let said = of(&[ramp(None), ramp(Some(0.5)), ramp(Some(0.3))]);
        assert!((said.to_degrees() - 0.3).abs() < 1e-9);
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
