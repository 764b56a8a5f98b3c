//! `rig compare`: the paper's table.
//!
//! For each set-point the recorded repeats are averaged and every model is
//! judged by its RMS error against that mean, in degrees and in percent of the
//! set-point: the layout of the paper's Table III.

use std::path::PathBuf;

use clap::Parser;

use super::input::InputArgs;
use super::output::{self, FileKind, Output};
use crate::columns::Layout;
use crate::diagnose::noise::NoiseFloor;
use crate::error::{InputError, write_atomically};
use crate::estimate::Dataset;
use crate::estimate::assemble::assemble;
use crate::estimate::fit::{Effort, Fitter};
use crate::linear::linear_rival;
use crate::model_file::ModelFile;
use crate::recording::{Recording, read_all};
use crate::statistics::{mean, rms};

/// Compares models with recordings: RMS error for each set-point, against the
/// mean of the repeats.
///
/// Repeats are recognised by their pressure; the set-point comes from the
/// column setpoint_deg, from the metadata, or from the largest angle that the
/// mean run holds.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  rig compare --model nominal.toml --model repaired.toml step60_*.csv step90_*.csv
  rig compare --model nominal.toml --linear step60_*.csv      the paper's table")]
pub struct Args {
    /// Model file; repeat the flag for several
    #[arg(long = "model", required = true, value_name = "MODEL.toml")]
    models: Vec<PathBuf>,
    /// Recordings
    #[arg(required = true, value_name = "REC.csv")]
    recordings: Vec<PathBuf>,
    /// Add the paper's linear rival of the first model, refitted to these
    /// recordings so that it is at its best
    #[arg(long)]
    linear: bool,
    /// Write the table as CSV
    #[arg(short, long, value_name = "TABLE.csv")]
    output: Option<PathBuf>,
    #[command(flatten)]
    input: InputArgs,
}

/// Where the recordings stand: as the command line says, else as the models do, which have
/// to agree.
fn layout(files: &[ModelFile], args: &Args) -> Result<Layout, InputError> {
    let mut said: Option<&ModelFile> = None;
    for file in files.iter().filter(|it| it.recording != Layout::default()) {
        match said {
            Some(first) if first.recording != file.recording => {
                return Err(InputError::new(
                    format!(
                        "[recording] says otherwise than that of {}",
                        first.path.display()
                    ),
                    "make them the same, or leave one of them out: the models are compared on the same recordings",
                )
                .in_file(&file.path));
            }
            _ => said = Some(file),
        }
    }
    let by_models = said.map(|file| file.recording.clone()).unwrap_or_default();
    Ok(args.input.layout().or(&by_models))
}

/// Errors of one model at one set-point.
#[derive(Clone, Copy)]
struct Cell {
    rms_deg: f64,
    percent: f64,
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let read = args.recordings.iter().chain(&args.models);
    output::check(
        &[Output::of("-o", FileKind::Table, args.output.as_ref())],
        read,
    )?;
    let files = args
        .models
        .iter()
        .map(|path| ModelFile::read(path))
        .collect::<Result<Vec<_>, InputError>>()?;
    let recordings = read_all(&args.recordings, &layout(&files, args)?, super::warn)?;
    let assembled = assemble(&recordings, &[])?;
    for concern in &assembled.concerns {
        super::warn(&concern.to_string());
    }
    let data = &assembled.data;
    let runs = data.recordings(true);
    let groups = groups(&runs);
    let mut columns: Vec<(String, Vec<Cell>)> = Vec::new();
    for file in &files {
        columns.push((file.name.clone(), errors(&file.model, data, &groups)));
    }
    if args.linear
        && let Some(first) = files.first()
    {
        let rival = linear_rival(&first.model, data.reach());
        let fitter = Fitter::new(&rival, data);
        let free: Vec<_> = first
            .free
            .iter()
            .copied()
            .filter(|id| {
                *id != model_core::actuator::ParameterId::Exponent && rival.value(*id).is_some()
            })
            .collect();
        let fitted = fitter.fit(&rival, &free, Effort::Full);
        columns.push((
            "linear rival, refitted".into(),
            errors(&fitted.model, data, &groups),
        ));
    }
    let mut text = table(&groups, &columns);
    if let Some(path) = &args.output {
        write_atomically(path, csv_table(&groups, &columns).as_bytes())?;
        text += &format!("\nwritten: {}\n", path.display());
    }
    Ok(super::print(&text)?)
}

/// Runs to one set-point.
struct Group {
    label: String,
    setpoint_deg: f64,
    /// Their places among all runs.
    runs: Vec<usize>,
}

fn groups(runs: &[Recording]) -> Vec<Group> {
    let mut sets = NoiseFloor::of(runs).groups;
    for index in 0..runs.len() {
        if !sets.iter().any(|set| set.contains(&index)) {
            sets.push(vec![index]);
        }
    }
    sets.sort();
    sets.into_iter()
        .map(|set| {
            let angles: Vec<&[f64]> = set.iter().map(|&run| runs[run].angle.as_slice()).collect();
            Group {
                label: runs[set[0]].name.clone(),
                setpoint_deg: setpoint_deg(&runs[set[0]], &average(&angles)),
                runs: set,
            }
        })
        .collect()
}

/// Mean of repeats, sample by sample.
fn average(members: &[&[f64]]) -> Vec<f64> {
    let count = members.iter().map(|member| member.len()).min().unwrap_or(0);
    (0..count)
        .map(|k| {
            let values: Vec<f64> = members.iter().map(|member| member[k]).collect();
            mean(&values)
        })
        .collect()
}

/// The set-point of a run (°): as recorded, as in the metadata, or the largest
/// angle that the run holds.
fn setpoint_deg(recording: &Recording, average: &[f64]) -> f64 {
    let recorded = recording.column("setpoint_deg").map(|column| {
        column
            .iter()
            .copied()
            .filter(|value| value.is_finite())
            .fold(0.0, |largest: f64, value| {
                if value.abs() > largest.abs() {
                    value
                } else {
                    largest
                }
            })
    });
    recorded
        .filter(|setpoint| *setpoint != 0.0)
        .or(recording.meta.setpoint_deg)
        .unwrap_or_else(|| {
            let mut angles: Vec<f64> = average.iter().map(|angle| angle.abs()).collect();
            angles.sort_unstable_by(f64::total_cmp);
            // A tenth of the run above it: overshoot does not count.
            angles[angles.len() - 1 - angles.len() / 10].to_degrees()
        })
}

/// The model is simulated over the sessions; what it misses of the mean of
/// repeats is the mean of what it misses of each.
fn errors(model: &model_core::actuator::Model<f64>, data: &Dataset, groups: &[Group]) -> Vec<Cell> {
    let fitter = Fitter::new(model, data);
    let residuals = fitter.compare(model).residuals;
    groups
        .iter()
        .map(|group| {
            let repeats: Vec<&[f64]> = group
                .runs
                .iter()
                .map(|&run| residuals[run].as_slice())
                .collect();
            let rms_deg = rms(&average(&repeats)).to_degrees();
            Cell {
                rms_deg,
                percent: 100.0 * rms_deg / group.setpoint_deg.abs(),
            }
        })
        .collect()
}

fn table(groups: &[Group], columns: &[(String, Vec<Cell>)]) -> String {
    const WIDTH: usize = 24;
    let cut = |name: &str| -> String { name.chars().take(WIDTH - 2).collect() };
    let mut text = format!("{:<20} {:>9} {:>8}", "RMS error", "set-point", "repeats");
    for (name, _) in columns {
        text += &format!(" {:>WIDTH$}", cut(name));
    }
    text.push('\n');
    for (row, group) in groups.iter().enumerate() {
        text += &format!(
            "{:<20} {:>8.1}° {:>8}",
            group.label.chars().take(20).collect::<String>(),
            group.setpoint_deg,
            group.runs.len()
        );
        for (_, cells) in columns {
            let Cell { rms_deg, percent } = cells[row];
            let cell = if percent.is_finite() {
                format!("{rms_deg:.2}° ({percent:.1} %)")
            } else {
                format!("{rms_deg:.2}°")
            };
            text += &format!(" {cell:>WIDTH$}");
        }
        text.push('\n');
    }
    text
}

fn csv_table(groups: &[Group], columns: &[(String, Vec<Cell>)]) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut rows = vec![
        [
            "run",
            "setpoint_deg",
            "repeats",
            "model",
            "rms_deg",
            "rms_percent",
        ]
        .map(str::to_owned),
    ];
    for (name, cells) in columns {
        for (group, cell) in groups.iter().zip(cells) {
            rows.push([
                group.label.clone(),
                format!("{:.3}", group.setpoint_deg),
                group.runs.len().to_string(),
                name.clone(),
                format!("{:.4}", cell.rms_deg),
                format!("{:.3}", cell.percent),
            ]);
        }
    }
    for row in rows {
        // Writing to memory does not fail.
        let _ = writer.write_record(row);
    }
    writer
        .into_inner()
        .map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
        .unwrap_or_default()
}
