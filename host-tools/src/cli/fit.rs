//! `rig fit`: the parameters of a model from recordings.

use std::path::PathBuf;

use clap::Parser;
use schemars::JsonSchema;
use serde::Serialize;

use super::input::InputArgs;
use super::json::{JsonArgs, Parameter, SCHEMA};
use super::output::{self, FileKind, Output};
use softrig::diagnose::verdict::Zeros;
use softrig::estimate::fit::{Fit, rms_each};
use softrig::estimate::refit::{NOT_CONVERGED, Refit, refit};
use softrig_formats::error::write_atomically;
use softrig_formats::model_file::{ModelFile, parameter_name, parameter_unit, to_file_units};
use softrig_formats::numbers::{short, tidy, with_ends};
use softrig_formats::recording::Recording;

/// Fits the free parameters of a model to recordings.
///
/// The model is simulated over the measured pressure and compared with the
/// measured angle; `[fit] free` in the model file says what may move.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  rig fit --model m.toml step60_*.csv step90_*.csv -o fitted.toml
  rig fit --model m.toml step60_*.csv --json -")]
pub struct Args {
    /// Model file
    #[arg(long, value_name = "MODEL.toml")]
    model: PathBuf,
    /// Recordings
    #[arg(required = true, value_name = "REC.csv")]
    recordings: Vec<PathBuf>,
    /// Write the fitted model
    #[arg(short, long, value_name = "FITTED.toml")]
    output: Option<PathBuf>,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    input: InputArgs,
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let read = args.recordings.iter().chain([&args.model]);
    output::check(
        &[
            Output::of("-o", FileKind::Model, args.output.as_ref()),
            args.json.output(),
        ],
        read,
    )?;
    let (file, recordings) = super::read(&args.model, &args.recordings, &args.input.layout())?;
    let Refit {
        data,
        concerns,
        nominal,
        fitted: fit,
    } = refit(&file, &recordings)?;
    for concern in &concerns {
        super::warn(&concern.to_string());
    }
    let mut text = format!(
        "{}\n{}\n{}\n",
        parameter_table(&file, &fit),
        error_table(&data.recordings(true), &nominal, &fit),
        Zeros::of(&fit, &data)
    );
    if !fit.converged {
        super::warn(NOT_CONVERGED);
    }
    if let Some(path) = &args.output {
        let model = file.text_with(&fit.model, "");
        write_atomically(path, model.as_bytes())?;
        text += &format!("\nwritten: {}\n", path.display());
    }
    let warnings = concerns.iter().map(ToString::to_string);
    let not_converged = (!fit.converged).then(|| NOT_CONVERGED.to_owned());
    let result = FitResult {
        schema: SCHEMA,
        model: file.name.clone(),
        parameters: parameters(&file, &fit),
        rmse_deg: Errors::of("all".to_owned(), nominal.rmse(), fit.rmse()),
        recordings: errors(&data.recordings(true), &nominal, &fit),
        nuisance: Zeros::of(&fit, &data),
        converged: fit.converged,
        warnings: warnings.chain(not_converged).collect(),
    };
    args.json.deliver(&result, &text)
}

/// What `rig fit --json` writes.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct FitResult {
    /// Version of the layout.
    schema: u32,
    /// Name of the model.
    model: String,
    /// The free parameters, in the units of model files.
    parameters: Vec<Parameter>,
    /// RMS error over all recordings.
    rmse_deg: Errors,
    /// RMS error of each recording.
    recordings: Vec<Errors>,
    /// Zeros of the sensors.
    nuisance: Zeros,
    /// Whether the fit met its tolerance.
    converged: bool,
    /// What was said about recordings and fit.
    warnings: Vec<String>,
}

/// RMS errors before and after a fit.
#[derive(Clone, Debug, Serialize, JsonSchema)]
struct Errors {
    /// The recording, or `all`.
    name: String,
    /// As supplied (°).
    nominal: f64,
    /// As fitted (°).
    fitted: f64,
}

impl Errors {
    fn of(name: String, nominal: f64, fitted: f64) -> Self {
        Self {
            name,
            nominal: tidy(nominal.to_degrees()),
            fitted: tidy(fitted.to_degrees()),
        }
    }
}

fn errors(recordings: &[Recording], before: &Fit, after: &Fit) -> Vec<Errors> {
    let names = recordings.iter().map(|it| it.name.clone());
    let each = rms_each(before).into_iter().zip(rms_each(after));
    names
        .zip(each)
        .map(|(name, (before, after))| Errors::of(name, before, after))
        .collect()
}

/// The free parameters before and after.
fn parameters(file: &ModelFile, fit: &Fit) -> Vec<Parameter> {
    let free = fit.free.iter().enumerate();
    free.map(|(index, &id)| {
        let shown = |value: f64| tidy(to_file_units(&fit.model, id, value));
        let ends = fit.interval95(index);
        let ends = ends.filter(|(low, high)| low.is_finite() && high.is_finite());
        Parameter {
            name: parameter_name(&fit.model, id),
            unit: parameter_unit(&fit.model, id).to_owned(),
            nominal: file.model.value(id).map(shown),
            value: fit.model.value(id).map_or(f64::NAN, shown),
            interval95: ends.map(|(low, high)| [shown(low), shown(high)]),
            from: None,
        }
    })
    .collect()
}

/// Free parameters before and after, with their 95 % intervals.
pub(crate) fn parameter_table(file: &ModelFile, fit: &Fit) -> String {
    let mut text = format!(
        "{:<40} {:>11} {:>11}   {:<24}\n",
        "parameter", "nominal", "fitted", "95 % interval"
    );
    for (index, &id) in fit.free.iter().enumerate() {
        let shown = |value: f64| to_file_units(&fit.model, id, value);
        let nominal = file
            .model
            .value(id)
            .map_or_else(|| "–".to_owned(), |value| short(shown(value)));
        let fitted = fit.model.value(id).map_or(f64::NAN, shown);
        let (fitted, interval) = match fit.interval95(index) {
            Some((low, high)) if low.is_finite() && high.is_finite() => {
                let (fitted, [low, high]) = with_ends(fitted, [shown(low), shown(high)]);
                (fitted, format!("{low} … {high}"))
            }
            _ => (short(fitted), "not determined by these runs".to_owned()),
        };
        let name = parameter_name(&fit.model, id);
        let unit = parameter_unit(&fit.model, id);
        let label = if unit.is_empty() {
            name
        } else {
            format!("{name} ({unit})")
        };
        text += &format!("{label:<40} {nominal:>11} {fitted:>11}   {interval:<24}\n");
    }
    text
}

/// RMS error of each recording before and after.
fn error_table(recordings: &[Recording], before: &Fit, after: &Fit) -> String {
    let row = |name: &str, before: f64, after: f64| {
        let [before, after] = [before, after].map(|rms| short(rms.to_degrees()));
        format!("{name:<40} {before:>11} {after:>11}\n")
    };
    let mut text = format!(
        "{:<40} {:>11} {:>11}\n",
        "RMS error (°)", "nominal", "fitted"
    );
    for ((recording, before), after) in recordings.iter().zip(rms_each(before)).zip(rms_each(after))
    {
        text += &row(&recording.name, before, after);
    }
    text + &row("all", before.rmse(), after.rmse())
}
