//! The angle loop around the pressure loop.
//!
//! ```text
//! p = p_model(θ_set) + kp e + I − kd θ̇      e = θ_set − θ,  dI/dt = ki e
//! ```
//!
//! The model's inverse gives the pressure that should hold the angle; the
//! feedback pays for what the model does not know. The derivative acts on the
//! measured angle, so that a step of the set-point is no kick. The integral
//! rests while the pump or a limit keeps the pressure from following.

use super::limit::within;

/// Gains and limit of the angle loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Proportional gain kp (Pa/rad).
    pub proportional: f32,
    /// Integral gain ki (Pa/s per rad).
    pub integral: f32,
    /// Derivative gain kd (Pa s/rad).
    pub derivative: f32,
    /// Largest pressure (Pa) that may be asked for.
    pub max_pressure: f32,
}

/// Time constant (s) of the smoothing in the derivative: a flex sensor's noise
/// of 0.1° from one period to the next would otherwise be 10 °/s.
const DERIVATIVE_TIME_S: f32 = 0.05;

/// The angle loop's memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Loop {
    /// Pressure (Pa) that the integral asks for.
    integral: f32,
    /// The angle before (rad); none at the start.
    before: Option<f32>,
    /// Smoothed rate (rad/s).
    rate: f32,
}

impl Loop {
    /// Returns the pressure (Pa) for set-point and measured angle (rad), given
    /// the model's holding pressure (Pa), and lets `dt` seconds pass.
    /// `follows` says whether the pressure follows what is asked for.
    pub fn step(
        &mut self,
        config: &Config,
        (setpoint, holding): (f32, f32),
        measured: f32,
        follows: bool,
        dt: f32,
    ) -> f32 {
        let error = setpoint - measured;
        let change = self.before.map_or(0.0, |before| measured - before);
        self.before = Some(measured);
        self.rate += (change - self.rate * dt) / (DERIVATIVE_TIME_S + dt);

        let wanted =
            holding + config.proportional * error + self.integral - config.derivative * self.rate;
        let pressure = within(wanted, 0.0, config.max_pressure);
        #[allow(clippy::float_cmp)] // Unchanged unless a limit acted.
        let free = follows && pressure == wanted;
        if free {
            let next = self.integral + config.integral * error * dt;
            self.integral = within(next, -config.max_pressure, config.max_pressure);
        }
        pressure
    }
}
