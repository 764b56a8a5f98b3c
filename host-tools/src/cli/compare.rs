//! `rig compare`: the paper's table.
//!
//! For each set-point the recorded repeats are averaged, and the RMS error of every model
//! against that mean is given in degrees and in percent of the set-point, in the layout of
//! the paper's Table III. The picture has the layout of its Figs. 8 and 9.

use std::fmt;
use std::path::PathBuf;

use clap::Parser;
use model_core::actuator::{Model, ParameterId};

use super::input::InputArgs;
use super::output::{self, FileKind, Output};
use crate::plot::{Figure, Mark, Panel, Role, Series, Style, write_svg};
use softrig::diagnose::noise::NoiseFloor;
use softrig::estimate::Dataset;
use softrig::estimate::assemble::assemble;
use softrig::estimate::fit::{Effort, Fitter};
use softrig::sim::linear::linear_rival;
use softrig::statistics::{mean, rms, squares_about_mean};
use softrig_formats::columns::Layout;
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::{Recording, read_all};

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
  rig compare --model nominal.toml --linear step60_*.csv      the paper's table
  rig compare --model nominal.toml --linear step*.csv --plot steps.svg     and its picture")]
pub struct Args {
    /// Model file; repeat the flag for several
    #[arg(long = "model", required = true, value_name = "MODEL.toml")]
    models: Vec<PathBuf>,
    /// Recordings
    #[arg(required = true, value_name = "REC.csv")]
    recordings: Vec<PathBuf>,
    /// Add the paper's linear rival of the first model, refitted to these
    /// recordings
    #[arg(long)]
    linear: bool,
    /// Write the table as CSV
    #[arg(short, long, value_name = "TABLE.csv")]
    output: Option<PathBuf>,
    /// Draw, for each set-point, the mean of the repeats with their standard deviation, and
    /// every model
    #[arg(long, value_name = "STEPS.svg")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    input: InputArgs,
}

/// Colours of the models.
const OF_MODELS: [Role; 4] = [Role::Nominal, Role::After, Role::Emphasis, Role::Other(1)];

/// The layout of the recordings: from the command line, otherwise from the models, which
/// have to agree.
fn layout(files: &[ModelFile], args: &Args) -> Result<Layout, InputError> {
    let mut said: Option<&ModelFile> = None;
    for file in files.iter().filter(|it| it.recording != Layout::default()) {
        match said {
            Some(first) if first.recording != file.recording => {
                return Err(InputError::new(
                    format!(
                        "[recording] contradicts that of {}",
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
        &[
            Output::of("-o", FileKind::Table, args.output.as_ref()),
            Output::of("--plot", FileKind::Picture, args.plot.as_ref()),
        ],
        read,
    )?;
    let files = args
        .models
        .iter()
        .map(|path| super::read_model(path))
        .collect::<Result<Vec<_>, InputError>>()?;
    let recordings = read_all(&args.recordings, &layout(&files, args)?, super::warn)?;
    let assembled = assemble(&recordings, &[])?;
    for concern in &assembled.concerns {
        super::warn(&concern.to_string());
    }
    let data = &assembled.data;
    let runs = data.recordings(true);
    let groups = groups(&runs);
    let mut columns: Vec<Column> = files
        .iter()
        .map(|file| Column::of(name_of(file, &files), &file.model, data, &groups))
        .collect();
    if args.linear
        && let Some(first) = files.first()
    {
        let rival = linear_rival(&first.model, data.largest_angle());
        let fitter = Fitter::new(&rival, data);
        let free: Vec<_> = first
            .free
            .iter()
            .copied()
            .filter(|id| *id != ParameterId::Exponent && rival.value(*id).is_some())
            .collect();
        let fitted = fitter.fit(&rival, &free, Effort::Full);
        let name = "linear rival, refitted".to_owned();
        columns.push(Column {
            is_rival: true,
            ..Column::of(name, &fitted.model, data, &groups)
        });
    }
    let mut text = table(&groups, &columns);
    if let Some(path) = &args.output {
        write_atomically(path, csv_table(&groups, &columns).as_bytes())?;
        text += &format!("\nwritten: {}\n", path.display());
    }
    if let Some(path) = &args.plot {
        write_svg(path, &figure(&runs, &groups, &columns))?;
        text += &format!("\npicture: {}\n", path.display());
    }
    Ok(super::print(&text)?)
}

/// The name of a model, or that of its file if another has the same.
fn name_of(file: &ModelFile, all: &[ModelFile]) -> String {
    let alike = all.iter().filter(|other| other.name == file.name).count();
    match file.path.file_name() {
        Some(path) if alike > 1 => path.to_string_lossy().into_owned(),
        _ => file.name.clone(),
    }
}

/// A model beside the recordings.
struct Column {
    name: String,
    /// Simulated minus measured angle (rad), one series per run.
    residuals: Vec<Vec<f64>>,
    cells: Vec<Cell>,
    /// Whether it is the linear rival.
    is_rival: bool,
}

impl Column {
    /// Simulates the model over the sessions; its error against the mean of repeats is
    /// the mean of its errors on each.
    fn of(name: String, model: &Model<f64>, data: &Dataset, groups: &[Group]) -> Self {
        let residuals = Fitter::new(model, data).compare(model).residuals;
        let cells = groups
            .iter()
            .map(|group| {
                let rms_deg = rms(&average(&group.of(&residuals))).to_degrees();
                Cell {
                    rms_deg,
                    percent: 100.0 * rms_deg / group.setpoint_deg.abs(),
                }
            })
            .collect();
        Self {
            name,
            residuals,
            cells,
            is_rival: false,
        }
    }
}

/// Runs to one set-point.
struct Group {
    label: String,
    setpoint_deg: f64,
    /// Their indices among all runs.
    runs: Vec<usize>,
}

impl Group {
    /// The series of its runs, from those of all runs.
    fn of<'a>(&self, all: &'a [Vec<f64>]) -> Vec<&'a [f64]> {
        self.runs.iter().map(|&run| all[run].as_slice()).collect()
    }
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
    across(members, mean)
}

/// Standard deviation of one repeat, sample by sample; none of a single run.
fn deviation(members: &[&[f64]]) -> Option<Vec<f64>> {
    let free = members.len().checked_sub(1).filter(|free| *free > 0)?;
    let of_sample = |values: &[f64]| (squares_about_mean(values) / free as f64).sqrt();
    Some(across(members, of_sample))
}

/// Applies `number` to each sample that all repeats have.
fn across(members: &[&[f64]], number: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    let count = members.iter().map(|member| member.len()).min().unwrap_or(0);
    (0..count)
        .map(|k| {
            let values: Vec<f64> = members.iter().map(|member| member[k]).collect();
            number(&values)
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

/// An error in degrees and, where that means something, in percent of the set-point.
impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rms_deg, percent } = self;
        if percent.is_finite() {
            write!(f, "{rms_deg:.2}° ({percent:.1} %)")
        } else {
            write!(f, "{rms_deg:.2}°")
        }
    }
}

/// The paper's Figs. 8 and 9: the mean of the repeats to each set-point, and what each model
/// makes of their pressures.
fn figure(runs: &[Recording], groups: &[Group], columns: &[Column]) -> Figure {
    let angles: Vec<Vec<f64>> = runs.iter().map(|run| run.angle.clone()).collect();
    let has_repeats = groups.iter().any(|group| group.runs.len() > 1);
    let band = if has_repeats {
        ", with the standard deviation of one repeat as a band where that is wider than the line"
    } else {
        ""
    };
    let mut figure = Figure::new("Models beside the mean of the repeats")
        .with_subtitle(format!(
            "Grey: the measured angle, the mean of all runs to one set-point{band}. Beside each \
             model its RMS error against that mean, in degrees and in percent of the set-point."
        ))
        .with_separate_x()
        .with_columns(groups.len().min(2));
    for (place, group) in groups.iter().enumerate() {
        figure = figure.with_panel(panel(runs, group, &angles, columns, place));
    }
    figure
}

fn panel(
    runs: &[Recording],
    group: &Group,
    angles: &[Vec<f64>],
    columns: &[Column],
    place: usize,
) -> Panel {
    let degrees =
        |values: &[f64]| -> Vec<f64> { values.iter().map(|it| it.to_degrees()).collect() };
    let measured = group.of(angles);
    let middle = average(&measured);
    let clock = &runs[group.runs[0]].time;
    let start = clock.first().copied().unwrap_or(0.0);
    let time: Vec<f64> = clock.iter().map(|time| time - start).collect();
    let runs_are = match group.runs.len() {
        1 => "one run".to_owned(),
        count => format!("{count} repeats"),
    };
    let title = format!("{}, {:.0}°, {runs_are}", group.label, group.setpoint_deg);
    let mut panel = Panel::new("time (s)", "angle (°)").with_title(title);
    if let Some(deviation) = deviation(&measured) {
        let edge = |sign: f64| -> Vec<f64> {
            let both = middle.iter().zip(&deviation);
            both.map(|(middle, deviation)| (middle + sign * deviation).to_degrees())
                .collect()
        };
        let band = Series::band("", &time, &edge(-1.0), &edge(1.0), Role::Reference);
        panel = panel.with_series(band);
    }
    panel = panel.with_series(Series::new(
        "measured",
        &time,
        &degrees(&middle),
        Style::MEASURED,
    ));
    for (index, column) in columns.iter().enumerate() {
        let misses = average(&group.of(&column.residuals));
        let angle: Vec<f64> = middle.iter().zip(&misses).map(|(a, b)| a + b).collect();
        let label = format!("{}: {}", column.name, column.cells[place]);
        let style = if column.is_rival {
            Style::BEFORE.dashed()
        } else {
            Style::new(OF_MODELS[index % OF_MODELS.len()], Mark::Line)
        };
        panel = panel.with_series(Series::new(label, &time, &degrees(&angle), style));
    }
    panel
}

fn table(groups: &[Group], columns: &[Column]) -> String {
    const WIDTH: usize = 24;
    let cut = |name: &str| -> String { name.chars().take(WIDTH - 2).collect() };
    let mut text = format!("{:<20} {:>9} {:>8}", "RMS error", "set-point", "repeats");
    for column in columns {
        text += &format!(" {:>WIDTH$}", cut(&column.name));
    }
    text.push('\n');
    for (row, group) in groups.iter().enumerate() {
        text += &format!(
            "{:<20} {:>8.1}° {:>8}",
            group.label.chars().take(20).collect::<String>(),
            group.setpoint_deg,
            group.runs.len()
        );
        for column in columns {
            text += &format!(" {:>WIDTH$}", column.cells[row].to_string());
        }
        text.push('\n');
    }
    text
}

fn csv_table(groups: &[Group], columns: &[Column]) -> String {
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
    for column in columns {
        for (group, cell) in groups.iter().zip(&column.cells) {
            rows.push([
                group.label.clone(),
                format!("{:.3}", group.setpoint_deg),
                group.runs.len().to_string(),
                column.name.clone(),
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
