//! `rig simulate`: a model over a recording or a protocol.

use std::path::PathBuf;

use clap::{ArgGroup, Parser, ValueEnum};
use model_core::actuator::Model;
use model_core::power::{GuardedMicromath, Minimax, Power};

use super::input::InputArgs;
use super::output::{self, FileKind, Output};
use crate::error::{InputError, write_with_meta};
use crate::estimate::fit::Fitter;
use crate::estimate::{Dataset, Nuisance, Session};
use crate::linear::linear_rival;
use crate::model_file::ModelFile;
use crate::own_effects::refuse_on_board;
use crate::plot::{Figure, Panel, Series, Style, write_svg};
use crate::protocol::{Play, Protocol, play};
use crate::protocol_file::ProtocolFile;
use crate::record::meta_path;
use crate::recording::{PASCAL_PER_KPA, Recording, to_csv};
use crate::simulate::Start;

/// Simulates a model over the pressure of a recording, or over a protocol.
#[derive(Debug, Parser)]
#[command(group(ArgGroup::new("input").required(true).args(["recording", "protocol"])))]
#[command(after_help = "\
Examples:
  rig simulate --model m.toml --protocol step --angle-deg 60 -o step60.csv
  rig simulate --model m.toml --protocol steps -o steps.csv
  rig simulate --model m.toml --recording run.csv --plot run.svg
  rig simulate --model m.toml --recording run.csv --linear --arithmetic board")]
pub struct Args {
    /// Model file
    #[arg(long, value_name = "MODEL.toml")]
    model: PathBuf,
    /// Take the pressure from this recording
    #[arg(long, value_name = "REC.csv")]
    recording: Option<PathBuf>,
    /// Generate the pressure that should reach the set-points of a protocol:
    /// step, staircase or triangle, shaped by --angle-deg and --hold-s; a name
    /// of `rig record --list`; or a protocol file. board:NAME is always the
    /// board's
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
    #[arg(long, value_enum, default_value_t = Arithmetic::F64)]
    arithmetic: Arithmetic,
    /// Write the run as a recording
    #[arg(short, long, value_name = "OUT.csv")]
    output: Option<PathBuf>,
    /// Draw the run
    #[arg(long, value_name = "OUT.svg")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    input: InputArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Arithmetic {
    /// Double precision
    F64,
    /// The board's single precision with its default power function
    Board,
    /// The board's single precision with guarded micromath
    BoardMicromath,
}

fn angle(text: &str) -> Result<f64, String> {
    in_range(text, 0.1, 360.0, "degrees")
}

fn seconds(text: &str) -> Result<f64, String> {
    in_range(text, 0.1, 3600.0, "seconds")
}

fn in_range(text: &str, low: f64, high: f64, unit: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (low..=high).contains(&value) => Ok(value),
        _ => Err(format!("give a number from {low} to {high} {unit}")),
    }
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let played = args.protocol.as_ref().map(PathBuf::from);
    output::check(
        &[
            Output::of("-o", FileKind::Recording, args.output.as_ref())
                .replacing(args.output.as_deref().is_some_and(output::is_simulated)),
            Output::of("--plot", FileKind::Picture, args.plot.as_ref()),
        ],
        args.recording.iter().chain(&played).chain([&args.model]),
    )?;
    let file = model_file(args)?;
    let (recording, setpoint) = match (&args.recording, args.protocol.as_deref()) {
        (Some(path), _) => {
            let (recording, warnings) =
                Recording::read_as(path, &args.input.layout().or(&file.recording))?;
            for warning in &warnings {
                super::warn(warning);
            }
            (recording, None)
        }
        (None, name) => from_protocol(&file, name.unwrap_or("step"), args)?,
    };
    let data = Dataset::of(std::slice::from_ref(&recording));
    let session = &data.sessions()[0];
    let largest = recording
        .pressure
        .iter()
        .fold(0.0, |largest: f64, p| largest.max(p.abs()));
    let model = if args.linear {
        linear_rival(&file.model, steady_angle(&file.model, largest))
    } else {
        file.model
    };
    let nuisance = if args.recording.is_some() {
        // Zeros and start with which the model comes nearest to the recording.
        let fitter = Fitter::new(&model, &data);
        fitter.compare(&model).nuisances[0]
    } else {
        Nuisance {
            start: Start {
                angle: model.reading(&model.at_rest(0.0, 0.0)),
                rate: 0.0,
            },
            ..Nuisance::AT_ZERO
        }
    };
    let simulated = match args.arithmetic {
        Arithmetic::F64 => session.simulate(&model, &nuisance),
        Arithmetic::Board => on_board::<Minimax>(session, &model, &nuisance),
        Arithmetic::BoardMicromath => on_board::<GuardedMicromath>(session, &model, &nuisance),
    };
    let degrees =
        |radians: &[f64]| -> Vec<f64> { radians.iter().map(|a| a.to_degrees()).collect() };
    let simulated_deg = degrees(&simulated);
    let measured_deg = args.recording.as_ref().map(|_| degrees(&recording.angle));

    let name = if args.linear {
        format!("{}, linear rival", file.name)
    } else {
        file.name.clone()
    };
    let mut text = format!(
        "{name}: {} samples over {:.2} s, angle from {:.2}° to {:.2}°\n",
        recording.len(),
        recording.duration(),
        // Adding zero turns −0 into 0.
        (100.0 * simulated_deg.iter().copied().fold(f64::INFINITY, f64::min)).round() / 100.0 + 0.0,
        simulated_deg
            .iter()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max),
    );
    if let Some(measured) = &measured_deg {
        let error: Vec<f64> = simulated_deg
            .iter()
            .zip(measured)
            .map(|(a, b)| a - b)
            .collect();
        text += &format!(
            "RMS error against the recording: {:.3}°\n",
            crate::statistics::rms(&error)
        );
    }
    let shown = Shown {
        name,
        recording: &recording,
        measured_deg,
        setpoint_deg: setpoint,
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
        write_svg(path, &shown.figure())?;
        text += &format!("drawn: {}\n", path.display());
    }
    Ok(super::print(&text)?)
}

/// The model, if the arithmetic that is asked for can run it.
fn model_file(args: &Args) -> Result<ModelFile, InputError> {
    let file = super::read_model(&args.model)?;
    if args.arithmetic != Arithmetic::F64 {
        refuse_on_board(&file)?;
    }
    Ok(file)
}

/// A simulated run with what there is to compare it with.
struct Shown<'a> {
    name: String,
    recording: &'a Recording,
    measured_deg: Option<Vec<f64>>,
    setpoint_deg: Option<Vec<f64>>,
    simulated_deg: Vec<f64>,
}

impl Shown<'_> {
    /// As a recording: beside a measured angle the simulated one is a
    /// prediction, without one it is the angle.
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
        let mut panel = Panel::new("", "angle (°)").with_weight(2.0);
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

/// A recording of nothing but the commanded pressure, with the set-points (°).
fn from_protocol(
    file: &ModelFile,
    name: &str,
    args: &Args,
) -> Result<(Recording, Option<Vec<f64>>), InputError> {
    let angle = args.angle_deg.to_radians();
    let hold = args.hold_s;
    let shape = match name {
        // One step, held and released.
        "step" => Some(Protocol::Step {
            angle,
            hold,
            release: 0.6 * hold,
        }),
        // Four steps up and down.
        "staircase" => Some(Protocol::Staircase {
            angle,
            steps: 4,
            hold,
        }),
        // Two ramps up and down.
        "triangle" => Some(Protocol::Triangle {
            angle,
            ramp: hold,
            cycles: 2,
        }),
        _ => None,
    };
    let (time, setpoint, pressure) = if let Some(shape) = shape {
        shape.pressure(&file.model)
    } else {
        let name = name.strip_prefix("board:").unwrap_or(name);
        let Play {
            time,
            setpoint,
            pressure,
            ..
        } = play(
            &ProtocolFile::find(name)?,
            &file.model,
            u32::from(wire::telemetry::RATE_HZ),
        );
        (time, setpoint, pressure)
    };
    if pressure.iter().any(|pressure| !pressure.is_finite()) {
        return Err(InputError::new(
            "the model needs an infinite pressure for this set-point",
            "give an input_gain_n_per_kpa other than zero",
        )
        .in_file(&file.path));
    }
    let recording = Recording {
        angle: vec![0.0; time.len()],
        time,
        pressure,
        ..Recording::default()
    };
    let setpoint = setpoint.iter().map(|angle| angle.to_degrees()).collect();
    Ok((recording, Some(setpoint)))
}

/// The angle (rad) at which the plain model rests under `pressure` (Pa).
pub(crate) fn steady_angle(model: &Model<f64>, pressure: f64) -> f64 {
    let d = model.dynamics();
    let angle = (d.input_gain.abs() * pressure / d.stiffness).powf(1.0 / d.exponent);
    if angle.is_finite() { angle } else { 0.0 }
}

#[allow(clippy::cast_possible_truncation)]
fn on_board<P: Power<f32>>(session: &Session, model: &Model<f64>, nuisance: &Nuisance) -> Vec<f64> {
    let board: Model<f32, P> = model.map(|value| value as f32);
    session.simulate(&board, nuisance)
}
