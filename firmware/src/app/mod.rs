//! The application: readings and lines in, outputs and replies out.
//!
//! It makes all decisions and touches no hardware, so that the whole of it runs and is tested on
//! a computer. The board layer makes an [`App`] after a reset and calls it once per control
//! period.

mod activity;
mod derived;
mod protection;
mod remarks;
mod requests;
mod saving;
mod texts;

use model_core::predictor::Predictor;
use ufmt::{uWrite, uwrite};
use wire::{
    answer::{Counters, Identity, ImageSum, SettingsId},
    decimal::Hundredths,
    fault::Fault,
    history::{FaultRecord, MOMENT_PERIODS, Moment},
    line::Sealed,
    reply::REMARK,
    settings::{Key, Settings},
    state::State,
    telemetry::{Setpoint, Telemetry},
};

use crate::{
    control::Measured,
    faults::Log,
    homing,
    io::{Inputs, Outputs, Oversampled, Pump, ResetCause, Valve},
    monitor::{Monitor, Seen},
    past::Past,
    runner::{Memory, Runner},
    safety::{Conditions, Event, Supervisor},
    self_test::SelfTest,
    sensing::{Calibration, Readings, Sensors},
    settings::{calibration, model},
    store::{Eeprom, Loaded, load},
    stroke::Stroke,
    units::{DEG_PER_RAD, KPA_PER_PA, RAD_PER_DEG},
};

use activity::{Activity, Play, PlayInputs};
use derived::Derived;
use protection::Protection;
use saving::Saving;

pub use texts::{HELP, PlainTexts, Texts};

/// Calls that prepare the table of the power, 20 ms of work.
const AT_ONCE: u8 = 14;

/// The memory of the board.
///
/// After a reset the board layer calls [`App::new`] and then [`App::banner`]. Then, once per
/// control period:
///
/// 1. [`App::receive`] for every line that was completed since, or [`App::overlong`] for one that
///    was too long;
/// 2. [`App::tick`] with the inputs, the EEPROM and the second before a fault, and applies the
///    outputs;
/// 3. [`App::telemetry`], and writes the line;
/// 4. [`App::report`], which writes at most one further line.
#[derive(Clone, Debug)]
pub struct App {
    settings: Settings,
    derived: Derived,
    draft: Settings,
    /// None while the settings make no sense.
    calibration: Option<Calibration>,
    /// The model of the settings; that of the self-test while there is one.
    predictor: Predictor,
    sensors: Sensors,
    supervisor: Supervisor,
    conditions: Conditions,
    reset: ResetCause,
    image: Option<ImageSum>,
    activity: Activity,
    memory: Memory,
    monitor: Monitor,
    protection: Protection,
    inputs: Inputs,
    seen: Seen,
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
    log: Log,
    stroke: Stroke,
    /// Whether the plunger was homed since the reset: the counter tells where it is.
    was_homed: bool,
    /// Microsteps that were lost between the last two homings.
    lost_steps: Option<i32>,
    /// How late the pressure sensor was at the last arming (ms).
    delay_ms: Option<u16>,
    /// The supply at the last arming.
    supply_armed: Oversampled,
    /// The state at the start of this period, and the segment of a protocol then.
    phase: (State, Option<u8>),
}

/// Takes the model of the settings for the prediction; returns whether it can be stepped.
#[inline(never)]
fn take_model(predictor: &mut Predictor, settings: &Settings) -> bool {
    let farthest = settings.number(Key::MaxAngle) * RAD_PER_DEG;
    // By reference: a second one has no room on the stack.
    match &model(settings) {
        Ok(model) => predictor.restart(model, farthest).is_ok(),
        Err(_) => false,
    }
}

impl App {
    /// Starts after a reset, idle, with the stored settings. If none are stored, or if they
    /// are damaged, which is a fault, the defaults are used.
    pub fn new(eeprom: &impl Eeprom, reset: ResetCause) -> Self {
        let mut app = Self::empty(reset, None);
        app.load(eeprom);
        app
    }

    /// Reads the settings and the log, and prepares calibration and model. It is separate from
    /// [`App::empty`], so that the board does not hold a second application on the stack.
    #[inline(never)]
    pub fn load(&mut self, eeprom: &impl Eeprom) {
        self.log.load(eeprom);
        self.stroke.load(eeprom);
        let found = load(eeprom, &mut self.settings);
        self.derived = Derived::of(&self.settings, &self.stroke);
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

    /// An application that has not read its settings. `image` is the program that runs it, as
    /// far as that is known.
    #[inline(always)] // Where it will stay: it is too large to be moved there.
    pub fn empty(reset: ResetCause, image: Option<ImageSum>) -> Self {
        Self {
            draft: Settings::EMPTY,
            settings: Settings::EMPTY,
            derived: Derived::NONE,
            sensors: Sensors::new(),
            supervisor: Supervisor::new(),
            conditions: Conditions {
                watchdog: reset == ResetCause::Watchdog,
                brown_out: reset == ResetCause::BrownOut,
                restarted: reset == ResetCause::WhileArmed,
                image_damaged: image.is_some_and(|image| !image.is_whole()),
                ..Conditions::default()
            },
            calibration: None,
            predictor: Predictor::empty(),
            reset,
            image,
            activity: Activity::None,
            memory: Memory::new(),
            monitor: Monitor::default(),
            protection: Protection::default(),
            inputs: Inputs::default(),
            seen: Seen::default(),
            outputs: Outputs::default(),
            volume: 0.0,
            heard: 0,
            sequence: 0,
            counters: Counters::default(),
            saving: Saving::No,
            help: None,
            self_test: None,
            sentence: None,
            log: Log::new(),
            stroke: Stroke::new(),
            was_homed: false,
            lost_steps: None,
            delay_ms: None,
            supply_armed: Oversampled::NOT_MEASURED,
            phase: (State::Idle, None),
        }
    }

    /// The settings in use.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The fastest change of the pump's rate (microsteps/s²).
    pub fn acceleration(&self) -> f32 {
        self.derived.acceleration
    }

    /// The board's state.
    pub fn state(&self) -> State {
        self.supervisor.state()
    }

    /// Writes who this is, and why it started if that is unusual.
    ///
    /// # Errors
    ///
    /// Errors of the output.
    pub fn banner<W: uWrite + ?Sized>(&self, out: &mut W) -> Result<(), W::Error> {
        let mut line = Sealed::new(out);
        line.write_str(REMARK)?;
        uwrite!(line, "{}", self.identity())?;
        match self.reset {
            ResetCause::Ordinary => {}
            ResetCause::BrownOut => line.write_str(", brown-out")?,
            ResetCause::Watchdog => line.write_str(", watchdog")?,
            ResetCause::WhileArmed => line.write_str(", restart")?,
        }
        line.finish()
    }

    fn identity(&self) -> Identity<'static> {
        Identity::new(
            env!("CARGO_PKG_VERSION"),
            SettingsId::of(&self.settings),
            self.image,
        )
    }

    /// Lets one control period pass.
    ///
    /// `past` is apart from the application, which is made on the stack.
    #[inline(never)]
    pub fn tick(&mut self, inputs: &Inputs, eeprom: &mut impl Eeprom, past: &mut Past) -> Outputs {
        self.inputs = *inputs;
        self.phase = (self.state(), self.running().map(Runner::index));
        self.store(eeprom);
        self.volume = inputs.steps as f32 * self.settings.number(Key::VolumePerStep);
        let readings = self.sense(inputs);
        let seen = protection::Seen {
            limits: &self.derived.limits,
            inputs,
            readings: &readings,
            outputs: &self.outputs,
            state: self.supervisor.state(),
            volume: self.volume,
            largest: self.derived.largest,
            farthest: self.derived.farthest,
            supply: self.supply_armed,
            seeks_pushed_end: match &self.activity {
                Activity::Homing(homing) => homing.seeks_pushed_end(),
                Activity::None | Activity::Playing(_) => false,
            },
            heard: self.heard,
        };
        self.protection.look(&seen, &mut self.conditions);
        self.latch();
        // Events, not conditions: once latched they are over.
        self.conditions.watchdog = false;
        self.conditions.brown_out = false;
        self.conditions.restarted = false;

        let measured = Measured {
            pressure: readings.pressure.filtered,
            angle: readings.angle.filtered,
            volume: self.volume,
            prediction: None,
        };
        let outputs = match self.state() {
            State::Idle | State::Fault => Outputs::default(),
            State::Homing => self.home(inputs, readings.pressure.filtered),
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
        self.remember(past);
        self.sequence = self.sequence.wrapping_add(1);
        self.outputs
    }

    /// Writes at most a byte of settings, log or stroke: a second one would wait 3.3 ms.
    #[inline(never)]
    fn store(&mut self, eeprom: &mut impl Eeprom) {
        if self.saving.step(&self.settings, eeprom) {
            self.conditions.settings_damaged = false;
        } else if self.saving.is_busy() {
            // The settings go first.
        } else if self.log.is_busy() {
            self.log.step(eeprom);
        } else {
            self.stroke.step(eeprom);
        }
    }

    /// Keeps this period for the second before a fault.
    #[inline(never)]
    fn remember(&self, past: &mut Past) {
        let (state, segment) = self.phase;
        if state != State::Fault {
            past.clear_if_ended();
        }
        let stopped = state != State::Fault && self.state() == State::Fault;
        if !stopped && !self.sequence.is_multiple_of(MOMENT_PERIODS) {
            return;
        }
        let time_ms = self.inputs.time_ms;
        past.note(&Moment {
            time_ms,
            pressure_kpa: self.seen.pressure,
            angle_deg: self.seen.angle,
            volume_ul: self.volume_ul(),
            state,
            segment,
        });
        if stopped {
            past.end(time_ms);
        }
    }

    /// Volume that the pump displaced (µl).
    fn volume_ul(&self) -> i32 {
        #[allow(clippy::cast_possible_truncation)] // Saturates.
        let volume_ul = self.volume as i32;
        volume_ul
    }

    /// Says what a fault means, and logs it.
    fn tell(&mut self, fault: Fault) {
        self.sentence = Some(fault);
        self.log.note(FaultRecord {
            number: 0,
            fault: fault.code(),
            state: self.phase.0,
            reset: self.reset,
            time_ms: self.inputs.time_ms,
            pressure_kpa: self.seen.pressure,
            volume_ul: self.volume_ul(),
        });
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

    /// A fault that control logic found.
    fn fail(&mut self, fault: Fault) {
        match fault {
            Fault::Stall => self.conditions.stall = true,
            Fault::EndSwitch => self.conditions.end_switch = true,
            Fault::RetractedSwitch => self.conditions.retracted_switch = true,
            Fault::MotorReversed => self.conditions.motor_reversed = true,
            Fault::Reach => self.conditions.out_of_reach = true,
            Fault::Disagreement => self.conditions.disagreement = true,
            Fault::Blind => self.conditions.blind = true,
            Fault::Late => self.conditions.late = true,
            Fault::GasLaw => self.conditions.gas_law = true,
            Fault::Vent => self.conditions.vent_blocked = true,
            _ => self.conditions.internal = true,
        }
        self.latch();
        self.activity = Activity::None;
    }

    /// Enters a fault if its condition holds.
    fn latch(&mut self) {
        let was_vented = !self.supervisor.is_latched(Fault::Vent);
        if let Some(fault) = self.supervisor.update(&self.conditions) {
            self.tell(fault);
            self.activity = Activity::None;
        } else if was_vented && self.supervisor.is_latched(Fault::Vent) {
            // Beside what stopped the rig, this is what its operator has to know.
            self.tell(Fault::Vent);
        }
    }

    #[inline(never)]
    fn home(&mut self, inputs: &Inputs, pressure: f32) -> Outputs {
        let Activity::Homing(homing) = &mut self.activity else {
            self.fail(Fault::Internal);
            return Outputs::default();
        };
        let progress = homing.step(&homing::Config::of(&self.settings), inputs, pressure);
        self.delay_ms = homing.delay_ms();
        match progress {
            homing::Progress::Moving(outputs) => outputs,
            homing::Progress::Done => {
                self.lost_steps = self.was_homed.then_some(homing.let_go_at());
                self.was_homed = true;
                if let Some(steps) = homing.stroke() {
                    self.stroke.note(steps, &self.settings);
                    self.derived = Derived::of(&self.settings, &self.stroke);
                }
                let air = homing.found().map_or(0.0, |found| found.air);
                self.derived.take_air(&self.settings, air);
                self.finish(Event::Homed);
                Outputs {
                    pump: Pump::Brake,
                    ..Outputs::default()
                }
            }
            homing::Progress::Failed(fault) => {
                self.fail(fault);
                Outputs::default()
            }
        }
    }

    #[inline(never)]
    fn play(&mut self, measured: &Measured) -> Outputs {
        let Activity::Playing(play) = &mut self.activity else {
            self.fail(Fault::Internal);
            return Outputs::default();
        };
        let progress = play.step(&PlayInputs {
            settings: &self.settings,
            largest: self.derived.largest,
            most: self.derived.most,
            memory: &self.memory,
            predictor: &self.predictor,
            monitor: &self.monitor,
            measured,
            pressurised: self.conditions.pressurised,
        });
        match progress {
            activity::Progress::Playing(outputs) => outputs,
            activity::Progress::Done(outputs) => {
                self.finish(Event::ProtocolDone);
                outputs
            }
            activity::Progress::Failed(fault) => {
                self.fail(fault);
                Outputs::default()
            }
        }
    }

    /// Ends the present activity.
    fn finish(&mut self, event: Event) {
        self.activity = Activity::None;
        if self.supervisor.handle(event, &self.conditions).is_err() {
            self.fail(Fault::Internal);
        }
    }

    /// The protocol that is being played, while there is one.
    fn running(&self) -> Option<&Runner> {
        match &self.activity {
            Activity::Playing(play) => Some(play.runner()),
            Activity::None | Activity::Homing(_) => None,
        }
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
        Telemetry {
            sequence: self.sequence,
            time_ms: self.inputs.time_ms,
            pressure_kpa: self.seen.pressure,
            angle_deg: self.seen.angle,
            predicted_deg: self.monitor.predicted(),
            setpoint: match &self.activity {
                Activity::Playing(play) => play.setpoint(),
                Activity::None | Activity::Homing(_) => Setpoint::None,
            },
            volume_ul: self.volume_ul(),
            state: self.state(),
            fault: self.supervisor.fault().map_or(0, Fault::code),
            mismatch: self.monitor.mismatch(),
        }
    }
}

#[cfg(test)]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
mod tests;

#[cfg(test)]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
mod reach;
