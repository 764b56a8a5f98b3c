// SPDX-License-Identifier: GPL-3.0-or-later
//! The board in a simulator, instruction by instruction, with a simulated
//! actuator on its pins.
//!
//! The firmware's claims (the same bits as the desktop, so many cycles, so much
//! stack, safe after a broken wire) are only worth something if the image that
//! is flashed was run. Here it runs, unchanged. [`Board`] is the bare Arduino
//! Mega 2560; [`VirtualRig`] is the board with syringe pump, valve, actuator,
//! sensors and switches in closed loop, and the place to start. What is
//! simulated, with equations and numbers, is in `docs/virtual-rig.md`.
//!
//! The crate links simavr, which is GPL, so it is a process of its own: nothing
//! that is shipped links it.
#![deny(unsafe_code)]

pub mod bench;
pub mod board;
pub mod fault;
pub mod image;
mod noise;
pub mod plant;
pub mod rig;
mod simavr;
pub mod soak;
pub mod stk500;
pub mod wiring;

pub use bench::Bench;
pub use board::{Board, BoardError, Mark, MarkTotal, Pin, ResetCause, State, Stepper};
pub use fault::{Fault, Planned};
pub use image::{Image, ImageError};
pub use plant::PlantConfig;
pub use rig::{Options, Truth, VirtualRig, default_actuator};
