//! `rig fit`: the parameters of a model from recordings.

use std::path::PathBuf;

use clap::Parser;

use super::input::InputArgs;
use super::output::{self, FileKind, Output};
use softrig::diagnose::verdict::Zeros;
use softrig::estimate::fit::{Fit, rms_each};
use softrig::estimate::refit::{NOT_CONVERGED, Refit, refit};
use softrig_formats::error::write_atomically;
use softrig_formats::model_file::{ModelFile, parameter_unit, to_file_units};
use softrig_formats::numbers::{short, with_ends};
use softrig_formats::recording::Recording;

/// Fits the free parameters of a model to recordings.
///
/// The model is simulated over the measured pressure and compared with the
/// measured angle; `[fit] free` in the model file says what may move.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  rig fit --model m.toml step60_*.csv step90_*.csv -o fitted.toml")]
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
        &[Output::of("-o", FileKind::Model, args.output.as_ref())],
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
    Ok(super::print(&text)?)
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
        let name = softrig_formats::model_file::parameter_name(&fit.model, id);
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
