//! What commands print for machines: `--json FILE`, or `--json -` on standard output, alone.

use std::path::{Path, PathBuf};

use clap::Args;
use schemars::JsonSchema;
use serde::Serialize;

use super::output::{FileKind, Output};
use softrig_formats::error::write_atomically;

/// Version of the layouts in this program that have one.
pub(crate) const SCHEMA: u32 = 1;

/// The flag of commands with a result.
#[derive(Clone, Debug, Default, Args)]
pub struct JsonArgs {
    /// Also write the result as JSON; with - as FILE, print it and nothing else
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

impl JsonArgs {
    /// The file, to be checked before the work begins.
    pub(crate) fn output(&self) -> Output<'_> {
        Output::of("--json", FileKind::Json, self.file())
    }

    /// The file; none where the result is printed, or not wanted.
    pub(crate) fn file(&self) -> Option<&PathBuf> {
        self.json.as_ref().filter(|path| !is_stdout(path))
    }

    /// Prints the text, and writes the result; only the result if that is to be printed.
    pub(crate) fn deliver(&self, value: &impl Serialize, text: &str) -> anyhow::Result<()> {
        match self.json.as_deref() {
            Some(path) if is_stdout(path) => Ok(super::print_own(&text_of(value)?)?),
            Some(path) => {
                write_atomically(path, text_of(value)?.as_bytes())?;
                Ok(super::print(text)?)
            }
            None => Ok(super::print(text)?),
        }
    }
}

/// Whether a name stands for standard output.
pub(crate) fn is_stdout(path: &Path) -> bool {
    path == Path::new("-")
}

/// A result as text.
pub(crate) fn text_of(value: &impl Serialize) -> anyhow::Result<String> {
    Ok(serde_json::to_string_pretty(value)? + "\n")
}

/// A parameter of a model.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct Parameter {
    /// Its name, as in `[fit] free`.
    pub name: String,
    /// The unit of its numbers; empty for a number without one.
    pub unit: String,
    /// Its value before; absent if it was not there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nominal: Option<f64>,
    /// Its value.
    pub value: f64,
    /// Its 95 % interval; absent if nothing determines it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interval95: Option<[f64; 2]>,
    /// Where the number is from, in a word; absent where all are from one fit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
}
