//! `softrig diagnose`: which effect does the model lack?

use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Parser;
use model_core::catalogue::Kind;

use super::input::{InputArgs, layout_of_folder};
use super::json::JsonArgs;
use super::model::ModelArgs;
use super::output::{self, FileKind, Output};
use super::picture::PictureArgs;
use super::watch::Watched;
use crate::batch::{self, Batch, Share, manifest};
use softrig::diagnose::decide::verdict::Verdict;
use softrig::diagnose::score::grammar::is_name_of_term;
use softrig::diagnose::{Budget, Diagnosis, Job, Request, diagnose_from};
use softrig::estimate::checkpoint::Checkpoint;
use softrig::estimate::placement::with_tip_load;
use softrig::estimate::start_from::StartFrom;
use softrig::prediction::{Prediction, StandIn};
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::own_effects::OwnEffects;
use softrig_formats::recording::{check_distinct, read_all_to_show};
use softrig_report::Outputs;
use softrig_report::content::Content;
use softrig_report::html::page;
use softrig_report::pictures::{figure, figure_of_runs};
use softrig_report::provenance::{Provenance, command_line};
use softrig_report::terminal::summary;

/// Finds where model and recordings disagree, names the missing effect, and
/// writes the model with the effect added.
///
/// A recording session is simulated whole. Without --holdout, runs are left out
/// in turn for validation. Give runs that differ: steps of several sizes, slow
/// and fast ones.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig diagnose --model m.toml run.csv
  softrig diagnose --model m.toml run.csv --report report.html -o repaired.toml
  softrig diagnose --model m.toml run.csv --json verdict.json
  softrig diagnose --model m.toml monday.csv tuesday.csv      sessions of one rig
  softrig diagnose --model m.toml id_*.csv --holdout vad_*.csv --plot gap.svg
  softrig diagnose --model m.toml run.csv --plot fig.pdf --width 89mm      for a paper
  softrig diagnose --model m.toml train.csv --holdout test.csv --start-from 20   a benchmark's rules
  softrig diagnose --model m.toml --effects mine.toml run.csv  tries formulas of your own
  softrig diagnose --model m.toml run.csv --no-formulas       effects with a name only
  softrig diagnose --model m.toml run.csv --without gravity   what would take its place?
  softrig diagnose --model m.toml run.csv --prediction theta_sim     what your own simulation lacks
  softrig diagnose --model m.toml run.csv --resume fits       after an interruption
  softrig diagnose --model m.toml run.csv --budget 2min       what is found by then
  softrig diagnose --batch cases.csv -o out                   thousands of recordings
  softrig diagnose --batch cases.csv -o out --share 7/400     as one job of an array
  softrig diagnose --batch cases.csv -o out --budget 1min     at most that long a case

Ctrl-C prints what is known so far, writes nothing, and exits with code 130.

A file of effects has sections [[effect]] with kind = \"custom\", a name, a formula
for the force, and its parameters; docs/custom-effects.md.

A batch is a CSV with the columns case,model,recordings,holdout; docs/batch.md.

The verdict is one of: effect_found, parameters_only, no_discrepancy,
cannot_tell, unexplained. `softrig schema` prints the schema of the JSON.")]
pub struct Args {
    #[command(flatten)]
    model: ModelArgs,
    /// Recordings to fit
    #[arg(required_unless_present = "batch", value_name = "REC.csv")]
    recordings: Vec<PathBuf>,
    /// File of your own effects, given by formulas, to try beside those of the catalogue; in
    /// every case of a batch
    #[arg(long, value_name = "EFFECTS.toml")]
    effects: Option<PathBuf>,
    /// Try named effects only; do not fall back on formulas
    #[arg(long)]
    no_formulas: bool,
    /// Exclude these catalogue effects, or terms beyond it (term_…), to see what takes their place
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', value_parser = effect_or_term)]
    #[arg(conflicts_with = "batch")]
    without: Vec<String>,
    /// Diagnose your own simulation, whose angles are in this column of the recordings: COLUMN, or
    /// COLUMN:rad. The --model is fitted to those angles and diagnosed in its place
    #[arg(
        long,
        value_name = "COLUMN[:UNIT]",
        conflicts_with_all = ["output", "batch"]
    )]
    prediction: Option<Prediction>,
    /// Validation recordings; without them, runs are left out in turn
    #[arg(long, num_args = 1.., value_name = "REC.csv")]
    holdout: Vec<PathBuf>,
    /// Use the validation recordings as a test set: they do not affect the selection, their initial
    /// state comes from this many first samples, and nothing is fitted to the rest. rest: starts at
    /// rest at zero; period: one period of a steady state. One value for all, or one each
    #[arg(
        long,
        value_name = "SAMPLES|rest|period",
        value_delimiter = ',',
        requires = "holdout",
        conflicts_with = "batch"
    )]
    start_from: Vec<StartFrom>,
    #[command(flatten)]
    json: JsonArgs,
    /// Write the whole diagnosis as one HTML page that needs no network
    #[arg(long, value_name = "REPORT.html")]
    report: Option<PathBuf>,
    /// Draw the measured runs, the models before and after, and the residuals
    #[arg(long, value_name = "GAP.svg|pdf|png")]
    plot: Option<PathBuf>,
    /// Draw these runs, by their names [default: the fitted and the validation run with the
    /// largest error]
    #[arg(long, value_name = "RUN,…", value_delimiter = ',', requires = "plot")]
    runs: Vec<String>,
    /// Write the resulting model: with the effect added, refitted, or unchanged. For a batch,
    /// the folder of all results
    #[arg(short, long, value_name = "REPAIRED.toml")]
    output: Option<PathBuf>,
    /// Make -o write named effects only; if none is named, the refitted model
    #[arg(long, requires = "output", conflicts_with = "batch")]
    named_only: bool,
    /// Diagnose every case of a manifest, each into its own folder below -o. Cases with
    /// existing results are skipped
    #[arg(
        long,
        value_name = "MANIFEST.csv",
        requires = "output",
        conflicts_with_all = [
            "model", "recordings", "holdout", "json", "report", "plot", "resume"
        ]
    )]
    batch: Option<PathBuf>,
    /// Only every Nth case of the batch, starting with the Kth (from 0): one job of an array
    #[arg(long, value_name = "K/N", requires = "batch", value_parser = share)]
    share: Option<Share>,
    /// Number of cases diagnosed in parallel; they share the threads, and memory grows in
    /// proportion
    #[arg(long, value_name = "N", requires = "batch", default_value = "1")]
    jobs: NonZero<usize>,
    /// Keep finished fits in this folder, and reuse those that are there
    #[arg(long, value_name = "FOLDER")]
    resume: Option<PathBuf>,
    /// Time limit of the search, such as 30s or 5min; per case in a batch. The verdict covers what
    /// was tried by then, so it depends on the computer. Writing it takes a little longer
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    budget: Option<Duration>,
    /// Acceptable model error in degrees; smaller errors are not reported as missing effects.
    /// Default, and in a batch: `tolerance_deg` of the metadata, or 1 % of the range of the angle
    #[arg(long, value_name = "DEG", conflicts_with = "batch", value_parser = positive)]
    tolerance: Option<f64>,
    /// Random seed
    #[arg(long, default_value_t = 1)]
    seed: u64,
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
    match (&args.batch, &args.output) {
        (Some(manifest), Some(out)) => run_batch(args, manifest, out),
        (None, _) => run_one(args, &args.model.find()?),
        // The command line was checked for it.
        _ => anyhow::bail!("name the results folder of the batch"),
    }
}

/// Reads the name of an effect of the catalogue, or of a term of the grammar.
fn effect_or_term(name: &str) -> Result<String, String> {
    let is_effect = Kind::from_name(name).is_some_and(Kind::is_name);
    if is_effect || is_name_of_term(name) {
        return Ok(name.to_owned());
    }
    let names: Vec<&str> = Kind::NAMES.iter().map(|kind| kind.name()).collect();
    Err(format!(
        "unknown effect: give one of {}, or the name of a term from a verdict, term_…",
        names.join(", ")
    ))
}

/// Reads a number above zero.
fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if f64::is_finite(value) && value > 0.0 => Ok(value),
        _ => Err("give a number of degrees above zero, such as 0.5".into()),
    }
}

fn share(text: &str) -> Result<Share, String> {
    let numbers = text
        .split_once('/')
        .and_then(|(index, of)| Some((index.parse().ok()?, of.parse().ok()?)));
    match numbers {
        Some((index, of)) if index < of => Ok(Share { index, of }),
        _ => Err("give the job number, from 0, and the number of jobs, such as 3/50".into()),
    }
}

fn run_batch(args: &Args, path: &Path, out: &Path) -> anyhow::Result<()> {
    let mut all = manifest::open(path)?;
    let settings = batch::Settings {
        layout: args.input.layout(),
        folder: layout_of_folder()?,
        seed: args.seed,
        own: match &args.effects {
            Some(path) => Some(OwnEffects::read_for_any(path)?),
            None => None,
        },
        formulas: !args.no_formulas,
        budget: args.budget.map(Budget::Time),
        anew: false,
    };
    let summary = Batch {
        out,
        settings: &settings,
        share: args.share,
        jobs: args.jobs,
    }
    .run(&mut all, &Job::default(), &|line| {
        Ok(super::print(&format!("{line}\n"))?)
    })?;
    if args.share.is_none() {
        let table = batch::table(out);
        super::print(&format!("{} cases in {}\n", summary.cases, table.display()))?;
    }
    if let Some(warning) = summary.warning() {
        super::warn(&warning);
    }
    match summary.failure() {
        None => Ok(()),
        Some(failure) => anyhow::bail!(failure),
    }
}

fn run_one(args: &Args, model: &PathBuf) -> anyhow::Result<()> {
    // A large file takes seconds to read, which are the user's too.
    let begun = Instant::now();
    check_outputs(args, model)?;
    check_distinct(&args.recordings, &args.holdout)?;
    let file = super::read_model(model)?;
    let layout = args.input.layout_over(&file.recording)?;
    let mut recordings = read_all_to_show(&args.recordings, &layout, super::warn)?;
    let file = with_tip_load(file, &recordings);
    let own = match &args.effects {
        Some(path) => Some(OwnEffects::read(path, &file.model)?),
        None => None,
    };
    let mut holdout = read_all_to_show(&args.holdout, &layout, super::warn)?;
    if args.tolerance.is_some() {
        for recording in recordings.iter_mut().chain(&mut holdout) {
            recording.meta.tolerance_deg = args.tolerance;
        }
    }
    // Before the long work: these are the bytes that it starts from.
    let provenance = match &args.report {
        Some(_) => Some(Provenance::of(
            model,
            args.effects.as_deref(),
            &args.recordings,
            &args.holdout,
            command_line(),
        )?),
        None => None,
    };
    let (stand_in, file) = match &args.prediction {
        Some(prediction) => {
            let (stand_in, file) = StandIn::of(&file, prediction, &mut recordings, &mut holdout)?;
            (Some(stand_in), file)
        }
        None => (None, file),
    };
    let request = Request {
        file: &file,
        recordings: &recordings,
        holdout: &holdout,
        start_from: &args.start_from,
        own: own.as_ref(),
        formulas: !args.no_formulas,
        without: &args.without,
        seed: args.seed,
    };
    let checkpoint = checkpoint(args)?;
    let clock = Instant::now();
    let budget = args.budget.map(Budget::Time);
    let watched = Watched::start(go_on(args.resume.as_deref()), budget, begun)?;
    let diagnosis = diagnose_from(&request, &checkpoint, &watched.job);
    let writing = watched.finish();
    let diagnosis = diagnosis?;
    let seconds = clock.elapsed().as_secs_f64();

    let mut content = Content::of(&request, &diagnosis);
    if let Some(stand_in) = &stand_in {
        content.speak_of_simulation(stand_in);
    }
    let is_left_out = args.named_only && !diagnosis.is_named();
    if is_left_out {
        content.leave_out_unnamed();
    }
    let mut outputs = Outputs {
        named_only: is_left_out,
        verdict: args.json.file().map(PathBuf::as_path),
        ..Outputs::default()
    };
    if let (Some(path), Some(provenance)) = (&args.report, &provenance) {
        let page = page(&request, &diagnosis, &content, provenance, seconds)?;
        write_atomically(path, page.as_bytes())?;
        outputs.page = Some(path);
    }
    // What a picture lacks, such as a run of that name, is said after the answer.
    let picture = draw(args, &diagnosis);
    if picture.is_ok() {
        outputs.picture = args.plot.as_deref();
    }
    if let Some(path) = &args.output {
        let text = if args.named_only {
            diagnosis.named_model_text(&file)
        } else {
            diagnosis.model_text(&file)
        };
        write_atomically(path, text.as_bytes())?;
        outputs.model = Some(path);
    }
    // A reader of the summary that waits can be interrupted again.
    drop(writing);
    let text = summary(&content, &outputs, args.seed, seconds);
    let mut verdict = Verdict {
        simulation: stand_in,
        ..diagnosis.verdict(&request, seconds)
    };
    if is_left_out {
        verdict.upload = false;
        verdict.upload_refused.clone_from(&content.refused);
    }
    args.json.deliver(&verdict, &text)?;
    Ok(picture?)
}

/// What an earlier run had fitted already.
fn checkpoint(args: &Args) -> anyhow::Result<Checkpoint> {
    let Some(folder) = &args.resume else {
        return Ok(Checkpoint::default());
    };
    let checkpoint = Checkpoint::open(folder)?;
    if let Some(damaged) = checkpoint.damaged() {
        super::warn(damaged);
    }
    Ok(checkpoint)
}

/// Draws the picture, of the runs that were asked for, where one is asked for.
fn draw(args: &Args, diagnosis: &Diagnosis) -> Result<(), InputError> {
    let Some(path) = &args.plot else {
        return Ok(());
    };
    let figure = if args.runs.is_empty() {
        figure(diagnosis)
    } else {
        figure_of_runs(diagnosis, &args.runs)?
    };
    args.picture.write(path, &figure)
}

/// Refuses, before the long work, files that the results would overwrite.
fn check_outputs(args: &Args, model: &PathBuf) -> Result<(), InputError> {
    let read = args.recordings.iter().chain(&args.holdout);
    args.picture.check("--plot", args.plot.as_ref())?;
    output::check(
        &[
            args.json.output(),
            Output::of("--report", FileKind::Page, args.report.as_ref()),
            Output::of("--plot", FileKind::Picture, args.plot.as_ref()),
            Output::of("-o", FileKind::Model, args.output.as_ref()),
        ],
        read.chain([model]).chain(&args.effects),
    )
}

/// How an interrupted diagnosis is taken up.
fn go_on(resume: Option<&Path>) -> String {
    match resume {
        Some(folder) => format!(
            "To continue, repeat the command: the fits in {} are reused.",
            folder.display()
        ),
        None => "Repeating starts over: use --resume FOLDER to keep finished fits.".into(),
    }
}
