//! Do the proposed experiments decide? `cargo xtask bench decide` builds and runs it.

use std::process::ExitCode;

use clap::Parser;
use softrig_bench::rig_loop::decide::{Options, bench};
use softrig_tests::rig_loop::Programs;

/// Do the experiments that `softrig` proposes decide what one session cannot tell?
///
/// For each effect an actuator is drawn that hides it. One session is recorded on the virtual
/// rig and diagnosed; where it cannot tell, `softrig next` makes the experiments, two at most.
#[derive(Debug, Parser)]
#[command(
    name = "cargo xtask bench decide",
    after_help = "\
Examples:
  cargo xtask bench decide --seeds 1 --only gravity,end_stop
  cargo xtask bench decide --seeds 5301..5302 --docs"
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
            eprintln!("decide: {problem}");
            ExitCode::FAILURE
        }
    }
}
