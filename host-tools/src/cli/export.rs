//! `softrig export`: a model as a file of another language.

use std::path::{Path, PathBuf};

use clap::Parser;

use super::input::InputArgs;
use super::model::ModelArgs;
use super::output::{self, FileKind, Output};
use softrig::estimate::Dataset;
use softrig::estimate::fitter::Fitter;
use softrig_export::{Defaults, ExportError, Language, export, functional_mockup_unit, identifier};
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::{PASCAL_PER_KPA, Recording};

/// Writes a model as C, Python, Modelica, MATLAB or an FMU that repeats `softrig simulate`.
///
/// The file needs nothing else. Its inputs are times in seconds and gauge pressures in kPa,
/// its outputs are angles in degrees. docs/export.md shows how to use each language.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig export --model repaired.toml --to c -o finger.c
  cc -std=c99 -O2 -DSOFTRIG_MAIN finger.c -lm -o finger && ./finger run.csv > simulated.csv
  softrig export --model repaired.toml --to python -o finger.py && python3 finger.py run.csv
  softrig export --model repaired.toml --to matlab -o finger.m
  softrig export --model repaired.toml --to modelica -o Finger.mo
  softrig export --model repaired.toml --to fmu -o finger.fmu
  softrig export --model repaired.toml --to python --recording run.csv -o finger.py")]
pub struct Args {
    #[command(flatten)]
    model: ModelArgs,
    /// What to write
    #[arg(long, visible_alias = "as", value_enum, value_name = "LANGUAGE")]
    to: Target,
    /// Take the initial state and the sensor zeros from this recording, as `softrig simulate
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

/// What a model can be written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Target {
    /// C99: a program, or functions for a controller
    C,
    /// Python 3 without packages
    Python,
    /// A Modelica package
    Modelica,
    /// A MATLAB function, for GNU Octave too
    Matlab,
    /// A functional mock-up unit for co-simulation (FMI 2.0)
    Fmu,
}

impl Target {
    /// What the extension of a file name stands for.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()? {
            "c" => Some(Self::C),
            "py" => Some(Self::Python),
            "mo" => Some(Self::Modelica),
            "m" => Some(Self::Matlab),
            "fmu" => Some(Self::Fmu),
            _ => None,
        }
    }
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let model = args.model.find()?;
    output::check(
        &[Output::of("-o", FileKind::Code, args.output.as_ref())],
        args.recording.iter().chain([&model]),
    )?;
    let file = super::read_model(&model)?;
    let defaults = match &args.recording {
        Some(path) => starting_as(path, args, &file)?,
        None => Defaults::default(),
    };
    let stem = args.output.as_ref().and_then(|path| path.file_stem());
    let name = stem.map_or_else(
        || "softrig_model".to_owned(),
        |stem| stem.to_string_lossy().into_owned(),
    );
    let Exported { content, warning } = exported(&file, args.to, &name, defaults)?;
    if let Some(warning) = &warning {
        super::warn(warning);
    }
    match &args.output {
        Some(path) => {
            write_atomically(path, &content)?;
            super::print(&format!("written: {}\n", path.display()))?;
        }
        None if args.to == Target::Fmu => {
            return Err(
                InputError::new("an FMU is no text", "name its file with -o finger.fmu").into(),
            );
        }
        None => super::print(&String::from_utf8(content)?)?,
    }
    Ok(())
}

/// What a file holds.
#[derive(Clone, Debug)]
pub struct Exported {
    /// Its bytes.
    pub content: Vec<u8>,
    /// What is to be said about it.
    pub warning: Option<String>,
}

/// A model as a file called `name`, without its extension.
///
/// # Errors
///
/// Refuses a model with too many branches, and a name that MATLAB does not take.
pub fn exported(
    file: &ModelFile,
    target: Target,
    name: &str,
    defaults: Defaults,
) -> Result<Exported, InputError> {
    let fault = |error: ExportError| {
        let advice = match &error {
            ExportError::Branches(_) => "leave out one of its effects",
            _ => "this is a fault of softrig: please report it with the model file",
        };
        InputError::new(error.to_string(), advice).in_file(&file.path)
    };
    let language = match target {
        Target::C => Language::C,
        Target::Python => Language::Python,
        Target::Modelica => Language::Modelica,
        Target::Matlab if identifier(name) != name => {
            return Err(InputError::new(
                "is no name of a MATLAB function, which a file has to be named after",
                format!(
                    "use letters, digits and underscores: -o {}.m",
                    identifier(name)
                ),
            )
            .in_file(Path::new(&format!("{name}.m"))));
        }
        Target::Matlab => Language::Matlab,
        Target::Fmu => {
            let unit = functional_mockup_unit(file, name, defaults).map_err(fault)?;
            let warning = unit.source_only.map(|why| {
                format!("the unit has only its source, which some tools compile themselves: {why}; install a C compiler for a library")
            });
            return Ok(Exported {
                content: unit.bytes,
                warning,
            });
        }
    };
    let text = export(file, language, name, defaults).map_err(fault)?;
    Ok(Exported {
        content: text.into_bytes(),
        warning: None,
    })
}

/// The initial state and zeros that `softrig simulate --recording` estimates.
fn starting_as(
    path: &std::path::Path,
    args: &Args,
    file: &ModelFile,
) -> Result<Defaults, InputError> {
    let layout = args.input.layout_over(&file.recording)?;
    let (recording, warnings) = Recording::read_as(path, &layout)?;
    for warning in recording.remarks(warnings) {
        super::warn(&warning);
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
