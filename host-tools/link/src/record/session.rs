//! A session at the rig: arms it, plays a protocol, records, and leaves it at rest.
//!
//! Who waits for it is an [`Attendant`]: a person at a terminal, or at a page in a browser. However
//! it ends, the pump is off and what was received is kept.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context;
use softrig_formats::instant::{Instant, sleep};
use softrig_formats::protocol_file::ProtocolFile;
use softrig_formats::setup::Setup;
use softrig_formats::terminal::printable_line;
use wire::command::Command;
use wire::settings::{Key, Settings};
use wire::state::State;

use super::outcome::{End, RecordingOutcome};
use super::{About, LoggedSample, Part, Recorder, Shelf, check_limits, parts};
use crate::{Connector, Event, Link, LinkError, Timing};

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

/// The stage of a recording that only its attendant ends.
pub const ENDLESS: &str = "recording until it is stopped";

/// Who waits while a rig is recorded.
pub trait Attendant {
    /// What is being done, for a time that is not known.
    fn waits(&mut self, stage: &'static str);

    /// What is being done, of which `passed_ms` of `total_ms` have passed by the board's clock.
    fn plays(&mut self, stage: &str, passed_ms: i64, total_ms: i64);

    /// A row of the recording.
    fn sees(&mut self, row: &LoggedSample);

    /// Something that is worth knowing, and does not end the recording.
    fn warns(&mut self, text: &str);

    /// Whether the recording is to end.
    fn has_enough(&self) -> bool;
}

/// What is to be recorded.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The file of the recording.
    pub output: PathBuf,
    /// What is played; without one nothing moves.
    pub protocol: Option<ProtocolFile>,
    /// How long is recorded without a protocol (s); until it is enough where none is said.
    pub seconds: Option<f64>,
    /// Whether each step is also written to a file of its own.
    pub split: bool,
    /// Whether a latched fault is cleared first.
    pub clear: bool,
    /// How long a pulled cable and a silent board are waited for.
    pub patience: Duration,
    /// How the rig stands, where somebody said so.
    pub setup: Option<Setup>,
    /// Seconds in one of the board's, if that was measured.
    pub clock_factor: Option<f64>,
    /// When it begins (RFC 3339, UTC).
    pub started: String,
}

/// Records a rig. An error says what was kept.
///
/// # Errors
///
/// Invalid protocols before anything moves; then faults of the link or the board.
pub fn record(
    connector: impl Connector + 'static,
    plan: &Plan,
    shelf: Box<dyn Shelf>,
    attendant: &mut dyn Attendant,
) -> anyhow::Result<RecordingOutcome> {
    attendant.waits("waiting for the board, which restarts");
    let mut link = Link::open(connector, Timing::default())?;
    attendant.waits("reading the board's settings");
    link.learn_patience()?;
    if plan.clear {
        link.request(Command::Clear)?;
    }
    let fault = link.status()?.fault;
    let protocol = plan.protocol.as_ref();
    if let (Some(fault), Some(_)) = (fault, protocol) {
        return Err(link.faulted(fault.code()))
            .context("nothing was moved; when the cause is gone, record with --clear");
    }
    let mut about = about(&link, protocol, plan.started.clone());
    about.setup.clone_from(&plan.setup);
    about.clock_factor = plan.clock_factor;
    if let Some(protocol) = protocol {
        let settings = link.read_settings(|_, _| ())?;
        about.angle_range_deg = angle_range(&settings);
        for advice in check_limits(protocol, &settings)? {
            attendant.warns(&advice);
        }
    }
    let parts = protocol.map(listed_parts).unwrap_or_default();
    let recorder = Recorder::create(shelf, &plan.output, about, !parts.is_empty())?;
    let session = Session {
        link,
        recorder,
        patience: plan.patience,
        attendant,
    };
    session.run(plan, &parts, fault.is_none())
}

/// The parts of a protocol that are listed as runs: one that is no step is the whole of it.
fn listed_parts(protocol: &ProtocolFile) -> Vec<Part> {
    let parts = parts(protocol);
    if parts.len() > 1 || parts.iter().any(|part| part.step.is_some()) {
        parts
    } else {
        Vec::new()
    }
}

/// What is known of a recording when it begins.
pub fn about(link: &Link, protocol: Option<&ProtocolFile>, started: String) -> About {
    let board = link.board();
    let segments = protocol.map_or(&[][..], |protocol| &protocol.segments);
    About {
        simulated: link.is_simulated().then_some(true),
        protocol: protocol.map(|protocol| protocol.name.clone()),
        started,
        port: link.port().to_owned(),
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

/// The commands that load a protocol into a board.
pub fn load_commands(protocol: &ProtocolFile) -> Vec<Command> {
    // A protocol was checked to have at most 32 segments.
    let count = u8::try_from(protocol.segments.len()).unwrap_or(u8::MAX);
    let segments = (0..count)
        .zip(&protocol.segments)
        .map(|(index, &segment)| Command::Segment { index, segment });
    std::iter::once(Command::Load(count))
        .chain(segments)
        .collect()
}

/// Takes what happened on the link.
fn take(recorder: &mut Recorder, attendant: &mut dyn Attendant, event: &Event) {
    let before = recorder.last().map(|row| row.time_ms);
    recorder.take(event);
    if let Some(row) = recorder.last()
        && before != Some(row.time_ms)
    {
        attendant.sees(row);
    }
}

struct Session<'a> {
    link: Link,
    recorder: Recorder,
    patience: Duration,
    attendant: &'a mut dyn Attendant,
}

impl Session<'_> {
    /// Records, leaves the rig at rest, and completes the files.
    fn run(
        mut self,
        plan: &Plan,
        parts: &[Part],
        was_well: bool,
    ) -> anyhow::Result<RecordingOutcome> {
        let outcome = match &plan.protocol {
            Some(protocol) => self.play(protocol),
            None => self.listen(plan.seconds),
        };
        let moved = plan.protocol.is_some();
        let is_cut_short = !matches!(outcome, Ok(End::Complete));
        self.leave(is_cut_short && moved);
        let remaining_kpa = if moved { self.remaining_kpa() } else { None };
        // Nobody pumps into what does not vent.
        if moved && !is_cut_short && remaining_kpa.is_none() {
            self.count_lost_steps();
        }
        if was_well {
            self.keep_black_box();
        }
        let Self {
            link,
            recorder,
            attendant,
            ..
        } = self;
        let ended = RecordingOutcome::of(recorder, &link.counters(), outcome, parts, plan.split);
        if let Some(kpa) = remaining_kpa {
            attendant.warns(&format!(
                "{kpa:.0} kPa are still in the actuator: open it by hand before you touch it"
            ));
        }
        ended
    }

    /// Handles the events of a short time; reconnects if the connection was lost.
    fn pump(&mut self) -> anyhow::Result<()> {
        let wait = Duration::from_millis(50);
        if let Some(event) = self.link.next_event(wait) {
            take(&mut self.recorder, self.attendant, &event);
        }
        self.recorder.check()?;
        if !self.link.is_connected() {
            self.reconnect()?;
        }
        // A board that replies is there; one that says everything but samples is not to be waited for.
        let is_late = self.link.quiet_for() > self.patience
            || self.link.without_sample_for() > 10 * self.patience;
        if is_late && !self.attendant.has_enough() {
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
        let (recorder, attendant) = (&mut self.recorder, &mut *self.attendant);
        self.link
            .request_with(command, &mut |event| take(recorder, attendant, &event))
    }

    fn reconnect(&mut self) -> anyhow::Result<()> {
        let port = self.link.port().to_owned();
        self.attendant.warns(&format!(
            "{port}: the connection was lost after {:.1} s of the recording; waiting for it to come back",
            self.recorder.elapsed_ms() as f64 / 1000.0
        ));
        let until = Instant::now() + self.patience;
        while Instant::now() < until && !self.attendant.has_enough() {
            match self.link.reconnect() {
                Ok(()) => {
                    self.attendant
                        .warns(&format!("{port}: the connection is back"));
                    return Ok(());
                }
                Err(error @ LinkError::OtherVersion { .. }) => return Err(error.into()),
                Err(_) => sleep(Duration::from_millis(200)),
            }
        }
        if self.attendant.has_enough() {
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

    /// Waits by the board's clock; false if that is enough.
    fn rest(&mut self, ms: i64) -> anyhow::Result<bool> {
        // The first sample may still be on its way.
        while self.recorder.last().is_none() && !self.attendant.has_enough() {
            self.pump()?;
        }
        let end = self.recorder.elapsed_ms() + ms;
        while self.recorder.elapsed_ms() < end {
            if self.attendant.has_enough() {
                return Ok(false);
            }
            self.pump()?;
        }
        Ok(true)
    }

    /// Records for some time, or until it is enough.
    fn listen(&mut self, seconds: Option<f64>) -> anyhow::Result<End> {
        // At most a million seconds.
        #[allow(clippy::cast_possible_truncation)]
        let total = seconds.map(|seconds| (seconds * 1000.0).round() as i64);
        self.attendant.waits(if total.is_none() {
            ENDLESS
        } else {
            "recording"
        });
        while total.is_none_or(|total| self.recorder.elapsed_ms() < total) {
            if self.attendant.has_enough() {
                return Ok(if total.is_none() {
                    End::Complete
                } else {
                    End::Interrupted
                });
            }
            self.pump()?;
            if let Some(total) = total {
                self.attendant
                    .plays("recording", self.recorder.elapsed_ms(), total);
            }
        }
        Ok(End::Complete)
    }

    /// Arms the rig, plays the protocol, and waits for its end.
    fn play(&mut self, protocol: &ProtocolFile) -> anyhow::Result<End> {
        self.attendant.waits("recording the actuator at rest");
        if !self.rest(AFTER_MS)? {
            return Ok(End::Interrupted);
        }
        if self.state() != Some(State::Ready) {
            self.attendant.waits("homing the plunger, at most a minute");
            let (recorder, attendant) = (&mut self.recorder, &mut *self.attendant);
            let ready = self.link.arm(&mut |event| {
                take(recorder, attendant, &event);
                !attendant.has_enough()
            })?;
            if !ready {
                return Ok(End::Interrupted);
            }
        }
        self.attendant.waits("sending the protocol");
        self.load(protocol)?;
        self.attendant.waits("letting the actuator settle");
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
        self.attendant.waits("waiting for the first step");
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
            if self.attendant.has_enough() {
                return Ok(End::Interrupted);
            }
            self.pump()?;
            let now_ms = self.recorder.elapsed_ms();
            match self.state() {
                Some(State::Running) => {
                    let started = *started_ms.get_or_insert(now_ms);
                    let total = i64::from(protocol.total_ms());
                    self.attendant.plays(&name, now_ms - started, total);
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
        self.attendant.waits("waiting for rest");
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
            self.attendant.warns(&format!(
                "{error}; the pump could not be told to stop, and stops by itself within seconds"
            ));
            return;
        }
        // So that the recording shows that it stopped.
        let until = Instant::now() + Duration::from_millis(500);
        while Instant::now() < until && self.link.is_connected() {
            if let Some(event) = self.link.next_event(Duration::from_millis(20)) {
                take(&mut self.recorder, self.attendant, &event);
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
        self.attendant
            .waits("reading the second before the fault from the board");
        let kept = self
            .link
            .past()
            .map_err(anyhow::Error::from)
            .and_then(|past| match past.as_slice() {
                [] => Ok(()),
                past => Ok(self.recorder.write_black_box(past).map(drop)?),
            });
        if let Err(error) = kept {
            self.attendant.warns(&format!(
                "only the second before the fault is lost: {error:#}"
            ));
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
                take(&mut self.recorder, self.attendant, &event);
            }
        }
    }

    /// Homes once more, beside the recording: what the counter is off by then was lost in the run.
    fn count_lost_steps(&mut self) {
        // A firmware that does not know the question would only move the plunger.
        if !self.link.is_connected() || self.link.machine().is_err() {
            return;
        }
        self.attendant
            .waits("homing once more, to count the steps that were lost");
        let Self {
            link, attendant, ..
        } = self;
        let counted = link
            .arm(&mut |_| !attendant.has_enough())
            .and_then(|_| link.machine());
        // Stopped, whatever came of it.
        let stopped = link.request(Command::Disarm);
        match counted.and_then(|machine| stopped.map(|_| machine)) {
            Ok(machine) => self.recorder.about.lost_steps = machine.lost_steps,
            Err(error) => self.attendant.warns(&format!(
                "the recording is complete; lost steps were not checked: {error}"
            )),
        }
    }
}
