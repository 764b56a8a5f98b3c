//! The time of a whole diagnosis.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::{Value, json};
use softrig_tests::process::succeed;
use softrig_tests::shared_folder;

use crate::invariance::cases::Case;
use crate::invariance::known;

/// Times a whole diagnosis: of the real pendulum where its recordings are at hand, else of a
/// simulated example
#[derive(Args, Debug)]
pub struct Options {
    /// The program to time
    #[arg(long = "softrig", value_name = "PATH", overrides_with = "rig")]
    rig: PathBuf,
    /// Where the example goes [default: bench/example in the folder that cargo builds into]
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
}

const RUNS: usize = 5;
/// How long one run may take.
const LIMIT: Duration = Duration::from_secs(3_600);

impl Options {
    /// Times it.
    ///
    /// # Errors
    ///
    /// If the program fails.
    pub fn measure(&self, folder: &Path) -> Result<Value, String> {
        let folder = self.folder.as_deref().unwrap_or(folder);
        let log = folder.with_extension("txt");
        let pendulum = shared_folder().join("data/real/pendulum");
        let (name, case) = if pendulum.is_dir() {
            let labels = known::real()?;
            (
                "real pendulum",
                Case::read(&pendulum, labels.get("pendulum"))?,
            )
        } else {
            let mut example = Command::new(&self.rig);
            example.args(["example", "-o"]).arg(folder);
            succeed(&mut example, LIMIT, &log)?;
            ("simulated example", Case::read(folder, None)?)
        };
        let mut times = Vec::new();
        for _ in 0..RUNS {
            let mut command = Command::new(&self.rig);
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
        Ok(json!({
            "benchmark": "diagnosis", "name": name, "runs": RUNS,
            "recordings": case.recordings.len() + case.holdout.len(),
            "median_s": times[RUNS / 2], "fastest_s": times[0], "slowest_s": times[RUNS - 1],
        }))
    }
}
