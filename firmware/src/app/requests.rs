//! What the board makes of a line from the computer: questions are answered, orders are
//! obeyed or refused.
//!
//! A request that comes twice, because its reply was lost, does nothing the second time:
//! what moves or saves is refused with [`Refusal::NotNow`], what sets or asks has the same
//! result.

use ufmt::{uWrite, uwrite};
use wire::{
    command::{Command, Rejection, Request},
    decimal::{HalfWord, Word},
    fault::Fault,
    reply::{self, Refusal},
    state::State,
};

use super::{Activity, App, Play, checksum, saving::Saving, take_model};
use crate::{
    homing::Homing,
    runner::Runner,
    safety::Event,
    self_test::SelfTest,
    sensing::Sensors,
    settings::{calibration, check},
};

/// Lines that were not obeyed, since reset; they stop counting at the top.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// No such command.
    pub unknown: u16,
    /// Checksum wrong.
    pub damaged: u16,
    /// Too long for a line.
    pub overlong: u16,
}

impl App {
    /// Counts a line that was too long to be read.
    pub fn overlong(&mut self) {
        self.counters.overlong = self.counters.overlong.saturating_add(1);
    }

    /// Obeys a line, without its end, and writes the reply.
    ///
    /// # Errors
    ///
    /// Those of the output.
    #[inline(never)]
    pub fn receive<W: uWrite + ?Sized>(
        &mut self,
        line: &[u8],
        out: &mut W,
    ) -> Result<(), W::Error> {
        let request = match Request::parse(line) {
            Ok(request) => request,
            Err(Rejection::Unsealed) => return reply::no(out, 0, Refusal::Unsealed),
            Err(Rejection::Unknown { id }) => {
                self.counters.unknown = self.counters.unknown.saturating_add(1);
                return reply::no(out, id, Refusal::Unknown);
            }
            Err(_) => {
                self.counters.damaged = self.counters.damaged.saturating_add(1);
                return Ok(());
            }
        };
        self.heard = self.inputs.time_ms;
        self.conditions.host_silent = false;
        let id = request.id;
        match request.command {
            Command::Hello => {
                let mut line = reply::ok(out, id)?;
                line.write_char(' ')?;
                self.identity(&mut line)?;
                line.finish()
            }
            Command::Status => self.status(id, out),
            Command::Raw => {
                let mut line = reply::ok(out, id)?;
                uwrite!(line, " {} {}", self.inputs.pressure.0, self.inputs.flex.0)?;
                line.finish()
            }
            Command::Exact => self.exact(id, out),
            Command::Get(key) => match self.settings.bits(key) {
                Some(bits) => {
                    let mut line = reply::ok(out, id)?;
                    uwrite!(line, " {}", Word(bits))?;
                    line.finish()
                }
                None => reply::no(out, id, Refusal::OutOfBounds),
            },
            Command::SelfTest => {
                if !matches!(self.state(), State::Idle | State::Fault) || self.is_busy() {
                    return reply::no(out, id, Refusal::NotNow);
                }
                self.monitor.restart();
                self.self_test = Some(SelfTest::default());
                reply::ok(out, id)?.finish()
            }
            command => match self.obey(command) {
                Ok(()) => reply::ok(out, id)?.finish(),
                Err(refusal) => reply::no(out, id, refusal),
            },
        }
    }

    /// Obeys an order, whose reply says no more than ok or no.
    #[inline(never)]
    fn obey(&mut self, command: Command) -> Result<(), Refusal> {
        match command {
            Command::Help => self.help = Some(0),
            Command::Arm => {
                if self.is_busy() {
                    return Err(Refusal::NotNow);
                }
                self.supervisor.handle(Event::Arm, &self.conditions)?;
                self.activity = Activity::Homing(Homing::start(&self.inputs));
            }
            Command::Disarm => {
                self.supervisor.handle(Event::Disarm, &self.conditions)?;
                self.activity = Activity::Rest;
            }
            Command::Stop => {
                self.supervisor.handle(Event::Stop, &self.conditions)?;
                self.activity = Activity::Rest;
            }
            Command::Clear => {
                self.supervisor.handle(Event::Clear, &self.conditions)?;
                self.monitor.clear();
            }
            Command::Run(named) => {
                if self.state() != State::Ready {
                    // The supervisor knows the reason.
                    return self.supervisor.handle(Event::Run, &self.conditions);
                }
                // A prediction begins at rest, not somewhere in the run.
                if !self.predictor.is_complete() {
                    return Err(Refusal::NotNow);
                }
                let runner = Runner::start(named, &self.memory, &self.settings)
                    .ok_or(Refusal::BadProtocol)?;
                self.supervisor.handle(Event::Run, &self.conditions)?;
                self.activity = Activity::Playing(Play::new(runner));
                self.monitor.restart();
                self.monitor.clear();
            }
            Command::Load(count) => {
                if self.state() == State::Running {
                    return Err(Refusal::NotNow);
                }
                self.memory.clear(count);
            }
            Command::Segment { index, segment } => {
                if self.state() == State::Running {
                    return Err(Refusal::NotNow);
                }
                if !self.memory.put(index, &segment) {
                    return Err(Refusal::BadProtocol);
                }
            }
            Command::Set { key, bits } => {
                self.draft
                    .set(key, bits)
                    .map_err(|_| Refusal::OutOfBounds)?;
            }
            Command::Discard => self.draft.clone_from(&self.settings),
            Command::Save => self.save()?,
            Command::Tare => {
                if self.state() != State::Idle {
                    return Err(Refusal::NotNow);
                }
                self.sensors.tare()?;
                // The prediction was in the old zero.
                self.monitor.restart();
            }
            // Heard, which is all that it is for.
            Command::Beat => {}
            // Questions: they were answered.
            Command::Hello
            | Command::Status
            | Command::Raw
            | Command::Exact
            | Command::Get(_)
            | Command::SelfTest => return Err(Refusal::Unknown),
        }
        Ok(())
    }

    /// Whether something at rest is not to be disturbed.
    pub(super) fn is_busy(&self) -> bool {
        self.saving.is_busy() || self.self_test.is_some()
    }

    /// Uses the draft, if it makes sense as a whole, and starts to write it.
    ///
    /// The reply comes at once and says that the settings are in use;
    /// [`App::report`] says some 3 s later whether the EEPROM has them.
    #[inline(never)] // What it needs on the stack is not for `main` to keep.
    fn save(&mut self) -> Result<(), Refusal> {
        let resting = matches!(self.state(), State::Idle | State::Fault);
        if !resting || self.is_busy() {
            return Err(Refusal::NotNow);
        }
        check(&self.draft)?;
        if !take_model(&mut self.predictor, &self.draft) {
            return Err(Refusal::BadSettings);
        }
        let calibrated = calibration(&self.draft).ok();
        if calibrated != self.calibration {
            self.calibration = calibrated;
            self.sensors = Sensors::new();
        }
        self.settings.clone_from(&self.draft);
        self.monitor.restart();
        self.saving = Saving::Accepted;
        Ok(())
    }

    #[inline(never)]
    fn status<W: uWrite + ?Sized>(&mut self, id: u8, out: &mut W) -> Result<(), W::Error> {
        let fault = self.supervisor.fault();
        self.sentence = fault;
        let mut line = reply::ok(out, id)?;
        line.write_char(' ')?;
        line.write_char(self.state().letter() as char)?;
        let counters = &self.counters;
        uwrite!(
            line,
            " {} {} {} {} {}",
            fault.map_or(0, Fault::code),
            counters.unknown,
            counters.damaged,
            counters.overlong,
            HalfWord(checksum(&self.settings)),
        )?;
        if let Some(runner) = self.running() {
            uwrite!(line, " {} {}", runner.index(), runner.repeat())?;
        }
        line.finish()
    }

    /// `SEQUENCE STEPS ANGLE RATE PRESSURE`: the prediction belongs to the line of
    /// that number, and started so many steps before; then its angle (rad), rate
    /// (rad/s) and newest pressure (Pa) to the bit.
    #[inline(never)]
    fn exact<W: uWrite + ?Sized>(&mut self, id: u8, out: &mut W) -> Result<(), W::Error> {
        let Some(prediction) = self.monitor.prediction() else {
            return reply::no(out, id, Refusal::NoReading);
        };
        let mut line = reply::ok(out, id)?;
        uwrite!(line, " {} {}", self.sequence, prediction.steps())?;
        for value in [
            prediction.angle(),
            self.predictor.rate(prediction),
            prediction.pressure(),
        ] {
            uwrite!(line, " {}", Word(value.to_bits()))?;
        }
        line.finish()
    }
}
