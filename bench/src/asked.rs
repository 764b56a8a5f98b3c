//! What a benchmark that times the program is told.

use std::path::{Path, PathBuf};

use clap::Args;

/// The program, and a place for its files.
#[derive(Args, Debug)]
pub struct Asked {
    /// The program to time
    #[arg(long = "softrig", value_name = "PATH", overrides_with = "rig")]
    pub rig: PathBuf,
    /// Where its files go [default: bench in the folder that cargo builds into]
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
}

impl Asked {
    /// Where its files go: `otherwise` if nothing was said.
    pub fn folder<'a>(&'a self, otherwise: &'a Path) -> &'a Path {
        self.folder.as_deref().unwrap_or(otherwise)
    }
}
