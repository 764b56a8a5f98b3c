//! Models in motion: simulated over a pressure or a protocol, on plain and on dual numbers.

pub mod dual;
pub(crate) mod formula;
pub(crate) mod linear;
pub(crate) mod protocol;
pub mod simulate;
pub mod simulation;
