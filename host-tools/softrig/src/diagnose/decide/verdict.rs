//! The verdict as data: what `--json` writes, and its schema.

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::diagnose::evidence::free_run::TestRun;
use crate::diagnose::evidence::measure::Closure;
use crate::estimate::Dataset;
use crate::estimate::fit::Fit;
use crate::prediction::StandIn;
use softrig_formats::bounded::read_text;
use softrig_formats::error::InputError;
use softrig_formats::left_out::LeftOut;
use softrig_formats::measurand::Measurand;
use softrig_formats::numbers::tidy;
use softrig_formats::recording::PASCAL_PER_KPA;
use softrig_formats::settings_file::Zeros as BoardZeros;

/// The schema number of this structure.
pub const SCHEMA: u32 = 1;

/// The answer to "what is missing?".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// One or several effects are named.
    EffectFound,
    /// The structure is right; only parameters were off.
    ParametersOnly,
    /// The nominal model is already at the noise floor.
    NoDiscrepancy,
    /// Several effects explain the recordings equally well.
    CannotTell,
    /// The model is inadequate and no known effect restores it.
    Unexplained,
}

/// A verdict, as written to JSON.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Verdict {
    /// Number of this schema.
    pub schema: u32,
    /// The answer.
    pub verdict: Answer,
    /// How strongly an effect is named.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub strength: Option<Strength>,
    /// The family that all rivals of `cannot_tell` share; several for combinations,
    /// joined by " + ".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub family: Option<String>,
    /// The named effects.
    pub effects: Vec<NamedEffect>,
    /// Rival explanations, best first; the answer set of `cannot_tell`.
    pub alternatives: Vec<Alternative>,
    /// Whether the repaired model is adequate.
    pub adequacy: Adequacy,
    /// What a model may be off without it mattering, in degrees: if no effect explains more,
    /// nothing that matters is missing.
    pub tolerance_deg: f64,
    /// Share of the error beyond the noise that the repaired model removes on held-out
    /// runs, at three horizons.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub closure: Option<Closure>,
    /// Remaining error, on held-out runs, of the model that `-o` writes.
    pub remaining: Remaining,
    /// What `-o` adds to the model although no effect is named and no answer set given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub repair: Option<Repair>,
    /// Features that the missing force goes with, strongest first.
    #[serde(rename = "where")]
    pub places: Vec<Place>,
    /// Features of responses to steps in which the refitted model is off the same way in most of them.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub steps: Vec<Step>,
    /// RMS error on the fitted recordings, in degrees.
    pub rmse_deg: FittedError,
    /// RMS error on held-out recordings, in degrees.
    pub holdout_rmse_deg: HeldOutError,
    /// Errors on test recordings, which chose nothing (`--start-from`); absent if there are none.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub test: Vec<TestError>,
    /// Zeros of the sensors, one number per fitted session.
    #[serde(default)]
    pub nuisance: Zeros,
    /// Whether the model that `-o` writes is worth an upload: it predicts held-out runs better
    /// than the supplied one, on the board as well, and a board can run it.
    #[serde(default)]
    pub upload: bool,
    /// Why the model that `-o` writes is not worth an upload although it predicts better on the computer.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub upload_refused: Option<String>,
    /// Runs that would separate the remaining rivals.
    pub next_experiment: Vec<Experiment>,
    /// What is said to lack something, where that is not the model but somebody else's simulation, known
    /// by its predictions alone.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub simulation: Option<StandIn>,
    /// What ended the search early; absent if it was completed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ended: Option<EndedBy>,
    /// What was not tried in that case: effects by kind, and other parts of the search.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub not_tried: Vec<String>,
    /// What was left out of the files, or changed in them.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub left_out: Vec<LeftOut>,
    /// Files that were fitted, then files held out.
    pub recordings: Vec<String>,
    /// Random seed.
    pub seed: u64,
    /// Version of the tool.
    pub tool_version: String,
    /// Wall time in seconds.
    pub seconds: f64,
}

/// What ended a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EndedBy {
    /// The time that it was given.
    Budget,
}

/// How strongly an effect is named.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Strength {
    /// It removes two thirds of the error beyond the noise, or more.
    Explains,
    /// It removes a quarter to two thirds.
    Part,
}

/// The remaining error of a model.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Remaining {
    /// RMS error on held-out runs, in degrees.
    pub rmse_deg: f64,
    /// The same error in units of the noise floor.
    pub times_noise: f64,
    /// The feature that the remaining missing force goes with; absent if there is none in
    /// particular.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub goes_with: Option<String>,
}

/// A repair without a named effect.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Repair {
    /// Kind of the first added effect.
    pub kind: String,
    /// The variable of a table; otherwise the kinds of all added effects.
    pub of: Vec<String>,
}

/// An effect with its parameters in the units of model files.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct NamedEffect {
    /// Kind, as in model files.
    pub kind: String,
    /// Parameters by key.
    pub parameters: serde_json::Map<String, serde_json::Value>,
    /// 95 % intervals by key, of the parameters that were fitted.
    pub interval95: serde_json::Map<String, serde_json::Value>,
    /// Probability among the tried rivals.
    pub probability: f64,
    /// The formula of a force that no effect of the catalogue makes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub formula: Option<String>,
    /// What that is, in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub title: Option<String>,
    /// Other formulas that push alike in these recordings.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub alike: Vec<String>,
}

/// A rival explanation.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Alternative {
    /// Its effects.
    pub kinds: Vec<String>,
    /// The formulas of those that no effect of the catalogue makes.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub formulas: Vec<String>,
    /// Probability among the explanations of the same size.
    pub probability: f64,
    /// Twice the logarithm of how much less likely the held-out runs are than under the best.
    pub delta_bic: f64,
}

/// Whether the repaired model is adequate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Adequacy {
    /// Whether the residual of the final model cannot be distinguished from noise.
    pub adequate: bool,
    /// Share of the held-out gap between refit and noise floor that the repair
    /// removes.
    pub holdout_gap_closed: f64,
    /// Whether the formula itself fits, or only its kind.
    pub exact_form: bool,
}

/// A feature that the missing force goes with.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Place {
    /// The feature.
    pub feature: String,
    /// Share of the missing force, 0 to 1.
    pub share_of_gap: f64,
    /// A sentence.
    pub text: String,
}

/// A feature of the response to steps of the pressure.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Step {
    /// Its name, with its unit.
    pub feature: String,
    /// Median over the steps, as measured.
    pub measured: f64,
    /// The same, as the refitted model simulates them.
    pub simulated: f64,
    /// Steps in which it could be read.
    pub steps: usize,
    /// Those in which it is off in this direction.
    pub alike: usize,
}

/// RMS errors on fitted recordings, in degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct FittedError {
    /// The model as supplied.
    pub nominal: f64,
    /// The same structure, refitted.
    pub refit: f64,
    /// With the named effects; equal to `refit` where there are none.
    pub repaired: f64,
    /// What noise alone leaves.
    pub noise_floor: f64,
}

/// RMS errors on held-out recordings, in degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct HeldOutError {
    /// The model as supplied.
    pub nominal: f64,
    /// The same structure, refitted.
    pub refit: f64,
    /// With the named effects, as the board predicts; where a board cannot run that model or
    /// measure the pressure, in double precision, and then `upload` is false.
    pub repaired: f64,
}

/// RMS errors on a test recording, simulated over the whole of it; zeros are those of the fitted
/// recordings, and nothing is fitted to the rest.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct TestError {
    /// Its file.
    pub recording: String,
    /// Where its initial state comes from: a number of first samples, which are not scored;
    /// `rest`; or `period`, its own input played once before.
    pub start_from: String,
    /// Samples that are scored.
    pub samples: usize,
    /// The model as supplied, in degrees.
    pub nominal: f64,
    /// The same structure, refitted.
    pub refit: f64,
    /// The model that `-o` writes, in double precision.
    pub repaired: f64,
}

impl TestError {
    /// Of a test recording.
    pub fn of(run: &TestRun) -> Self {
        let degrees = |radians: f64| tidy(radians.to_degrees());
        Self {
            recording: run.path.display().to_string(),
            start_from: run.start.to_string(),
            samples: run.samples,
            nominal: degrees(run.nominal),
            refit: degrees(run.refit),
            repaired: degrees(run.repaired),
        }
    }
}

/// Zeros of the sensors, one number per session; see [`crate::estimate::nuisance`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Zeros {
    /// Reading of the pressure sensor without pressure (kPa).
    pub pressure_zero_kpa: Vec<f64>,
    /// Reading of the angle sensor at 0° (°).
    pub angle_zero_deg: Vec<f64>,
}

impl Zeros {
    /// The zeros of a fit, one number per session of which something was fitted.
    pub fn of(fit: &Fit, data: &Dataset) -> Self {
        let fitted = fit
            .nuisances
            .iter()
            .enumerate()
            .filter(|(index, _)| !data.fitted_ranges(*index).is_empty());
        let (pressure_zero_kpa, angle_zero_deg) = fitted
            .map(|(_, nuisance)| {
                (
                    tidy(nuisance.pressure_zero / PASCAL_PER_KPA),
                    tidy(nuisance.angle_zero.to_degrees()),
                )
            })
            .unzip();
        Self {
            pressure_zero_kpa,
            angle_zero_deg,
        }
    }
}

/// Reads the zeros of the last session from the file of a verdict, for a board.
///
/// # Errors
///
/// Says why the file has none.
pub fn read_zeros(path: &Path) -> Result<BoardZeros, InputError> {
    zeros_in(&read_text(path)?, path)
}

/// Those in the text of a verdict; `path` is only named in messages.
///
/// # Errors
///
/// Says why there are none.
pub fn zeros_in(text: &str, path: &Path) -> Result<BoardZeros, InputError> {
    #[derive(Deserialize)]
    struct Written {
        nuisance: Option<Zeros>,
    }
    let verdict: Written = serde_json::from_str(text).map_err(|error| {
        let mut fault = InputError::new(
            format!("is not a verdict: {error}"),
            "give the file that `softrig diagnose --json` wrote",
        )
        .in_file(path);
        fault.line = Some(error.line() as u64);
        fault
    })?;
    let last = verdict.nuisance.and_then(|zeros| {
        Some(BoardZeros {
            pressure_kpa: *zeros.pressure_zero_kpa.last()?,
            angle_deg: *zeros.angle_zero_deg.last()?,
        })
    });
    last.ok_or_else(|| {
        InputError::new(
            "has no zeros",
            "diagnose again with this version of `softrig`, or leave --zeros away",
        )
        .in_file(path)
    })
}

impl Zeros {
    /// One line: the zeros of one session, or the range over several. Empty if there are none.
    pub fn sentence(&self, measurand: &Measurand) -> String {
        let range = |values: &[f64], unit: &str| {
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if values.len() > 1 {
                format!("{low:+.2} … {high:+.2}{unit}")
            } else {
                format!("{low:+.2}{unit}")
            }
        };
        let of = match self.angle_zero_deg.len() {
            0 => return String::new(),
            1 => String::new(),
            count => format!(" of {count} sessions"),
        };
        format!(
            "Zeros{of}, estimated with the model: pressure {}, {} {}.",
            range(&self.pressure_zero_kpa, " kPa"),
            measurand.name(),
            range(&self.angle_zero_deg, measurand.unit())
        )
    }
}

/// A run that would separate rivals.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Experiment {
    /// Name of the protocol.
    pub protocol: String,
    /// By how much the base is to be turned for it (°), if it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tilt_deg: Option<f64>,
    /// What is to hang at the tip (g), if it is to change.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tip_load_g: Option<f64>,
    /// The length of the tube (mm), if it is to change.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tube_mm: Option<f64>,
    /// How long it is to rest before (s), if it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rested_s: Option<f64>,
    /// Minutes of work and waiting, with the run.
    pub work_min: f64,
    /// The rivals that it separates.
    pub separates: Vec<String>,
    /// Expected evidence.
    pub expected_delta_chi2: f64,
}

/// The JSON Schema of a verdict.
pub fn schema() -> serde_json::Value {
    schemars::schema_for!(Verdict).into()
}
