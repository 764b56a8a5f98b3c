//! `softrig compare`: the paper's table.
//!
//! For each set-point the recorded repeats are averaged, and the RMS error of every model
//! against that mean is given in degrees and in percent of the set-point, in the layout of
//! the paper's Table III. The picture has the layout of its Figs. 8 and 9.

use std::path::PathBuf;

use clap::Parser;
use schemars::JsonSchema;
use serde::Serialize;

use super::input::InputArgs;
use super::json::{JsonArgs, SCHEMA};
use super::output::{self, FileKind, Output};
use super::picture::PictureArgs;
use softrig::comparison::{Comparison, Repeats, average, check_comparable, deviation};
use softrig::estimate::assemble::assemble;
use softrig::prediction::Prediction;
use softrig_formats::columns::Layout;
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::model_file::ModelFile;
use softrig_formats::numbers::tidy;
use softrig_formats::recording::read_all;
use softrig_report::plot::{Figure, Mark, Panel, Role, Series, Style};

/// Compares models with recordings: RMS error for each set-point, against the
/// mean of the repeats.
///
/// Repeats are recognised by their pressure; the set-point comes from the
/// column setpoint_deg, from the metadata, or from the largest angle that the
/// mean run holds.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig compare --model nominal.toml --model repaired.toml step60_*.csv step90_*.csv
  softrig compare --model nominal.toml --linear step60_*.csv      the paper's table
  softrig compare --model nominal.toml --linear step*.csv --plot steps.svg     and its picture
  softrig compare --model nominal.toml --prediction theta_sim step*.csv        beside your own")]
pub struct Args {
    /// Model file; repeat the flag for several [default: model in softrig.toml]
    #[arg(long = "model", value_name = "MODEL.toml")]
    models: Vec<PathBuf>,
    /// Compare the angles in this column as well, which a simulation of yours gave (ARX, SOFA,
    /// Simulink, an FMU): COLUMN, or COLUMN:rad. Then no model is needed
    #[arg(long, value_name = "COLUMN[:UNIT]")]
    prediction: Option<Prediction>,
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
    #[arg(long, value_name = "STEPS.svg|pdf|png")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    picture: PictureArgs,
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
    args.input.layout_over(&by_models)
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let models = match args.models.as_slice() {
        [] if args.prediction.is_some() && !args.linear => Vec::new(),
        [] => vec![super::model::of_rig_file()?],
        named => named.to_vec(),
    };
    let read = args.recordings.iter().chain(&models);
    args.picture.check("--plot", args.plot.as_ref())?;
    output::check(
        &[
            Output::of("-o", FileKind::Table, args.output.as_ref()),
            Output::of("--plot", FileKind::Picture, args.plot.as_ref()),
            args.json.output(),
        ],
        read,
    )?;
    let files = models
        .iter()
        .map(|path| super::read_model(path))
        .collect::<Result<Vec<_>, InputError>>()?;
    let recordings = read_all(&args.recordings, &layout(&files, args)?, super::warn)?;
    for warning in check_comparable(&files, &recordings)? {
        super::warn(&warning);
    }
    let assembled = assemble(&recordings, &[])?;
    for concern in &assembled.concerns {
        super::warn(&concern.to_string());
    }
    let mut comparison = Comparison::of(&files, &assembled.data, args.linear);
    if let Some(prediction) = &args.prediction {
        comparison = comparison.with_prediction(prediction)?;
    }
    let mut text = table(&comparison);
    if let Some(path) = &args.output {
        write_atomically(path, csv_table(&comparison).as_bytes())?;
        text += &format!("\nwritten: {}\n", path.display());
    }
    if let Some(path) = &args.plot {
        args.picture.write(path, &figure(&comparison))?;
        text += &format!("\npicture: {}\n", path.display());
    }
    args.json.deliver(&Errors::of(&comparison), &text)
}

/// What `softrig compare --json` writes.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct Errors {
    /// Version of the layout.
    schema: u32,
    /// A row for each model and set-point.
    rows: Vec<Row>,
}

/// The error of a model at a set-point.
#[derive(Clone, Debug, Serialize, JsonSchema)]
struct Row {
    /// Name of the runs.
    run: String,
    /// Set-point (°).
    setpoint_deg: f64,
    /// Number of runs that are averaged.
    repeats: usize,
    /// Name of the model.
    model: String,
    /// RMS error against the mean of the repeats (°).
    rms_deg: f64,
    /// The same in percent of the set-point; none where that is zero.
    rms_percent: Option<f64>,
}

impl Errors {
    fn of(comparison: &Comparison) -> Self {
        let rows = comparison.models.iter().flat_map(|model| {
            let errors = comparison.groups.iter().zip(&model.errors);
            errors.map(|(group, error)| Row {
                run: group.label.clone(),
                setpoint_deg: tidy(group.setpoint_deg),
                repeats: group.runs.len(),
                model: model.name.clone(),
                rms_deg: tidy(error.rms_deg),
                rms_percent: Some(error.percent).filter(|it| it.is_finite()).map(tidy),
            })
        });
        Self {
            schema: SCHEMA,
            rows: rows.collect(),
        }
    }
}

/// The paper's Figs. 8 and 9: the mean of the repeats to each set-point, and what each model
/// makes of their pressures.
fn figure(comparison: &Comparison) -> Figure {
    let Comparison { runs, groups, .. } = comparison;
    let angles: Vec<Vec<f64>> = runs.iter().map(|run| run.angle.clone()).collect();
    let has_repeats = groups.iter().any(|group| group.runs.len() > 1);
    let band = if has_repeats {
        ", with the standard deviation of one repeat as a band where that is wider than the line"
    } else {
        ""
    };
    let mut figure = Figure::new("Models beside the mean of the repeats")
        .with_subtitle(format!(
            "Grey: the measured {}, the mean of all runs to one set-point{band}. Beside each \
             model its RMS error against that mean, and in percent of the set-point.",
            comparison.measurand().name()
        ))
        .with_separate_x()
        .with_columns(groups.len().min(2));
    for (place, group) in groups.iter().enumerate() {
        figure = figure.with_panel(panel(comparison, group, &angles, place));
    }
    figure
}

/// The panel of the runs to one set-point, the one at `place`; `angles` are those of all runs.
fn panel(comparison: &Comparison, group: &Repeats, angles: &[Vec<f64>], place: usize) -> Panel {
    let degrees =
        |values: &[f64]| -> Vec<f64> { values.iter().map(|it| it.to_degrees()).collect() };
    let measured = group.of(angles);
    let middle = average(&measured);
    let clock = &comparison.runs[group.runs[0]].time;
    let start = clock.first().copied().unwrap_or(0.0);
    let time: Vec<f64> = clock.iter().map(|time| time - start).collect();
    let runs_are = match group.runs.len() {
        1 => "one run".to_owned(),
        count => format!("{count} repeats"),
    };
    let measurand = comparison.measurand();
    let unit = measurand.unit();
    let title = format!(
        "{}, {:.0}{unit}, {runs_are}",
        group.label, group.setpoint_deg
    );
    let mut panel = Panel::new("time (s)", measurand.label()).with_title(title);
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
    for (index, model) in comparison.models.iter().enumerate() {
        let misses = average(&group.of(&model.residuals));
        let angle: Vec<f64> = middle.iter().zip(&misses).map(|(a, b)| a + b).collect();
        let label = format!("{}: {}", model.name, model.errors[place].shown(&measurand));
        let style = if model.is_rival {
            Style::BEFORE.dashed()
        } else {
            Style::new(OF_MODELS[index % OF_MODELS.len()], Mark::Line)
        };
        panel = panel.with_series(Series::new(label, &time, &degrees(&angle), style));
    }
    panel
}

fn table(comparison: &Comparison) -> String {
    let Comparison { groups, models, .. } = comparison;
    let measurand = comparison.measurand();
    let labels = super::width(20, groups.iter().map(|group| group.label.as_str()));
    let names = super::width(24, models.iter().map(|model| model.name.as_str()));
    let mut text = format!(
        "{:<labels$} {:>9} {:>8}",
        "RMS error", "set-point", "repeats"
    );
    for model in models {
        text += &format!(" {:>names$}", model.name);
    }
    text.push('\n');
    for (row, group) in groups.iter().enumerate() {
        text += &format!(
            "{:<labels$} {:>9} {:>8}",
            group.label,
            format!("{:.1}{}", group.setpoint_deg, measurand.unit()),
            group.runs.len()
        );
        for model in models {
            text += &format!(" {:>names$}", model.errors[row].shown(&measurand));
        }
        text.push('\n');
    }
    text
}

fn csv_table(comparison: &Comparison) -> String {
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
    for model in &comparison.models {
        for (group, error) in comparison.groups.iter().zip(&model.errors) {
            rows.push([
                group.label.clone(),
                format!("{:.3}", group.setpoint_deg),
                group.runs.len().to_string(),
                model.name.clone(),
                format!("{:.4}", error.rms_deg),
                format!("{:.3}", error.percent),
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
