// SPDX-License-Identifier: GPL-3.0-or-later
//! The board in a simulator, instruction by instruction.
//!
//! The firmware's claims (the same bits as the desktop, so many cycles, so much
//! stack) are only worth something if the image that is flashed was run. Here it
//! runs, unchanged. The crate links simavr, which is GPL, so it is a process of
//! its own: nothing else in the workspace links it.
#![deny(unsafe_code)]

pub mod board;
pub mod image;
mod simavr;

pub use board::{Board, BoardError, Mark, State};
pub use image::{Image, ImageError};
