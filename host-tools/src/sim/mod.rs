//! Simulation over a pressure or a protocol, with plain and with dual numbers.

pub mod dual;
pub mod formula;
pub mod linear;
pub mod protocol;
pub mod simulate;
pub mod simulation;
