//! `softrig next`: the experiments that decide, one after the other.
//!
//! A diagnosis that cannot tell ends with the run that would. Here it is made: the rig is set up
//! as the plan asks, the run is recorded, and all recordings are diagnosed together, until the
//! answer is clear or nothing that is known decides. What was recorded is kept, so that the
//! command takes up where it was ended.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use clap::Parser;

use super::input::InputArgs;
use super::model::ModelArgs;
use super::output::{self, FileKind, Output};
use super::plan::{self, NOTHING_DECIDES};
use super::port::PortArgs;
use super::record;
use super::virtual_rig::Companion;
use super::watch::Watched;
use softrig::diagnose::decide::verdict::Answer;
use softrig::diagnose::experiment::plan::{Limits, Proposal};
use softrig::diagnose::{Diagnosis, Request, diagnose};
use softrig::estimate::usable;
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::own_effects::OwnEffects;
use softrig_formats::recording::{Recording, check_distinct, read_all, recordings_among};
use softrig_formats::terminal::quoted;
use softrig_report::content::Content;

/// Runs experiments until the answer is clear or no run would decide: diagnoses, proposes a run,
/// asks you to set up the rig, records, and diagnoses all recordings together.
///
/// Plans and recordings stay in the -o folder. After an interruption repeat the command: complete
/// runs are not recorded again.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig next --port /dev/ttyACM0 --model m.toml run.csv -o decide
  softrig next --virtual truth.toml --model m.toml run.csv -o decide    on the virtual rig
  softrig next --port /dev/ttyACM0 --model m.toml run.csv --limits deg=60,s=120
  softrig diagnose --model m.toml run.csv decide/*.csv --report report.html

The virtual rig turns its own base; on a bench you are asked to.")]
pub struct Args {
    #[command(flatten)]
    port: PortArgs,
    /// Record on the virtual rig, with the actuator of this model file
    #[arg(long = "virtual", value_name = "TRUTH.toml", conflicts_with = "port")]
    actuator: Option<PathBuf>,
    #[command(flatten)]
    model: ModelArgs,
    /// Recordings so far
    #[arg(required = true, value_name = "REC.csv")]
    recordings: Vec<PathBuf>,
    /// Validation recordings; without them, runs are left out in turn
    #[arg(long, value_name = "REC.csv", num_args = 1..)]
    holdout: Vec<PathBuf>,
    /// File of your own effects, given by formulas, to try beside those of the catalogue
    #[arg(long, value_name = "EFFECTS.toml")]
    effects: Option<PathBuf>,
    /// Folder for the plans and their recordings
    #[arg(short, long, value_name = "FOLDER", default_value = "next")]
    output: PathBuf,
    /// Write the last verdict as JSON
    #[arg(long, value_name = "VERDICT.json")]
    json: Option<PathBuf>,
    /// Maximum experiments
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=20))]
    most: u32,
    /// Highest set-point (deg), highest pressure (kpa), longest run (s)
    #[arg(long, value_name = "deg=90,kpa=170,s=180")]
    limits: Option<String>,
    /// Do not prompt: the rig is already set up as planned
    #[arg(long)]
    ready: bool,
    /// Random seed
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    input: InputArgs,
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, of the link, or of the board.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let model = args.model.find()?;
    let read = args.recordings.iter().chain(&args.holdout);
    let read = read.chain([&model]).chain(&args.effects);
    output::check(
        &[Output::of("--json", FileKind::Json, args.json.as_ref())],
        read.chain(&args.actuator),
    )?;
    check_distinct(&args.recordings, &args.holdout)?;
    // Before the long work.
    match &args.actuator {
        Some(actuator) => drop(super::read_model(actuator)?),
        None => drop(args.port.find()?),
    }
    let limits = plan::limits(args.limits.as_deref())?;
    let mut recordings = recordings_among(&args.recordings, super::warn)?;
    let given = recordings.len();
    let mut used;
    let mut made = 0;
    loop {
        let diagnosed = diagnosed(args, &model, &recordings, given, limits)?;
        super::print(&format!("{}\n", diagnosed.sentence))?;
        used = diagnosed.used;
        let next = match diagnosed.step {
            Step::Told => break,
            Step::WasNotSetUp(why) => {
                super::print(&format!(
                    "Stopped: {why}\nCorrect this and repeat the command.\n"
                ))?;
                return Ok(());
            }
            Step::Run(next) => *next,
        };
        let best = &next.proposal;
        if !best.decides {
            super::print(&format!("No run is expected to decide: {NOTHING_DECIDES}"))?;
            break;
        }
        if made == args.most {
            super::print(&format!(
                "Stopped after {made} experiments, the limit set by --most.\n"
            ))?;
            break;
        }
        made += 1;
        let recording = args.output.join(format!("next{made}.csv"));
        if is_complete(&recording) {
            refuse_another_plan(best, &recording)?;
            super::print(&format!("{} is recorded already.\n", recording.display()))?;
        } else {
            record_next(args, &next, &recording)?;
        }
        if !is_complete(&recording) {
            super::print("The run ended early. Repeat the command to continue.\n")?;
            return Ok(());
        }
        recordings.push(recording);
    }
    super::print(&format!(
        "To keep the answer: {}\n",
        to_keep(args, &model, &used)
    ))?;
    Ok(())
}

/// The command that writes the last answer to files.
fn to_keep(args: &Args, model: &PathBuf, recordings: &[PathBuf]) -> String {
    let name = |path: &PathBuf| quoted(&path.to_string_lossy());
    let names = |paths: &[PathBuf]| paths.iter().map(name).collect::<Vec<_>>().join(" ");
    let mut command = format!(
        "softrig diagnose --model {} {}",
        name(model),
        names(recordings)
    );
    if !args.holdout.is_empty() {
        command += &format!(" --holdout {}", names(&args.holdout));
    }
    if let Some(effects) = &args.effects {
        command += &format!(" --effects {}", name(effects));
    }
    command + " --report report.html -o repaired.toml"
}

/// The run that would say more.
struct Next {
    proposal: Proposal,
    /// How far the actuator was bent in the recordings so far (rad).
    bent_rad: f64,
}

/// What follows from a diagnosis.
enum Step {
    /// The answer is clear, or no run is known.
    Told,
    /// A recording contradicts what is said of its rig, and with it all that rests on it.
    WasNotSetUp(String),
    /// A run would say more.
    Run(Box<Next>),
}

/// What the recordings say, and what to do next.
struct Diagnosed {
    /// The answer in a sentence.
    sentence: String,
    /// The recordings that it rests on: not those of planned runs that missed their aim.
    used: Vec<PathBuf>,
    step: Step,
}

/// Diagnoses the recordings, of which the first `given` were not planned here.
fn diagnosed(
    args: &Args,
    model: &Path,
    paths: &[PathBuf],
    given: usize,
    limits: Limits,
) -> anyhow::Result<Diagnosed> {
    let (file, mut recordings) = super::read(model, paths, &args.input)?;
    let planned = recordings.split_off(given);
    let (used, missed): (Vec<_>, Vec<_>) = planned
        .into_iter()
        .map(|recording| (usable(&recording).err(), recording))
        .partition(|(fault, _)| fault.is_none());
    recordings.extend(used.into_iter().map(|(_, recording)| recording));
    for fault in missed.iter().filter_map(|(fault, _)| fault.as_ref()) {
        super::warn(&fault.to_string());
    }
    let missed: Vec<Recording> = missed.into_iter().map(|(_, recording)| recording).collect();
    let own = match &args.effects {
        Some(path) => Some(OwnEffects::read(path, &file.model)?),
        None => None,
    };
    let holdout = read_all(
        &args.holdout,
        &args.input.layout_over(&file.recording)?,
        super::warn,
    )?;
    let request = Request {
        file: &file,
        recordings: &recordings,
        holdout: &holdout,
        start_from: &[],
        own: own.as_ref(),
        formulas: true,
        without: &[],
        seed: args.seed,
    };
    let go_on = "To go on, repeat the command.".to_owned();
    let watched = Watched::start(go_on, None, Instant::now())?;
    let clock = Instant::now();
    let diagnosis = diagnose(&request, &watched.job);
    drop(watched.finish());
    let diagnosis: Diagnosis = diagnosis?;
    if let Some(path) = &args.json {
        let verdict = diagnosis.verdict(&request, clock.elapsed().as_secs_f64());
        let text = serde_json::to_string_pretty(&verdict)? + "\n";
        write_atomically(path, text.as_bytes())?;
    }
    for concern in &diagnosis.concerns {
        super::warn(&concern.to_string());
    }
    let is_open = diagnosis.finding.answer() == Answer::CannotTell;
    // What a run that missed its aim says of the rig holds all the same, such as the range of
    // the sensor that it left.
    let limits = limits.of_rig(&[&recordings[..], &missed].concat());
    let within = (args.limits.is_some() || !missed.is_empty())
        .then(|| diagnosis.experiments_within(&request, limits));
    let mut proposals = within.as_ref().unwrap_or(&diagnosis.proposals).iter();
    let step = if let Some(concern) = diagnosis.contradicted_setup() {
        Step::WasNotSetUp(concern.to_string())
    } else if is_open
        && let Some((proposal, _)) = proposals.find(|(it, _)| !is_plan_of(it, &missed))
    {
        Step::Run(Box::new(Next {
            proposal: proposal.clone(),
            bent_rad: limits.stretched_rad,
        }))
    } else {
        Step::Told
    };
    Ok(Diagnosed {
        sentence: Content::of(&request, &diagnosis).sentence,
        used: recordings.iter().map(|it| it.path.clone()).collect(),
        step,
    })
}

/// Whether one of these recordings was made for the proposal.
fn is_plan_of(proposal: &Proposal, recordings: &[Recording]) -> bool {
    let plans = recordings.iter().map(|it| it.path.with_extension("toml"));
    let text = proposal.protocol.to_text();
    plans.into_iter().any(|plan| is_text_of(&plan, &text))
}

/// Whether a file holds just this text.
fn is_text_of(file: &Path, text: &str) -> bool {
    std::fs::read_to_string(file).is_ok_and(|found| found == text)
}

/// Whether a recording is there, to its end.
fn is_complete(path: &Path) -> bool {
    path.exists() && Recording::read(path).is_ok_and(|(it, _)| it.meta.complete == Some(true))
}

/// Refuses a recording that answers another question, such as that of another actuator.
fn refuse_another_plan(best: &Proposal, recording: &Path) -> Result<(), InputError> {
    if is_text_of(&recording.with_extension("toml"), &best.protocol.to_text()) {
        return Ok(());
    }
    Err(InputError::new(
        "was recorded for a different plan from the one needed now",
        "use another -o folder, or add this recording to the command",
    )
    .in_file(recording))
}

/// Writes the plan of a run, has the rig set up, and records it.
fn record_next(args: &Args, next: &Next, recording: &Path) -> anyhow::Result<()> {
    let best = &next.proposal;
    let folder = &args.output;
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let plan = recording.with_extension("toml");
    write_atomically(&plan, best.protocol.to_text().as_bytes())?;
    super::print(&format!(
        "Next: {}{} ({:.0} s), expected Δχ² {:.0}: {}\n",
        best.protocol.setup.instruction(),
        best.protocol.title,
        f64::from(best.protocol.total_ms()) / 1000.0,
        best.evidence,
        plan.display()
    ))?;
    // A virtual rig at full speed takes a core for as long as it is there.
    let mut companion = None;
    let port = if let Some(actuator) = &args.actuator {
        let rig = companion.insert(Companion::start(Some(actuator), None)?);
        rig.set_up(&best.protocol.setup, next.bent_rad)?;
        rig.port().to_owned()
    } else {
        if !args.ready {
            super::ask_to_set_up(&best.protocol.setup)?;
        }
        args.port.find()?
    };
    let words = ["record", "--ready", "--force", "--port", &port, "--plan"];
    let words = words.iter().map(std::ffi::OsString::from).chain([
        plan.into_os_string(),
        "-o".into(),
        recording.into(),
    ]);
    record::run(&record::Args::try_parse_from(words)?)
}
