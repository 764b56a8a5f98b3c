//! Everything behind the `rig` command: recordings and models in, fits,
//! pictures and verdicts out.
#![forbid(unsafe_code)]
// A room's first page names its modules, also those that no other crate sees.
#![allow(rustdoc::private_intra_doc_links)]
// Whatever is said goes through `terminal`, which makes harmless what others wrote.
#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

mod batch;
pub mod cli;
pub mod diagnose;
pub mod estimate;
pub mod export;
pub mod family;
pub mod first_model;
pub mod io;
pub mod materials;
pub mod numbers;
pub mod plot;
pub mod report;
pub mod rig;
pub mod sim;
pub mod statistics;
pub mod synth;
