//! Rigs and effects of another physics than softrig's: the truths of the blind benchmark.
//!
//! [`law`] and [`world`] share no code with the crates under test, so that a mistake in those cannot
//! hide itself here. There are two generations of cases, runs from rest ([`cases`]) and whole
//! sessions ([`mod@bench`]). `bench_truth` of the benchmarks holds the laws against published figures.
#![forbid(unsafe_code)]

pub mod bench;
pub mod cases;
pub mod experiments;
pub mod folder;
pub mod hidden;
pub mod kinds;
pub mod law;
pub mod refit;
pub mod sensors;
pub mod sizes;
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
