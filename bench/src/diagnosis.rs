//! The time of a whole diagnosis.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use softrig_tests::process::succeed;
use softrig_tests::shared_folder;

use crate::asked::Asked;
use crate::invariance::cases::Case;
use crate::invariance::known;

const RUNS: usize = 5;
/// How long one run may take.
const LIMIT: Duration = Duration::from_secs(3_600);

/// Times it.
///
/// # Errors
///
/// If the program fails.
pub fn measure(asked: &Asked, folder: &Path) -> Result<Value, String> {
    let folder = asked.folder(folder);
    let log = folder.with_extension("txt");
    let pendulum = shared_folder().join("data/real/pendulum");
    let (name, case) = if pendulum.is_dir() {
        let labels = known::real()?;
        (
            "real pendulum",
            Case::read(&pendulum, labels.get("pendulum"))?,
        )
    } else {
        let mut example = Command::new(&asked.rig);
        example.args(["example", "-o"]).arg(folder);
        succeed(&mut example, LIMIT, &log)?;
        ("simulated example", Case::read(folder, None)?)
    };
    let mut times = Vec::new();
    for _ in 0..RUNS {
        let mut command = Command::new(&asked.rig);
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
