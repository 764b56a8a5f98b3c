//! `rig gap`: how well the board itself predicts.
//!
//! The firmware steps the uploaded model beside the actuator and logs its angle
//! next to the measured one. This command needs no model and fits nothing: it
//! subtracts two columns of a recording, and so shows what an upload was worth.

use std::path::PathBuf;

use clap::Parser;

use crate::error::InputError;
use crate::plot::{Figure, Panel, Series, Style, write_svg};
use crate::recording::{Recording, read_all};
use crate::statistics::rms;

/// Shows the gap between the angle that the board predicts and the angle that
/// it measures, before and after an upload.
///
/// The prediction is the column predicted_deg that `rig record` writes: the
/// model on the board, stepped on the board, fed with the measured pressure.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  rig gap run_*.csv
  rig gap before/*.csv --after after/*.csv --plot gap.svg")]
pub struct Args {
    /// Recordings, made with the model at hand or before the upload
    #[arg(required = true, value_name = "REC.csv")]
    recordings: Vec<PathBuf>,
    /// Recordings made after the upload
    #[arg(long, num_args = 1.., value_name = "REC.csv")]
    after: Vec<PathBuf>,
    /// Draw the worst recording, before and after, with what the model leaves
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    super::check_outputs([&args.plot])?;
    super::check_distinct(&args.recordings, &args.after)?;
    let before = gaps(&args.recordings)?;
    let after = gaps(&args.after)?;
    let mut text = table(&before, &after);
    if let Some(path) = &args.plot {
        write_svg(path, &figure(&before, &after))?;
        text += &format!("\npicture: {}\n", path.display());
    }
    Ok(super::print(&text)?)
}

/// One recording with the board's prediction, in degrees.
struct Gap {
    name: String,
    time: Vec<f64>,
    measured: Vec<f64>,
    predicted: Vec<f64>,
}

impl Gap {
    fn of(recording: &Recording) -> Result<Self, InputError> {
        let predicted = recording
            .column("predicted_deg")
            .filter(|column| column.iter().any(|value| value.is_finite()))
            .ok_or_else(|| {
                InputError::new(
                    "has no column predicted_deg with numbers in it",
                    "give recordings of `rig record`: the board logs its prediction in them",
                )
                .in_file(&recording.path)
            })?;
        Ok(Self {
            name: recording.name.clone(),
            time: recording.time.clone(),
            measured: recording.angle.iter().map(|a| a.to_degrees()).collect(),
            predicted,
        })
    }

    /// Predicted less measured, where the board predicted.
    fn errors(&self) -> Vec<f64> {
        self.predicted
            .iter()
            .zip(&self.measured)
            .map(|(predicted, measured)| predicted - measured)
            .collect()
    }

    fn finite_errors(&self) -> Vec<f64> {
        let mut errors = self.errors();
        errors.retain(|error| error.is_finite());
        errors
    }

    fn rms(&self) -> f64 {
        rms(&self.finite_errors())
    }

    fn largest(&self) -> f64 {
        self.finite_errors()
            .iter()
            .fold(0.0, |largest, error| largest.max(error.abs()))
    }
}

fn gaps(paths: &[PathBuf]) -> Result<Vec<Gap>, InputError> {
    let recordings = read_all(paths, super::warn)?;
    recordings.iter().map(Gap::of).collect()
}

/// RMS over all samples of all recordings.
fn overall(gaps: &[Gap]) -> f64 {
    rms(&gaps.iter().flat_map(Gap::finite_errors).collect::<Vec<_>>())
}

fn table(before: &[Gap], after: &[Gap]) -> String {
    let mut text = format!(
        "The board's own prediction less its flex sensor\n\n{:<28} {:>8} {:>12}\n",
        "recording", "RMS (°)", "largest (°)"
    );
    let mut rows = |title: &str, gaps: &[Gap]| {
        if gaps.is_empty() {
            return;
        }
        if !after.is_empty() {
            text += &format!("{title}\n");
        }
        for gap in gaps {
            let name: String = gap.name.chars().take(26).collect();
            text += &format!("  {name:<26} {:>8.3} {:>12.3}\n", gap.rms(), gap.largest());
        }
        if gaps.len() > 1 {
            let largest = gaps.iter().map(Gap::largest).fold(0.0, f64::max);
            text += &format!("  {:<26} {:>8.3} {largest:>12.3}\n", "all", overall(gaps));
        }
    };
    rows("before", before);
    rows("after", after);
    if !after.is_empty() {
        text += &format!("\n{}\n", sentence(before, after));
    }
    text
}

fn sentence(before: &[Gap], after: &[Gap]) -> String {
    let (before, after) = (overall(before), overall(after));
    let change = 100.0 * (1.0 - after / before);
    if change >= 1.0 {
        format!("The gap shrank from {before:.2}° to {after:.2}° RMS, by {change:.0} %.")
    } else if change > -1.0 {
        format!("The gap stayed at {after:.2}° RMS.")
    } else {
        format!(
            "The gap grew from {before:.2}° to {after:.2}° RMS: the upload made the prediction worse."
        )
    }
}

/// The recording with the largest gap before, and the same or the worst one
/// after.
fn figure(before: &[Gap], after: &[Gap]) -> Figure {
    let worst = |gaps: &'_ [Gap]| -> Option<usize> {
        (0..gaps.len()).max_by(|&a, &b| gaps[a].rms().total_cmp(&gaps[b].rms()))
    };
    let first = worst(before).map(|index| &before[index]);
    let second = first
        .and_then(|first| after.iter().find(|gap| gap.name == first.name))
        .or_else(|| worst(after).map(|index| &after[index]));
    let title = if after.is_empty() {
        "What the board predicts and what it measures".to_owned()
    } else {
        sentence(before, after)
    };
    let shown: Vec<(&Gap, &str, Style)> = [
        first.map(|gap| (gap, "before the upload", Style::BEFORE)),
        second.map(|gap| (gap, "after the upload", Style::AFTER)),
    ]
    .into_iter()
    .flatten()
    .collect();
    let mut figure = Figure::new(title)
        .with_subtitle(
            "Predicted on the microcontroller, from the measured pressure, while the run was made.",
        )
        .with_columns(shown.len().max(1))
        .with_separate_x();
    let alone = after.is_empty();
    for (gap, when, style) in &shown {
        let heading = if alone {
            gap.name.clone()
        } else {
            format!("{} ({when})", gap.name)
        };
        figure = figure.with_panel(
            Panel::new("time (s)", "angle (°)")
                .with_title(heading)
                .with_weight(1.6)
                .with_series(Series::new(
                    "measured",
                    &gap.time,
                    &gap.measured,
                    Style::MEASURED,
                ))
                .with_series(Series::new("predicted", &gap.time, &gap.predicted, *style)),
        );
    }
    let reach = shown
        .iter()
        .map(|(gap, ..)| gap.largest())
        .fold(0.1, f64::max);
    for (gap, _, style) in &shown {
        figure = figure.with_panel(
            Panel::new("time (s)", "predicted − measured (°)")
                .with_y_range(-1.1 * reach, 1.1 * reach)
                .with_level(0.0)
                .with_series(Series::new("", &gap.time, &gap.errors(), *style)),
        );
    }
    figure
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn recording(rows: &str) -> Recording {
        let text = format!("time_s,pressure_kpa,angle_deg,predicted_deg\n{rows}");
        Recording::parse(&text, Path::new("run.csv")).unwrap().0
    }

    #[test]
    fn the_gap_is_predicted_less_measured_where_both_exist() {
        let gap = Gap::of(&recording("0,0,1,4\n0.01,0,2,\n0.02,0,5,1\n")).unwrap();
        assert_eq!(gap.finite_errors().len(), 2);
        assert!((gap.rms() - 12.5_f64.sqrt()).abs() < 1e-12);
        assert!((gap.largest() - 4.0).abs() < 1e-12);
    }

    #[test]
    fn a_recording_without_predictions_is_refused() {
        assert!(Gap::of(&recording("0,0,1,\n0.01,0,2,\n")).is_err());
        let plain = Recording::parse(
            "time_s,pressure_kpa,angle_deg\n0,0,1\n0.01,0,2\n",
            Path::new("run.csv"),
        );
        let error = Gap::of(&plain.unwrap().0).err().unwrap().to_string();
        assert!(error.contains("predicted_deg"), "{error}");
    }

    #[test]
    fn a_worse_prediction_is_not_called_an_improvement() {
        let good = [Gap::of(&recording("0,0,1,1.1\n0.01,0,2,2.1\n")).unwrap()];
        let bad = [Gap::of(&recording("0,0,1,2\n0.01,0,2,3\n")).unwrap()];
        assert!(sentence(&bad, &good).contains("by 90 %"));
        assert!(sentence(&good, &bad).contains("grew"));
        assert!(sentence(&good, &good).contains("stayed"));
    }
}
