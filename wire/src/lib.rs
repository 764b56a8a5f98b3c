//! The serial protocol, defined once for both ends.
//!
//! The board writes with these types and the computer reads with them, so a
//! format cannot change on one side only. No allocation, no floating-point
//! formatting: the same code must fit an ATmega2560.
#![no_std]
#![forbid(unsafe_code)]

// Tests share a file with the firmware's, which calls it so.
#[cfg(test)]
extern crate self as wire;

pub mod answer;
pub mod assemble;
pub mod checksum;
#[cfg(test)]
mod checksum_tests;
pub mod command;
pub mod decimal;
pub mod fault;
mod fields;
pub mod history;
pub mod keyword;
mod label;
pub mod line;
pub mod protocol;
pub mod reply;
pub mod self_test;
pub mod settings;
pub mod stamp;
pub mod state;
pub mod step_report;
pub mod stretch;
pub mod telemetry;
#[cfg(test)]
mod testing;
#[cfg(any(test, feature = "std"))]
pub mod text;

/// The example of the README is one that works.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;
