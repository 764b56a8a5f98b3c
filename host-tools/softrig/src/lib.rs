//! Simulation, estimation and diagnosis of soft pneumatic actuators.
//!
//! Recordings and models come from `softrig_formats`, in SI; the physics is `model_core`'s.
//! [`estimate`] fits a model to recordings, [`diagnose`] names the effect that a model lacks, and
//! [`first_model`] makes a model from recordings alone.
#![forbid(unsafe_code)]
// A room's first page names its modules, also those that no other crate sees.
#![allow(rustdoc::private_intra_doc_links)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]
#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

pub mod board_gap;
pub mod comparison;
pub mod diagnose;
pub mod estimate;
pub mod first_model;
pub mod linear;
pub mod portable;
pub mod prediction;
pub mod residual_analysis;
pub mod sim;
pub mod statistics;
pub mod synth;

/// The example of the README is one that works.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;
