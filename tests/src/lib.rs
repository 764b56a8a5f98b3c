//! Helpers that the cross-crate tests share: where data that is not part of
//! the project lies, a diagnosis without a command line around it, and the loop
//! of the demo.

pub mod process;
pub mod rig_loop;
pub mod verdict;

use std::fs;
use std::path::{Path, PathBuf};

use softrig::diagnose::{Diagnosis, Job, Request, diagnose};
use softrig::synth::example::Example;
use softrig_formats::error::write_atomically;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::{Recording, read_all};

/// Whether the longer form of a test is asked for, as `cargo xtask test --all` does.
pub fn all_tests() -> bool {
    std::env::var_os("SOFTRIG_ALL_TESTS").is_some()
}

/// The folder of data that are not part of the project: beside it, or where
/// `SOFTRIG_SHARED` says.
pub fn shared_folder() -> PathBuf {
    std::env::var_os("SOFTRIG_SHARED")
        .map_or_else(|| process::root().join("../shared"), PathBuf::from)
}

/// A folder of the shared data. Where it is absent, one line says so.
pub fn shared(folder: &str) -> Option<PathBuf> {
    let found = shared_folder().join(folder);
    if found.is_dir() {
        return Some(found);
    }
    eprintln!("skipped: there is no folder {}", found.display());
    None
}

/// A model and the recordings to diagnose it with.
#[derive(Debug)]
pub struct Case {
    /// The nominal model.
    pub file: ModelFile,
    /// Recordings to fit.
    pub recordings: Vec<Recording>,
    /// Recordings to judge by; may be empty.
    pub holdout: Vec<Recording>,
}

impl Case {
    /// Reads `model.toml` and, by the start of their names, files in
    /// `recordings/`.
    ///
    /// # Panics
    ///
    /// If a file cannot be read: the tests that call this cannot go on.
    pub fn read(folder: &Path, fitted: &[&str], held_out: &[&str]) -> Self {
        let recordings = |starts: &[&str]| {
            let mut paths: Vec<PathBuf> = std::fs::read_dir(folder.join("recordings"))
                .unwrap()
                .map(|entry| entry.unwrap().path())
                .filter(|path| {
                    let name = path.file_name().unwrap().to_string_lossy();
                    !name.ends_with(".toml") && starts.iter().any(|start| name.starts_with(start))
                })
                .collect();
            paths.sort();
            read_all(
                &paths,
                &softrig_formats::columns::Layout::default(),
                |warning| {
                    eprintln!("{warning}");
                },
            )
            .unwrap()
        };
        Self {
            file: ModelFile::read(&folder.join("model.toml")).unwrap(),
            recordings: recordings(fitted),
            holdout: recordings(held_out),
        }
    }

    /// Writes an example into `folder` and reads it back, as a user would.
    ///
    /// # Panics
    ///
    /// If the folder cannot be written.
    pub fn of_example(example: &Example, folder: &Path) -> Self {
        example.write(folder).unwrap();
        Self::read(folder, &[""], &[])
    }

    /// Diagnoses the case.
    ///
    /// # Panics
    ///
    /// If the diagnosis refuses the recordings.
    pub fn diagnose(&self) -> Diagnosis {
        let request = Request {
            file: &self.file,
            recordings: &self.recordings,
            holdout: &self.holdout,
            start_from: &[],
            own: None,
            formulas: true,
            without: &[],
            seed: 1,
        };
        diagnose(&request, &Job::default()).unwrap()
    }
}

/// The names of the effects that the repaired model adds, named or not, in alphabetical order.
pub fn named(diagnosis: &Diagnosis) -> Vec<&'static str> {
    let mut names: Vec<_> = diagnosis
        .repaired
        .added
        .iter()
        .map(|kind| kind.name())
        .collect();
    names.sort_unstable();
    names
}

/// Reads a text.
///
/// # Errors
///
/// Names the file.
pub fn text_of(path: &Path) -> Result<String, String> {
    fs::read_to_string(path).map_err(|error| format!("cannot read {}: {error}", path.display()))
}

/// Writes a text into a folder, which is made.
///
/// # Errors
///
/// Names the file.
pub fn write(path: &Path, text: &str) -> Result<(), String> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)
            .map_err(|error| format!("cannot make {}: {error}", folder.display()))?;
    }
    write_atomically(path, text.as_bytes()).map_err(|error| error.to_string())
}
