//! The second phase: diagnose folders, knowing nothing else.
//!
//! A verdict that is there is kept, so a run that was interrupted goes on where
//! it stopped. Verdicts of another version of the tool are not: they lie in a
//! folder that is named by a hash of its sources.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use softrig::diagnose::{Job, Request, diagnose};
use softrig_formats::columns::Layout;
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::model_file::{ModelFile, to_file_units};
use softrig_formats::recording::read_all;

use super::cases::stable_hash;
use crate::processor::{self, Of};

/// What the second phase leaves of a case.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Outcome {
    /// The verdict as `softrig diagnose --json` writes it; none if the diagnosis
    /// refused the recordings.
    pub verdict: Option<serde_json::Value>,
    /// Why it refused.
    pub refused: Option<String>,
    /// The parameters of the final fit.
    pub fitted: Vec<FittedParameter>,
    /// The repaired model file.
    pub repaired: String,
    /// The models of explanations that cannot be told apart.
    #[serde(default)]
    pub rivals: Vec<String>,
    /// Wall time (s).
    pub seconds: f64,
    /// Processor time on all cores (s); none where it is not known, or where
    /// several cases were diagnosed at the same time.
    #[serde(default)]
    pub cpu_seconds: Option<f64>,
}

/// A parameter of the final fit, in the units of files.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FittedParameter {
    /// Name as in `[fit] free`.
    pub name: String,
    /// Value.
    pub value: f64,
    /// 95 % interval; infinite ends are written as none.
    pub interval95: Option<(f64, f64)>,
}

impl Outcome {
    /// Diagnoses the model and the recordings in a folder.
    ///
    /// # Errors
    ///
    /// Says which file cannot be read.
    pub fn of(folder: &Path) -> Result<Self, InputError> {
        let file = ModelFile::read(&folder.join("model.toml"))?;
        let paths = recordings(folder)?;
        let recordings = read_all(&paths, &Layout::default(), |_| {})?;
        let request = Request::of(&file, &recordings);
        let (clock, before) = (Instant::now(), processor::seconds(Of::Itself));
        // A panic is a wrong answer to one case, not the end of the benchmark.
        let diagnosis = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            diagnose(&request, &Job::default()).map_err(|error| error.to_string())
        }))
        .unwrap_or_else(|_| Err("the diagnosis panicked".to_owned()));
        let seconds = clock.elapsed().as_secs_f64();
        let processor = processor::seconds(Of::Itself).zip(before);
        let cpu_seconds = processor.map(|(after, before)| after - before);
        let diagnosis = match diagnosis {
            Ok(diagnosis) => diagnosis,
            Err(refusal) => {
                return Ok(Self {
                    refused: Some(refusal),
                    seconds,
                    cpu_seconds,
                    ..Self::default()
                });
            }
        };
        let fit = &diagnosis.repaired.fit;
        let rivals = diagnosis.rivals.iter();
        let rivals = rivals.map(|rival| file.text_with(&rival.fit.model, ""));
        let fitted = fit
            .free
            .iter()
            .enumerate()
            .map(|(index, &id)| {
                let shown = |value: f64| to_file_units(&fit.model, id, value);
                FittedParameter {
                    name: softrig_formats::model_file::parameter_name(&fit.model, id),
                    value: shown(fit.model.value(id).unwrap_or(f64::NAN)),
                    interval95: fit
                        .interval95(index)
                        .map(|(low, high)| (shown(low), shown(high)))
                        .filter(|(low, high)| low.is_finite() && high.is_finite()),
                }
            })
            .collect();
        let verdict = diagnosis.verdict(&request, seconds);
        let verdict = serde_json::to_value(verdict).map_err(|error| {
            InputError::new(format!("the verdict cannot be written: {error}"), "")
        })?;
        Ok(Self {
            verdict: Some(verdict),
            refused: None,
            fitted,
            repaired: file.text_with(&fit.model, ""),
            rivals: rivals.collect(),
            seconds,
            cpu_seconds,
        })
    }

    /// Reads what an earlier run left; none if there is nothing whole.
    pub fn read(path: &Path) -> Option<Self> {
        serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()
    }
}

/// The recordings in a folder, in the order of their names.
fn recordings(folder: &Path) -> Result<Vec<PathBuf>, InputError> {
    let folder = folder.join("recordings");
    let entries =
        std::fs::read_dir(&folder).map_err(|error| InputError::from_io(&folder, &error))?;
    let mut paths: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|end| end == "csv"))
        .collect();
    paths.sort();
    Ok(paths)
}

/// Hash of the sources of the crates under test: what a verdict depends on.
pub fn tool_hash() -> String {
    fn walk(folder: &Path, files: &mut Vec<PathBuf>) {
        let Ok(entries) = std::fs::read_dir(folder) else {
            return;
        };
        for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
            if path.is_dir() {
                walk(&path, files);
            } else {
                files.push(path);
            }
        }
    }
    let root = softrig_tests::process::root();
    let mut files = Vec::new();
    for part in ["model-core/src", "host-tools"] {
        walk(&root.join(part), &mut files);
    }
    files.sort();
    let bytes: Vec<u8> = files
        .iter()
        .chain([&root.join("Cargo.lock")])
        .filter_map(|path| std::fs::read(path).ok())
        .flatten()
        .collect();
    format!("{:08x}", stable_hash(&bytes) >> 32)
}

/// Diagnoses every case that has no verdict yet, `jobs` at a time.
///
/// # Errors
///
/// The first file that cannot be read or written; verdicts so far are kept.
pub fn diagnose_all(
    cases: &Path,
    verdicts: &Path,
    names: &[String],
    jobs: usize,
) -> Result<(), InputError> {
    std::fs::create_dir_all(verdicts).map_err(|error| InputError::from_io(verdicts, &error))?;
    let path_of = |name: &String| verdicts.join(format!("{name}.json"));
    let open: Vec<&String> = names
        .iter()
        .filter(|name| Outcome::read(&path_of(name)).is_none())
        .collect();
    let kept = names.len() - open.len();
    if kept > 0 {
        eprintln!("{kept} verdicts are there already");
    }
    let clock = Instant::now();
    let (next, finished) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let work = || -> Result<(), InputError> {
        while let Some(name) = open.get(next.fetch_add(1, Ordering::Relaxed)) {
            let mut outcome = Outcome::of(&cases.join(name))?;
            if jobs > 1 {
                outcome.cpu_seconds = None;
            }
            let text = serde_json::to_string_pretty(&outcome).map_err(|error| {
                InputError::new(format!("the verdict cannot be written: {error}"), "")
            })?;
            write_atomically(&path_of(name), text.as_bytes())?;
            let done = finished.fetch_add(1, Ordering::Relaxed) + 1;
            eprintln!(
                "{done:>4} of {}  {name}  {:>5.1} s  {}",
                open.len(),
                outcome.seconds,
                remaining(clock.elapsed(), done, open.len())
            );
        }
        Ok(())
    };
    at_once(jobs, work)
}

/// Runs `work` on so many threads at once, one at least.
///
/// # Errors
///
/// The first of their errors, once all are done.
pub fn at_once<E: Send>(
    jobs: usize,
    work: impl Fn() -> Result<(), E> + Copy + Send + Sync,
) -> Result<(), E> {
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs.max(1)).map(|_| scope.spawn(work)).collect();
        workers
            .into_iter()
            .try_for_each(|worker| match worker.join() {
                Ok(result) => result,
                Err(panic) => std::panic::resume_unwind(panic),
            })
    })
}

/// How long the rest will take, in words.
pub fn remaining(elapsed: Duration, done: usize, all: usize) -> String {
    let seconds = elapsed.as_secs_f64() / done.max(1) as f64 * all.saturating_sub(done) as f64;
    if seconds < 90.0 {
        format!("{seconds:.0} s left")
    } else {
        format!("{:.0} min left", seconds / 60.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_is_in_proportion() {
        let elapsed = Duration::from_secs(60);
        assert_eq!(remaining(elapsed, 3, 6), "60 s left");
        assert_eq!(remaining(elapsed, 1, 11), "10 min left");
        assert_eq!(remaining(elapsed, 4, 4), "0 s left");
    }
}
