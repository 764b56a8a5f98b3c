//! In place of `softrig export`, in a build without the other languages.

use clap::Parser;
use softrig_formats::error::InputError;
use softrig_formats::formats::binary::WITH_LAB;

/// Writes a model as C, Python, Modelica, MATLAB or an FMU: not in this build.
#[derive(Debug, Parser)]
#[command(after_help = "Examples:\n  softrig export --model repaired.toml --to c -o finger.c")]
pub struct Args {
    /// Arguments of a build with it
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    _words: Vec<String>,
}

/// Says where a build is that has it.
///
/// # Errors
///
/// Always.
pub fn run(_: &Args) -> anyhow::Result<()> {
    Err(InputError::new(
        "export: this softrig was built without it",
        format!("take one that has it, {WITH_LAB}"),
    )
    .into())
}
