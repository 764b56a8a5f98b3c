//! Simulation over a pressure or a protocol, with plain and with dual numbers, and as the board
//! predicts.

pub mod band_limited;
pub mod board;
pub mod dual;
pub mod fixed_power;
pub mod linear;
pub mod protocol;
pub mod simulate;
pub mod work;
