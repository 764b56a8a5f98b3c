//! The loop on many drawn actuators; `cargo xtask bench loop` builds and runs it.

use std::process::ExitCode;

use clap::Parser;
use softrig_bench::rig_loop::bench::{Options, bench};
use softrig_tests::rig_loop::Programs;

/// How much does a diagnosis improve what the board predicts?
///
/// Draws an actuator from each seed, which hides an effect, and runs the demo's loop on it:
/// record, diagnose, upload, record again.
#[derive(Debug, Parser)]
#[command(
    name = "cargo xtask bench loop",
    after_help = "\
Examples:
  cargo xtask bench loop --seeds 201..212
  cargo xtask bench loop --seeds 901..924 --docs"
)]
struct Args {
    #[command(flatten)]
    options: Options,
    #[command(flatten)]
    programs: Programs,
}

fn main() -> ExitCode {
    let args = Args::parse();
    match bench(&args.programs, &args.options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("loop: {problem}");
            ExitCode::FAILURE
        }
    }
}
