//! `softrig convert`: a recording in another format.

use std::path::{Path, PathBuf};

use clap::Parser;

use super::choice::choice;
use super::input::InputArgs;
use super::output::{self, FileKind, Output};
use softrig_formats::bounded::read_text;
use softrig_formats::columns::Layout;
use softrig_formats::error::{InputError, write_atomically, write_with_meta};
use softrig_formats::formats::write::{Format, bytes};
use softrig_formats::recording::{Recording, meta_beside, stem};

/// Writes recordings in another format: CSV, Parquet or MCAP.
///
/// Converts every format that `softrig` reads: tables in any dialect, MATLAB files, Parquet,
/// MCAP. The result has the columns time_s, pressure_kpa and angle_deg, in s, kPa (gauge) and
/// degrees, and all other columns unchanged. Metadata is written too: beside a CSV, inside
/// Parquet and MCAP. A conversion and back changes no digit.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig convert run.csv -o run.mcap            # for Foxglove and PlotJuggler
  softrig convert run.mcap -o again.csv
  softrig convert lab.mat -o lab.csv --columns time=t,pressure=p,angle=theta --units pressure=bar
  softrig convert bag.mcap -o bag.csv --columns pressure=/rig/pressure,angle=/rig/angle.data
  softrig convert data/*.csv -o tables --to parquet   # several: into a folder")]
pub struct Args {
    /// Recordings
    #[arg(required = true, value_name = "IN")]
    recordings: Vec<PathBuf>,
    /// File to write: .csv, .csv.gz, .parquet or .mcap. With --to or several recordings, a
    /// folder in which each keeps its name
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Format of the files in a folder
    #[arg(long, value_parser = choice::<Format>(), value_name = "FORMAT")]
    to: Option<Format>,
    /// Model file whose section [recording] says which columns hold what
    #[arg(long, value_name = "MODEL.toml")]
    model: Option<PathBuf>,
    #[command(flatten)]
    input: InputArgs,
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let outputs = outputs(args)?;
    for (from, (to, format)) in args.recordings.iter().zip(&outputs) {
        let output = Output::of("-o", FileKind::Recording, Some(to))
            .rows_only(!writes_metadata(from, to, *format));
        output::check(&[output], args.recordings.iter().chain(&args.model))?;
    }
    let of_model = match &args.model {
        Some(model) => super::read_model(model)?.recording,
        None => Layout::default(),
    };
    let layout = args.input.layout_over(&of_model)?;
    for (from, (to, format)) in args.recordings.iter().zip(&outputs) {
        let rows = convert(from, to, *format, &layout)?;
        super::print(&format!("{}: {rows} samples\n", to.display()))?;
    }
    Ok(())
}

/// The path and format of each output.
fn outputs(args: &Args) -> Result<Vec<(PathBuf, Format)>, InputError> {
    let is_folder = args.output.is_dir() || args.to.is_some() || args.recordings.len() > 1;
    if !is_folder {
        let format = Format::of(&args.output).ok_or_else(|| {
            InputError::new(
                "does not name a format that can be written",
                "end it in .csv, .csv.gz, .parquet or .mcap",
            )
            .in_file(&args.output)
        })?;
        return Ok(vec![(args.output.clone(), format)]);
    }
    let Some(format) = args.to else {
        return Err(InputError::new(
            format!("{} would be a folder of files", args.output.display()),
            "say their format: --to csv, csv.gz, parquet or mcap",
        ));
    };
    let mut outputs: Vec<(PathBuf, Format)> = Vec::new();
    for from in &args.recordings {
        let name = format!("{}.{}", stem(from), format.ending());
        let to = args.output.join(name);
        if outputs.iter().any(|(taken, _)| *taken == to) {
            return Err(InputError::new(
                format!("would be written to {}, as another is", to.display()),
                "convert them one by one, or into folders of their own",
            )
            .in_file(from));
        }
        outputs.push((to, format));
    }
    std::fs::create_dir_all(&args.output)
        .map_err(|error| softrig_formats::error::not_written(&args.output, &error))?;
    Ok(outputs)
}

/// Whether metadata is written beside the rows. If the file beside them is already the
/// original's, it serves both.
fn writes_metadata(from: &Path, to: &Path, format: Format) -> bool {
    let beside = |path: &Path| output::same_file(&meta_beside(path));
    !format.holds_metadata() && beside(from) != beside(to)
}

/// Converts one recording, and says how many samples it has.
fn convert(from: &Path, to: &Path, format: Format, layout: &Layout) -> anyhow::Result<usize> {
    let samples = softrig_formats::formats::read(from, layout)?;
    // As everywhere else with its metadata, and all that is said about both.
    let (recording, warnings) = Recording::assemble(samples.clone(), from)?;
    for warning in recording.remarks(warnings) {
        super::warn(&warning);
    }
    let beside = meta_beside(from);
    let meta = if beside.exists() {
        Some(read_text(&beside)?)
    } else {
        samples.meta.clone()
    };
    let count = samples.len();
    let rows = bytes(samples, meta.clone(), format)?;
    match meta {
        Some(meta) if writes_metadata(from, to, format) => {
            write_with_meta((to, &rows), (&meta_beside(to), meta.as_bytes()))?;
        }
        _ => write_atomically(to, &rows)?,
    }
    Ok(count)
}
