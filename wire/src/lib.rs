//! What travels over the serial cable, defined once for both ends.
//!
//! The board writes with these types and the computer reads with them, so a
//! format cannot change on one side only. No allocation, no floating-point
//! formatting: the same code must fit an ATmega2560.
#![no_std]
#![forbid(unsafe_code)]

pub mod checksum;
pub mod decimal;
pub mod line;
pub mod step_report;
pub mod stretch;
