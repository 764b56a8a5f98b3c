// SPDX-License-Identifier: GPL-3.0-or-later
//! The simulated board and rig, with small programs of C, in one program.

mod board;
mod bootloader;
mod closed_loop;
mod common;
mod serve;
mod speed;
