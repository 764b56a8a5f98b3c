//! One file for each subcommand of `rig`: its arguments, and what it does with
//! the library.

pub mod compare;
pub mod diagnose;
pub mod example;
pub mod fit;
pub mod materials;
pub mod simulate;

use std::path::PathBuf;

use crate::error::InputError;
use crate::model_file::ModelFile;
use crate::recording::{Recording, read_all};

/// Prints a warning where it does not mix with results.
pub(crate) fn warn(text: &str) {
    eprintln!("warning: {text}");
}

/// Reads a model and recordings, with their warnings.
pub(crate) fn read(
    model: &std::path::Path,
    recordings: &[PathBuf],
) -> Result<(ModelFile, Vec<Recording>), InputError> {
    let file = ModelFile::read(model)?;
    let recordings = read_all(recordings, warn)?;
    Ok((file, recordings))
}

/// Refuses to start long work whose results could not be written.
pub(crate) fn check_outputs<'a>(
    outputs: impl IntoIterator<Item = &'a Option<PathBuf>>,
) -> Result<(), InputError> {
    for path in outputs.into_iter().flatten() {
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => continue,
        };
        if !folder.is_dir() {
            return Err(InputError::new(
                format!("cannot be written: there is no folder {}", folder.display()),
                "create it first",
            )
            .in_file(path));
        }
    }
    Ok(())
}

/// A spinner for long work on a terminal, silent elsewhere.
pub(crate) fn spinner() -> indicatif::ProgressBar {
    let bar = indicatif::ProgressBar::new_spinner();
    bar.enable_steady_tick(std::time::Duration::from_millis(120));
    bar
}
