//! The application: what the board makes of readings and of lines.
//!
//! It owns everything that is decided and nothing that is wired. The board layer
//! calls, once a control period:
//!
//! 1. [`App::receive`] for every line that was completed since, or
//!    [`App::overlong`] for one that was too long;
//! 2. [`App::tick`] with the inputs and the EEPROM, and obeys the outputs;
//! 3. [`App::telemetry`], and writes the line;
//! 4. [`App::report`], which writes at most one further line.
//!
//! After a reset it calls [`App::new`] and then [`App::banner`].
//!
//! A request that comes twice, because its reply was lost, does nothing the
//! second time: what moves or saves is refused with [`Refusal::NotNow`], what
//! sets or asks has the same result.

use model_core::predictor::Predictor;
use ufmt::{uWrite, uwrite};
use wire::{
    checksum::Crc16,
    command::{Command, Rejection, Request},
    decimal::{HalfWord, Hundredths, Word},
    fault::Fault,
    line::Sealed,
    protocol::{Demand, Track},
    reply::{self, REMARK, Refusal, VERSION},
    settings::{Key, Settings},
    state::State,
    telemetry::{Setpoint, Telemetry},
};

use crate::{
    control::{self, Controller, DEG_PER_RAD, KPA_PER_PA, Measured, RAD_PER_DEG, limit},
    homing::{self, Homing, Progress},
    io::{Inputs, Outputs, Pump, ResetCause, Valve},
    monitor::{Monitor, Seen},
    probe::Probe,
    runner::{Memory, Runner},
    safety::{
        Conditions, Event, LARGEST_AT_REST_PA, LONGEST_VENTING, STILL_THERE, Supervisor,
        runs_into_end,
    },
    self_test::SelfTest,
    sensing::{Calibration, Readings, Sensors},
    settings::{Limits, calibration, check, model},
    stall::Watch,
    store::{Eeprom, Loaded, Poll, Writer, load},
};

/// Long texts for people, which the board keeps in flash: a constant string
/// would lie in its RAM.
pub trait Texts {
    /// Writes what a fault means and what to do.
    ///
    /// # Errors
    ///
    /// Those of the output.
    fn fault<W: uWrite + ?Sized>(&self, fault: Fault, out: &mut W) -> Result<(), W::Error>;

    /// Writes a line of the help, without a line end; whether another follows.
    ///
    /// # Errors
    ///
    /// Those of the output.
    fn help<W: uWrite + ?Sized>(&self, line: u8, out: &mut W) -> Result<bool, W::Error>;
}

/// The help, line by line.
pub const HELP: [&str; 6] = [
    "status, raw, exact, get KEY: look; stop, disarm: pump off, valve open",
    "arm: home and be ready; run [paper|steps|stairs|triangle|small|sines|hold]",
    "load N, seg I step|ramp|sines|hold|release|repeat ...: a protocol of your own",
    "set KEY BITS, save, discard: settings; tare: zero the sensors; clear: a fault",
    "selftest: model steps to the bit; hello, beat: for programs",
    "what moves or changes something needs a checksum: use rig",
];

/// The texts where RAM does not matter.
#[derive(Clone, Copy, Debug, Default)]
pub struct PlainTexts;

impl Texts for PlainTexts {
    fn fault<W: uWrite + ?Sized>(&self, fault: Fault, out: &mut W) -> Result<(), W::Error> {
        out.write_str(fault.sentence())
    }

    fn help<W: uWrite + ?Sized>(&self, line: u8, out: &mut W) -> Result<bool, W::Error> {
        if let Some(text) = HELP.get(usize::from(line)) {
            out.write_str(text)?;
        }
        Ok(usize::from(line) + 1 < HELP.len())
    }
}

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

/// Calls that prepare the table of the power, 20 ms of work.
const AT_ONCE: u8 = 14;

/// How near (microsteps) to its start position a plunger is back.
const BACK_STEPS: f32 = 3.0;

/// Periods for which it has to be back before the valve closes: the last air
/// goes out in 0.2 s.
const VENTING: u8 = 20;

/// Everything that the board remembers.
#[derive(Clone, Debug)]
pub struct App {
    settings: Settings,
    draft: Settings,
    /// None while the settings make no sense.
    calibration: Option<Calibration>,
    /// The model of the settings; that of the self-test while there is one.
    predictor: Predictor,
    sensors: Sensors,
    supervisor: Supervisor,
    conditions: Conditions,
    reset: ResetCause,
    homing: Option<Homing>,
    controller: Controller,
    memory: Memory,
    runner: Option<Runner>,
    monitor: Monitor,
    stall: Watch,
    /// Periods for which the plunger has been back at its start.
    back: u8,
    /// Periods for which the valve has been open; beyond [`LONGEST_VENTING`], those for
    /// which there is a pressure nevertheless.
    venting: u16,
    /// Whether the last reading of the pressure was above its limit.
    pressure_was_high: bool,
    inputs: Inputs,
    seen: Seen,
    setpoint: Setpoint,
    outputs: Outputs,
    volume: f32,
    /// When a valid line came last (ms).
    heard: u32,
    sequence: u16,
    counters: Counters,
    saving: Saving,
    /// The next line of help, while there is one.
    help: Option<u8>,
    self_test: Option<SelfTest>,
    /// A fault whose sentence is to be written.
    sentence: Option<Fault>,
}

/// How far settings are on their way to EEPROM.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Saving {
    No,
    /// Accepted; the slot is chosen in the next period.
    Accepted,
    Writing(Writer),
    /// What became of it is still to be told.
    Over {
        kept: bool,
    },
}

impl Saving {
    fn is_busy(self) -> bool {
        matches!(self, Self::Accepted | Self::Writing(_))
    }
}

/// Takes the model of settings for the prediction; whether it can be stepped.
#[inline(never)]
fn take_model(predictor: &mut Predictor, settings: &Settings) -> bool {
    let farthest = settings.number(Key::MaxAngle) * RAD_PER_DEG;
    // By reference: a second one has no room on the stack.
    match &model(settings) {
        Ok(model) => predictor.restart(model, farthest).is_ok(),
        Err(_) => false,
    }
}

/// The checksum of all settings, by which a computer knows them again.
pub fn checksum(settings: &Settings) -> u16 {
    let mut crc = Crc16::new();
    for word in settings.words() {
        for byte in word.to_le_bytes() {
            crc.update(byte);
        }
    }
    crc.value()
}

impl App {
    /// Starts after a reset, idle, with the settings that are stored; with those
    /// that a board is shipped with if none are or if they are damaged, which is
    /// a fault.
    pub fn new(eeprom: &impl Eeprom, reset: ResetCause) -> Self {
        let mut app = Self::empty(reset);
        app.load(eeprom);
        app
    }

    /// Reads the settings and computes what follows from them. Apart from
    /// [`App::empty`], so that on the board there is one application and not a
    /// second one on the stack meanwhile.
    #[inline(never)]
    pub fn load(&mut self, eeprom: &impl Eeprom) {
        let found = load(eeprom, &mut self.settings);
        self.draft.clone_from(&self.settings);
        self.calibration = calibration(&self.settings).ok();
        let is_steppable = take_model(&mut self.predictor, &self.settings);
        // No period has begun yet: a model without friction is ready with the first line.
        for _ in 0..AT_ONCE {
            self.predictor.prepare();
        }
        self.conditions.settings_damaged =
            found == Loaded::Damaged || self.calibration.is_none() || !is_steppable;
    }

    /// An application that has not read its settings.
    #[inline(always)] // Where it will stay: it is too large to be moved there.
    pub fn empty(reset: ResetCause) -> Self {
        Self {
            draft: Settings::EMPTY,
            settings: Settings::EMPTY,
            sensors: Sensors::new(),
            supervisor: Supervisor::new(),
            conditions: Conditions {
                watchdog: reset == ResetCause::Watchdog,
                brown_out: reset == ResetCause::BrownOut,
                ..Conditions::default()
            },
            calibration: None,
            predictor: Predictor::empty(),
            reset,
            homing: None,
            controller: Controller::new(),
            memory: Memory::new(),
            runner: None,
            monitor: Monitor::default(),
            stall: Watch::default(),
            back: 0,
            venting: 0,
            pressure_was_high: false,
            inputs: Inputs::default(),
            seen: Seen::default(),
            setpoint: Setpoint::None,
            outputs: Outputs::default(),
            volume: 0.0,
            heard: 0,
            sequence: 0,
            counters: Counters::default(),
            saving: Saving::No,
            help: None,
            self_test: None,
            sentence: None,
        }
    }

    /// The settings in use: the board's driver takes its acceleration from them.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// What the board is doing.
    pub fn state(&self) -> State {
        self.supervisor.state()
    }

    /// Writes who this is, and why it started if that is unusual.
    ///
    /// # Errors
    ///
    /// Those of the output.
    pub fn banner<W: uWrite + ?Sized>(&self, out: &mut W) -> Result<(), W::Error> {
        let mut line = Sealed::new(out);
        line.write_str(REMARK)?;
        self.identity(&mut line)?;
        match self.reset {
            ResetCause::Ordinary => {}
            ResetCause::BrownOut => line.write_str(", brown-out")?,
            ResetCause::Watchdog => line.write_str(", watchdog")?,
        }
        line.finish()
    }

    fn identity<W: uWrite + ?Sized>(&self, out: &mut W) -> Result<(), W::Error> {
        uwrite!(
            out,
            "softrig {} wire {} settings {}",
            env!("CARGO_PKG_VERSION"),
            VERSION,
            HalfWord(checksum(&self.settings))
        )
    }

    /// Lets one control period pass.
    #[inline(never)]
    pub fn tick(&mut self, inputs: &Inputs, eeprom: &mut impl Eeprom) -> Outputs {
        self.inputs = *inputs;
        self.store(eeprom);
        self.volume = inputs.steps as f32 * self.settings.number(Key::VolumePerStep);
        let readings = self.sense(inputs);
        self.look(inputs, &readings);
        if self.supervisor.update(&self.conditions).is_some() {
            self.sentence = self.supervisor.fault();
            self.rest();
        }
        // Events, not conditions: once latched they are over.
        self.conditions.watchdog = false;
        self.conditions.brown_out = false;

        let measured = Measured {
            pressure: readings.pressure.filtered,
            angle: readings.angle.filtered,
            volume: self.volume,
            expected: None,
        };
        let outputs = match self.state() {
            State::Idle | State::Fault => Outputs::default(),
            State::Homing => self.home(inputs),
            State::Ready => Outputs {
                pump: Pump::Rate(0.0),
                valve: Valve::Closed,
                ..Outputs::default()
            },
            State::Running => self.play(&measured),
        };
        self.outputs = Outputs {
            light: self.light(),
            ..self.supervisor.restrain(outputs)
        };
        self.predict();
        self.sequence = self.sequence.wrapping_add(1);
        self.outputs
    }

    /// Steps the prediction, or prepares its tables a little further.
    #[inline(never)]
    fn predict(&mut self) {
        if !self.predictor.prepare() || self.self_test.is_some() {
            return;
        }
        let judge = self.state() == State::Running;
        self.monitor
            .step(&self.predictor, &self.settings, &self.seen, judge);
    }

    /// Writes a byte of what is to be saved.
    #[inline(never)]
    fn store(&mut self, eeprom: &mut impl Eeprom) {
        self.saving = match self.saving {
            Saving::Accepted => Saving::Writing(Writer::new(eeprom)),
            Saving::Writing(mut writer) => match writer.step(&self.settings, eeprom) {
                Poll::Writing => Saving::Writing(writer),
                Poll::Done => {
                    self.conditions.settings_damaged = false;
                    Saving::Over { kept: true }
                }
                Poll::Failed => Saving::Over { kept: false },
            },
            other => other,
        };
    }

    /// Reads the sensors; without a calibration there is nothing to read.
    #[inline(never)]
    fn sense(&mut self, inputs: &Inputs) -> Readings {
        let Some(calibration) = &self.calibration else {
            self.seen = Seen::default();
            return Readings::default();
        };
        let readings = self.sensors.update(calibration, inputs);
        let rounded =
            |value: Option<f32>, scale| value.map(|value| Hundredths::round(value * scale));
        self.seen = Seen {
            pressure: rounded(readings.pressure.valid(), KPA_PER_PA),
            angle: rounded(readings.angle.valid(), DEG_PER_RAD),
        };
        readings
    }

    /// What may be wrong in this period.
    #[inline(never)]
    fn look(&mut self, inputs: &Inputs, readings: &Readings) {
        let limits = Limits::of(&self.settings);
        // Numbers above zero are in the order of their bits, which are compared in a tenth
        // of the time; what is not a number counts as much.
        let size = readings.pressure.filtered.abs().to_bits();
        let pressurised = size > LARGEST_AT_REST_PA.to_bits();
        let rate = match self.outputs.pump {
            Pump::Rate(rate) => rate,
            Pump::Off | Pump::Brake => 0.0,
        };
        let closed = self.outputs.valve == Valve::Closed;
        self.venting = if closed {
            0
        } else if pressurised {
            self.venting.saturating_add(1)
        } else {
            self.venting.saturating_add(1).min(LONGEST_VENTING)
        };
        let pressure = readings.pressure.value;
        // Twice in a row: a wire that breaks within a reading leaves a mean of
        // good and bad conversions, which can look like any pressure once.
        let high = readings.pressure.fresh && pressure > limits.pressure_pa;
        let over_pressure = core::mem::replace(&mut self.pressure_was_high, high) && high;
        self.conditions = Conditions {
            emergency_stop: inputs.emergency_stop,
            over_pressure,
            // A flex sensor is noisy; 20 ms do not matter to silicone.
            over_angle: readings.angle.filtered > limits.angle_rad,
            pressure_sensor: readings.pressure.fault.is_some(),
            flex_sensor: readings.angle.fault.is_some(),
            stall: self
                .stall
                .step(&self.settings, closed, self.volume, pressure),
            end_switch: runs_into_end(self.supervisor.state(), inputs, rate),
            host_silent: inputs.time_ms.wrapping_sub(self.heard) > limits.host_timeout_ms,
            overrun: inputs.overruns > 0,
            internal: false,
            retracted_switch: false,
            motor_reversed: false,
            vent_blocked: self.venting > LONGEST_VENTING + STILL_THERE,
            out_of_reach: false,
            disagreement: false,
            pressurised,
            ..self.conditions
        };
    }

    /// Forgets everything that was going on.
    fn rest(&mut self) {
        self.homing = None;
        self.runner = None;
        self.setpoint = Setpoint::None;
        self.back = 0;
    }

    /// A fault that control logic found.
    fn fail(&mut self, fault: Fault) {
        match fault {
            Fault::Stall => self.conditions.stall = true,
            Fault::EndSwitch => self.conditions.end_switch = true,
            Fault::RetractedSwitch => self.conditions.retracted_switch = true,
            Fault::MotorReversed => self.conditions.motor_reversed = true,
            Fault::Reach => self.conditions.out_of_reach = true,
            Fault::Disagreement => self.conditions.disagreement = true,
            _ => self.conditions.internal = true,
        }
        if self.supervisor.update(&self.conditions).is_some() {
            self.sentence = self.supervisor.fault();
        }
        self.rest();
    }

    #[inline(never)]
    fn home(&mut self, inputs: &Inputs) -> Outputs {
        let config = homing::Config::of(&self.settings);
        let homing = self.homing.get_or_insert_with(|| Homing::start(inputs));
        match homing.step(&config, inputs) {
            Progress::Moving(outputs) => outputs,
            Progress::Done => {
                self.homing = None;
                if self
                    .supervisor
                    .handle(Event::Homed, &self.conditions)
                    .is_err()
                {
                    self.fail(Fault::Internal);
                }
                Outputs {
                    pump: Pump::Brake,
                    ..Outputs::default()
                }
            }
            Progress::Failed(fault) => {
                self.fail(fault);
                Outputs::default()
            }
        }
    }

    #[inline(never)]
    fn play(&mut self, measured: &Measured) -> Outputs {
        let Some(runner) = &mut self.runner else {
            self.fail(Fault::Internal);
            return Outputs::default();
        };
        let config = control::Config::of(&self.settings).with_delay(self.predictor.delay_s());
        let per_step = self.settings.number(Key::VolumePerStep);
        let demand = runner.demand(&self.memory);
        let closed = |flow: f32| Outputs {
            pump: Pump::Rate(flow / per_step),
            valve: Valve::Closed,
            ..Outputs::default()
        };
        let outputs = match demand {
            Demand::Track { track, level } => {
                self.back = 0;
                let mut measured = *measured;
                if track == Track::AngleClosedLoop {
                    measured.expected = self.monitor.expected(&self.predictor);
                }
                let model = self.predictor.model();
                let flow = self
                    .controller
                    .track(&config, model, (track, level), &measured);
                self.setpoint = if track == Track::Pressure {
                    let pressure = self.controller.pressure_setpoint();
                    Setpoint::Pressure(Hundredths::round(pressure * KPA_PER_PA))
                } else {
                    let angle = self.controller.angle_setpoint();
                    Setpoint::Angle(Hundredths::round(angle * DEG_PER_RAD))
                };
                closed(flow)
            }
            Demand::Hold => {
                self.setpoint = Setpoint::None;
                closed(0.0)
            }
            Demand::Release | Demand::Done => {
                self.controller = Controller::new();
                self.setpoint = Setpoint::None;
                let start = homing::Config::of(&self.settings).start_volume();
                let gap = start - measured.volume;
                let is_back = limit::size(gap) <= BACK_STEPS * per_step;
                self.back = if is_back {
                    self.back.saturating_add(1)
                } else {
                    0
                };
                let flow = if is_back {
                    0.0
                } else {
                    config.pressure.approach(gap)
                };
                Outputs {
                    pump: Pump::Rate(flow / per_step),
                    ..Outputs::default()
                }
            }
        };
        if let Some(fault) = self.controller.fault() {
            self.fail(fault);
            return Outputs::default();
        }
        // Behind a narrow tube the air needs longer than the plunger.
        let is_back = self.back >= VENTING && !self.conditions.pressurised;
        if demand == Demand::Done {
            if is_back {
                self.runner = None;
                if self
                    .supervisor
                    .handle(Event::ProtocolDone, &self.conditions)
                    .is_err()
                {
                    self.fail(Fault::Internal);
                }
            }
        } else {
            runner.advance(&self.memory, is_back);
        }
        outputs
    }

    /// Slow blinking at rest, fast in a fault, steady while armed.
    fn light(&self) -> bool {
        let time = self.inputs.time_ms;
        match self.state() {
            State::Idle => time & 0x400 != 0,
            State::Fault => time & 0x80 != 0,
            State::Homing | State::Ready | State::Running => true,
        }
    }

    /// The sample of this period.
    pub fn telemetry(&self) -> Telemetry {
        #[allow(clippy::cast_possible_truncation)] // Saturates.
        let volume_ul = self.volume as i32;
        Telemetry {
            sequence: self.sequence,
            time_ms: self.inputs.time_ms,
            pressure_kpa: self.seen.pressure,
            angle_deg: self.seen.angle,
            predicted_deg: self.monitor.predicted(),
            setpoint: self.setpoint,
            volume_ul,
            state: self.state(),
            fault: self.supervisor.fault().map_or(0, Fault::code),
            mismatch: self.monitor.mismatch(),
        }
    }

    /// Writes at most one line that has been waiting: `#: saved` or `#: not saved`,
    /// the sentence of a fault, help, the self-test. One a period, so that the cable
    /// keeps up.
    ///
    /// # Errors
    ///
    /// Those of the output.
    #[inline(never)]
    pub fn report<W: uWrite + ?Sized>(
        &mut self,
        texts: &impl Texts,
        out: &mut W,
        probe: &mut impl Probe,
    ) -> Result<(), W::Error> {
        if let Saving::Over { kept } = self.saving {
            self.saving = Saving::No;
            let mut line = Sealed::new(out);
            line.write_str(REMARK)?;
            if !kept {
                line.write_str("not ")?;
            }
            line.write_str("saved")?;
            return line.finish();
        }
        if let Some(fault) = self.sentence.take() {
            let mut line = Sealed::new(out);
            line.write_str(REMARK)?;
            texts.fault(fault, &mut line)?;
            return line.finish();
        }
        // A line and the telemetry do not fit into one period on the cable.
        let has_room = self.sequence.is_multiple_of(4);
        if let Some(test) = &mut self.self_test {
            if has_room && !test.advance(&mut self.predictor, out, probe)? {
                self.self_test = None;
                if !take_model(&mut self.predictor, &self.settings) {
                    self.predictor.clear();
                }
            }
            return Ok(());
        }
        let Some(index) = self.help else {
            return Ok(());
        };
        if has_room {
            let mut line = Sealed::new(out);
            line.write_str(REMARK)?;
            let more = texts.help(index, &mut line)?;
            line.finish()?;
            self.help = more.then_some(index.saturating_add(1));
        }
        Ok(())
    }

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

    /// Commands whose reply says no more than ok or no.
    #[inline(never)]
    fn obey(&mut self, command: Command) -> Result<(), Refusal> {
        match command {
            Command::Help => self.help = Some(0),
            Command::Arm => {
                if self.is_busy() {
                    return Err(Refusal::NotNow);
                }
                self.supervisor.handle(Event::Arm, &self.conditions)?;
                self.rest();
            }
            Command::Disarm => {
                self.supervisor.handle(Event::Disarm, &self.conditions)?;
                self.rest();
            }
            Command::Stop => {
                self.supervisor.handle(Event::Stop, &self.conditions)?;
                self.rest();
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
                self.rest();
                self.runner = Some(runner);
                self.controller = Controller::new();
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
            // What is not here is answered elsewhere, or only heard.
            _ => {}
        }
        Ok(())
    }

    /// Whether something at rest is not to be disturbed.
    fn is_busy(&self) -> bool {
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
        if let Some(runner) = &self.runner {
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

#[cfg(test)]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
mod tests;

#[cfg(test)]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
mod reach;
