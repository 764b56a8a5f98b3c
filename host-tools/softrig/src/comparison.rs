//! Models beside recordings: the paper's Table III.
//!
//! For each set-point the recorded repeats are averaged, and the RMS error of every model against
//! that mean is given in degrees and in percent of the set-point.

use model_core::actuator::{Model, ParameterId};
use softrig_formats::error::InputError;
use softrig_formats::measurand::Measurand;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::{Recording, measurand};

use crate::diagnose::recordings::noise::NoiseFloor;
use crate::estimate::Dataset;
use crate::estimate::fit::{Effort, Residuals};
use crate::estimate::fitter::Fitter;
use crate::estimate::placement::without_law;
use crate::estimate::unit_errors;
use crate::prediction::Prediction;
use crate::sim::linear::linear_rival;
use crate::statistics::{mean, rms, squares_about_mean};

/// Models beside recordings.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// The runs.
    pub runs: Vec<Recording>,
    /// The runs by set-point.
    pub groups: Vec<Repeats>,
    /// The models.
    pub models: Vec<ComparedModel>,
}

impl Comparison {
    /// Simulates models over the sessions of `data`; with `linear`, also the paper's linear rival
    /// of the first model, refitted to the same sessions.
    pub fn of(files: &[ModelFile], data: &Dataset, linear: bool) -> Self {
        let runs = data.recordings(true);
        let groups = groups(&runs);
        let mut models: Vec<ComparedModel> = files
            .iter()
            .map(|file| ComparedModel::of(name_of(file, files), &file.model, data, &groups))
            .collect();
        if let Some(first) = files.first().filter(|_| linear) {
            let rival = linear_rival(&first.model, data.largest_angle());
            let fitter = Fitter::new(&rival, data);
            let free: Vec<_> = first
                .free
                .iter()
                .copied()
                .filter(|id| *id != ParameterId::Exponent && rival.value(*id).is_some())
                .collect();
            let fitted = fitter.fit(&rival, &free, Effort::Full);
            let name = "linear rival, refitted".to_owned();
            models.push(ComparedModel {
                is_rival: true,
                ..ComparedModel::of(name, &fitted.model, data, &groups)
            });
        }
        Self {
            runs,
            groups,
            models,
        }
    }

    /// What the output is.
    pub fn measurand(&self) -> Measurand {
        measurand(&self.runs)
    }

    /// Adds somebody else's predictions of the same runs.
    ///
    /// # Errors
    ///
    /// Names a recording without any.
    pub fn with_prediction(mut self, prediction: &Prediction) -> Result<Self, InputError> {
        let residuals: Residuals = self
            .runs
            .iter()
            .map(|run| prediction.residual(run))
            .collect::<Result<_, _>>()?;
        let name = prediction.column.clone();
        let compared = ComparedModel::of_residuals(name, residuals, &self.groups);
        self.models.push(compared);
        Ok(self)
    }
}

/// Refuses recordings that no model can be compared with: their columns hold something else than
/// their header says. Of several models, one that agrees with them as they are is enough. Returns
/// what a setup says of the rig that a model has no law for.
///
/// # Errors
///
/// Names the recordings, the columns, and the flags that say what they hold.
pub fn check_comparable<'a>(
    files: impl IntoIterator<Item = &'a ModelFile>,
    recordings: &[Recording],
) -> Result<Vec<String>, InputError> {
    let mut warnings: Vec<String> = Vec::new();
    let mut refused: Option<InputError> = None;
    let mut agrees = false;
    for file in files {
        match unit_errors::refuse(file, recordings) {
            Ok(()) => agrees = true,
            Err(error) => {
                refused.get_or_insert(error);
            }
        }
        let missing = recordings.iter().find_map(|recording| {
            let setup = recording.meta.setup.as_ref()?;
            Some((recording, without_law(setup, file)?))
        });
        warnings.extend(missing.map(|(recording, (key, lacks, advice))| {
            let found = format!("[setup] of {} has {key}, and {lacks}", recording.name);
            let error = InputError::new(found, advice).in_file(&file.path);
            format!("{error}; it is simulated without")
        }));
    }
    match refused {
        Some(error) if !agrees => Err(error),
        _ => Ok(warnings),
    }
}

/// The name of a model, or that of its file if another has the same.
fn name_of(file: &ModelFile, all: &[ModelFile]) -> String {
    let alike = all.iter().filter(|other| other.name == file.name).count();
    match file.path.file_name() {
        Some(path) if alike > 1 => path.to_string_lossy().into_owned(),
        _ => file.name.clone(),
    }
}

/// Errors of one model at one set-point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelError {
    /// RMS error against the mean of the repeats (°).
    pub rms_deg: f64,
    /// The same in percent of the set-point; not finite where that is zero.
    pub percent: f64,
}

/// A model beside the recordings.
#[derive(Clone, Debug)]
pub struct ComparedModel {
    /// Its name.
    pub name: String,
    /// Simulated minus measured angle (rad), one series per run.
    pub residuals: Residuals,
    /// Its error at each set-point.
    pub errors: Vec<ModelError>,
    /// Whether it is the linear rival.
    pub is_rival: bool,
}

impl ComparedModel {
    /// Simulates the model over the sessions.
    fn of(name: String, model: &Model<f64>, data: &Dataset, groups: &[Repeats]) -> Self {
        let residuals = Fitter::new(model, data).compare(model).residuals;
        Self::of_residuals(name, residuals, groups)
    }

    /// By its residuals on each run: the error against the mean of repeats is the mean of the errors
    /// on each. Samples without one do not count.
    fn of_residuals(name: String, residuals: Residuals, groups: &[Repeats]) -> Self {
        let errors = groups
            .iter()
            .map(|group| {
                let mut error = average(&group.of(&residuals));
                error.retain(|it| it.is_finite());
                let rms_deg = rms(&error).to_degrees();
                ModelError {
                    rms_deg,
                    percent: 100.0 * rms_deg / group.setpoint_deg.abs(),
                }
            })
            .collect();
        Self {
            name,
            residuals,
            errors,
            is_rival: false,
        }
    }
}

/// Runs to one set-point.
#[derive(Clone, Debug)]
pub struct Repeats {
    /// Name of the first.
    pub label: String,
    /// The set-point (°): as recorded, as in the metadata, or the largest angle that is held.
    pub setpoint_deg: f64,
    /// Their indices among all runs.
    pub runs: Vec<usize>,
}

impl Repeats {
    /// The series of its runs, from those of all runs.
    pub fn of<'a>(&self, all: &'a [Vec<f64>]) -> Vec<&'a [f64]> {
        self.runs.iter().map(|&run| all[run].as_slice()).collect()
    }
}

fn groups(runs: &[Recording]) -> Vec<Repeats> {
    let mut sets = NoiseFloor::of(runs).groups;
    for index in 0..runs.len() {
        if !sets.iter().any(|set| set.contains(&index)) {
            sets.push(vec![index]);
        }
    }
    sets.sort();
    sets.into_iter()
        .map(|set| {
            let angles: Vec<&[f64]> = set.iter().map(|&run| runs[run].angle.as_slice()).collect();
            Repeats {
                label: runs[set[0]].name.clone(),
                setpoint_deg: setpoint_deg(&runs[set[0]], &average(&angles)),
                runs: set,
            }
        })
        .collect()
}

/// Mean of repeats, sample by sample.
pub fn average(members: &[&[f64]]) -> Vec<f64> {
    across(members, mean)
}

/// Standard deviation of one repeat, sample by sample; none of a single run.
pub fn deviation(members: &[&[f64]]) -> Option<Vec<f64>> {
    let free = members.len().checked_sub(1).filter(|free| *free > 0)?;
    let of_sample = |values: &[f64]| (squares_about_mean(values) / free as f64).sqrt();
    Some(across(members, of_sample))
}

/// Applies `number` to each sample that all repeats have.
fn across(members: &[&[f64]], number: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    let count = members.iter().map(|member| member.len()).min().unwrap_or(0);
    (0..count)
        .map(|k| {
            let values: Vec<f64> = members.iter().map(|member| member[k]).collect();
            number(&values)
        })
        .collect()
}

/// The set-point of a run (°): as recorded, as in the metadata, or the largest
/// angle that the run holds.
fn setpoint_deg(recording: &Recording, average: &[f64]) -> f64 {
    let recorded = recording.column("setpoint_deg").map(|column| {
        column
            .iter()
            .copied()
            .filter(|value| value.is_finite())
            .fold(0.0, |largest: f64, value| {
                if value.abs() > largest.abs() {
                    value
                } else {
                    largest
                }
            })
    });
    recorded
        .filter(|setpoint| *setpoint != 0.0)
        .or(recording.meta.setpoint_deg)
        .unwrap_or_else(|| {
            let mut angles: Vec<f64> = average.iter().map(|angle| angle.abs()).collect();
            angles.sort_unstable_by(f64::total_cmp);
            // A tenth of the run above it: overshoot does not count.
            angles[angles.len() - 1 - angles.len() / 10].to_degrees()
        })
}

impl ModelError {
    /// The error in the unit of the output and, where that means something, in percent of the
    /// set-point.
    pub fn shown(&self, measurand: &Measurand) -> String {
        let Self { rms_deg, percent } = self;
        let unit = measurand.unit();
        if percent.is_finite() {
            format!("{rms_deg:.2}{unit} ({percent:.1} %)")
        } else {
            format!("{rms_deg:.2}{unit}")
        }
    }
}
