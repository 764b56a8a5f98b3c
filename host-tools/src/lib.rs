//! The `softrig` command: what its arguments mean, and how results become files and code
//! in other languages. Fits and verdicts come from `softrig`, pictures and reports from
//! `softrig_report`, files from `softrig_formats`, the board's answers from `softrig_link`.
#![forbid(unsafe_code)]
// A room's first page names its modules, also those that no other crate sees.
#![allow(rustdoc::private_intra_doc_links)]
// Whatever is said goes through `terminal`, which makes harmless what others wrote.
#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

pub mod batch;
pub mod cli;
pub mod command;
mod commission;
mod monitor;
