//! Everything behind the `rig` command: recordings and models in, fits,
//! pictures and verdicts out.
#![forbid(unsafe_code)]
// Whatever is said goes through `terminal`, which makes harmless what others wrote.
#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

pub mod batch;
pub mod bounded;
pub mod checkpoint;
pub mod cmd;
pub mod columns;
pub mod denoise;
pub mod diagnose;
pub mod dual;
pub mod error;
pub mod estimate;
pub mod example;
pub mod export;
pub mod first_model;
pub mod formula;
pub mod io;
pub mod linear;
pub mod link;
pub mod materials;
pub mod model_file;
pub mod monitor;
pub mod numbers;
pub mod own_effects;
pub mod plot;
pub mod protocol;
pub mod protocol_file;
pub mod ranges;
pub mod record;
pub mod recording;
pub mod report;
pub mod settings_file;
pub mod simulate;
pub mod simulation;
pub mod smooth;
pub mod statistics;
pub mod terminal;
pub mod usable;
