//! Simulation over a pressure or a protocol, with plain and with dual numbers.

pub mod dual;
pub(crate) mod linear;
pub(crate) mod protocol;
pub mod simulate;
