//! The angle loop around the pressure loop: internal model control.
//!
//! The board predicts the angle θ̂ from the measured pressure anyway. Where the actuator
//! does what its model does, θ̂ and its rate are all there is to know about its motion,
//! without a sensor's noise and lag, and the pressure that moves it as wanted follows
//! from the equation of motion:
//!
//! ```text
//! a = ω² (θ_model − θ̂) − 2ω θ̂̇              critically damped towards θ_model
//! p = p_model(θ̂) + (M a + C θ̂̇)/g
//! ```
//!
//! So the loop is as fast at 10°, where silicone is soft and late, as at 90°, where it is
//! stiff and rings. Where the pump is too slow, the prediction is too: it is driven by the
//! pressure that is there, not by the one that was asked for, and nothing winds up.
//!
//! What the sensor adds is how far the model is off. By Ludwick's law a wrong stiffness
//! scales the angle, so the error is taken as a share s of the angle, and the model is
//! asked for an angle at which the actuator is where it should be:
//!
//! ```text
//! s = (θ − θ̂)/max(|θ̂|, 10°)      through (1 + lead·d/dt)/(1 + smoothing·d/dt)
//! θ_model = θ_set/(1 + s)
//! ```
//!
//! With an exact model s is zero and there is no feedback to oscillate. The share is
//! limited, so that a sensor that shows nothing cannot ask for more than the pressure of
//! twice the angle; and where sensor and prediction stay that far apart, the rig stops.

use crate::{
    design::{PARTED_PERIODS, PARTED_RAD, PERIOD_S},
    sensing::filter::LowPass,
};

use super::{
    RAD_PER_DEG,
    limit::{size, within},
};

/// Gains of the angle loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Bandwidth ω (rad/s); without one the actuator moves as it does by itself.
    pub bandwidth: f32,
    /// Smoothing of the model's error (s).
    pub smoothing: f32,
    /// Lead of the model's error (s).
    pub lead: f32,
}

/// What the model says of the present.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Angle (rad) that the sensor should show.
    pub reading: f32,
    /// Angle (rad) of the actuator.
    pub angle: f32,
    /// Its rate (rad/s).
    pub rate: f32,
}

/// Below this angle (rad), 10°, an error is taken as it is and not as a share.
const FLOOR_RAD: f32 = 10.0 * RAD_PER_DEG;

/// The share of the angle that the model may be off: an actuator that bends half as far,
/// or twice as far, as it should. A stiffness that is 30 % off is −0.14 or 0.23 of it for
/// the shipped exponent.
const SHARES: (f32, f32) = (-0.5, 1.0);

/// Within this (rad), 0.15°, of an angle that stands still the pressure is kept as it is.
const REST_RAD: f32 = 0.15 * RAD_PER_DEG;

/// Beyond this (rad), 0.35°, it is moved again: seven times the noise of a smoothed reading.
const RESTART_RAD: f32 = 0.35 * RAD_PER_DEG;

/// The rate (rad/s), 1 °/s, below which the model stands still.
const STILL_RAD_PER_S: f32 = RAD_PER_DEG;

/// What the loop asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wish {
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
    /// What the model expects, as late as the sensor's smoothed reading; none at the start.
    expected: Option<LowPass>,
    /// Share that the model is off, smoothed.
    share: f32,
    setpoint: f32,
    resting: bool,
    parted: u8,
}

impl Loop {
    /// Whether sensor and prediction have been apart for too long.
    pub fn has_parted(&self) -> bool {
        self.parted >= PARTED_PERIODS
    }

    /// Lets one control period pass in which there is nothing to say what the model expects.
    pub fn without_model(&mut self) {
        self.parted = self.parted.saturating_add(1);
    }

    /// Lets one control period pass, for set-point and smoothed reading (rad). `pushes` is
    /// whether the pressure that is asked for could do harm.
    pub fn step(
        &mut self,
        config: &Config,
        setpoint: f32,
        measured: f32,
        model: &Expected,
        pushes: bool,
    ) -> Wish {
        let expected = self
            .expected
            .get_or_insert(LowPass::settled(model.reading))
            .update(model.reading);
        let gap = measured - expected;
        let (seen, believed) = (size(measured), size(expected));
        let is_half = 2.0 * seen < believed || 2.0 * believed < seen || measured * expected < 0.0;
        self.parted = if pushes && is_half && size(gap) > PARTED_RAD {
            self.parted.saturating_add(1)
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
            return Wish::Keep;
        }
        let bandwidth = config.bandwidth;
        if bandwidth <= 0.0 {
            return Wish::Hold(target);
        }
        let pull = bandwidth * (target - model.reading) - 2.0 * model.rate;
        Wish::Accelerate(bandwidth * pull)
    }
}
