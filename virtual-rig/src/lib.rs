// SPDX-License-Identifier: GPL-3.0-or-later
//! The board in an instruction-level simulator, with a simulated actuator on its pins.
//!
//! Claims about the firmware (the same bits as the desktop, cycles, stack, safety after a
//! broken wire) must be tested on the flashed image. Here that image runs unchanged.
//! [`Board`] is the bare Arduino Mega 2560; [`VirtualRig`] is the board with syringe pump,
//! valve, actuator, sensors and switches in closed loop, and the place to start.
//! `docs/virtual-rig.md` describes the simulation, with equations and numbers.
//!
//! The crate links simavr, which is GPL, so it runs as a process of its own, and no
//! released program links it.
#![deny(unsafe_code)]

pub mod alone;
pub mod bench;
pub mod board;
pub mod fault;
pub mod image;
mod noise;
pub mod plant;
pub mod rig;
mod simavr;
pub mod stk500;
pub mod wiring;

pub use alone::Alone;
pub use bench::Bench;
pub use board::{Board, BoardError, Mark, MarkTotal, Pin, ResetCause, State, Stepper};
pub use fault::{Defect, Fault, Planned, Size};
pub use image::{Image, ImageError};
pub use plant::PlantConfig;
pub use rig::{Options, Truth, VirtualRig, default_actuator};
