//! Everything behind the `rig` command.
#![forbid(unsafe_code)]

pub mod materials;
pub mod plot;
