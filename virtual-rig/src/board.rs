// SPDX-License-Identifier: GPL-3.0-or-later
//! An Arduino Mega 2560 that runs an image.

use crate::{
    image::Image,
    simavr::{Outcome, Simavr},
};

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
    /// What was measured: the value that the firmware wrote to GPIOR0.
    pub id: u8,
    /// Processor cycles between the opening and the closing write.
    pub cycles: u64,
}

/// What can go wrong while a board is made or runs.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BoardError {
    /// simavr does not offer the processor, or memory is short.
    #[error("the simulator cannot make an ATmega2560: is simavr built with megaAVR cores?")]
    NoProcessor,
    /// The processor jumped out of its program or its watchdog fired unserved.
    #[error("the processor crashed at cycle {cycle}; output so far was kept")]
    Crashed {
        /// The cycle of the crash.
        cycle: u64,
    },
    /// Output could not be buffered.
    #[error("no memory left for the board's output: take it more often")]
    OutOfMemory,
}

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
}
