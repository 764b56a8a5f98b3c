//! `rig fit`: the parameters of a model from recordings.

use std::path::PathBuf;

use clap::Parser;

use super::input::InputArgs;
use super::output::{self, FileKind, Output};
use crate::diagnose::verdict::Zeros;
use crate::error::write_atomically;
use crate::estimate::fit::{Fit, rms_each};
use crate::estimate::refit::{NOT_CONVERGED, Refit, refit};
use crate::model_file::{ModelFile, parameter_unit, to_file_units};
use crate::recording::Recording;

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
            .map_or_else(|| "–".to_owned(), |value| number(shown(value)));
        let fitted = fit.model.value(id).map_or(f64::NAN, shown);
        let interval = match fit.interval95(index) {
            Some((low, high)) if low.is_finite() && high.is_finite() => {
                format!("{} … {}", number(shown(low)), number(shown(high)))
            }
            _ => "not determined by these runs".to_owned(),
        };
        let name = crate::model_file::parameter_name(&fit.model, id);
        let unit = parameter_unit(&fit.model, id);
        let label = if unit.is_empty() {
            name
        } else {
            format!("{name} ({unit})")
        };
        text += &format!(
            "{label:<40} {nominal:>11} {:>11}   {interval:<24}\n",
            number(fitted)
        );
    }
    text
}

/// RMS error of each recording before and after.
fn error_table(recordings: &[Recording], before: &Fit, after: &Fit) -> String {
    let mut text = format!(
        "{:<40} {:>11} {:>11}\n",
        "RMS error (°)", "nominal", "fitted"
    );
    for ((recording, before), after) in recordings.iter().zip(rms_each(before)).zip(rms_each(after))
    {
        text += &format!(
            "{:<40} {:>11.3} {:>11.3}\n",
            recording.name,
            before.to_degrees(),
            after.to_degrees()
        );
    }
    text += &format!(
        "{:<40} {:>11.3} {:>11.3}\n",
        "all",
        before.rmse().to_degrees(),
        after.rmse().to_degrees()
    );
    text
}

/// Four significant digits.
pub(crate) fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let magnitude = value.abs().log10().floor();
    if !(-4.0..6.0).contains(&magnitude) {
        return format!("{value:.3e}");
    }
    // Between 0 and 7 after the check.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let decimals = (3.0 - magnitude).clamp(0.0, 7.0) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::number;

    #[test]
    fn numbers_keep_four_digits() {
        for (value, text) in [
            (0.0, "0"),
            (0.36, "0.3600"),
            (-63.4, "-63.40"),
            (209_872.0, "209872"),
            (2.17e-5, "2.170e-5"),
        ] {
            assert_eq!(number(value), text);
        }
    }
}
