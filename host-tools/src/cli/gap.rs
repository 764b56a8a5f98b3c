//! `softrig gap`: the error of the board's own prediction.
//!
//! The firmware simulates the uploaded model beside the actuator and logs the predicted
//! angle next to the measured one. This command needs no model and fits nothing: it
//! subtracts two columns of a recording, before and after an upload.

use std::path::PathBuf;

use clap::Parser;

use super::input::InputArgs;
use super::json::JsonArgs;
use super::output::{self, FileKind, Output};
use super::picture::PictureArgs;
use softrig::board_gap::{BoardGap, GapOf, PredictedRun, predicted_runs};
use softrig_formats::columns::Layout;
use softrig_formats::error::InputError;
use softrig_formats::recording::{check_distinct, read_all};
use softrig_report::gap::gap_figure;

/// Shows the gap between the angle that the board predicts and the angle that
/// it measures, before and after an upload.
///
/// The prediction is the column predicted_deg that `softrig record` writes: the board
/// simulates its model from the measured pressure. In a session, only runs listed in its metadata
/// count.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig gap run.csv
  softrig gap before/run.csv --after after/run.csv --plot gap.svg
  softrig gap before/run.csv --after after/run.csv --json gap.json")]
pub struct Args {
    /// Recordings made with the present model, or before the upload
    #[arg(required = true, value_name = "REC.csv")]
    recordings: Vec<PathBuf>,
    /// Recordings made after the upload
    #[arg(long, num_args = 1.., value_name = "REC.csv")]
    after: Vec<PathBuf>,
    /// Draw the worst run, before and after, with its errors. Runs before and after are
    /// matched by name, else by set-point and repeat, else by their order
    #[arg(long, value_name = "FILE.svg|pdf|png")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    picture: PictureArgs,
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let read = args.recordings.iter().chain(&args.after);
    args.picture.check("--plot", args.plot.as_ref())?;
    output::check(
        &[
            Output::of("--plot", FileKind::Picture, args.plot.as_ref()),
            args.json.output(),
        ],
        read,
    )?;
    check_distinct(&args.recordings, &args.after)?;
    let layout = args.input.layout_over(&Layout::default())?;
    let before = gaps(&args.recordings, &layout)?;
    let after = gaps(&args.after, &layout)?;
    let gap = BoardGap::of(&before, &after);
    let mut text = table(&gap);
    if let Some(path) = &args.plot {
        args.picture
            .write(path, &gap_figure(&before, &after, &gap))?;
        text += &format!("\npicture: {}\n", path.display());
    }
    args.json.deliver(&gap, &text)
}

fn gaps(paths: &[PathBuf], layout: &Layout) -> Result<Vec<PredictedRun>, InputError> {
    let (runs, notes) = predicted_runs(&read_all(paths, layout, super::warn)?)?;
    for note in notes {
        super::warn(&note);
    }
    Ok(runs)
}

fn table(gap: &BoardGap) -> String {
    let sides = std::iter::once(&gap.before).chain(&gap.after);
    let runs = sides.flat_map(|side| &side.runs);
    let names = super::width(26, runs.map(|run| run.name.as_str()));
    let indented = names + 2;
    let mut text = format!(
        "The board's own prediction less its flex sensor\n\n{:<indented$} {:>8} {:>12}\n",
        "run", "RMS (°)", "largest (°)"
    );
    let mut rows = |title: &str, side: &GapOf| {
        if gap.after.is_some() {
            text += &format!("{title}\n");
        }
        for run in &side.runs {
            text += &format!(
                "  {:<names$} {:>8.3} {:>12.3}\n",
                run.name, run.rms_deg, run.largest_deg
            );
        }
        if side.runs.len() > 1 {
            let GapOf {
                rms_deg,
                largest_deg,
                ..
            } = side;
            text += &format!("  {:<names$} {rms_deg:>8.3} {largest_deg:>12.3}\n", "all");
        }
    };
    rows("before", &gap.before);
    if let Some(after) = &gap.after {
        rows("after", after);
    }
    if let Some(sentence) = &gap.sentence {
        text += &format!("\n{sentence}\n");
    }
    if let Some(tracking) = &gap.tracking {
        let apart = if gap.sentence.is_some() { "" } else { "\n" };
        text += &format!("{apart}{tracking}\n");
    }
    text
}
