//! The benchmarks that `cargo xtask bench` starts: what each asks and how it counts. Each returns its figures as one
//! JSON value; [`pages`] shows them and writes them into `docs/`.
#![forbid(unsafe_code)]

pub mod asked;
pub mod blind;
pub mod catalogue;
pub mod commands;
pub mod diagnosis;
pub mod invariance;
pub mod many;
pub mod pages;
pub mod pictures;
pub mod processor;
pub mod public;
pub mod real;
pub mod rig_loop;
pub mod search;
pub mod simulate;
