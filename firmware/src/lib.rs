//! The firmware's logic, as plain functions that a desktop can test.
//!
//! The binary beside this library owns the registers. All decisions are made here, without
//! hardware, without allocation and without panics.
#![no_std]
#![forbid(unsafe_code)]

pub mod app;
pub mod byte;
pub mod control;
pub mod design;
pub mod faults;
pub mod frame;
pub mod gas;
pub mod ground;
pub mod homing;
pub mod io;
pub mod monitor;
pub mod past;
pub mod pins;
#[cfg(any(test, feature = "plant"))]
#[doc(hidden)]
#[allow(
    missing_docs,
    clippy::missing_panics_doc,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss
)]
pub mod plant;
pub mod port;
#[cfg_attr(test, allow(missing_docs, clippy::cast_possible_truncation))]
pub mod ring;
pub mod runner;
pub mod safety;
pub mod self_test;
pub mod sensing;
pub mod settings;
pub mod sight;
pub mod stall;
pub mod stepper;
pub mod store;
pub mod stroke;
pub mod supply;
#[cfg(test)]
mod testing;
pub mod units;
pub mod wiring;

// Random protocols, as the tests of the wire have them.
#[cfg(test)]
#[path = "../../wire/src/testing.rs"]
mod wire_testing;
