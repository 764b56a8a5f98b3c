// SPDX-License-Identifier: GPL-3.0-or-later
//! The image that is flashed, instruction by instruction, on a simulated rig:
//! what it promises in operation, and what it does when something breaks.
//!
//! `cargo xtask test` builds the image and says where it is; without one every
//! test here says that it is skipped.

mod bench;
mod faults;
mod handlers;
mod line;
mod prediction;
mod pump;
mod runs;
mod settings;
mod start;
mod steps;
mod stroke;
mod unseen;
