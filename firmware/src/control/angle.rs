//! The angle loop around the pressure loop: internal model control.
//!
//! The board predicts the angle from the measured pressure. With an exact model the prediction is
//! the state of the actuator, without the noise and lag of a sensor, so the loop is as fast at
//! 10°, where silicone is soft and slow, as at 90°, where it is stiff and rings. A slow pump
//! causes no windup, since the prediction is driven by the measured pressure, not by the
//! commanded one.
//!
//! The sensor only gives the model error. With an exact model that is zero, and no feedback can
//! oscillate.

use model_core::predictor::{Prediction, Predictor};

use crate::{
    design::{DISAGREEMENT_PERIODS, DISAGREEMENT_RAD, PERIOD_S},
    sensing::filter::LowPass,
    units::RAD_PER_DEG,
};

use super::limit::{size, within};

/// Gains of the angle loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Bandwidth ω (rad/s); if zero, the prediction is not controlled.
    pub bandwidth: f32,
    /// Smoothing of the model's error (s).
    pub smoothing: f32,
    /// Lead of the model's error (s).
    pub lead: f32,
}

/// The predicted state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Angle (rad) that the sensor should show.
    pub reading: f32,
    /// Angle (rad) of the actuator.
    pub angle: f32,
    /// Its rate (rad/s).
    pub rate: f32,
}

impl Expected {
    /// By the model; none after it diverged.
    pub fn of(predictor: &Predictor, prediction: &Prediction) -> Option<Self> {
        let expected = Self {
            reading: prediction.reading(),
            angle: prediction.angle(),
            rate: predictor.rate(prediction),
        };
        (expected.reading.is_finite() && expected.angle.is_finite() && expected.rate.is_finite())
            .then_some(expected)
    }
}

/// Angle (rad), 10°, below which an error counts relative to this angle.
const FLOOR_RAD: f32 = 10.0 * RAD_PER_DEG;

/// Limits of the relative model error: an actuator that bends half as far, or twice as far,
/// as predicted. A stiffness error of 30 % gives −0.14 or 0.23 for the shipped exponent.
const SHARES: (f32, f32) = (-0.5, 1.0);

/// Error (rad), 0.15°, at a constant angle, below which the pressure is held.
const REST_RAD: f32 = 0.15 * RAD_PER_DEG;

/// Error (rad), 0.35°, above which it changes again: seven times the noise of a smoothed
/// reading.
const RESTART_RAD: f32 = 0.35 * RAD_PER_DEG;

/// Rate (rad/s), 1 °/s, below which the model is at standstill.
const STILL_RAD_PER_S: f32 = RAD_PER_DEG;

/// The output of the loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Output {
    /// The pressure as it is.
    Keep,
    /// An angular acceleration (rad/s²).
    Accelerate(f32),
    /// An angle (rad), by the model's static inverse.
    Hold(f32),
}

/// The angle loop's memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Loop {
    /// The prediction, delayed like the sensor's smoothed reading; none at the start.
    expected: Option<LowPass>,
    /// Relative model error, smoothed.
    share: f32,
    setpoint: f32,
    resting: bool,
    disagreement: u8,
}

impl Loop {
    /// Whether sensor and prediction have disagreed for too long.
    pub fn disagrees(&self) -> bool {
        self.disagreement >= DISAGREEMENT_PERIODS
    }

    /// Lets one control period pass without a prediction.
    pub fn without_model(&mut self) {
        self.disagreement = self.disagreement.saturating_add(1);
    }

    /// Lets one control period pass, for set-point and smoothed reading (rad). `pushes` says
    /// whether the commanded pressure could do harm.
    ///
    /// With θ̂ the predicted angle, ω the bandwidth and z all memories of the model:
    ///
    /// ```text
    /// a = ω² (θ_model − θ̂) − 2ω θ̂̇              critically damped towards θ_model
    /// p = p(θ̂, θ̂̇, z, a)                        what accelerates by a, with all memories z
    /// ```
    ///
    /// By Ludwick's law a wrong stiffness scales the angle, so the model error is a relative error s,
    /// and the reference of the model is corrected by it:
    ///
    /// ```text
    /// s = (θ − θ̂)/max(|θ̂|, 10°)      through (1 + lead·d/dt)/(1 + smoothing·d/dt)
    /// θ_model = θ_set/(1 + s)
    /// ```
    ///
    /// s is limited, so that a dead sensor cannot command more than the pressure of twice the angle.
    /// If sensor and prediction stay that far apart, the rig stops ([`Loop::disagrees`]).
    pub fn step(
        &mut self,
        config: &Config,
        setpoint: f32,
        measured: f32,
        model: &Expected,
        pushes: bool,
    ) -> Output {
        let expected = self
            .expected
            .get_or_insert(LowPass::settled(model.reading))
            .update(model.reading);
        let gap = measured - expected;
        let (seen, believed) = (size(measured), size(expected));
        let is_half = 2.0 * seen < believed || 2.0 * believed < seen || measured * expected < 0.0;
        self.disagreement = if pushes && is_half && size(gap) > DISAGREEMENT_RAD {
            self.disagreement.saturating_add(1)
        } else {
            0
        };

        let (least, most) = SHARES;
        let now = gap / size(expected).max(FLOOR_RAD);
        let change = (within(now, least, most) - self.share) / (config.smoothing + PERIOD_S);
        self.share += change * PERIOD_S;
        let share = within(self.share + config.lead * change, least, most);
        let scaled = setpoint / (1.0 + share);
        let target = if scaled > FLOOR_RAD {
            scaled
        } else {
            setpoint - share * FLOOR_RAD
        };

        let error = size(setpoint - measured);
        let band = if self.resting { RESTART_RAD } else { REST_RAD };
        #[allow(clippy::float_cmp)] // A set-point that stands still is the same.
        let same = setpoint == self.setpoint;
        self.setpoint = setpoint;
        self.resting = same && error < band && size(model.rate) < STILL_RAD_PER_S;
        if self.resting {
            return Output::Keep;
        }
        let bandwidth = config.bandwidth;
        if bandwidth <= 0.0 {
            return Output::Hold(target);
        }
        let pull = bandwidth * (target - model.reading) - 2.0 * model.rate;
        Output::Accelerate(bandwidth * pull)
    }
}
