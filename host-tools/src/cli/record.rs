//! `softrig record`: plays a protocol and records the rig.

use std::cell::Cell;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use anyhow::Context;
use clap::{ArgGroup, Parser};
use indicatif::{ProgressBar, ProgressStyle};
use schemars::JsonSchema;
use serde::Serialize;
use wire::command::Command;
use wire::protocol::Named;
use wire::settings::{Key, Settings};
use wire::state::State;

use super::Interrupt;
use super::json::{JsonArgs, SCHEMA};
use super::output::{self, FileKind, Output};
use super::port::PortArgs;
use softrig_formats::error::InputError;
use softrig_formats::protocol_file::{ProtocolFile, describe};
use softrig_formats::setup::Setup;
use softrig_formats::terminal::{printable_line, remark};
use softrig_link::line::command_text;
use softrig_link::record::{
    About, Gap, Part, Recorder, Step, black_box_path, check_limits, meta_path, parts, run_path,
    steps,
};
use softrig_link::rig_file::{RigFile, board_name, rig_file};
use softrig_link::{Event, Link, LinkError, SerialConnector, Timing, is_pseudo_terminal};

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
    /// Name of a protocol that every board knows, or a protocol file
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
    /// Write one file only; always so without --split
    #[arg(long, hide = true, conflicts_with = "split")]
    whole: bool,
    /// Clear a latched fault first, if its cause is gone
    #[arg(long)]
    clear: bool,
    /// Wait for this time for a pulled cable to be plugged in again, or for a board that has
    /// fallen silent, in seconds
    #[arg(long, value_name = "N", default_value_t = 30.0, value_parser = seconds)]
    patience: f64,
    /// How the rig stands, with commas: tilt_deg (by how much the base is turned since the
    /// angle was zeroed, positive in the direction in which the actuator bends), tip_load_g,
    /// tube_mm, temperature_c, rested_s, new_part=actuator|sensor
    #[arg(long, value_name = "KEY=VALUE,…")]
    setup: Option<Setup>,
    /// What `softrig commission` measured of the board: its clock corrects the times
    /// [default: softrig.toml, if there is one]
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    /// The rig stands as the protocol file asks: do not wait for Enter
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

/// Rest after arming and before a protocol (ms of the board's time).
const REST_MS: i64 = 1_000;
/// Time recorded after the end of a protocol or after a fault (ms).
const AFTER_MS: i64 = 500;
/// In which time (wall clock) the air goes out of a rig at rest; the board's own fault comes 3.5 s
/// after the vent was opened.
const VENTED: Duration = Duration::from_secs(4);
/// What a pressure sensor may show without pressure (kPa), as the board has it before it arms.
const NO_PRESSURE_KPA: f32 = 5.0;

/// How long (ms) a run may take beyond twice the time of its protocol: releases wait until the
/// plunger is back. The board has a deadline for each of them; this is for a board that keeps
/// none.
const LATEST_END_MS: i64 = 600_000;

/// Longest wait (wall clock) for the board to obey.
const OBEY: Duration = Duration::from_secs(5);

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
                "leave --split away: it needs a release of a second or more after every step",
            )
        })?,
        _ => Vec::new(),
    };
    // One part that is no step is the whole protocol: nothing to list.
    let parts = protocol
        .as_ref()
        .map(parts)
        .filter(|parts| parts.len() > 1 || parts.iter().any(|part| part.step.is_some()))
        .unwrap_or_default();
    let played = protocol.as_ref().and_then(|it| it.path.as_ref());
    check_output(output, played, &files, args.force)?;
    let asked = protocol.as_ref().map(|it| it.setup.clone());
    let setup = setup_of(args.setup.as_ref(), asked.as_ref());
    if let Some(asked) = asked.filter(|_| !args.ready) {
        super::ask_to_set_up(&asked)?;
    }
    let clock_factor = clock_factor(args.rig.as_deref(), port)?;
    let interrupt = Interrupt::listen()?;
    let stage = Stage::new();
    stage.wait("waiting for the board, which restarts");
    let mut link = Link::open(SerialConnector::new(port), Timing::default())?;
    stage.wait("reading the board's settings");
    link.learn_patience()?;
    if args.clear {
        link.request(Command::Clear)?;
    }
    let status = link.status()?;
    if let (Some(fault), Some(_)) = (status.fault, &protocol) {
        return Err(link.faulted(fault.code()))
            .context("nothing was moved; when the cause is gone, record with --clear");
    }
    let mut angle_range_deg = None;
    if let Some(protocol) = &protocol {
        let settings = link.read_settings(|_, _| ())?;
        angle_range_deg = angle_range(&settings);
        for advice in check_limits(protocol, &settings)? {
            super::warn(&advice);
        }
    }
    let about = About {
        angle_range_deg,
        setup,
        clock_factor,
        ..about(&link, port, protocol.as_ref())
    };
    let recorder = Recorder::create(output, about, !parts.is_empty())?;
    let mut session = Session {
        link,
        recorder,
        interrupt,
        patience: Duration::from_secs_f64(args.patience),
        stage,
    };
    let outcome = match &protocol {
        Some(protocol) => session.play(protocol),
        None => session.listen(args.seconds),
    };
    let armed = outcome.is_err() || !matches!(outcome, Ok(End::Complete));
    session.leave(armed && protocol.is_some());
    let remaining_kpa = if protocol.is_some() {
        session.remaining_kpa()
    } else {
        None
    };
    // Nobody pumps into what does not vent.
    if protocol.is_some() && !armed && remaining_kpa.is_none() {
        session.count_lost_steps();
    }
    if status.fault.is_none() {
        session.keep_black_box();
    }
    session.stage.finish();
    let ended = session.end(outcome, &parts, args.split, output);
    if let Some(kpa) = remaining_kpa {
        super::warn(&format!(
            "{kpa:.0} kPa are still in the actuator: open it by hand before you touch it"
        ));
    }
    ended
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
        Some(_) => Err(InputError::new(
            found,
            "`softrig commission` writes it, or leave --rig away",
        )
        .in_file(path)),
        None => Ok(None),
    };
    let Some(file) = RigFile::find(path)? else {
        return absent("is not there");
    };
    match (file.board, file.clock) {
        (Some(its), Some(clock)) if its == board => Ok(Some(clock.factor)),
        (Some(its), Some(_)) => {
            let found = format!("is of the board `{its}`, and this one is `{board}`");
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

/// How a recording ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// As expected.
    Complete,
    /// Someone pressed Ctrl-C.
    Interrupted,
}

struct Session {
    link: Link,
    recorder: Recorder,
    interrupt: Interrupt,
    patience: Duration,
    stage: Stage,
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

    fn suspend(&self, say: impl FnOnce()) {
        self.bar.suspend(say);
    }

    fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// A fixed template; tests would find an invalid one.
fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

impl Session {
    /// Handles the events of a short time; reconnects if the connection was lost.
    fn pump(&mut self) -> anyhow::Result<()> {
        let wait = Duration::from_millis(50);
        if let Some(event) = self.link.next_event(wait) {
            self.recorder.take(&event);
        }
        self.recorder.check()?;
        if !self.link.is_connected() {
            self.reconnect()?;
        }
        // A board that replies is there; one that says everything but samples is not to be waited for.
        let is_late = self.link.quiet_for() > self.patience
            || self.link.without_sample_for() > 10 * self.patience;
        if is_late && !self.interrupt.requested() {
            Err(self.link.late(
                &format!(
                    "no sample has come for {:.0} s, although the port is open: {}",
                    self.link.without_sample_for().as_secs_f64(),
                    self.link.what_came()
                ),
                "press the board's reset button and record again; what was recorded so far is kept",
            ))?;
        }
        Ok(())
    }

    fn request(&mut self, command: Command) -> Result<String, LinkError> {
        let recorder = &mut self.recorder;
        self.link
            .request_with(command, &mut |event| recorder.take(&event))
    }

    fn reconnect(&mut self) -> anyhow::Result<()> {
        let port = self.link.port().to_owned();
        self.stage.suspend(|| {
            super::warn(&format!(
                "{port}: the connection was lost after {:.1} s of the recording; waiting for it to come back",
                self.recorder.elapsed_ms() as f64 / 1000.0
            ));
        });
        let until = Instant::now() + self.patience;
        while Instant::now() < until && !self.interrupt.requested() {
            match self.link.reconnect() {
                Ok(()) => {
                    self.stage.suspend(|| {
                        super::warn(&format!("{port}: the connection is back"));
                    });
                    return Ok(());
                }
                Err(error @ LinkError::OtherVersion { .. }) => return Err(error.into()),
                Err(_) => std::thread::sleep(Duration::from_millis(200)),
            }
        }
        if self.interrupt.requested() {
            return Ok(());
        }
        Err(self.link.late(
            &format!(
                "the connection did not come back within {:.0} s",
                self.patience.as_secs_f64()
            ),
            "check the cable; what was recorded so far is kept",
        ))?
    }

    fn state(&self) -> Option<State> {
        self.recorder.last().map(|row| row.sample.state)
    }

    /// Waits by the board's clock; false after Ctrl-C.
    fn rest(&mut self, ms: i64) -> anyhow::Result<bool> {
        // The first sample may still be on its way.
        while self.recorder.last().is_none() && !self.interrupt.requested() {
            self.pump()?;
        }
        let end = self.recorder.elapsed_ms() + ms;
        while self.recorder.elapsed_ms() < end {
            if self.interrupt.requested() {
                return Ok(false);
            }
            self.pump()?;
        }
        Ok(true)
    }

    /// Records for some time, or until Ctrl-C.
    fn listen(&mut self, seconds: Option<f64>) -> anyhow::Result<End> {
        // At most a million seconds.
        #[allow(clippy::cast_possible_truncation)]
        let total = seconds.map(|seconds| (seconds * 1000.0).round() as i64);
        self.stage.wait("recording, Ctrl-C ends it");
        if total.is_none() && !std::io::stderr().is_terminal() {
            remark("recording until Ctrl-C or SIGTERM; --seconds N ends it by itself");
        }
        while total.is_none_or(|total| self.recorder.elapsed_ms() < total) {
            if self.interrupt.requested() {
                return Ok(if total.is_none() {
                    End::Complete
                } else {
                    End::Interrupted
                });
            }
            self.pump()?;
            if let Some(total) = total {
                self.stage
                    .play("recording", self.recorder.elapsed_ms(), total);
            }
        }
        Ok(End::Complete)
    }

    /// Arms the rig, plays the protocol, and waits for its end.
    fn play(&mut self, protocol: &ProtocolFile) -> anyhow::Result<End> {
        self.stage.wait("recording the actuator at rest");
        if !self.rest(AFTER_MS)? {
            return Ok(End::Interrupted);
        }
        if self.state() != Some(State::Ready) {
            self.stage.wait("homing the plunger, at most a minute");
            let (recorder, interrupt) = (&mut self.recorder, &self.interrupt);
            let ready = self.link.arm(&mut |event| {
                recorder.take(&event);
                !interrupt.requested()
            })?;
            if !ready {
                return Ok(End::Interrupted);
            }
        }
        self.stage.wait("sending the protocol");
        self.load(protocol)?;
        self.stage.wait("letting the actuator settle");
        if !self.rest(REST_MS)? {
            return Ok(End::Interrupted);
        }
        match self.request(Command::Run(protocol.named)) {
            Ok(_) => {}
            // It has been running since the first request; only the reply was lost.
            Err(LinkError::Refused { retried: true, .. })
                if self.state() == Some(State::Running) => {}
            Err(error) => return Err(error.into()),
        }
        self.stage.wait("waiting for the first step");
        self.follow(protocol)
    }

    /// Sends a protocol that the board does not know.
    fn load(&mut self, protocol: &ProtocolFile) -> Result<(), LinkError> {
        if protocol.named.is_some() {
            return Ok(());
        }
        for command in load_commands(protocol) {
            self.request(command)?;
        }
        Ok(())
    }

    /// Waits for the end of a protocol that was started.
    fn follow(&mut self, protocol: &ProtocolFile) -> anyhow::Result<End> {
        let asked = Instant::now();
        let asked_ms = self.recorder.elapsed_ms();
        let mut started_ms = None;
        let name = printable_line(&protocol.name).into_owned();
        loop {
            if self.interrupt.requested() {
                return Ok(End::Interrupted);
            }
            self.pump()?;
            let now_ms = self.recorder.elapsed_ms();
            match self.state() {
                Some(State::Running) => {
                    let started = *started_ms.get_or_insert(now_ms);
                    let total = i64::from(protocol.total_ms());
                    self.stage.play(&name, now_ms - started, total);
                    if now_ms - started > 2 * total + LATEST_END_MS {
                        Err(self.link.late(
                            "the protocol should have ended minutes ago",
                            "look whether the plunger comes back to its start; the rig is stopped now",
                        ))?;
                    }
                }
                Some(State::Fault) => {
                    let code = self.recorder.last().map_or(0, |row| row.sample.fault);
                    self.rest(AFTER_MS)?;
                    return Err(self.link.faulted(code)).context("the protocol was cut off");
                }
                Some(_) if started_ms.is_some() => break,
                // Telemetry sent before may still say ready.
                _ if asked.elapsed() > OBEY && now_ms > asked_ms + AFTER_MS => {
                    Err(self.link.late(
                        "the board accepted the protocol and does not play it",
                        "press its reset button and try again",
                    ))?;
                }
                _ => {}
            }
        }
        let played_ms = self.recorder.elapsed_ms() - started_ms.unwrap_or(0);
        self.stage.wait("waiting for rest");
        self.rest(AFTER_MS)?;
        let total_ms = i64::from(protocol.total_ms());
        if self.state() == Some(State::Ready) && played_ms + REST_MS >= total_ms {
            return Ok(End::Complete);
        }
        Err(self.link.late(
            &format!(
                "the protocol ended after {:.1} s of {:.1} s",
                played_ms as f64 / 1000.0,
                total_ms as f64 / 1000.0
            ),
            "a pulled cable or the reset button ends it: look for the gap in the recording, and record again",
        ))?
    }

    /// Leaves the rig at rest in any case.
    fn leave(&mut self, at_once: bool) {
        if !self.link.is_connected() {
            // The board stops by itself when it receives nothing.
            return;
        }
        let last = if at_once {
            Command::Stop
        } else {
            Command::Disarm
        };
        if matches!(self.state(), Some(State::Idle | State::Fault) | None) && !at_once {
            return;
        }
        if let Err(error) = self.request(last) {
            super::warn(&format!(
                "{error}; the pump could not be told to stop, and stops by itself within seconds"
            ));
            return;
        }
        // So that the recording shows that it stopped.
        let until = Instant::now() + Duration::from_millis(500);
        while Instant::now() < until && self.link.is_connected() {
            if let Some(event) = self.link.next_event(Duration::from_millis(20)) {
                self.recorder.take(&event);
            }
            if matches!(self.state(), Some(State::Idle | State::Fault)) {
                break;
            }
        }
    }

    /// Writes the second before a fault, which the board remembers, beside the recording.
    fn keep_black_box(&mut self) {
        if self.state() != Some(State::Fault) || !self.link.is_connected() {
            return;
        }
        self.stage
            .wait("reading the second before the fault from the board");
        let kept = self
            .link
            .past()
            .map_err(anyhow::Error::from)
            .and_then(|past| match past.as_slice() {
                [] => Ok(()),
                past => Ok(self.recorder.write_black_box(past).map(drop)?),
            });
        if let Err(error) = kept {
            self.stage.suspend(|| {
                super::warn(&format!(
                    "the second before the fault is lost, the recording is not: {error:#}"
                ));
            });
        }
    }

    /// The pressure that stays although the rig is at rest with its vent open; none if it goes
    /// out or is not known.
    fn remaining_kpa(&mut self) -> Option<f32> {
        let until = Instant::now() + VENTED;
        loop {
            let kpa = self.recorder.last()?.sample.pressure_kpa?.to_f32();
            if kpa.abs() <= NO_PRESSURE_KPA {
                return None;
            }
            if Instant::now() >= until || !self.link.is_connected() {
                return Some(kpa);
            }
            if let Some(event) = self.link.next_event(Duration::from_millis(20)) {
                self.recorder.take(&event);
            }
        }
    }

    /// Homes once more, beside the recording: what the counter is off by then was lost in the run.
    fn count_lost_steps(&mut self) {
        // A firmware that does not know the question would only move the plunger.
        if !self.link.is_connected() || self.link.machine().is_err() {
            return;
        }
        self.stage
            .wait("homing once more, to count the steps that were lost");
        let Self {
            link, interrupt, ..
        } = self;
        let counted = link
            .arm(&mut |_| !interrupt.requested())
            .and_then(|_| link.machine());
        // Stopped, whatever came of it.
        let stopped = link.request(Command::Disarm);
        match counted.and_then(|machine| stopped.map(|_| machine)) {
            Ok(machine) => self.recorder.about.lost_steps = machine.lost_steps,
            Err(error) => self.stage.suspend(|| {
                super::warn(&format!(
                    "whether steps were lost is not known, the recording is whole: {error}"
                ));
            }),
        }
    }

    /// Completes the metadata, and reports the files.
    fn end(
        self,
        outcome: anyhow::Result<End>,
        parts: &[Part],
        cut: bool,
        output: &Path,
    ) -> anyhow::Result<()> {
        let Self {
            link, mut recorder, ..
        } = self;
        recorder.counts.count(&link.counters());
        recorder.about.complete = matches!(outcome, Ok(End::Complete));
        let counts = recorder.counts;
        let gaps = recorder.about.gap.len() as u64;
        let mismatch_from_s = recorder.about.mismatch_from_s;
        let lost_steps = recorder.about.lost_steps;
        let restarts = told_restarts(&recorder.about.gap);
        let has_moved = !recorder.about.segments.is_empty();
        let black_box = recorder
            .about
            .black_box
            .is_some()
            .then(|| black_box_path(output));
        let mut kept = format!(
            "{} samples are kept in {}",
            counts.samples,
            output.display()
        );
        if let Some(path) = &black_box {
            kept += &format!(
                ", the second before the fault, as the board saw it, in {}",
                path.display()
            );
        }
        if let Some(restarts) = &restarts {
            kept += &format!("; {restarts}");
        }
        let finished = recorder.finish(parts, cut);
        // The cause comes first; that the recording could not be completed follows from it.
        let outcome = outcome.map_err(|error| error.context(kept.clone()))?;
        let runs = finished.context(kept.clone())?;
        if outcome == End::Interrupted {
            anyhow::bail!("interrupted; the pump was told to stop, {kept}");
        }
        let mut text = format!("{}: {} samples", output.display(), counts.samples);
        for (count, what) in [
            (counts.dropped_lines, "lines were lost on the way"),
            (gaps, "gaps"),
            (
                counts.rows_without_reading,
                "rows without a reading are in the .faulty.csv beside it",
            ),
        ] {
            if count > 0 {
                text += &format!(", {count} {what}");
            }
        }
        text.push('\n');
        if let Some(from_s) = mismatch_from_s {
            text += &format!(
                "from {from_s:.1} s on the angle disagrees with the board's prediction (column mismatch): a flex sensor that came off, or a model that is wrong\n"
            );
        }
        text += &lost_steps.map_or_else(String::new, told_lost);
        if let (Some(first), Some(last)) = (runs.first(), runs.last()) {
            text += &format!(
                "{} runs: {} … {}\n",
                runs.len(),
                first.display(),
                last.display()
            );
        }
        if let Some(path) = &black_box {
            text += &format!(
                "the second before the fault, as the board saw it: {}\n",
                path.display()
            );
        }
        if has_moved {
            text += &format!(
                "next: softrig diagnose --model MODEL.toml {}\n",
                output.display()
            );
        }
        if let Some(restarts) = restarts {
            text += &format!("{restarts}\n");
        }
        Ok(super::print(&text)?)
    }
}

/// Where the board started anew within the recording, if it did.
fn told_restarts(gaps: &[Gap]) -> Option<String> {
    let restarts: Vec<String> = gaps
        .iter()
        .filter(|gap| gap.restarted)
        .map(|gap| format!("{:.1} s", gap.from_s))
        .collect();
    (!restarts.is_empty()).then(|| {
        format!(
            "the board restarted after {}: look at its supply and the cable; its times after that are by this computer's clock",
            restarts.join(", ")
        )
    })
}

/// Microsteps within which a home is found: what `softrig commission` bears.
const HOME_STEPS: u32 = 17;

/// What lost steps mean for the recording.
fn told_lost(steps: i32) -> String {
    let most = steps.unsigned_abs();
    if most <= HOME_STEPS {
        return format!("no steps lost: the plunger came home within {most} microsteps\n");
    }
    let way = if steps > 0 {
        "less far in"
    } else {
        "farther in"
    };
    format!(
        "{most} microsteps were lost: at the end the plunger stood {way} than pump_ul says; look at the driver's current and 12 V, at the coupling, and at what the plunger rubs on\n"
    )
}

/// The commands that load a protocol into a board.
fn load_commands(protocol: &ProtocolFile) -> Vec<Command> {
    // A protocol was checked to have at most 32 segments.
    let count = u8::try_from(protocol.segments.len()).unwrap_or(u8::MAX);
    let segments = (0..count)
        .zip(&protocol.segments)
        .map(|(index, &segment)| Command::Segment { index, segment });
    std::iter::once(Command::Load(count))
        .chain(segments)
        .collect()
}

fn about(link: &Link, port: &str, protocol: Option<&ProtocolFile>) -> About {
    let board = link.board();
    let segments = protocol.map_or(&[][..], |protocol| &protocol.segments);
    About {
        simulated: is_pseudo_terminal(port).then_some(true),
        protocol: protocol.map(|protocol| protocol.name.clone()),
        started: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
        port: port.to_owned(),
        firmware: board.firmware.clone(),
        wire: board.wire,
        settings: board.settings.to_string(),
        image: board.image.map(|image| format!("{:04x}", image.found)),
        rig: env!("CARGO_PKG_VERSION").into(),
        segments: segments
            .iter()
            .map(|segment| {
                let mut text = wire::text::Text::default();
                let Ok(()) = segment.write(&mut text);
                text.0
            })
            .collect(),
        ..About::default()
    }
}

/// The angles (°) at the ends of the flex sensor's table, beyond which readings are
/// extrapolated.
fn angle_range(settings: &Settings) -> Option<[f64; 2]> {
    // At most eight.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let last = (settings.number(Key::FlexPoints) as u8).checked_sub(1)?;
    let [first, last] = [0, last].map(|point| f64::from(settings.number(Key::FlexAngle(point))));
    Some([first.min(last), first.max(last)])
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
    Recorder::create(path, about(link, link.port(), None), false)
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
