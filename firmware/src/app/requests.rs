//! Handles lines from the computer: queries are answered, commands are executed or
//! refused.
//!
//! A request that comes twice, because its reply was lost, has no further effect: a second
//! command that moves or saves is refused with [`Refusal::NotNow`], and one that sets or
//! queries has the same result.

use ufmt::{uDisplay, uWrite, uwrite};
use wire::{
    answer::{Bits, Exact, Machine, Place, Raw, SettingsId, Status, Switches},
    command::{Command, Rejection, Request},
    reply::{self, Refusal},
    state::State,
};

use super::{Activity, App, Play, derived::Derived, saving::Saving, take_model};
use crate::{
    homing::Homing,
    io::Inputs,
    past::Past,
    runner::Runner,
    safety::Event,
    self_test::SelfTest,
    sensing::Sensors,
    settings::{calibration, check},
    store::Eeprom,
    supply,
};

impl App {
    /// Counts a line that was too long to be read.
    pub fn overlong(&mut self) {
        self.counters.overlong = self.counters.overlong.saturating_add(1);
    }

    /// Obeys a line, without its end, and writes the reply.
    ///
    /// # Errors
    ///
    /// Errors of the output.
    #[inline(never)]
    pub fn receive<W: uWrite + ?Sized>(
        &mut self,
        line: &[u8],
        eeprom: &impl Eeprom,
        past: &Past,
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
            Command::Hello => answer(out, id, &self.identity()),
            Command::Status => {
                let status = self.status();
                self.sentence = status.fault;
                answer(out, id, &status)
            }
            Command::Raw => {
                let Inputs { pressure, flex, .. } = self.inputs;
                if !pressure.is_measured() || !flex.is_measured() {
                    return reply::no(out, id, Refusal::NoReading);
                }
                let raw = Raw {
                    pressure: pressure.0,
                    flex: flex.0,
                };
                answer(out, id, &raw)
            }
            Command::Switches => {
                let switches = Switches {
                    retracted: self.inputs.retracted_end,
                    pushed: self.inputs.pushed_end,
                    emergency_stop: self.inputs.emergency_stop,
                };
                answer(out, id, &switches)
            }
            Command::Machine => {
                let machine = Machine {
                    stroke_steps: self.stroke.steps(&self.settings),
                    lost_steps: self.lost_steps,
                    supply_mv: supply::millivolts(self.inputs.supply),
                    delay_ms: self.delay_ms,
                    air_ul: self.derived.air_ul(),
                };
                answer(out, id, &machine)
            }
            Command::Exact => match self.exact() {
                Some(exact) => answer(out, id, &exact),
                None => reply::no(out, id, Refusal::NoReading),
            },
            Command::Get(key) => match self.settings.bits(key) {
                Some(bits) => answer(out, id, &Bits(bits)),
                None => reply::no(out, id, Refusal::OutOfBounds),
            },
            Command::Log(back) => {
                // While a byte is written, reading waits for it.
                let resting = matches!(self.state(), State::Idle | State::Fault);
                if !resting || self.saving.is_busy() || self.log.is_busy() {
                    return reply::no(out, id, Refusal::NotNow);
                }
                match self.log.read(eeprom, back) {
                    Some(record) => answer(out, id, &record),
                    None => reply::no(out, id, Refusal::Nothing),
                }
            }
            Command::Past(back) => match past.get(back) {
                Some(moment) => answer(out, id, &moment),
                None => reply::no(out, id, Refusal::Nothing),
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

    /// Executes a command whose reply is only ok or no.
    #[inline(never)]
    fn obey(&mut self, command: Command) -> Result<(), Refusal> {
        match command {
            Command::Help => self.help = Some(0),
            Command::Arm | Command::Stroke => {
                if self.is_busy() {
                    return Err(Refusal::NotNow);
                }
                self.supervisor.handle(Event::Arm, &self.conditions)?;
                self.derived.forget_air();
                self.delay_ms = None;
                self.supply_armed = self.inputs.supply;
                self.activity = Activity::Homing(if command == Command::Stroke {
                    Homing::measuring(&self.inputs)
                } else {
                    Homing::start(&self.inputs)
                });
            }
            Command::Disarm => {
                self.supervisor.handle(Event::Disarm, &self.conditions)?;
                self.activity = Activity::None;
            }
            Command::Stop => {
                self.supervisor.handle(Event::Stop, &self.conditions)?;
                self.activity = Activity::None;
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
            | Command::Log(_)
            | Command::Past(_)
            | Command::Switches
            | Command::Machine
            | Command::Get(_)
            | Command::SelfTest => return Err(Refusal::Unknown),
        }
        Ok(())
    }

    /// Whether the board is busy at rest and must not be disturbed.
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
        if !self.stroke.allows(&self.draft) {
            return Err(Refusal::BeyondStroke);
        }
        if !take_model(&mut self.predictor, &self.draft) {
            return Err(Refusal::BadSettings);
        }
        self.calibrate();
        self.settings.clone_from(&self.draft);
        self.derived = Derived::of(&self.settings, &self.stroke);
        self.monitor.restart();
        self.saving = Saving::Accepted;
        Ok(())
    }

    /// Takes the calibration of the draft into use.
    #[inline(never)] // Its room on the stack shall not be there while the model is checked.
    fn calibrate(&mut self) {
        let calibrated = calibration(&self.draft).ok();
        if calibrated != self.calibration {
            self.calibration = calibrated;
            self.sensors = Sensors::new();
        }
    }

    fn status(&self) -> Status {
        Status {
            state: self.state(),
            fault: self.supervisor.fault(),
            counters: self.counters,
            settings: SettingsId::of(&self.settings),
            place: self.running().map(|runner| Place {
                segment: runner.index(),
                repeat: runner.repeat(),
            }),
        }
    }

    /// The prediction that the newest line of telemetry shows, if there is one.
    fn exact(&self) -> Option<Exact> {
        let prediction = self.monitor.prediction()?;
        Some(Exact {
            sequence: self.sequence,
            steps: prediction.steps(),
            angle: prediction.angle(),
            rate: self.predictor.rate(prediction),
            pressure: prediction.pressure(),
        })
    }
}

/// Writes a reply with an answer in it.
#[inline(never)]
fn answer<W: uWrite + ?Sized>(out: &mut W, id: u8, answer: &impl uDisplay) -> Result<(), W::Error> {
    let mut line = reply::ok(out, id)?;
    uwrite!(line, " {}", answer)?;
    line.finish()
}
