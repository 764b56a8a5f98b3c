//! Models in motion: simulated over a pressure or a protocol, on plain and on dual numbers.

pub mod dual;
pub mod formula;
pub mod linear;
pub mod protocol;
pub mod simulate;
pub mod simulation;
