//! Test recordings: simulated with the final models, from their first samples only.
//!
//! They choose nothing: the search does not see them, and validates by leaving runs out in turn.
//! The zeros of their sensors are those of the fitted recordings, in the mean.

use std::path::PathBuf;

use model_core::actuator::Model;
use rayon::prelude::*;

use crate::estimate::fit::Fit;
use crate::estimate::placement::Placement;
use crate::estimate::start_from::{StartFrom, error_of, simulate_from};
use crate::estimate::{Dataset, Nuisance, Session};
use crate::statistics::{mean, squares_about_mean};
use softrig_formats::recording::Recording;

/// RMS errors (rad) on one test recording.
#[derive(Clone, Debug, PartialEq)]
pub struct TestRun {
    /// Name of the recording.
    pub name: String,
    /// Its file.
    pub path: PathBuf,
    /// Where its initial state comes from.
    pub start: StartFrom,
    /// Number of samples that are scored.
    pub samples: usize,
    /// The model as supplied.
    pub nominal: f64,
    /// The nominal structure, refitted.
    pub refit: f64,
    /// The repaired model, in double precision.
    pub repaired: f64,
    /// RMS deviation of the measured angle from its mean.
    pub spread: f64,
}

/// A model as fitted, with the zeros of the fitted recordings.
#[derive(Clone, Copy, Debug)]
pub struct FittedModel<'a> {
    model: &'a Model<f64>,
    zeros: Nuisance,
}

impl<'a> FittedModel<'a> {
    /// With the mean zeros of the sessions of `data` that were fitted, at least in part.
    pub fn of(fit: &'a Fit, data: &Dataset) -> Self {
        let fitted = fit.nuisances.iter().enumerate();
        let of_fitted: Vec<&Nuisance> = fitted
            .filter(|(index, _)| !data.fitted_ranges(*index).is_empty())
            .map(|(_, nuisance)| nuisance)
            .collect();
        let mean_of = |zero: fn(&Nuisance) -> f64| {
            let zeros: Vec<f64> = of_fitted.iter().map(|it| zero(it)).collect();
            mean(&zeros)
        };
        Self {
            model: &fit.model,
            zeros: Nuisance {
                pressure_zero: mean_of(|it| it.pressure_zero),
                angle_zero: mean_of(|it| it.angle_zero),
                ..Nuisance::AT_ZERO
            },
        }
    }
}

/// Simulates the nominal, the refitted and the repaired model over a test recording, whose angle at
/// rest (rad) is subtracted as from those that were fitted.
fn run(
    recording: &Recording,
    start: StartFrom,
    models: &[FittedModel<'_>; 3],
    tube_mm: Option<f64>,
    subtracted: f64,
) -> TestRun {
    let moved = Recording {
        angle: recording.angle.iter().map(|it| it - subtracted).collect(),
        ..recording.clone()
    };
    let clock = recording.time.first().copied().unwrap_or(0.0);
    let placement = Placement::of_recording(recording, tube_mm);
    let session = Session::new(moved, clock, Vec::new()).standing(placement);
    let [nominal, refit, repaired] = models.map(|FittedModel { model, zeros }| {
        let simulated = simulate_from(model, &session, &zeros, start);
        error_of(&simulated, session.recording(), start)
    });
    let samples = recording.len().saturating_sub(start.used());
    TestRun {
        name: recording.name.clone(),
        path: recording.path.clone(),
        start,
        samples,
        nominal,
        refit,
        repaired,
        spread: (squares_about_mean(&recording.angle) / recording.len().max(1) as f64).sqrt(),
    }
}

/// Simulates the nominal, the refitted and the repaired model over test recordings.
pub fn runs(
    tests: &[(&Recording, StartFrom)],
    models: &[FittedModel<'_>; 3],
    data: &Dataset,
    subtracted: f64,
) -> Vec<TestRun> {
    let tube_mm = data.tube_mm();
    tests
        .par_iter()
        .map(|(recording, start)| run(recording, *start, models, tube_mm, subtracted))
        .collect()
}

/// RMS error (rad) over the samples of all test recordings.
pub fn rms_of(runs: &[TestRun], error: impl Fn(&TestRun) -> f64) -> f64 {
    let samples: usize = runs.iter().map(|run| run.samples).sum();
    let squares = runs
        .iter()
        .map(|run| run.samples as f64 * error(run).powi(2));
    (squares.sum::<f64>() / samples.max(1) as f64).sqrt()
}
