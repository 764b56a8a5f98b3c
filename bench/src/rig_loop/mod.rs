//! The demo's loop for many actuators, and the experiments that a diagnosis proposes.

pub mod bench;
pub mod decide;
