//! The time of a whole diagnosis; `cargo xtask bench diagnosis` builds and runs it.

use std::path::PathBuf;
use std::process::{Command, ExitCode};
use std::time::{Duration, Instant};

use clap::Parser;
use softrig_bench::invariance::cases::Case;
use softrig_bench::invariance::known;
use softrig_tests::process::succeed;
use softrig_tests::shared_folder;

/// Times a whole diagnosis: of the real pendulum where its recordings are at hand, else of a
/// simulated example.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask bench diagnosis")]
struct Args {
    /// The program to time
    #[arg(long = "softrig", value_name = "PATH", overrides_with = "rig")]
    rig: PathBuf,
    /// Where the example goes
    #[arg(long, value_name = "DIR", overrides_with = "folder")]
    folder: PathBuf,
}

const RUNS: usize = 5;
/// How long one run may take.
const LIMIT: Duration = Duration::from_secs(3_600);

fn main() -> ExitCode {
    match time(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("diagnosis: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn time(args: &Args) -> Result<(), String> {
    let log = args.folder.with_extension("txt");
    let pendulum = shared_folder().join("data/real/pendulum");
    let (name, case) = if pendulum.is_dir() {
        let labels = known::real()?;
        (
            "real pendulum",
            Case::read(&pendulum, labels.get("pendulum"))?,
        )
    } else {
        let mut example = Command::new(&args.rig);
        example.args(["example", "-o"]).arg(&args.folder);
        succeed(&mut example, LIMIT, &log)?;
        ("simulated example", Case::read(&args.folder, None)?)
    };
    let mut times = Vec::new();
    for _ in 0..RUNS {
        let mut command = Command::new(&args.rig);
        command.arg("diagnose").arg("--model").arg(&case.model);
        command.args(&case.recordings);
        if !case.holdout.is_empty() {
            command.arg("--holdout").args(&case.holdout);
        }
        let clock = Instant::now();
        succeed(&mut command, LIMIT, &log)?;
        times.push(clock.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    println!(
        "bench: softrig diagnose, {name}, {} recordings: median of {RUNS} runs {:.1} s ({:.1} s to {:.1} s)",
        case.recordings.len() + case.holdout.len(),
        times[RUNS / 2],
        times[0],
        times[RUNS - 1]
    );
    Ok(())
}
