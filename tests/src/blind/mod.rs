//! The blind benchmark: how often does the diagnosis name what is missing, and
//! how often something that is not?
//!
//! `cargo xtask bench blind` runs it in three phases that do not share memory:
//! [`draw`] draws truths and writes folders as a lab would hand them over, the
//! answers into files beside; [`verdicts`] diagnoses the folders and writes
//! what it found; [`score`] opens the answers. The physics is [`law`] and [`world`],
//! which share no code with the crates under test. There are two generations of
//! cases, runs from rest ([`cases`]) and whole sessions ([`mod@bench`]); what is
//! hidden, how it is counted and how it is shown is the same for both.

pub mod answer;
pub mod bench;
pub mod cases;
pub mod counts;
pub mod draw;
pub mod experiments;
pub mod folder;
pub mod gate;
pub mod grade;
pub mod hidden;
pub mod kinds;
pub mod law;
pub mod page;
pub mod picture;
pub mod refit;
pub mod said;
pub mod score;
pub mod sensors;
pub mod sizes;
pub mod tables;
pub mod verdicts;
pub mod world;

/// The sources that decide what the cases of every set are: where they are other
/// ones, all cases are drawn again.
pub const GENERATOR: &str = concat!(
    include_str!("cases.rs"),
    include_str!("experiments.rs"),
    include_str!("folder.rs"),
    include_str!("kinds.rs"),
    include_str!("law.rs"),
    include_str!("refit.rs"),
    include_str!("sensors.rs"),
    include_str!("sizes.rs"),
    include_str!("world.rs"),
    include_str!("bench/cases.rs"),
    include_str!("bench/instruments.rs"),
    include_str!("bench/session.rs"),
    include_str!("bench/sizing.rs"),
);
