// SPDX-License-Identifier: GPL-3.0-or-later
//! Long runs of the firmware image in the virtual rig.
#![forbid(unsafe_code)]

pub mod soak;
