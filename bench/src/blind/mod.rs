//! The blind benchmark: how often does the diagnosis name what is missing, and
//! how often something that is not?
//!
//! `cargo xtask bench blind` runs it in three phases that do not share memory:
//! [`draw`] draws truths and writes folders as a lab would hand them over, the
//! answers into files beside; [`verdicts`] diagnoses the folders and writes
//! what it found; [`score`] opens the answers. The physics is [`law`] and [`world`],
//! which share no code with the crates under test. There are two generations of
//! cases, runs from rest ([`cases`]) and whole sessions ([`mod@bench`]), and forces that no
//! catalogue has ([`laws`]); how what is hidden is counted and shown is the same for all.

pub mod answer;
pub mod counts;
pub mod draw;
pub mod gate;
pub mod grade;
pub mod laws;
pub mod run;
pub mod said;
pub mod score;
pub mod tables;
pub mod verdicts;

pub use softrig_worlds::{
    GENERATOR, bench, cases, experiments, folder, hidden, kinds, law, refit, sensors, sizes, world,
};
