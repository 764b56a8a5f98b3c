//! Tests across crates, in one program: each more would link all of softrig again.

mod custom_effects;
mod documents;
mod firmware_in_simulator;
mod formulas;
mod hardware;
mod identification;
mod materials;
mod real_recordings;
mod second_processor;
mod serial_plotter;
