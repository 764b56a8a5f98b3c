//! Physics of a soft pneumatic bending actuator.
//!
//! The crate reads like the paper it starts from (Yang, Stuart, Kurkcu and Tomizuka, "Nonlinear
//! Modeling for Soft Pneumatic Actuators via Data-Driven Parameter Estimation", arXiv
//! 2311.02527): Ludwick's law, the beam, the equation of motion, and then the effects that a real
//! rig adds to it. The same source runs in `f32` on an ATmega2560 and in `f64` or with derivatives
//! on a desktop, so that a prediction made on the board can be checked bit for bit.
//!
//! It holds physics and nothing else: no files, no formatting, no allocation.
#![cfg_attr(not(any(feature = "std", test)), no_std)]
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod actuator;
pub mod carried;
pub mod catalogue;
pub mod dynamics;
pub mod effects;
pub mod elementary;
pub mod glide;
pub mod input;
pub mod integrate;
pub mod leapfrog;
pub mod ludwick;
pub mod material;
pub mod part;
pub mod power;
pub mod power_table;
pub mod predictor;
pub mod prepared;
pub mod real;
mod scalars;

/// The example of the README is one that works.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;
