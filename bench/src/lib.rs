//! The benchmarks that `cargo xtask bench` starts: what each asks, how it counts, and what it says.
#![forbid(unsafe_code)]

pub mod blind;
pub mod invariance;
pub mod pages;
pub mod real;
pub mod rig_loop;
