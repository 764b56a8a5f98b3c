// SPDX-License-Identifier: GPL-3.0-or-later
//! An Arduino Mega 2560 that runs an image.

use crate::{
    image::Image,
    simavr::{CHANNELS, NOISE_TABLE, Outcome, Simavr},
};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// The board's processor clock in hertz.
pub const CLOCK_HZ: u32 = 16_000_000;

/// The board's supply and converter reference in millivolts.
pub const SUPPLY_MILLIVOLTS: u32 = 5_000;

/// The address behind the last byte of RAM, where the stack starts.
const RAM_END: u16 = 0x2200;

/// Whether the processor can go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// It executes, or sleeps until an interrupt.
    Running,
    /// It sleeps with interrupts off: nothing but a reset wakes it.
    Halted,
}

/// A measured stretch of firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mark {
    /// The measured code: the value that the firmware wrote to GPIOR0.
    pub id: u8,
    /// Processor cycles between the opening and the closing write.
    pub cycles: u64,
}

/// All stretches of one kind since the board was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MarkTotal {
    /// Processor cycles in all of them.
    pub cycles: u64,
    /// Processor cycles of the longest.
    pub longest: u64,
    /// How many there were.
    pub count: u64,
}

/// A pin of the processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin {
    /// The letter of the port, A to L without I, as ASCII.
    pub port: u8,
    /// The bit in the port, 0 to 7.
    pub bit: u8,
}

/// Why the processor starts anew.
///
/// The flags are those of the register MCUSR (ATmega2560 data sheet, 12.5.1),
/// which stay set until the firmware clears them or power is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetCause {
    /// Power came on: flag PORF alone. Memory is lost, EEPROM and flash stay.
    PowerOn,
    /// The reset line was pulled, by the button or by opening the port: flag
    /// EXTRF. Memory stays.
    External,
    /// The supply sagged: flag BORF. Memory stays.
    BrownOut,
    /// The watchdog was not served: flag WDRF. The simulated watchdog does this
    /// by itself; here it can be had without waiting.
    Watchdog,
}

impl ResetCause {
    /// The flag in MCUSR.
    pub const fn flag(self) -> u8 {
        match self {
            Self::PowerOn => 1,
            Self::External => 1 << 1,
            Self::BrownOut => 1 << 2,
            Self::Watchdog => 1 << 3,
        }
    }
}

/// Where a stepper driver is connected and how far it can go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepperWiring {
    /// One microstep on each rising edge.
    pub step: Pin,
    /// High counts up.
    pub direction: Pin,
    /// Low lets the driver step; undriven or high, it ignores edges.
    pub enable: Pin,
    /// Position at the start (microsteps).
    pub position: i64,
    /// The stop at the low end (microsteps).
    pub lowest: i64,
    /// The stop at the high end (microsteps).
    pub highest: i64,
}

/// The motion of a stepper motor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stepper {
    /// Where it stands (microsteps).
    pub position: i64,
    /// Rising edges while the driver was enabled.
    pub edges: u64,
    /// Edges that did not move it: at a stop, or stalled.
    pub lost: u64,
}

/// Errors while a board is made or runs.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BoardError {
    /// simavr does not offer the processor, or memory is short.
    #[error("the simulator cannot make an ATmega2560: is simavr built with megaAVR cores?")]
    NoProcessor,
    /// The processor jumped out of its program.
    #[error("the processor crashed at cycle {cycle}; output so far was kept")]
    Crashed {
        /// The cycle of the crash.
        cycle: u64,
    },
    /// Output could not be buffered.
    #[error("no memory left for the board's output: take it more often")]
    OutOfMemory,
    /// An EEPROM image has the wrong size.
    #[error("an EEPROM image of {0} bytes; the ATmega2560 holds {EEPROM_BYTES}")]
    EepromSize(usize),
}

/// EEPROM of the ATmega2560 in bytes.
pub const EEPROM_BYTES: usize = 4096;

/// A simulated board.
pub struct Board {
    simavr: Simavr,
    static_data_end: u16,
}

impl Board {
    /// Creates a board at power-on with `image` in its flash.
    ///
    /// # Errors
    ///
    /// [`BoardError::NoProcessor`] when the simulator lacks the processor.
    pub fn new(image: &Image) -> Result<Self, BoardError> {
        Simavr::new(c"atmega2560", CLOCK_HZ, SUPPLY_MILLIVOLTS, image.flash())
            .map(|simavr| Self {
                simavr,
                static_data_end: image.static_data_end(),
            })
            .ok_or(BoardError::NoProcessor)
    }

    /// Processor cycles since power-on.
    pub fn cycle(&self) -> u64 {
        self.simavr.cycle()
    }

    /// Runs for at least `cycles` more cycles, or until the processor halts.
    ///
    /// # Errors
    ///
    /// [`BoardError::Crashed`] and [`BoardError::OutOfMemory`]; the output up to
    /// then can still be taken.
    pub fn run(&mut self, cycles: u64) -> Result<State, BoardError> {
        match self.simavr.run_until(self.cycle().saturating_add(cycles)) {
            Outcome::Running => Ok(State::Running),
            Outcome::Halted => Ok(State::Halted),
            Outcome::Crashed => Err(BoardError::Crashed {
                cycle: self.cycle(),
            }),
            Outcome::OutOfMemory => Err(BoardError::OutOfMemory),
        }
    }

    /// The deepest that the stack has been, in bytes: the memory above the static
    /// data that was ever written.
    pub fn stack_bytes(&self) -> u16 {
        RAM_END.saturating_sub(self.simavr.first_written(self.static_data_end))
    }

    /// Takes the bytes that the board sent over UART0 since the last call.
    pub fn take_output(&mut self) -> Vec<u8> {
        self.simavr.take_output()
    }

    /// Takes the stretches measured since the last call.
    pub fn take_marks(&mut self) -> Vec<Mark> {
        self.simavr
            .take_marks()
            .into_iter()
            .map(|(id, cycles)| Mark { id, cycles })
            .collect()
    }

    /// Lets `cycles` pass without executing anything: halted, held in reset or
    /// without power.
    pub fn skip(&mut self, cycles: u64) {
        self.simavr.skip_to(self.cycle().saturating_add(cycles));
    }

    /// Queues bytes for UART0. They arrive at the pace of the line, 10 bit times
    /// each; a byte waits while the receiver is off or full.
    ///
    /// # Errors
    ///
    /// [`BoardError::OutOfMemory`].
    pub fn send(&mut self, bytes: &[u8]) -> Result<(), BoardError> {
        if self.simavr.send(bytes) {
            Ok(())
        } else {
            Err(BoardError::OutOfMemory)
        }
    }

    /// Bytes that were queued and have not arrived yet.
    pub fn unsent(&self) -> usize {
        self.simavr.unsent()
    }

    /// Bytes that a real receiver would have lost because the firmware had not
    /// read the two before. Here they wait instead.
    pub fn overruns(&self) -> u64 {
        self.simavr.overruns()
    }

    /// All stretches with the mark `id` since the board was made. A mark that
    /// another one interrupts ends there.
    pub fn mark_total(&self, id: u8) -> MarkTotal {
        let (cycles, longest, count) = self.simavr.mark_total(id);
        MarkTotal {
            cycles,
            longest,
            count,
        }
    }

    /// Cycles spent in a sleep mode since the board was made.
    pub fn slept_cycles(&self) -> u64 {
        self.simavr.slept()
    }

    /// Resets the processor. An EEPROM write goes on, except that
    /// [`ResetCause::PowerOn`] expects [`Board::cut_power`] before.
    pub fn reset(&mut self, cause: ResetCause) {
        self.simavr
            .reset(cause.flag(), cause == ResetCause::PowerOn);
    }

    /// Takes the power away: a byte of EEPROM that is being written is left with
    /// a random value. Time is [skipped](Board::skip) from here on until a
    /// reset by [`ResetCause::PowerOn`]. Returns the address of the torn byte.
    pub fn cut_power(&mut self, random: &mut Pcg64Mcg) -> Option<u16> {
        let torn = self.simavr.eeprom_writing()?;
        self.simavr.tear_eeprom(random.random());
        Some(torn)
    }

    /// Resets so far, of any cause.
    pub fn resets(&self) -> u64 {
        self.simavr.resets()
    }

    /// Whether the bootloader clears MCUSR before it starts the firmware, at this start and
    /// at all later ones.
    pub fn clear_reset_flags(&mut self, clears: bool) {
        self.simavr.clear_flags(clears);
    }

    /// The register MCUSR: causes of resets that the firmware has not cleared.
    pub fn reset_flags(&self) -> u8 {
        self.simavr.reset_flags()
    }

    /// The EEPROM's contents.
    pub fn eeprom(&mut self) -> Vec<u8> {
        self.simavr.eeprom()
    }

    /// Replaces the EEPROM's contents.
    ///
    /// # Errors
    ///
    /// [`BoardError::EepromSize`] unless there are [`EEPROM_BYTES`].
    pub fn set_eeprom(&mut self, bytes: &[u8]) -> Result<(), BoardError> {
        if self.simavr.set_eeprom(bytes) {
            Ok(())
        } else {
            Err(BoardError::EepromSize(bytes.len()))
        }
    }

    /// The EEPROM address that is being written, if any.
    pub fn eeprom_writing(&mut self) -> Option<u16> {
        self.simavr.eeprom_writing()
    }

    /// Bytes of EEPROM that the firmware has written.
    pub fn eeprom_writes(&mut self) -> u64 {
        self.simavr.eeprom_writes()
    }

    /// The level that the board drives on a pin, or nothing for an input.
    pub fn driven(&self, pin: Pin) -> Option<bool> {
        self.simavr.driven(pin.port, pin.bit)
    }

    /// Sets the level that the outside puts on an input.
    pub fn set_input(&mut self, pin: Pin, level: bool) {
        self.simavr.set_input(pin.port, pin.bit, level);
    }

    /// Sets the voltage on an analog input, with white noise that is drawn anew
    /// for each conversion (both in mV).
    pub fn set_analog(&mut self, channel: u8, millivolts: f64, noise_rms_millivolts: f64) {
        debug_assert!(channel < CHANNELS);
        self.simavr
            .set_analog(channel, millivolts, noise_rms_millivolts);
    }

    /// Draws the table of the converter's noise.
    pub fn seed_noise(&mut self, seed: u64) {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut table = [0.0f32; NOISE_TABLE];
        for value in &mut table {
            *value = StandardNormal.sample(&mut random);
        }
        self.simavr.seed_noise(&table, random.random());
    }

    /// Connects a stepper driver.
    pub fn wire_stepper(&mut self, wiring: StepperWiring) {
        let pins =
            [wiring.step, wiring.direction, wiring.enable].map(|pin: Pin| (pin.port, pin.bit));
        self.simavr
            .wire_stepper(pins, wiring.position, wiring.lowest, wiring.highest);
    }

    /// Lets the stepper turn the other way, or as it should.
    pub fn reverse(&mut self, reversed: bool) {
        self.simavr.reverse(reversed);
    }

    /// Takes the current from a coil of the stepper, or gives it back.
    pub fn tremble(&mut self, trembles: bool) {
        self.simavr.tremble(trembles);
    }

    /// Lets the main program hang from its next sleep to the next reset; interrupts go
    /// on unless it is `deaf`.
    pub fn hang(&mut self, deaf: bool) {
        self.simavr.hang(deaf);
    }

    /// Lets the stepper lose nine steps of ten, or none.
    pub fn skip_steps(&mut self, skips: bool) {
        self.simavr.skip_steps(skips);
    }

    /// Changes the supply (mV), which is the converter's reference too.
    pub fn set_supply(&mut self, millivolts: u32) {
        self.simavr.set_supply(millivolts);
    }

    /// Blocks or frees the stepper's shaft.
    pub fn stall(&mut self, stalled: bool) {
        self.simavr.stall(stalled);
    }

    /// The stepper's motion so far.
    pub fn stepper(&self) -> Stepper {
        let crate::simavr::Stepper {
            position,
            edges,
            lost,
        } = self.simavr.stepper();
        Stepper {
            position,
            edges,
            lost,
        }
    }

    /// Switches the record of step pulses on or off.
    pub fn trace_steps(&mut self, on: bool) {
        self.simavr.trace_steps(on);
    }

    /// Takes the recorded step pulses: the cycle of each rising edge.
    pub fn take_step_cycles(&mut self) -> Vec<u64> {
        self.simavr.take_step_cycles()
    }

    /// Copies flash.
    ///
    /// # Panics
    ///
    /// If the range does not lie within the flash.
    pub fn flash(&self, address: u32, length: u32) -> Vec<u8> {
        self.simavr.flash(address, length)
    }

    /// Replaces flash, as a programmer does.
    ///
    /// # Panics
    ///
    /// If the range does not lie within the flash.
    pub fn set_flash(&mut self, address: u32, bytes: &[u8]) {
        self.simavr.set_flash(address, bytes);
    }

    /// A byte of the data space: registers and memory.
    pub fn data(&self, address: u16) -> u8 {
        self.simavr.data(address)
    }
}
