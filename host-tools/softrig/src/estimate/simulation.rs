//! Simulates a model over a recording or a protocol.
//!
//! Over a recording, zeros and initial state are estimated, as in every fit. Over a protocol, or
//! a pressure alone, there is no measured angle: the sensors have no zero errors, and the
//! actuator starts at rest.

use std::ops::RangeInclusive;
use std::path::Path;

use model_core::actuator::Model;
use model_core::power::{GuardedMicromath, Minimax, Power};
use strum::{Display, EnumMessage, EnumString, IntoStaticStr, VariantArray};

use crate::diagnose::decide::verdict::read_zeros;
use crate::estimate::fitter::Fitter;
use crate::estimate::start_from::{StartFrom, simulate_from};
use crate::estimate::{Dataset, Nuisance, Session};
use crate::sim::board::{self, OnBoard};
use crate::sim::linear::linear_rival;
use crate::sim::protocol::{Play, Protocol, play};
use crate::sim::simulate::InitialState;
use softrig_formats::error::InputError;
use softrig_formats::model_file::ModelFile;
use softrig_formats::own_effects::refuse_on_board;
use softrig_formats::protocol_file::ProtocolFile;
use softrig_formats::recording::{PASCAL_PER_KPA, Recording};

/// Largest set-points of a protocol (°).
pub const ANGLES_DEG: RangeInclusive<f64> = 0.1..=360.0;

/// Times at each set-point of a protocol, or of each ramp (s).
pub const HOLDS_S: RangeInclusive<f64> = 0.1..=3600.0;

/// Checks a number of a protocol.
///
/// # Errors
///
/// Says what it can be.
pub fn in_range(value: f64, range: &RangeInclusive<f64>, unit: &str) -> Result<f64, String> {
    if range.contains(&value) {
        return Ok(value);
    }
    let (low, high) = (range.start(), range.end());
    Err(format!("give a number from {low} to {high} {unit}"))
}

/// The numbers in which a model is simulated.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    Display,
    EnumMessage,
    EnumString,
    IntoStaticStr,
    VariantArray,
)]
#[strum(serialize_all = "lowercase")]
pub enum Arithmetic {
    /// Double precision
    #[default]
    F64,
    /// What the board predicts: its own steps and its table of the power
    Board,
    /// Single precision with the minimax power, in Runge-Kutta steps
    Minimax,
    /// Single precision with micromath's power, guarded, in Runge-Kutta steps
    #[strum(to_string = "micromath", serialize = "board-micromath")]
    Micromath,
}

impl Arithmetic {
    /// Refuses a model with an effect that cannot be simulated in these numbers.
    ///
    /// # Errors
    ///
    /// Names the effect.
    pub fn check(self, file: &ModelFile) -> Result<(), InputError> {
        match self {
            Self::F64 => Ok(()),
            Self::Board | Self::Minimax | Self::Micromath => refuse_on_board(file),
        }
    }
}

/// The input of a simulation.
#[derive(Clone, Debug)]
pub struct Drive {
    /// Time and pressure, and the angle if it was measured: zeros if not.
    pub recording: Recording,
    /// Whether the angle was measured.
    pub is_measured: bool,
    /// Set-points of a protocol (°).
    pub setpoint_deg: Option<Vec<f64>>,
}

impl Drive {
    /// A recording with a measured angle.
    pub fn measured(recording: Recording) -> Self {
        Self {
            recording,
            is_measured: true,
            setpoint_deg: None,
        }
    }

    /// A pressure alone: the angle of the recording is not looked at.
    pub fn pressure(recording: Recording) -> Self {
        Self {
            recording: Recording {
                angle: vec![0.0; recording.len()],
                ..recording
            },
            is_measured: false,
            setpoint_deg: None,
        }
    }

    /// The pressure that should reach the set-points of a protocol: step, staircase or
    /// triangle to `angle_deg` (°), each set-point held or ramp lasting `hold_s` (s); a
    /// protocol of the board; or a protocol file.
    ///
    /// # Errors
    ///
    /// Names the protocols that exist, the fault in the file, or what the model cannot do.
    pub fn protocol(
        file: &ModelFile,
        name: &str,
        angle_deg: f64,
        hold_s: f64,
    ) -> Result<Self, InputError> {
        let angle = angle_deg.to_radians();
        let shape = match name {
            // One step, held and released.
            "step" => Some(Protocol::Step {
                angle,
                hold: hold_s,
                release: 0.6 * hold_s,
            }),
            // Four steps up and down.
            "staircase" => Some(Protocol::Staircase {
                angle,
                steps: 4,
                hold: hold_s,
            }),
            // Two ramps up and down.
            "triangle" => Some(Protocol::Triangle {
                angle,
                ramp: hold_s,
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
        let drive = Self::pressure(Recording {
            time,
            pressure,
            ..Recording::default()
        });
        Ok(Self {
            setpoint_deg: Some(setpoint.iter().map(|angle| angle.to_degrees()).collect()),
            ..drive
        })
    }

    /// The linear rival that bends as far as `model` under the largest pressure.
    pub fn linear_rival(&self, model: &Model<f64>) -> Model<f64> {
        let largest = self
            .recording
            .pressure
            .iter()
            .fold(0.0, |largest: f64, p| largest.max(p.abs()));
        linear_rival(model, steady_angle(model, largest))
    }

    /// The simulated angle (°), one a sample.
    ///
    /// # Errors
    ///
    /// Says why the board cannot step the model, or cannot follow the pressure.
    pub fn simulate(
        &self,
        model: &Model<f64>,
        arithmetic: Arithmetic,
    ) -> Result<Vec<f64>, InputError> {
        let data = Dataset::of(std::slice::from_ref(&self.recording));
        let session = &data.sessions()[0];
        let nuisance = if self.is_measured {
            // Zeros and start with which the model comes nearest to the recording.
            let fitter = Fitter::new(model, &data);
            fitter.compare(model).nuisances[0]
        } else {
            Nuisance {
                start: InitialState {
                    angle: model.reading(&model.at_rest(0.0, 0.0)),
                    rate: 0.0,
                },
                ..Nuisance::AT_ZERO
            }
        };
        let simulated = match arithmetic {
            Arithmetic::F64 => session.simulate(model, &nuisance),
            Arithmetic::Board => on_board(session, model, &nuisance)?,
            Arithmetic::Minimax => in_single::<Minimax>(session, model, &nuisance),
            Arithmetic::Micromath => in_single::<GuardedMicromath>(session, model, &nuisance),
        };
        Ok(simulated.iter().map(|angle| angle.to_degrees()).collect())
    }
}

impl Drive {
    /// The simulated angle (°) over a test recording, of which nothing but the start is used; with
    /// the zeros that the file of a verdict gives, or none.
    ///
    /// # Errors
    ///
    /// Says what is wrong with the file of zeros, or that the recording is too short.
    pub fn simulate_from(
        &self,
        model: &Model<f64>,
        start: StartFrom,
        zeros: Option<&Path>,
    ) -> Result<Vec<f64>, InputError> {
        start.check(&self.recording)?;
        let zeros = match zeros {
            Some(path) => {
                let zeros = read_zeros(path)?;
                Nuisance {
                    pressure_zero: zeros.pressure_kpa * PASCAL_PER_KPA,
                    angle_zero: zeros.angle_deg.to_radians(),
                    ..Nuisance::AT_ZERO
                }
            }
            None => Nuisance::AT_ZERO,
        };
        let data = Dataset::of(std::slice::from_ref(&self.recording));
        let simulated = simulate_from(model, &data.sessions()[0], &zeros, start);
        Ok(simulated.iter().map(|angle| angle.to_degrees()).collect())
    }
}

/// The angle (rad) at which the plain model rests under `pressure` (Pa).
fn steady_angle(model: &Model<f64>, pressure: f64) -> f64 {
    let d = model.dynamics();
    let angle = libm::pow(
        d.input_gain.abs() * pressure / d.stiffness,
        1.0 / d.exponent,
    );
    if angle.is_finite() { angle } else { 0.0 }
}

/// What the board predicts.
fn on_board(
    session: &Session,
    model: &Model<f64>,
    nuisance: &Nuisance,
) -> Result<Vec<f64>, InputError> {
    let refuse = |why: String| InputError::new(why, "simulate it in f64");
    let farthest = board::farthest(session.largest_angle());
    let model = &session.placed(model);
    board::plan(model, farthest).map_err(refuse)?;
    let board = OnBoard::new(model, farthest).map_err(|why| refuse(format!("the model {why}")))?;
    session
        .predict(&board, nuisance)
        .map_err(|why| refuse(why.to_string()))
}

/// Runge–Kutta steps in single precision, with a power function of any exponent.
#[allow(clippy::cast_possible_truncation)]
fn in_single<P: Power<f32>>(
    session: &Session,
    model: &Model<f64>,
    nuisance: &Nuisance,
) -> Vec<f64> {
    let single: Model<f32, P> = model.map(|value| value as f32);
    session.simulate_in(&single, nuisance)
}
