// SPDX-License-Identifier: GPL-3.0-or-later
//! The board and the plant in closed loop, for tests and `serve`.
//!
//! The processor runs instruction by instruction; every half millisecond of
//! simulated time the plant takes one step and puts new voltages and switch
//! levels on the board's pins. Step pulses are counted to the cycle in between.
//! Nothing depends on the time of day: the same image, seed and input at the
//! same cycles give the same output.

use std::{collections::BTreeMap, f64::consts::TAU};

use model_core::actuator::Model;
use model_core::dynamics::Dynamics;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use softrig::estimate::Placement;
use wire::settings::{Key, Settings};

use crate::{
    board::{
        Board, BoardError, CLOCK_HZ, Mark, MarkTotal, ResetCause, SUPPLY_MILLIVOLTS, State,
        Stepper, StepperWiring,
    },
    fault::{Defect, Fault, Planned, Size},
    image::Image,
    noise::Noise,
    plant::{
        Inputs, Plant, PlantConfig,
        sensors::{PressureSensor, SensorFault},
    },
    stk500::{Bootloader, LISTENS_S, Memory, Phase},
    wiring,
};

/// Processor cycles between two steps of the plant: 0.5 ms.
pub const PLANT_CYCLES: u64 = 8_000;

/// A power cut without an end lasts this long (s).
pub const POWER_CUT_S: f64 = 0.5;

/// Where the plunger stands at power-on, from the retracted switch (mm).
const START_MM: std::ops::Range<f64> = 2.0..8.0;

/// Options of a virtual rig.
#[derive(Clone, Debug)]
pub struct Options {
    /// Everything that is not the board.
    pub plant: PlantConfig,
    /// Random seed: where the plunger stands at first, noise of
    /// the sensors and the line, torn bytes of EEPROM.
    pub seed: u64,
    /// The EEPROM at the start, 4096 bytes; erased if there is nothing.
    pub eeprom: Option<Vec<u8>>,
    /// The faults and their times.
    pub faults: Vec<Planned>,
    /// Whether the bootloader leaves the reset flags in MCUSR to the firmware. That of the
    /// Arduino Mega 2560 clears them.
    pub keeps_reset_flags: bool,
    /// True seconds in one of the board's: above 1 its clock is slow. A ceramic resonator, as
    /// the Mega has, is off by up to 0.5 %.
    pub clock_factor: f64,
}

impl Default for Options {
    /// A healthy rig with [`default_actuator`], seed 1, an exact clock and an erased EEPROM.
    fn default() -> Self {
        Self::with_actuator(default_actuator())
    }
}

impl Options {
    /// A healthy default rig around an actuator.
    pub fn with_actuator(actuator: Model<f64>) -> Self {
        Self {
            plant: PlantConfig::new(actuator),
            seed: 1,
            eeprom: None,
            faults: Vec::new(),
            keeps_reset_flags: false,
            clock_factor: 1.0,
        }
    }
}

/// The plain actuator that a board is shipped to believe in: it bends by 90° at
/// 87 kPa.
///
/// # Panics
///
/// Never: the shipped parameters are valid.
pub fn default_actuator() -> Model<f64> {
    let shipped = |key| f64::from(Settings::DEFAULT.number(key));
    let dynamics = Dynamics {
        inertia: shipped(Key::Inertia),
        damping: shipped(Key::Damping),
        stiffness: shipped(Key::Stiffness),
        exponent: shipped(Key::Exponent),
        input_gain: shipped(Key::InputGain),
    };
    Model::new(dynamics, &[]).expect("the shipped parameters are valid")
}

/// How things really are, without sensors and noise.
#[derive(Clone, Copy, Debug, PartialEq)]
// Switches and valves are two-valued, and there are that many.
#[allow(clippy::struct_excessive_bools)]
pub struct Truth {
    /// Simulated time since the start (s).
    pub time_s: f64,
    /// Bending angle (°).
    pub angle_deg: f64,
    /// Gauge pressure at actuator and sensor (kPa).
    pub pressure_kpa: f64,
    /// Plunger, from the retracted switch (mm).
    pub plunger_mm: f64,
    /// Whether the vent valve lets air out.
    pub valve_open: bool,
    /// Whether the board lets the motor step.
    pub driver_enabled: bool,
    /// Whether the on-board light is on.
    pub light_on: bool,
    /// Step pulses, position in microsteps, and steps lost.
    pub steps: Stepper,
    /// Whether the retracted switch reads pressed.
    pub retracted_pressed: bool,
    /// Whether the pushed-in switch reads pressed.
    pub pushed_in_pressed: bool,
    /// Whether the rig has power.
    pub powered: bool,
}

/// The supply of [`Fault::LowSupply`] (mV).
const LOW_SUPPLY_MV: u32 = 4_200;

/// A board in closed loop with a simulated actuator.
///
/// # Examples
///
/// ```no_run
/// use std::path::Path;
/// use virtual_rig::{Fault, Image, Options, VirtualRig};
///
/// let image = Image::read(Path::new("firmware.elf"))?;
/// let mut rig = VirtualRig::new(&image, Options { seed: 7, ..Options::default() })?;
/// rig.run_for(0.5)?;
/// println!("banner: {:?}", rig.take_lines());
/// rig.send(b"home\n")?;
/// let homed = rig.run_until_line(10.0, |line| line.contains("homed"))?;
/// assert!(homed.is_some());
/// rig.set_fault(Fault::Leak, true);
/// rig.run_for(2.0)?;
/// assert!(rig.plant().valve_open, "a leak must end in a vented actuator");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct VirtualRig {
    board: Board,
    /// What a processor cycle takes (s).
    cycle_s: f64,
    plant: Plant,
    random: Pcg64Mcg,
    next_plant_cycle: u64,
    powered: bool,
    /// The bootloader while it has the processor, and the cycle at which it
    /// gives up listening.
    loader: Option<(Bootloader, u64)>,
    power_on_at: Option<u64>,
    supply_mv: u32,
    /// What lasts, with its size.
    faults: BTreeMap<Fault, Size>,
    drifts: Drifts,
    planned: Vec<(Planned, ServeState)>,
    /// How it stands.
    placement: Placement,
    to_board: Noise,
    from_board: Noise,
    output: Vec<u8>,
    keep_marks: bool,
    marks: Vec<Mark>,
}

/// How far what drifts has come. What is mended is as it was.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Drifts {
    /// The pressure sensor's reading (kPa).
    pressure_kpa: f64,
    /// Every count of the converter (share).
    reference: f64,
    /// The voltages of both sensors (mV).
    ground_millivolts: f64,
    /// What the mains adds to both (mV).
    mains_millivolts: f64,
}

impl Drifts {
    /// The least share of a count that is left: a reference of five times the supply.
    const LEAST: f64 = -0.8;

    /// Lets time (s) pass with faults, until a time (s).
    fn step(&mut self, faults: &BTreeMap<Fault, Size>, dt: f64, now: f64) {
        let Self {
            pressure_kpa,
            reference,
            ground_millivolts,
            ..
        } = *self;
        *self = Self::default();
        for (&fault, &size) in faults {
            match (fault, size) {
                (Fault::DriftingPressure, Size::Drift(rate)) => {
                    self.pressure_kpa = pressure_kpa + rate * dt;
                }
                (Fault::Reference, Size::Share(rate)) => {
                    self.reference = (reference + rate * dt).max(Self::LEAST);
                }
                (Fault::Ground, Size::Shift(rate)) => {
                    self.ground_millivolts = ground_millivolts + rate * dt;
                }
                (Fault::Mains, Size::Wave { hertz, millivolts }) => {
                    self.mains_millivolts = millivolts * (TAU * hertz * now).sin();
                }
                _ => {}
            }
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ServeState {
    Waiting,
    Happening,
    Over,
}

impl VirtualRig {
    /// Creates a rig at power-on with `image` in its flash.
    ///
    /// # Errors
    ///
    /// [`BoardError::NoProcessor`], or [`BoardError::EepromSize`] for an EEPROM
    /// of another size.
    pub fn new(image: &Image, options: Options) -> Result<Self, BoardError> {
        let mut random = Pcg64Mcg::seed_from_u64(options.seed);
        let mut board = Board::new(image)?;
        if let Some(eeprom) = &options.eeprom {
            board.set_eeprom(eeprom)?;
        }
        let syringe = options.plant.syringe;
        let start = syringe.microsteps(random.random_range(START_MM));
        board.wire_stepper(StepperWiring {
            step: wiring::STEP,
            direction: wiring::DIRECTION,
            enable: wiring::ENABLE,
            position: start,
            lowest: syringe.microsteps(syringe.lower_stop_mm),
            highest: syringe.microsteps(syringe.stroke_mm),
        });
        board.clear_reset_flags(!options.keeps_reset_flags);
        board.seed_noise(random.random());
        let mut part = || Pcg64Mcg::seed_from_u64(random.random());
        let (to_board, from_board) = (Noise::new(part()), Noise::new(part()));
        let cycle_s = options.clock_factor / f64::from(CLOCK_HZ);
        let interval = PLANT_CYCLES as f64 * cycle_s;
        let mut rig = Self {
            board,
            cycle_s,
            plant: Plant::new(options.plant, syringe.millimetres(start), interval),
            random,
            next_plant_cycle: PLANT_CYCLES,
            powered: true,
            loader: None,
            power_on_at: None,
            supply_mv: SUPPLY_MILLIVOLTS,
            faults: BTreeMap::new(),
            drifts: Drifts::default(),
            planned: options
                .faults
                .into_iter()
                .map(|planned| (planned, ServeState::Waiting))
                .collect(),
            placement: Placement::USUAL,
            to_board,
            from_board,
            output: Vec::new(),
            keep_marks: false,
            marks: Vec::new(),
        };
        rig.start_program();
        rig.drive_pins();
        Ok(rig)
    }

    // ------------------------------------------------------------------ time

    /// Runs for `seconds` of simulated time.
    ///
    /// # Errors
    ///
    /// [`BoardError::Crashed`] when the processor leaves its program. A halted
    /// processor (asleep with interrupts off) is none: time goes on.
    pub fn run_for(&mut self, seconds: f64) -> Result<(), BoardError> {
        // Simulated times are hours at most.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let cycles = (seconds.max(0.0) / self.cycle_s).round() as u64;
        self.run_cycles(cycles)
    }

    /// Runs for a number of processor cycles, give or take an instruction.
    ///
    /// # Errors
    ///
    /// Like [`VirtualRig::run_for`].
    pub fn run_cycles(&mut self, cycles: u64) -> Result<(), BoardError> {
        let end = self.cycle().saturating_add(cycles);
        while self.cycle() < end {
            let stop = end.min(self.next_plant_cycle);
            self.advance_board(stop)?;
            if self.cycle() >= self.next_plant_cycle {
                self.step_plant();
                self.next_plant_cycle += PLANT_CYCLES;
            }
        }
        Ok(())
    }

    /// Runs until the board has sent a line for which `wanted` is true, at most
    /// for `seconds`. Returns that line without its end; lines before it are
    /// dropped, later output is kept.
    ///
    /// # Errors
    ///
    /// Like [`VirtualRig::run_for`].
    pub fn run_until_line(
        &mut self,
        seconds: f64,
        mut wanted: impl FnMut(&str) -> bool,
    ) -> Result<Option<String>, BoardError> {
        let end = self.time_s() + seconds;
        loop {
            while let Some(line) = self.take_line() {
                if wanted(&line) {
                    return Ok(Some(line));
                }
            }
            if self.time_s() >= end {
                return Ok(None);
            }
            self.run_cycles(PLANT_CYCLES)?;
        }
    }

    /// Processor cycles since the start, also those without power.
    pub fn cycle(&self) -> u64 {
        self.board.cycle()
    }

    /// Simulated time since the start (s).
    pub fn time_s(&self) -> f64 {
        self.cycle() as f64 * self.cycle_s
    }

    fn advance_board(&mut self, stop: u64) -> Result<(), BoardError> {
        let cycles = stop.saturating_sub(self.cycle());
        self.stop_listening();
        let outcome = if self.powered && self.loader.is_none() {
            self.board.run(cycles)
        } else {
            Ok(State::Halted)
        };
        let sent = self.board.take_output();
        if !sent.is_empty() {
            let sent = self.line_noise(&sent, Direction::FromBoard);
            self.output.extend(sent);
        }
        let marks = self.board.take_marks();
        if self.keep_marks {
            self.marks.extend(marks);
        }
        if outcome? == State::Halted {
            let cycles = stop.saturating_sub(self.cycle());
            self.board.skip(cycles);
        }
        Ok(())
    }

    // ----------------------------------------------------------- serial line

    /// Sends bytes to the board, as a computer does. They arrive at the pace of
    /// the line.
    ///
    /// # Errors
    ///
    /// [`BoardError::OutOfMemory`].
    pub fn send(&mut self, bytes: &[u8]) -> Result<(), BoardError> {
        if !self.powered {
            return Ok(());
        }
        let bytes = self.line_noise(bytes, Direction::ToBoard);
        let rest = self.talk_to_loader(&bytes);
        self.board.send(rest)
    }

    /// A computer opens the port: that pulls the reset line, as on every Mega,
    /// and the bootloader listens for a second before the program starts. It
    /// starts at once when a byte comes that no programmer would send; that byte
    /// is lost. A session begins: drifts run from here, as on the board.
    pub fn open_port(&mut self) {
        if self.powered {
            self.reset(ResetCause::External);
            self.plant.restart_clock();
            self.loader = Some((Bootloader::new(), self.after(LISTENS_S)));
        }
    }

    /// The computer closes the port. A programmer that did not take its leave is
    /// done with.
    pub fn close_port(&mut self) {
        if self.loader.is_some() {
            self.start_program();
        }
    }

    /// Whether the bootloader has the processor.
    pub fn in_bootloader(&self) -> bool {
        self.loader.is_some()
    }

    /// Gives bytes to the bootloader as long as it wants them; returns the rest.
    fn talk_to_loader<'b>(&mut self, bytes: &'b [u8]) -> &'b [u8] {
        for (index, &byte) in bytes.iter().enumerate() {
            let Some((loader, _)) = &mut self.loader else {
                return &bytes[index..];
            };
            let answer = loader.receive(byte, &mut self.board);
            let leaving = loader.phase() == Phase::Leaving;
            let answer = self.line_noise(&answer, Direction::FromBoard);
            self.output.extend(answer);
            if leaving {
                self.start_program();
            }
        }
        &[]
    }

    fn stop_listening(&mut self) {
        if let Some((loader, until)) = &self.loader
            && loader.phase() == Phase::Listening
            && self.cycle() >= *until
        {
            self.start_program();
        }
    }

    /// Leaves the processor to the program, if there is one. An erased flash
    /// leads back into the bootloader.
    fn start_program(&mut self) {
        let erased = self.board.flash(0, 2) == [0xff, 0xff];
        self.loader = erased.then(|| (Bootloader::new(), u64::MAX));
    }

    /// Bytes that were sent and have not arrived yet.
    pub fn unsent(&self) -> usize {
        self.board.unsent()
    }

    /// Bytes that a real receiver would have lost because the firmware read too
    /// late. Here they wait; a test of the firmware wants 0.
    pub fn overruns(&self) -> u64 {
        self.board.overruns()
    }

    /// Takes everything that the board sent since it was last taken.
    pub fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.output)
    }

    /// Takes the complete lines that the board sent, without their ends. Bytes
    /// that are no UTF-8 are replaced; the rest of an incomplete line is kept.
    pub fn take_lines(&mut self) -> Vec<String> {
        std::iter::from_fn(|| self.take_line()).collect()
    }

    fn take_line(&mut self) -> Option<String> {
        let end = self.output.iter().position(|&byte| byte == b'\n')?;
        let line: Vec<u8> = self.output.drain(..=end).collect();
        let text = String::from_utf8_lossy(&line);
        Some(text.trim_end_matches(['\r', '\n']).into())
    }

    fn line_noise(&mut self, bytes: &[u8], direction: Direction) -> Vec<u8> {
        if self.faults.contains_key(&Fault::Unplugged) {
            return Vec::new();
        }
        if !self.faults.contains_key(&Fault::Noise) {
            return bytes.into();
        }
        match direction {
            Direction::ToBoard => self.to_board.pass(bytes),
            Direction::FromBoard => self.from_board.pass(bytes),
        }
    }

    // ------------------------------------------------------------ the plant

    /// A hand bends the actuator to an angle (°) and holds it there, or lets go.
    pub fn bend(&mut self, angle_deg: Option<f64>) {
        self.plant.bend(angle_deg);
    }

    /// The supply is so many volts from now on.
    pub fn set_supply(&mut self, volts: f64) {
        // A few volts.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let millivolts = (volts * 1000.0).round() as u32;
        self.supply_mv = millivolts;
        self.drive_pins();
    }

    /// The rig is changed as `change` says, against how it stands.
    pub fn change(&mut self, change: impl FnOnce(&mut Placement)) {
        change(&mut self.placement);
        self.plant.stand(&self.placement);
    }

    /// It is left alone without pressure for so many seconds, for which the board does not
    /// run: a person has lunch.
    pub fn rest(&mut self, seconds: f64) {
        self.plant.rest(seconds);
    }

    /// Another actuator of the same make takes the place of this one.
    pub fn replace_actuator(&mut self) {
        self.plant.replace_actuator();
    }

    /// How things really are.
    pub fn plant(&self) -> Truth {
        let steps = self.board.stepper();
        let plunger_mm = self.plant.config().syringe.millimetres(steps.position);
        let driven = |pin| self.powered && self.board.driven(pin) == Some(true);
        let (retracted_pressed, pushed_in_pressed) = self.end_switches(plunger_mm);
        Truth {
            time_s: self.time_s(),
            angle_deg: self.plant.angle_deg(),
            pressure_kpa: self.plant.pressure_kpa(),
            plunger_mm,
            valve_open: if self.faults.contains_key(&Fault::VentShut) {
                false
            } else {
                !driven(wiring::VENT_VALVE) || self.faults.contains_key(&Fault::VentOpen)
            },
            driver_enabled: self.powered && self.board.driven(wiring::ENABLE) == Some(false),
            light_on: driven(wiring::LIGHT),
            steps,
            retracted_pressed,
            pushed_in_pressed,
            powered: self.powered,
        }
    }

    fn end_switches(&self, plunger_mm: f64) -> (bool, bool) {
        let far = self.plant.config().syringe.pushed_in_switch_mm;
        (
            plunger_mm <= 0.0 || self.faults.contains_key(&Fault::RetractedSwitch),
            plunger_mm >= far || self.faults.contains_key(&Fault::EndSwitch),
        )
    }

    fn step_plant(&mut self) {
        self.follow_plan();
        let interval = PLANT_CYCLES as f64 * self.cycle_s;
        self.drifts.step(&self.faults, interval, self.time_s());
        let drift = SensorFault::Drifted(
            self.drifts.pressure_kpa * 1e3 * PressureSensor::MILLIVOLTS_PER_PA,
        );
        let now_ms = self.time_s() * 1e3;
        let holds = |fault: &Fault| match self.faults.get(fault) {
            Some(&Size::Gaps { every_ms, open_ms }) => now_ms % every_ms < open_ms,
            size => size.is_some(),
        };
        let sensor = |states: &[(Fault, SensorFault)]| {
            states
                .iter()
                .find(|(fault, _)| holds(fault))
                .map_or(SensorFault::None, |&(_, state)| state)
        };
        let truth = self.plant();
        let inputs = Inputs {
            plunger_mm: truth.plunger_mm,
            valve_closed: !truth.valve_open,
            leaking: self.faults.contains_key(&Fault::Leak),
            late_s: match self.faults.get(&Fault::Late) {
                Some(&Size::Time(seconds)) => Some(seconds),
                _ => None,
            },
            kinked: self.faults.contains_key(&Fault::Branch),
            flex: sensor(&[
                (Fault::OpenFlex, SensorFault::Open),
                (Fault::ShortFlex, SensorFault::Shorted),
                (Fault::StuckFlex, SensorFault::Stuck),
                (Fault::DetachedFlex, SensorFault::Detached),
            ]),
            pressure: sensor(&[
                (Fault::OpenPressure, SensorFault::Open),
                (Fault::ShortPressure, SensorFault::Shorted),
                (Fault::StuckPressure, SensorFault::Stuck),
                (Fault::FlickeringPressure, SensorFault::Open),
                (Fault::DriftingPressure, drift),
            ]),
        };
        self.plant.step(&inputs);
        self.drive_pins();
    }

    fn drive_pins(&mut self) {
        let truth = self.plant();
        let supply_mv = if self.faults.contains_key(&Fault::LowSupply) {
            LOW_SUPPLY_MV
        } else {
            self.supply_mv
        };
        let Drifts {
            reference,
            ground_millivolts,
            mains_millivolts,
            ..
        } = self.drifts;
        // Some volts.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let reference_mv = (f64::from(supply_mv) / (1.0 + reference)).round() as u32;
        self.board.set_supply(reference_mv);
        // Both sensors are ratiometric: their voltages are shares of the supply.
        let share = f64::from(supply_mv) / f64::from(SUPPLY_MILLIVOLTS);
        let added = ground_millivolts + mains_millivolts;
        for (channel, voltage) in [
            (wiring::PRESSURE_CHANNEL, self.plant.pressure_voltage()),
            (wiring::FLEX_CHANNEL, self.plant.flex_voltage()),
        ] {
            self.board.set_analog(
                channel,
                voltage.millivolts * share + added,
                voltage.noise_rms_millivolts * share,
            );
        }
        for (pin, pressed) in [
            (wiring::RETRACTED_SWITCH, truth.retracted_pressed),
            (wiring::PUSHED_IN_SWITCH, truth.pushed_in_pressed),
            (
                wiring::EMERGENCY_STOP,
                self.faults.contains_key(&Fault::EmergencyStop),
            ),
        ] {
            self.board.set_input(pin, pressed);
        }
    }

    // ---------------------------------------------------------------- faults

    /// Starts or ends a fault now. A [`Fault::BrownOut`] resets the board at
    /// once and does not last; [`Fault::Hang`] and [`Fault::Deaf`] last until a reset; [`Fault::PowerCut`] is
    /// [`VirtualRig::power_cut`] and [`VirtualRig::power_on`].
    pub fn set_fault(&mut self, defect: impl Into<Defect>, on: bool) {
        let Defect { fault, size } = defect.into();
        match (fault, on) {
            (Fault::BrownOut, true) => self.reset(ResetCause::BrownOut),
            (Fault::Hang | Fault::Deaf, true) => self.board.hang(fault == Fault::Deaf),
            (Fault::BrownOut | Fault::Hang | Fault::Deaf, false) => {}
            (Fault::PowerCut, true) => {
                self.power_cut();
            }
            (Fault::PowerCut, false) => self.power_on(),
            (_, true) => {
                self.faults.insert(fault, size);
            }
            (_, false) => {
                self.faults.remove(&fault);
            }
        }
        // What was mended does not wait for the plant's next step.
        self.drifts.step(&self.faults, 0.0, self.time_s());
        self.board.stall(self.faults.contains_key(&Fault::Stall));
        self.board
            .skip_steps(self.faults.contains_key(&Fault::LostSteps));
        self.board
            .tremble(self.faults.contains_key(&Fault::LostCoil));
        self.board
            .reverse(self.faults.contains_key(&Fault::ReversedMotor));
        self.drive_pins();
    }

    /// The faults that last at the moment.
    pub fn faults(&self) -> impl Iterator<Item = Fault> + '_ {
        self.faults.keys().copied()
    }

    /// Plans a fault for a time to come (s of simulated time).
    pub fn plan_fault(&mut self, planned: Planned) {
        self.planned.push((planned, ServeState::Waiting));
    }

    fn follow_plan(&mut self) {
        let now = self.time_s();
        if self.power_on_at.is_some_and(|at| self.cycle() >= at) {
            self.power_on();
        }
        for index in 0..self.planned.len() {
            let (planned, progress) = self.planned[index];
            if progress == ServeState::Waiting && now >= planned.from_s {
                self.planned[index].1 = ServeState::Happening;
                self.set_fault(planned.defect, true);
                if planned.defect.fault == Fault::PowerCut && planned.until_s.is_none() {
                    self.power_on_after(POWER_CUT_S);
                }
            } else if progress == ServeState::Happening
                && planned.until_s.is_some_and(|until| now >= until)
            {
                self.planned[index].1 = ServeState::Over;
                self.set_fault(planned.defect, false);
            }
        }
    }

    // ----------------------------------------------------- power and resets

    /// Takes the power away: valve open, motor free, processor dead, unsent
    /// bytes lost. A byte of EEPROM that is being written gets a random value;
    /// its address is returned.
    pub fn power_cut(&mut self) -> Option<u16> {
        if !self.powered {
            return None;
        }
        self.powered = false;
        self.board.cut_power(&mut self.random)
    }

    /// Gives the power back: a power-on reset. Does nothing if it is there.
    pub fn power_on(&mut self) {
        self.power_on_at = None;
        if !self.powered {
            self.powered = true;
            self.reset(ResetCause::PowerOn);
        }
    }

    /// Gives the power back after `seconds` of simulated time.
    pub fn power_on_after(&mut self, seconds: f64) {
        self.power_on_at = Some(self.after(seconds));
    }

    /// The cycle in so many seconds.
    fn after(&self, seconds: f64) -> u64 {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let cycles = (seconds.max(0.0) / self.cycle_s) as u64;
        self.cycle().saturating_add(cycles)
    }

    /// Resets the processor. For [`ResetCause::PowerOn`], a short interruption
    /// of the power. Does nothing without power.
    pub fn reset(&mut self, cause: ResetCause) {
        if !self.powered {
            return;
        }
        self.loader = None;
        if cause == ResetCause::PowerOn {
            self.board.cut_power(&mut self.random);
        }
        self.board.reset(cause);
        self.start_program();
        self.drive_pins();
    }

    // ------------------------------------------------------- looking inside

    /// The EEPROM's contents.
    pub fn eeprom(&mut self) -> Vec<u8> {
        self.board.eeprom()
    }

    /// The EEPROM address that is being written, if any.
    pub fn eeprom_writing(&mut self) -> Option<u16> {
        self.board.eeprom_writing()
    }

    /// Bytes of EEPROM that the firmware has written so far.
    pub fn eeprom_writes(&mut self) -> u64 {
        self.board.eeprom_writes()
    }

    /// Switches the record of step pulses on or off.
    pub fn trace_steps(&mut self, on: bool) {
        self.board.trace_steps(on);
    }

    /// Takes the recorded step pulses: the processor cycle of each rising edge
    /// of STEP while the driver was enabled. See [`VirtualRig::trace_steps`].
    pub fn step_edges(&mut self) -> Vec<u64> {
        self.board.take_step_cycles()
    }

    /// Cycles in all stretches that the firmware marked with `id` in GPIOR0,
    /// their number and the longest.
    pub fn mark_total(&self, id: u8) -> MarkTotal {
        self.board.mark_total(id)
    }

    /// Switches on or off that single marks are kept for
    /// [`VirtualRig::take_marks`]; totals are always there.
    pub fn keep_marks(&mut self, on: bool) {
        self.keep_marks = on;
    }

    /// Takes the single marks since the last call.
    pub fn take_marks(&mut self) -> Vec<Mark> {
        std::mem::take(&mut self.marks)
    }

    /// Cycles that the processor spent in a sleep mode.
    pub fn slept_cycles(&self) -> u64 {
        self.board.slept_cycles()
    }

    /// A byte of the data space: registers and memory.
    pub fn data(&self, address: u16) -> u8 {
        self.board.data(address)
    }

    /// The deepest that the stack has been since power-on, in bytes.
    pub fn stack_bytes(&self) -> u16 {
        self.board.stack_bytes()
    }

    /// Resets so far, of any cause; the start is none.
    pub fn resets(&self) -> u64 {
        self.board.resets()
    }

    /// The board, for what has no method here. Running it directly would leave
    /// the plant behind, so it is shared only for reading.
    pub fn board(&self) -> &Board {
        &self.board
    }
}

impl Memory for Board {
    fn read_flash(&mut self, address: u32, length: u32) -> Vec<u8> {
        self.flash(address, length)
    }

    fn write_flash(&mut self, address: u32, bytes: &[u8]) {
        self.set_flash(address, bytes);
    }

    fn read_eeprom(&mut self, address: u32, length: u32) -> Vec<u8> {
        self.eeprom()[address as usize..][..length as usize].into()
    }

    fn write_eeprom(&mut self, address: u32, bytes: &[u8]) {
        let mut eeprom = self.eeprom();
        eeprom[address as usize..][..bytes.len()].copy_from_slice(bytes);
        // It has the size that it was read with.
        let _ = self.set_eeprom(&eeprom);
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Direction {
    ToBoard,
    FromBoard,
}
