//! `softrig record`: plays a protocol and records the rig.

use std::cell::Cell;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use clap::{ArgGroup, Parser};
use indicatif::{ProgressBar, ProgressStyle};
use schemars::JsonSchema;
use serde::Serialize;
use wire::command::Command;
use wire::protocol::Named;

use super::Interrupt;
use super::json::{JsonArgs, SCHEMA};
use super::output::{self, FileKind, Output};
use super::port::PortArgs;
use softrig_formats::error::InputError;
use softrig_formats::protocol_file::{ProtocolFile, describe};
use softrig_formats::setup::Setup;
use softrig_formats::terminal::remark;
use softrig_link::line::command_text;
use softrig_link::record::session::{self, Attendant, ENDLESS, Plan, about, load_commands};
use softrig_link::record::{
    Disk, LoggedSample, Recorder, RecordingOutcome, Step, meta_path, run_path, steps,
};
use softrig_link::rig_file::{RigFile, board_name, rig_file};
use softrig_link::{Event, Link, SerialConnector};

/// Records a rig while it plays a protocol, or while it is left alone.
///
/// Every received line is written at once: a pulled cable, Ctrl-C or a crash loses
/// nothing that was received. Ctrl-C stops the pump first. When the cable is plugged
/// in again, a recording without a protocol goes on, with the gap marked. A protocol
/// ends: the board stopped the rig when the computer fell silent.
#[derive(Debug, Parser)]
#[command(group(ArgGroup::new("what").args(["protocol", "seconds"])))]
#[command(after_help = "\
Examples:
  softrig record --list
  softrig record --port /dev/ttyACM0 --protocol steps -o run.csv
  softrig record --port /dev/ttyACM0 --protocol mine.toml -o mine.csv --dry-run
  softrig record --port /dev/ttyACM0 --protocol steps --setup tilt_deg=90 -o aside.csv
  softrig record --port /dev/ttyACM0 --plan next.toml -o next.csv    what `softrig plan -o` wrote
  softrig record --port /dev/ttyACM0 --seconds 10 -o rest.csv
  softrig diagnose --model m.toml run.csv

A session is one file. The runs in it, such as each step with its release, are
listed in run.meta.toml beside it; `softrig diagnose` and `softrig gap` find them there.
A fault leaves run.blackbox.csv: the second before it, as the board saw it.
Times are in seconds, pressures in kPa, angles in degrees.")]
#[allow(clippy::struct_excessive_bools)] // Flags, each with a name of its own.
pub struct Args {
    #[command(flatten)]
    port: PortArgs,
    /// Name of a built-in protocol, or a protocol file
    #[arg(long, value_name = "NAME|FILE.toml", visible_alias = "plan")]
    protocol: Option<String>,
    /// Record for this time without moving anything, in seconds
    #[arg(long, value_name = "N", value_parser = seconds)]
    seconds: Option<f64>,
    /// File to write
    #[arg(short, long, value_name = "OUT.csv", required_unless_present_any = ["list", "dry_run"])]
    output: Option<PathBuf>,
    /// Replace files that exist
    #[arg(long)]
    force: bool,
    /// Also write each step to a file of its own (run_60_1.csv: the first to 60°)
    #[arg(long, requires = "protocol")]
    split: bool,
    /// Write one file only (default without --split)
    #[arg(long, hide = true, conflicts_with = "split")]
    whole: bool,
    /// Clear a latched fault first, if its cause is gone
    #[arg(long)]
    clear: bool,
    /// Wait this long, in seconds, for a pulled cable to be plugged in again or a silent board to
    /// answer
    #[arg(long, value_name = "N", default_value_t = 30.0, value_parser = seconds)]
    patience: f64,
    /// Rig setup, comma-separated: tilt_deg (rotation of the base since the angle was zeroed,
    /// positive in the bending direction), tip_load_g, tube_mm, temperature_c, rested_s,
    /// new_part=actuator|sensor
    #[arg(long, value_name = "KEY=VALUE,…")]
    setup: Option<Setup>,
    /// File with the board's clock from `softrig commission`, to correct the times [default:
    /// softrig.toml, if present]
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    /// Do not prompt: the rig is already set up as the protocol asks
    #[arg(long, requires = "protocol")]
    ready: bool,
    /// Print what would be sent and its duration, and open no port
    #[arg(long, requires = "protocol")]
    dry_run: bool,
    /// List the protocols that every board knows
    #[arg(long)]
    list: bool,
    #[command(flatten)]
    json: JsonArgs,
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.1..=1e6).contains(&value) => Ok(value),
        _ => Err("give a number from 0.1 to 1000000 seconds".into()),
    }
}

/// Runs the command.
///
/// # Errors
///
/// Invalid arguments and protocols before anything moves; then faults of the link or the
/// board.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if args.list {
        return args.json.deliver(&Protocols::known(), &list());
    }
    let protocol = args
        .protocol
        .as_deref()
        .map(ProtocolFile::find)
        .transpose()?;
    if let (true, Some(protocol)) = (args.dry_run, &protocol) {
        return Ok(super::print(&dry_run(protocol))?);
    }
    let Some(output) = &args.output else {
        return Err(InputError::new("no recording is named", "give -o run.csv").into());
    };
    let port = &args.port.find()?;
    let files = match &protocol {
        Some(protocol) if args.split => steps(protocol).ok_or_else(|| {
            InputError::new(
                format!("the protocol {} is not one of steps", protocol.name),
                "omit --split: it needs a release of a second or more after every step",
            )
        })?,
        _ => Vec::new(),
    };
    let played = protocol.as_ref().and_then(|it| it.path.as_ref());
    check_output(output, played, &files, args.force)?;
    let asked = protocol.as_ref().map(|it| it.setup.clone());
    let setup = setup_of(args.setup.as_ref(), asked.as_ref());
    if let Some(asked) = asked.filter(|_| !args.ready) {
        super::ask_to_set_up(&asked)?;
    }
    let plan = Plan {
        output: output.clone(),
        protocol,
        seconds: args.seconds,
        split: args.split,
        clear: args.clear,
        patience: Duration::from_secs_f64(args.patience),
        setup,
        clock_factor: clock_factor(args.rig.as_deref(), port)?,
        started: now(),
    };
    let mut terminal = Terminal {
        stage: Stage::new(),
        interrupt: Interrupt::listen()?,
    };
    let recorded = session::record(
        SerialConnector::new(port),
        &plan,
        Box::new(Disk),
        &mut terminal,
    );
    terminal.stage.finish();
    let RecordingOutcome {
        mut text,
        has_moved,
    } = recorded?;
    if has_moved {
        text += &format!(
            "next: softrig diagnose --model MODEL.toml {}\n",
            output.display()
        );
    }
    Ok(super::print(&text)?)
}

/// This moment (RFC 3339, UTC).
fn now() -> String {
    humantime::format_rfc3339_seconds(SystemTime::now()).to_string()
}

/// Who waits at a terminal.
struct Terminal {
    stage: Stage,
    interrupt: Interrupt,
}

impl Attendant for Terminal {
    fn waits(&mut self, stage: &'static str) {
        self.stage.wait(stage);
        if stage == ENDLESS && !std::io::stderr().is_terminal() {
            remark("recording until Ctrl-C or SIGTERM; --seconds N ends it by itself");
        }
    }

    fn plays(&mut self, stage: &str, passed_ms: i64, total_ms: i64) {
        self.stage.play(stage, passed_ms, total_ms);
    }

    fn sees(&mut self, _: &LoggedSample) {}

    fn warns(&mut self, text: &str) {
        self.stage.bar.suspend(|| super::warn(text));
    }

    fn has_enough(&self) -> bool {
        self.interrupt.requested()
    }
}

/// How the rig stands: as the command line says, else as the protocol asks; none where
/// nothing is said.
fn setup_of(said: Option<&Setup>, asked: Option<&Setup>) -> Option<Setup> {
    let none = Setup::default();
    let both = said.unwrap_or(&none).or(asked.unwrap_or(&none));
    (both != none || said.is_some()).then_some(both)
}

/// What corrects the times of this board: as the named file says, else the usual one if there is
/// one. That of another board is never used.
fn clock_factor(named: Option<&Path>, port: &str) -> Result<Option<f64>, InputError> {
    let path = named.unwrap_or_else(|| rig_file());
    let board = board_name(port);
    let absent = |found: &str| match named {
        Some(_) => Err(
            InputError::new(found, "write it with `softrig commission`, or omit --rig")
                .in_file(path),
        ),
        None => Ok(None),
    };
    let Some(file) = RigFile::find(path)? else {
        return absent("is not there");
    };
    match (file.board, file.clock) {
        (Some(its), Some(clock)) if its == board => Ok(Some(clock.factor)),
        (Some(its), Some(_)) => {
            let found = format!("belongs to board `{its}`; this one is `{board}`");
            if named.is_some() {
                let advice =
                    "name its own file, or measure it with `softrig commission --only clock`";
                return Err(InputError::new(found, advice).in_file(path));
            }
            super::warn(&format!(
                "{}: {found}; times are not corrected",
                path.display()
            ));
            Ok(None)
        }
        _ => absent("has no clock"),
    }
}

/// The present stage, shown in the last line of a terminal if there is one.
struct Stage {
    bar: ProgressBar,
    played: Cell<bool>,
}

impl Stage {
    fn new() -> Self {
        Self {
            bar: super::spinner(),
            played: Cell::new(false),
        }
    }

    /// A stage of unknown length.
    fn wait(&self, what: &'static str) {
        self.played.set(false);
        self.bar.set_style(style("{spinner} {msg}  {elapsed}"));
        self.bar.reset_elapsed();
        self.bar.set_message(what);
    }

    /// A stage of which `passed_ms` of `total_ms` have passed, by the board's clock.
    fn play(&self, what: &str, passed_ms: i64, total_ms: i64) {
        let milliseconds = |ms: i64| u64::try_from(ms).unwrap_or(0);
        if !self.played.replace(true) {
            self.bar
                .set_style(style("{wide_bar} {percent:>3} %  {msg}"));
            self.bar.set_length(milliseconds(total_ms));
        }
        let left = u32::try_from(total_ms - passed_ms).unwrap_or(0);
        self.bar.set_message(if left == 0 {
            format!("{what}, waiting for its end")
        } else {
            format!("{what}, {} left", minutes(left))
        });
        self.bar.set_position(milliseconds(passed_ms));
    }

    fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// A fixed template; tests would find an invalid one.
fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// Refuses to replace a recording.
fn check_output(
    output: &Path,
    protocol: Option<&PathBuf>,
    steps: &[Step],
    force: bool,
) -> Result<(), InputError> {
    if output
        .extension()
        .is_none_or(|extension| extension != "csv")
    {
        return Err(InputError::new(
            "does not end in .csv",
            "give the recording a name like run.csv",
        )
        .in_file(output));
    }
    let file = output.to_owned();
    // Whether it may be replaced is asked below, of everything that is written.
    output::check(
        &[Output::of("-o", FileKind::Recording, Some(&file)).replacing(true)],
        protocol,
    )?;
    let runs = steps.iter().map(|step| run_path(output, step));
    let exists = [output.to_owned(), meta_path(output)]
        .into_iter()
        .chain(runs)
        .find(|path| path.exists());
    match exists {
        Some(path) if !force => Err(InputError::new(
            "exists",
            "choose another name, or replace it with --force",
        )
        .in_file(&path)),
        _ => Ok(()),
    }
}

/// What `softrig record --list --json` writes.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct Protocols {
    /// Version of the layout.
    schema: u32,
    /// The protocols that every board knows.
    protocols: Vec<Listed>,
}

/// A protocol.
#[derive(Clone, Debug, Serialize, JsonSchema)]
struct Listed {
    /// Its name.
    name: String,
    /// How long it takes (s).
    seconds: f64,
    /// What it is.
    title: String,
}

impl Protocols {
    fn known() -> Self {
        let protocols = Named::ALL.iter().map(|&named| {
            let protocol = ProtocolFile::named(named);
            Listed {
                seconds: f64::from(protocol.total_ms()) / 1000.0,
                name: protocol.name,
                title: protocol.title,
            }
        });
        Self {
            schema: SCHEMA,
            protocols: protocols.collect(),
        }
    }
}

fn list() -> String {
    let mut text = String::new();
    for &named in Named::ALL {
        let protocol = ProtocolFile::named(named);
        text += &format!(
            "{:<10} {:>6}  {}\n",
            protocol.name,
            minutes(protocol.total_ms()),
            protocol.title
        );
    }
    text
}

fn minutes(ms: u32) -> String {
    let seconds = ms.div_ceil(1000);
    format!("{}:{:02}", seconds / 60, seconds % 60)
}

fn dry_run(protocol: &ProtocolFile) -> String {
    let mut text = format!(
        "{}: {} segments, {} min\n",
        protocol.name,
        protocol.segments.len(),
        minutes(protocol.total_ms())
    );
    for instruction in protocol.setup.instructions() {
        text += &format!("first {instruction}\n");
    }
    for (number, segment) in (1..).zip(&protocol.segments) {
        text += &format!("{number:>4}. {}\n", describe(segment));
    }
    text += "\nWould be sent (each with a number and a checksum):\n";
    let mut commands = vec![Command::Arm];
    if protocol.named.is_none() {
        commands.extend(load_commands(protocol));
    }
    commands.push(Command::Run(protocol.named));
    commands.push(Command::Disarm);
    for command in commands {
        text += &format!("  {}\n", command_text(command));
    }
    text
}

/// Begins a recording for another command: `softrig monitor --log`.
pub(crate) fn log(path: &Path, link: &Link) -> Result<Recorder, InputError> {
    check_output(path, None, &[], false)?;
    Recorder::create(Box::new(Disk), path, about(link, None, now()), false)
}

/// Ends what [`log`] began.
pub(crate) fn end_log(
    mut recorder: Recorder,
    link: &Link,
    complete: bool,
) -> Result<(), InputError> {
    recorder.counts.count(&link.counters());
    recorder.about.complete = complete;
    recorder.finish(&[], false).map(drop)
}

/// Writes an event to a log, if there is one.
pub(crate) fn note(log: &mut Option<Recorder>, event: &Event) -> Result<(), InputError> {
    match log {
        Some(recorder) => {
            recorder.take(event);
            recorder.check()
        }
        None => Ok(()),
    }
}
