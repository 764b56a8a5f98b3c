//! The diagnosis of real rigs beside black boxes; `cargo xtask bench real` builds and runs it.

use std::process::ExitCode;

use clap::Parser;
use softrig_bench::real::{Options, bench};

/// Does the diagnosis find in others' rigs what its authors report?
///
/// Diagnoses the recordings of eight real rigs, and compares the repaired models with
/// black-box models on the validation recordings.
#[derive(Debug, Parser)]
#[command(
    name = "cargo xtask bench real",
    after_help = "\
Examples:
  cargo xtask bench real --only pendulum,silverbox
  cargo xtask bench real --docs"
)]
struct Args {
    #[command(flatten)]
    options: Options,
}

fn main() -> ExitCode {
    match bench(&Args::parse().options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("real: {problem}");
            ExitCode::FAILURE
        }
    }
}
