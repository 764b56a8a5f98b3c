//! The controller: from set-points to the flow of the pump.
//!
//! It is a cascade with the pressure loop inside. A pressure set-point goes directly to
//! the pressure loop. An angle goes through the model's inverse, in closed loop after the
//! angle loop. Every path ends with the limited pressure set-point.

pub mod angle;
pub mod limit;
pub mod pressure;

use model_core::{
    actuator::Model,
    power::Power,
    predictor::{Prediction, Predictor},
};
use wire::{
    fault::Fault,
    protocol::ControlMode,
    settings::{Key, Settings},
};

use limit::{Range, Setpoint};

use crate::design::{LARGEST_AT_REST_PA, PERIOD_S};
use crate::units::{KPA_PER_PA, PA_PER_KPA, RAD_PER_DEG};

/// Pressure (Pa) of the air around.
pub const ATMOSPHERE_PA: f32 = 101_325.0;

/// Largest product of bandwidth and dead time (rad) with which the angle loop controls the
/// prediction: a phase of 57° at its corner.
const CALM: f32 = 1.0;

/// Everything that the loops need from the settings, in Pa, rad and µl.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// The pressure loop.
    pub pressure: pressure::Config,
    /// The angle loop.
    pub angle: angle::Config,
    /// Range and speed of pressure set-points.
    pub pressure_range: Range,
    /// Range and speed of angle set-points.
    pub angle_range: Range,
}

impl Config {
    /// The same configuration for a model with a dead time (s), by which the prediction is
    /// late. If the loop is not slow compared with it, it does not control the prediction: it
    /// sets the pressure that holds the corrected angle, and waits.
    pub fn with_delay(mut self, delay_s: f32) -> Self {
        if self.angle.bandwidth * delay_s > CALM {
            self.angle.bandwidth = 0.0;
        }
        self
    }

    /// Reads the settings, for a pump that may displace so much (µl) at most, and by the air behind it only
    /// that `most`. It is cheap enough to be done every period, which saves the RAM of a copy.
    pub fn of(settings: &Settings, max_volume: f32, most: f32) -> Self {
        let number = |key| settings.number(key);
        let highest = number(Key::SetpointMaxPressure) * PA_PER_KPA;
        let farthest = number(Key::SetpointMax) * RAD_PER_DEG;
        Self {
            pressure: pressure::Config {
                proportional: number(Key::PressureGain) * KPA_PER_PA,
                integral: number(Key::PressureIntegral) * KPA_PER_PA,
                max_flow: number(Key::MaxFlow),
                max_acceleration: number(Key::MaxFlowRate),
                max_volume,
                most,
            },
            angle: angle::Config {
                bandwidth: number(Key::AngleBandwidth),
                smoothing: number(Key::AngleSmoothing),
                lead: number(Key::AngleLead),
            },
            pressure_range: Range {
                highest,
                rate: number(Key::SetpointPressureRate) * PA_PER_KPA,
            },
            angle_range: Range {
                highest: farthest,
                rate: number(Key::SetpointRate) * RAD_PER_DEG,
            },
        }
    }
}

/// The measurements at the start of a period.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measured<'a> {
    /// Gauge pressure (Pa).
    pub pressure: f32,
    /// Bending angle (rad), filtered.
    pub angle: f32,
    /// Displaced volume (µl).
    pub volume: f32,
    /// Where the actuator is by the model; none without a prediction.
    pub prediction: Option<&'a Prediction>,
}

/// The memory of all loops.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Controller {
    /// The control mode of the period before.
    mode: Option<ControlMode>,
    angle_setpoint: Setpoint,
    pressure_setpoint: Setpoint,
    angle_loop: angle::Loop,
    pressure_loop: pressure::Loop,
    /// The angle (rad) of the cached holding pressure (Pa).
    holding: Option<(f32, f32)>,
    /// Whether the holding pressure was computed in the period before.
    fresh: bool,
}

impl Controller {
    /// Starts from rest: valve open, no pressure.
    pub fn new() -> Self {
        Self::default()
    }

    /// The set-point (rad) of the angle.
    pub fn angle_setpoint(&self) -> f32 {
        self.angle_setpoint.value()
    }

    /// The set-point (Pa) of the pressure.
    pub fn pressure_setpoint(&self) -> f32 {
        self.pressure_setpoint.value()
    }

    /// A fault that the loops found.
    pub fn fault(&self) -> Option<Fault> {
        if self.pressure_loop.is_out_of_reach() {
            Some(Fault::Reach)
        } else if self.angle_loop.disagrees() {
            Some(Fault::Disagreement)
        } else {
            None
        }
    }

    /// Returns the flow (µl/s, positive compresses) that brings the rig to a
    /// level (kPa or °), and lets one control period pass.
    pub fn track(
        &mut self,
        config: &Config,
        predictor: &Predictor,
        (mode, level): (ControlMode, f32),
        measured: &Measured,
    ) -> f32 {
        let before = self.mode.replace(mode);
        let pushes = self.pressure_setpoint.value() > LARGEST_AT_REST_PA;
        let target = if mode == ControlMode::Pressure {
            level * PA_PER_KPA
        } else {
            if matches!(before, None | Some(ControlMode::Pressure)) {
                self.angle_setpoint
                    .restart(&config.angle_range, measured.angle);
            }
            if before != Some(mode) {
                self.angle_loop = angle::Loop::default();
            }
            let angle =
                self.angle_setpoint
                    .step(&config.angle_range, level * RAD_PER_DEG, PERIOD_S);
            let model = predictor.model();
            let expected = measured
                .prediction
                .and_then(|prediction| angle::Expected::of(predictor, prediction));
            match (measured.prediction, &expected) {
                (Some(prediction), Some(expected)) if mode == ControlMode::AngleClosedLoop => {
                    let output = self.angle_loop.step(
                        &config.angle,
                        angle,
                        measured.angle,
                        expected,
                        pushes,
                    );
                    match output {
                        angle::Output::Keep => self.pressure_setpoint.value(),
                        angle::Output::Hold(angle) => self.holding_pressure(model, angle),
                        angle::Output::Accelerate(rate) => predictor.pressure_for(prediction, rate),
                    }
                }
                _ => {
                    if mode == ControlMode::AngleClosedLoop {
                        self.angle_loop.without_model();
                    }
                    self.holding_pressure(model, angle)
                }
            }
        };
        let pressure = self
            .pressure_setpoint
            .step(&config.pressure_range, target, PERIOD_S);
        self.pressure_loop.step(
            &config.pressure,
            pressure,
            measured.pressure,
            measured.volume,
            PERIOD_S,
        )
    }

    /// The pressure (Pa) that holds an angle (rad) by the model.
    ///
    /// It costs a quarter of a model step, so it is only computed for a new
    /// angle, and while the angle moves every second period.
    fn holding_pressure<P: Power<f32>>(&mut self, model: &Model<f32, P>, angle: f32) -> f32 {
        if let Some((at, pressure)) = self.holding {
            #[allow(clippy::float_cmp)] // The same number has the same pressure.
            if at == angle || self.fresh {
                self.fresh = false;
                return pressure;
            }
        }
        let pressure = model.holding_pressure(angle);
        self.holding = Some((angle, pressure));
        self.fresh = true;
        pressure
    }
}

#[cfg(test)]
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::float_cmp
)]
mod tests;
