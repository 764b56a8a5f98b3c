//! The pressure loop, with a syringe pump.
//!
//! The pump is an integrator: a flow changes the volume, and the gas law gives the pressure. At
//! 100 kPa the same flow changes it four times as fast as at rest; the loop compensates that, so
//! it is as fast at 100 kPa as at rest.
//!
//! With an integrating plant, proportional control alone has no steady-state error for steps; the
//! integral is for ramps, leaks and creep.

use super::{
    ATMOSPHERE_PA,
    limit::{size, within},
};

use crate::sight::DELAY_UL;

use crate::design::{OUT_OF_REACH_PA, OUT_OF_REACH_PERIODS, PERIOD_S};

/// Gains and limits of the pressure loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Proportional gain kp at rest (µl/s per Pa).
    pub proportional: f32,
    /// Integral gain ki (µl/s² per Pa).
    pub integral: f32,
    /// Fastest flow (µl/s).
    pub max_flow: f32,
    /// Fastest change of the flow (µl/s²), kept by the pump's driver.
    pub max_acceleration: f32,
    /// Largest displaced volume (µl).
    pub max_volume: f32,
    /// Volume (µl) beyond which the pressure would be above its limit, whatever the sensor shows.
    pub most: f32,
}

/// Error (Pa) within which the pump rests at a constant set-point. A chattering motor
/// only heats and shakes the rig; but near 10° a degree is only 130 Pa.
pub const DEADBAND_PA: f32 = 60.0;

/// Error (Pa) beyond which it starts again. The noise of a smoothed reading, a small part
/// of the sensor's 673 Pa per count, does not reach it.
pub const RESTART_PA: f32 = 250.0;

/// Error (Pa) within which the integral runs: beyond it the pump is on its way.
const INTEGRAL_ZONE_PA: f32 = 6_000.0;

/// Weight of a new error in the smoothed one: 0.1 s.
const SMOOTHING: f32 = 0.1;

/// Limit (Pa) of the smoothed error, so that an invalid reading has no lasting effect.
const FAR_PA: f32 = 20_000.0;

/// Largest share of the way left that is made in a second (1/s): a quarter in a control
/// period, of the half at which a plunger that is seen two periods late begins to hunt.
const FASTEST_APPROACH: f32 = 0.25 / PERIOD_S;

/// Share of the fastest flow below which the stroke is at its end.
const AT_END: f32 = 0.01;

/// Periods of a constant set-point after which the pump may rest.
const STILL_PERIODS: u8 = 10;

/// The pressure loop's memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Loop {
    /// Flow (µl/s) of the integral.
    integral: f32,
    setpoint: f32,
    still: u8,
    /// Error (Pa), smoothed, so that a single noisy reading does not decide about rest.
    smooth: f32,
    resting: bool,
    /// Periods at the end of the stroke, far from the set-point.
    at_end: u8,
}

impl Loop {
    /// Whether the pump has been at an end of its stroke for a second, far from the
    /// set-point.
    pub fn is_out_of_reach(&self) -> bool {
        self.at_end >= OUT_OF_REACH_PERIODS
    }

    /// Whether the pump rests at the set-point.
    pub fn is_resting(&self) -> bool {
        self.resting
    }

    /// Returns the flow (µl/s, positive compresses) for set-point and measured
    /// pressure (Pa) at a displaced volume (µl), and lets `dt` seconds pass.
    ///
    /// With V the volume (µl) of the enclosed air at atmospheric pressure p₀, v the displaced volume
    /// and e the error:
    ///
    /// ```text
    /// p = p₀ (V/(V − v) − 1)        dp/dv = (p₀ + p)²/(p₀ V): 2 kPa/ml at rest for
    ///                               50 ml, 8 kPa/ml at 100 kPa
    /// flow = kp (p₀/(p₀ + p))² e + I,  dI/dt = ki e   while nothing saturates
    /// ```
    ///
    /// The factor compensates the gas law. The integral only runs near the set-point and without
    /// saturation, so it cannot wind up, and it is reset when the pump rests. Volumes are in µl: one
    /// microstep is a fraction of one.
    pub fn step(
        &mut self,
        config: &Config,
        setpoint: f32,
        measured: f32,
        volume: f32,
        dt: f32,
    ) -> f32 {
        #[allow(clippy::float_cmp)] // A set-point that stands still is the same.
        let same = setpoint == self.setpoint;
        self.setpoint = setpoint;
        self.still = if same {
            self.still.saturating_add(1)
        } else {
            0
        };

        let error = setpoint - measured;
        self.smooth = within(
            self.smooth + (error - self.smooth) * SMOOTHING,
            -FAR_PA,
            FAR_PA,
        );
        let gap = size(self.smooth);
        let band = if self.resting {
            RESTART_PA
        } else {
            DEADBAND_PA
        };
        self.resting = self.still >= STILL_PERIODS && gap < band;
        if self.resting {
            self.integral = 0.0;
            self.at_end = 0;
            return 0.0;
        }

        let left = ATMOSPHERE_PA / (ATMOSPHERE_PA + measured.max(0.0));
        let wanted = config.proportional * (left * left * error) + self.integral;
        let flow = config.attainable(wanted, volume);
        #[allow(clippy::float_cmp)] // Unchanged unless a limit acted.
        let saturated = flow != wanted;
        self.at_end = if saturated
            && size(flow) < AT_END * config.max_flow
            && size(error) > OUT_OF_REACH_PA
        {
            self.at_end.saturating_add(1)
        } else {
            0
        };
        if !saturated && size(error) < INTEGRAL_ZONE_PA {
            let next = self.integral + config.integral * error * dt;
            self.integral = within(next, -config.max_flow, config.max_flow);
        } else if error * self.integral < 0.0 {
            // After an overshoot an integral of the opposite sign is of no use.
            self.integral = 0.0;
        }
        flow
    }
}

impl Config {
    /// The attainable flow (µl/s) nearest to `wanted` from which the pump can stop before
    /// the ends of its stroke.
    ///
    /// With a flow of at most k times the way left, the deceleration is k times
    /// the flow; k = acceleration/flow at full speed keeps it within the limit.
    pub fn attainable(&self, wanted: f32, volume: f32) -> f32 {
        let per_volume = self.per_volume();
        // A sensor that is late shows what was pushed only after a while. So the pump comes to that volume
        // as slowly as the latest sensor that is armed, which is one of so many µl.
        let slowing = self.max_flow * (1.0 / DELAY_UL);
        let up = (self.max_volume - volume) * per_volume;
        let up = within(up.min((self.most - volume) * slowing), 0.0, self.max_flow);
        let down = within(volume * per_volume, 0.0, self.max_flow);
        within(wanted, -down, up)
    }

    /// k above (1/s). A slow pump with a fast ramp would have a k that corrects a gap within a
    /// period. But what a plan does is seen two periods later, and the plunger would hunt about its
    /// place for ever.
    fn per_volume(&self) -> f32 {
        (self.max_acceleration / self.max_flow).min(FASTEST_APPROACH)
    }

    /// The flow (µl/s) that takes the plunger over the `gap` (µl) that is left
    /// and arrives there at rest.
    pub fn approach(&self, gap: f32) -> f32 {
        let flow = gap * self.per_volume();
        within(flow, -self.max_flow, self.max_flow)
    }
}
