//! The angle loop around the pressure loop.
//!
//! ```text
//! θᵣ = θ_set + kp e + I − kd θ̇      e = θ_set − θ,  dI/dt = ki e
//! p  = p_model(θᵣ)
//! ```
//!
//! The model's inverse gives the pressure that should hold an angle; the feedback
//! pays for what the model does not know. It corrects the *angle* that is asked
//! of the model, not the pressure: by the model's law a degree costs 0.1 kPa at
//! 10° and 2.6 kPa at 90°, and this way one set of gains serves both.
//!
//! The derivative acts on the measured angle, so that a step of the set-point is
//! no kick. The integral rests while the pump or a limit keeps the pressure from
//! following, and while the error is going away by itself: silicone is late, and
//! what is only late must not be added up.

use super::limit::{size, within};

/// Gains and limit of the angle loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Proportional gain kp (rad/rad).
    pub proportional: f32,
    /// Integral gain ki (1/s).
    pub integral: f32,
    /// Derivative gain kd (s).
    pub derivative: f32,
    /// Largest correction by the integral (rad).
    pub max_correction: f32,
}

/// Time constant (s) of the smoothing in the derivative: a flex sensor's noise
/// of 0.1° from one period to the next would otherwise be 10 °/s.
const DERIVATIVE_TIME_S: f32 = 0.05;

/// An error that vanishes within this time (s), at the rate at hand, is left to
/// itself.
const PATIENCE_S: f32 = 1.0;

/// Whether the pressure can follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Room {
    /// More pressure can be had.
    pub up: bool,
    /// Less pressure can be had.
    pub down: bool,
}

/// The angle loop's memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Loop {
    /// Angle (rad) that the integral adds.
    integral: f32,
    /// Measured angle and set-point before (rad); none at the start.
    before: Option<(f32, f32)>,
    /// Smoothed rate (rad/s).
    rate: f32,
}

impl Loop {
    /// Returns the angle (rad) to ask of the model for set-point and measured
    /// angle (rad), and lets `dt` seconds pass.
    pub fn step(
        &mut self,
        config: &Config,
        setpoint: f32,
        measured: f32,
        room: Room,
        dt: f32,
    ) -> f32 {
        let error = setpoint - measured;
        let (change, moved) = self.before.map_or((0.0, 0.0), |(was, wanted)| {
            (measured - was, setpoint - wanted)
        });
        self.before = Some((measured, setpoint));
        self.rate += (change - self.rate * dt) / (DERIVATIVE_TIME_S + dt);

        // How fast the error shrinks (rad/s).
        let closing = if error > 0.0 { self.rate } else { -self.rate };
        let leaves = moved == 0.0 && closing * PATIENCE_S > size(error);
        let can = if error > 0.0 { room.up } else { room.down };
        if can && !leaves {
            let next = self.integral + config.integral * error * dt;
            self.integral = within(next, -config.max_correction, config.max_correction);
        }
        setpoint + config.proportional * error + self.integral - config.derivative * self.rate
    }
}
