//! `softrig simulate`: a model over a recording or a protocol.

use std::path::PathBuf;

use clap::{ArgGroup, Parser};
use schemars::JsonSchema;
use serde::Serialize;

use super::choice::choice;
use super::input::InputArgs;
use super::json::{JsonArgs, SCHEMA};
use super::model::ModelArgs;
use super::output::{self, FileKind, Output};
use super::picture::PictureArgs;
use softrig::comparison::check_comparable;
use softrig::estimate::simulation::{ANGLES_DEG, Arithmetic, Drive, HOLDS_S, in_range};
use softrig::estimate::start_from::StartFrom;
use softrig_formats::error::write_with_meta;
use softrig_formats::model_file::ModelFile;
use softrig_formats::numbers::tidy;
use softrig_formats::recording::{PASCAL_PER_KPA, Recording, to_csv};
use softrig_link::record::meta_path;
use softrig_report::plot::{Figure, Panel, Series, Style};

/// Simulates a model over the pressure of a recording, or over a protocol.
#[derive(Debug, Parser)]
#[command(group(ArgGroup::new("input").required(true).args(["recording", "protocol"])))]
#[command(after_help = "\
Examples:
  softrig simulate --model m.toml --protocol step --angle-deg 60 -o step60.csv
  softrig simulate --model m.toml --protocol steps -o steps.csv
  softrig simulate --model m.toml --recording run.csv --plot run.svg
  softrig simulate --model m.toml --recording test.csv --start-from 20 --zeros verdict.json
  softrig simulate --model m.toml --recording run.csv --linear --arithmetic board")]
pub struct Args {
    #[command(flatten)]
    model: ModelArgs,
    /// Take the pressure from this recording
    #[arg(long, value_name = "REC.csv")]
    recording: Option<PathBuf>,
    /// Generate the pressure for the set-points of a protocol: step, staircase or
    /// triangle, shaped by --angle-deg and --hold-s; a name from `softrig record
    /// --list`; or a protocol file. board:NAME is always the board's
    #[arg(long, value_name = "NAME|FILE.toml")]
    protocol: Option<String>,
    /// Largest set-point of the protocol, in degrees
    #[arg(long, default_value_t = 60.0, value_parser = angle)]
    angle_deg: f64,
    /// Time at each set-point, or of each ramp, in seconds
    #[arg(long, default_value_t = 5.0, value_parser = seconds)]
    hold_s: f64,
    /// Simulate the paper's linear rival of the model instead
    #[arg(long)]
    linear: bool,
    /// Arithmetic to simulate in
    #[arg(long, value_parser = choice::<Arithmetic>(), default_value_t = Arithmetic::F64)]
    arithmetic: Arithmetic,
    /// Take zeros and initial state from this many first samples, which are not scored, and fit
    /// nothing to the rest; rest: starts at rest at zero; period: one period of a steady state
    #[arg(
        long,
        value_name = "SAMPLES|rest|period",
        conflicts_with_all = ["protocol", "arithmetic"]
    )]
    start_from: Option<StartFrom>,
    /// With --start-from: sensor zeros found by a diagnosis [default: none]
    #[arg(long, value_name = "VERDICT.json", requires = "start_from")]
    zeros: Option<PathBuf>,
    /// Write the run as a recording
    #[arg(short, long, value_name = "OUT.csv")]
    output: Option<PathBuf>,
    /// Draw the run
    #[arg(long, value_name = "OUT.svg|pdf|png")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    picture: PictureArgs,
}

fn angle(text: &str) -> Result<f64, String> {
    in_range(number(text), &ANGLES_DEG, "degrees")
}

fn seconds(text: &str) -> Result<f64, String> {
    in_range(number(text), &HOLDS_S, "seconds")
}

/// Not a number, which is in no range, where the text is none.
fn number(text: &str) -> f64 {
    text.parse().unwrap_or(f64::NAN)
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let path = args.model.find()?;
    let played = args.protocol.as_ref().map(PathBuf::from);
    args.picture.check("--plot", args.plot.as_ref())?;
    output::check(
        &[
            Output::of("-o", FileKind::Recording, args.output.as_ref())
                .replacing(args.output.as_deref().is_some_and(output::is_simulated)),
            Output::of("--plot", FileKind::Picture, args.plot.as_ref()),
            args.json.output(),
        ],
        args.recording
            .iter()
            .chain(&played)
            .chain(&args.zeros)
            .chain([&path]),
    )?;
    let file = super::read_model(&path)?;
    args.arithmetic.check(&file)?;
    let drive = drive(args, &file)?;
    let model = if args.linear {
        drive.linear_rival(&file.model)
    } else {
        file.model
    };
    let simulated_deg = match args.start_from {
        Some(start) => drive.simulate_from(&model, start, args.zeros.as_deref())?,
        None => drive
            .simulate(&model, args.arithmetic)
            .map_err(|error| error.in_file(&path))?,
    };
    let unscored = args.start_from.map_or(0, StartFrom::used);
    let Drive {
        recording,
        is_measured,
        setpoint_deg,
    } = drive;
    let degrees = || recording.angle.iter().map(|a| a.to_degrees()).collect();
    let measured_deg: Option<Vec<f64>> = is_measured.then(degrees);

    let name = if args.linear {
        format!("{}, linear rival", file.name)
    } else {
        file.name.clone()
    };
    let angles = simulated_deg.iter().copied();
    let mut result = Simulated {
        schema: SCHEMA,
        model: name.clone(),
        samples: recording.len(),
        duration_s: tidy(recording.duration()),
        least_deg: angles.clone().fold(f64::INFINITY, f64::min),
        largest_deg: angles.fold(f64::NEG_INFINITY, f64::max),
        rmse_deg: None,
        start_from: args.start_from.map(|start| start.to_string()),
    };
    let unit = recording.measurand.unit();
    let mut text = format!(
        "{name}: {} samples over {:.2} s, {} from {:.2}{unit} to {:.2}{unit}\n",
        recording.len(),
        recording.duration(),
        recording.measurand.name(),
        // Adding zero turns −0 into 0.
        (100.0 * result.least_deg).round() / 100.0 + 0.0,
        result.largest_deg,
    );
    if let Some(measured) = &measured_deg {
        let error: Vec<f64> = simulated_deg
            .iter()
            .zip(measured)
            .skip(unscored)
            .map(|(simulated, measured)| simulated - measured)
            .collect();
        let rmse = softrig::statistics::rms(&error);
        result.rmse_deg = Some(rmse);
        let how = result
            .start_from
            .as_ref()
            .map_or_else(String::new, |start| {
                format!(" (start from {start}, nothing fitted to the rest)")
            });
        text += &format!("RMS error against the recording: {rmse:.3}{unit}{how}\n");
    }
    let shown = Shown {
        name,
        recording: &recording,
        measured_deg,
        setpoint_deg,
        simulated_deg,
    };
    if let Some(path) = &args.output {
        let about = output::about_simulated(args.recording.is_none());
        write_with_meta(
            (path, shown.csv().as_bytes()),
            (&meta_path(path), about.as_bytes()),
        )?;
        text += &format!("written: {}\n", path.display());
    }
    if let Some(path) = &args.plot {
        args.picture.write(path, &shown.figure())?;
        text += &format!("drawn: {}\n", path.display());
    }
    args.json.deliver(&result, &text)
}

/// What the model is simulated over: the recording, or the protocol.
///
/// # Errors
///
/// Faults of the recording, or that there is no such protocol.
fn drive(args: &Args, file: &ModelFile) -> anyhow::Result<Drive> {
    Ok(match (&args.recording, args.protocol.as_deref()) {
        (Some(path), _) => {
            let (recording, warnings) =
                Recording::read_as(path, &args.input.layout_over(&file.recording)?)?;
            for warning in recording.remarks(warnings) {
                super::warn(&warning);
            }
            for warning in check_comparable([file], std::slice::from_ref(&recording))? {
                super::warn(&warning);
            }
            Drive::measured(recording)
        }
        (None, name) => Drive::protocol(file, name.unwrap_or("step"), args.angle_deg, args.hold_s)?,
    })
}

/// What `softrig simulate --json` writes.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct Simulated {
    /// Version of the layout.
    schema: u32,
    /// Name of the model.
    model: String,
    /// Number of samples.
    samples: usize,
    /// Time from the first to the last (s).
    duration_s: f64,
    /// Smallest angle (°).
    least_deg: f64,
    /// Largest angle (°).
    largest_deg: f64,
    /// RMS error against the recording (°); absent over a protocol.
    #[serde(skip_serializing_if = "Option::is_none")]
    rmse_deg: Option<f64>,
    /// Where the initial state came from, if nothing was fitted to the whole recording: a number of
    /// first samples, which are not scored; `rest`; or `period`.
    #[serde(skip_serializing_if = "Option::is_none")]
    start_from: Option<String>,
}

/// A simulated run, with the recording to compare it with if there is one.
struct Shown<'a> {
    name: String,
    recording: &'a Recording,
    measured_deg: Option<Vec<f64>>,
    setpoint_deg: Option<Vec<f64>>,
    simulated_deg: Vec<f64>,
}

impl Shown<'_> {
    /// As a recording: the simulated angle is the prediction beside a measured angle, and
    /// otherwise the angle.
    fn csv(&self) -> String {
        let mut columns: Vec<(&str, &[f64])> = Vec::new();
        let mut recording = self.recording.clone();
        if self.measured_deg.is_some() {
            columns.push(("predicted_deg", &self.simulated_deg));
        } else {
            recording.angle = self.simulated_deg.iter().map(|a| a.to_radians()).collect();
        }
        if let Some(setpoint) = &self.setpoint_deg {
            columns.push(("setpoint_deg", setpoint));
        }
        to_csv(&recording, &columns)
    }

    fn figure(&self) -> Figure {
        let time = &self.recording.time;
        let mut panel = Panel::new("", self.recording.measurand.label()).with_weight(2.0);
        for (label, curve, style) in [
            ("measured", &self.measured_deg, Style::MEASURED),
            ("set-point", &self.setpoint_deg, Style::REFERENCE),
        ] {
            if let Some(curve) = curve {
                panel = panel.with_series(Series::new(label, time, curve, style));
            }
        }
        let simulated = Series::new("simulated", time, &self.simulated_deg, Style::AFTER);
        let kpa: Vec<f64> = self
            .recording
            .pressure
            .iter()
            .map(|pressure| pressure / PASCAL_PER_KPA)
            .collect();
        Figure::new(self.name.clone())
            .with_panel(panel.with_series(simulated))
            .with_panel(
                Panel::new("time (s)", "pressure (kPa)").with_series(Series::new(
                    "pressure",
                    time,
                    &kpa,
                    Style::MEASURED,
                )),
            )
    }
}
