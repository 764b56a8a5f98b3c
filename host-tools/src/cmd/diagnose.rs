//! `rig diagnose`: which effect does the model lack?

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Parser;

use super::input::InputArgs;
use super::watch::Watched;
use crate::checkpoint::Checkpoint;
use crate::diagnose::family::title;
use crate::diagnose::verdict::Answer;
use crate::diagnose::{Diagnosis, Request, diagnose_from};
use crate::error::write_atomically;
use crate::report::Outputs;
use crate::report::content::Content;
use crate::report::html::page;
use crate::report::pictures::figure;
use crate::report::provenance::{Provenance, command_line};
use crate::report::terminal::summary;

/// Finds where model and recordings disagree, names the missing effect, and
/// writes the model with the effect added.
///
/// A recording session is simulated whole. Without --holdout its runs are left
/// out in turn to judge by. Give runs that differ: steps of several sizes, slow
/// and fast ones.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  rig diagnose --model m.toml run.csv
  rig diagnose --model m.toml run.csv --report report.html -o repaired.toml
  rig diagnose --model m.toml run.csv --json verdict.json
  rig diagnose --model m.toml monday.csv tuesday.csv      sessions of one rig
  rig diagnose --model m.toml id_*.csv --holdout vad_*.csv --plot gap.svg
  rig diagnose --model m.toml run.csv --resume fits       after an interruption

Ctrl-C prints what is known so far, writes nothing, and exits with code 130.

The verdict is one of: effect_found, parameters_only, no_discrepancy,
cannot_tell, unexplained. `rig schema` prints the schema of the JSON.")]
pub struct Args {
    /// Model file
    #[arg(long, value_name = "MODEL.toml")]
    model: PathBuf,
    /// Recordings to fit
    #[arg(required = true, value_name = "REC.csv")]
    recordings: Vec<PathBuf>,
    /// Recordings to judge by, which are not fitted
    #[arg(long, num_args = 1.., value_name = "REC.csv")]
    holdout: Vec<PathBuf>,
    /// Write the verdict as JSON
    #[arg(long, value_name = "VERDICT.json")]
    json: Option<PathBuf>,
    /// Write the whole diagnosis as one HTML page that needs no network
    #[arg(long, value_name = "REPORT.html")]
    report: Option<PathBuf>,
    /// Draw measured, before and after, and what is left
    #[arg(long, value_name = "GAP.svg")]
    plot: Option<PathBuf>,
    /// Write the model to go on with: with the effect added, refitted, or as it is
    #[arg(short, long, value_name = "REPAIRED.toml")]
    output: Option<PathBuf>,
    /// Keep finished fits in this folder, and take up those that are there
    #[arg(long, value_name = "FOLDER")]
    resume: Option<PathBuf>,
    /// Seed of everything random
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    input: InputArgs,
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    super::check_outputs([&args.json, &args.report, &args.plot, &args.output])?;
    super::check_distinct(&args.recordings, &args.holdout)?;
    let columns = args.input.columns();
    let (file, recordings) = super::read(&args.model, &args.recordings, &columns)?;
    let holdout = crate::recording::read_all(&args.holdout, &columns, super::warn)?;
    // Before the long work: these are the bytes that it starts from.
    let provenance = match &args.report {
        Some(_) => Some(Provenance::of(
            &args.model,
            &args.recordings,
            &args.holdout,
            command_line(),
        )?),
        None => None,
    };
    let request = Request {
        file: &file,
        recordings: &recordings,
        holdout: &holdout,
        seed: args.seed,
    };
    let checkpoint = match &args.resume {
        Some(folder) => Checkpoint::open(folder)?,
        None => Checkpoint::default(),
    };
    let clock = Instant::now();
    let watched = Watched::start(go_on(args.resume.as_deref()))?;
    let diagnosis = diagnose_from(&request, &checkpoint, &watched.progress);
    let writing = watched.finish();
    let diagnosis = diagnosis?;
    let seconds = clock.elapsed().as_secs_f64();

    let content = Content::of(&request, &diagnosis);
    let mut outputs = Outputs::default();
    if let Some(path) = &args.json {
        let mut text = serde_json::to_string_pretty(&diagnosis.verdict(&request, seconds))?;
        text.push('\n');
        write_atomically(path, text.as_bytes())?;
        outputs.verdict = Some(path);
    }
    if let (Some(path), Some(provenance)) = (&args.report, &provenance) {
        let page = page(&request, &diagnosis, &content, provenance, seconds)?;
        write_atomically(path, page.as_bytes())?;
        outputs.page = Some(path);
    }
    if let Some(path) = &args.plot {
        crate::plot::write_svg(path, &figure(&diagnosis))?;
        outputs.picture = Some(path);
    }
    if let Some(path) = &args.output {
        let text = file.text_with(diagnosis.model_to_keep(&file), &comment(&diagnosis));
        write_atomically(path, text.as_bytes())?;
        outputs.model = Some(path);
    }
    // A reader of the summary that waits can be interrupted again.
    drop(writing);
    let text = summary(&content, &outputs, args.seed, seconds);
    Ok(super::print(&text)?)
}

/// How an interrupted diagnosis is taken up.
fn go_on(resume: Option<&Path>) -> String {
    match resume {
        Some(folder) => format!(
            "To go on, repeat the command: the fits kept in {} are not made again.",
            folder.display()
        ),
        None => {
            "It would start anew: with --resume FOLDER, a diagnosis keeps finished fits.".into()
        }
    }
}

/// What stands above the effects that are added to the model.
fn comment(diagnosis: &Diagnosis) -> String {
    let what = match diagnosis.answer {
        Answer::CannotTell if diagnosis.families.is_empty() => {
            "Added by rig diagnose: one of several that these recordings cannot tell apart.".into()
        }
        Answer::CannotTell => format!("representative of {}", title(&diagnosis.families)),
        Answer::Unexplained => "Added by rig diagnose: lowers the error, not named.".to_owned(),
        _ => "Added by rig diagnose.".into(),
    };
    format!("# {what}\n")
}
