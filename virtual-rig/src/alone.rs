// SPDX-License-Identifier: GPL-3.0-or-later
//! A handler of an interrupt alone, from any state of the machine.

use crate::{
    board::{BoardError, CLOCK_HZ, SUPPLY_MILLIVOLTS},
    image::Image,
    simavr::{DATA_BYTES, Simavr},
};

/// Instructions within which a handler returns.
const LIMIT: u32 = 10_000;

/// Registers and memory: r0 to r31, the peripherals' registers, RAM.
pub type Data = Box<[u8; DATA_BYTES]>;

/// A processor without peripherals, whose registers are memory: what a handler does depends on the state
/// that it is given and on nothing else.
pub struct Alone(Simavr);

/// What a handler left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Handled {
    /// Registers and memory.
    pub data: Data,
    /// What it wrote to registers of peripherals, in order.
    pub writes: Vec<(u16, u8)>,
    /// Whether it came by the address that was asked for.
    pub passed: bool,
}

impl Alone {
    /// A processor with an image in its flash.
    ///
    /// # Errors
    ///
    /// [`BoardError::NoProcessor`] when the simulator lacks the processor.
    pub fn new(image: &Image) -> Result<Self, BoardError> {
        let mut simavr = Simavr::new(c"atmega2560", CLOCK_HZ, SUPPLY_MILLIVOLTS, image.flash())
            .ok_or(BoardError::NoProcessor)?;
        simavr.take_peripherals();
        Ok(Self(simavr))
    }

    /// Enters the code at an address as an interrupt does; nothing if it does not return. `through` is an
    /// address to look out for.
    pub fn enter(&mut self, data: &Data, at: u32, through: u32) -> Option<Handled> {
        let mut data = data.clone();
        let passed = self.0.enter(&mut data, at, through, LIMIT)?;
        Some(Handled {
            data,
            writes: self.0.writes(),
            passed,
        })
    }
}
