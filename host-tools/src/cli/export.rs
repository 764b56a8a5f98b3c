//! `rig export`: a model as a file of another language.

use std::path::PathBuf;

use clap::Parser;

use super::input::InputArgs;
use super::output::{self, FileKind, Output};
use crate::export::{Defaults, ExportError, Language, export, identifier};
use softrig::estimate::Dataset;
use softrig::estimate::fit::Fitter;
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::{PASCAL_PER_KPA, Recording};

/// Writes a model as C, Python, Modelica or MATLAB that repeats `rig simulate`.
///
/// The file needs nothing else. Its inputs are times in seconds and gauge pressures in kPa,
/// its outputs are angles in degrees. docs/export.md shows how to use each language.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  rig export --model repaired.toml --to c -o finger.c
  cc -std=c99 -O2 -DSOFTRIG_MAIN finger.c -lm -o finger && ./finger run.csv > simulated.csv
  rig export --model repaired.toml --to python -o finger.py && python3 finger.py run.csv
  rig export --model repaired.toml --to matlab -o finger.m
  rig export --model repaired.toml --to modelica -o Finger.mo
  rig export --model repaired.toml --to python --recording run.csv -o finger.py")]
pub struct Args {
    /// Model file
    #[arg(long, value_name = "MODEL.toml")]
    model: PathBuf,
    /// Language
    #[arg(long, value_enum, value_name = "LANGUAGE")]
    to: Language,
    /// Take the initial state and the sensor zeros from this recording, as `rig simulate
    /// --recording` estimates them, and the integration step from its largest angle
    #[arg(long, value_name = "REC.csv")]
    recording: Option<PathBuf>,
    /// Write to this file, whose name becomes that of the function or package; otherwise the
    /// file is printed
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    input: InputArgs,
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    output::check(
        &[Output::of("-o", FileKind::Code, args.output.as_ref())],
        args.recording.iter().chain([&args.model]),
    )?;
    let file = super::read_model(&args.model)?;
    let defaults = match &args.recording {
        Some(path) => starting_as(path, args, &file)?,
        None => Defaults::default(),
    };
    let stem = args.output.as_ref().and_then(|path| path.file_stem());
    let name = stem.map_or_else(
        || "softrig_model".to_owned(),
        |stem| stem.to_string_lossy().into_owned(),
    );
    if args.to == Language::Matlab && stem.is_some() && identifier(&name) != name {
        return Err(InputError::new(
            "is no name of a MATLAB function, which a file has to be named after",
            format!(
                "use letters, digits and underscores: -o {}.m",
                identifier(&name)
            ),
        )
        .in_file(args.output.as_deref().unwrap_or(&args.model))
        .into());
    }
    let text = export(&file, args.to, &name, defaults).map_err(|error| match error {
        ExportError::Branches(error) => anyhow::Error::from(
            InputError::new(error.to_string(), "leave out one of its effects").in_file(&file.path),
        ),
        other => other.into(),
    })?;
    match &args.output {
        Some(path) => {
            write_atomically(path, text.as_bytes())?;
            super::print(&format!("written: {}\n", path.display()))?;
        }
        None => super::print(&text)?,
    }
    Ok(())
}

/// The initial state and zeros that `rig simulate --recording` estimates.
fn starting_as(
    path: &std::path::Path,
    args: &Args,
    file: &ModelFile,
) -> Result<Defaults, InputError> {
    let (recording, warnings) = Recording::read_as(path, &args.input.layout())?;
    for warning in &warnings {
        super::warn(warning);
    }
    let data = Dataset::of(std::slice::from_ref(&recording));
    let found = Fitter::new(&file.model, &data)
        .compare(&file.model)
        .nuisances[0];
    Ok(Defaults {
        start_deg: Some(found.start.angle.to_degrees()),
        start_deg_per_s: found.start.rate.to_degrees(),
        pressure_zero_kpa: found.pressure_zero / PASCAL_PER_KPA,
        angle_zero_deg: found.angle_zero.to_degrees(),
        largest_angle_deg: data.sessions()[0].largest_angle().to_degrees(),
    })
}
