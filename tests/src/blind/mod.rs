//! The blind benchmark: how often does the diagnosis name what is missing, and
//! how often something that is not?
//!
//! `cargo xtask bench blind` runs it in three phases that do not share memory:
//! [`cases`] draws truths and writes folders as a lab would hand them over, the
//! answers into a file beside; [`verdicts`] diagnoses the folders and writes
//! what it found; [`score`] opens the answers. The physics is
//! [`truth`], which shares no code with the crates under test.

pub mod bench;
pub mod cases;
pub mod draw;
pub mod experiments;
pub mod gate;
pub mod kinds;
pub mod refit;
pub mod score;
pub mod sensors;
pub mod tables;
pub mod truth;
pub mod verdicts;

/// The sources that decide what the cases of the rich and the paper set are.
pub const GENERATOR: &str = concat!(
    include_str!("cases.rs"),
    include_str!("experiments.rs"),
    include_str!("kinds.rs"),
    include_str!("refit.rs"),
    include_str!("sensors.rs"),
    include_str!("truth.rs"),
    include_str!("bench/world.rs"),
);
