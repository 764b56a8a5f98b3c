//! The interface between control logic and hardware.
//!
//! The board layer fills [`Inputs`] and applies [`Outputs`] once per control period;
//! everything in between is plain functions that a desktop can test.

pub use wire::history::ResetCause;

use crate::design::OVERSAMPLING;

/// A sensor's reading: the sum of [`OVERSAMPLING`] conversions of ten bits, or
/// [`Self::NOT_MEASURED`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Oversampled(pub u16);

impl Oversampled {
    /// A control period that lacked a conversion, since interrupts were off: no sum of
    /// conversions is as large.
    pub const NOT_MEASURED: Self = Self(u16::MAX);

    /// Whether this is a reading.
    pub fn is_measured(self) -> bool {
        self != Self::NOT_MEASURED
    }

    /// The mean in counts of a ten-bit converter, with fractions.
    pub fn counts(self) -> f32 {
        f32::from(self.0) / f32::from(OVERSAMPLING)
    }
}

/// The rig at the start of a control period.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Inputs {
    /// Time since reset (ms), a multiple of the control period.
    pub time_ms: u32,
    /// Pressure sensor.
    pub pressure: Oversampled,
    /// Flex sensor.
    pub flex: Oversampled,
    /// The processor's reference of 1.1 V, by the supply: the sensors' reference. Measured once a
    /// second at rest.
    pub supply: Oversampled,
    /// The plunger is at the retracted end switch, or its wire is broken.
    pub retracted_end: bool,
    /// The plunger is at the pushed-in end switch, or its wire is broken.
    pub pushed_end: bool,
    /// The emergency-stop circuit is open.
    pub emergency_stop: bool,
    /// Microsteps made since the position was last set; positive compresses.
    pub steps: i32,
    /// Control periods that began late since the last one.
    pub overruns: u8,
}

/// The command to the pump's driver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Pump {
    /// Driver off: the motor is free.
    #[default]
    Off,
    /// Driver on, move at this rate (microsteps/s, positive compresses); the
    /// board layer limits its change to the acceleration of the settings.
    Rate(f32),
    /// Driver on, stop at once, without a ramp.
    Brake,
}

/// The vent valve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Valve {
    /// The air goes out. The state without power.
    #[default]
    Open,
    /// The air stays.
    Closed,
}

/// The outputs for the next control period.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outputs {
    /// The pump.
    pub pump: Pump,
    /// The valve.
    pub valve: Valve,
    /// Declares the present position of the plunger to be this (microsteps).
    pub set_steps: Option<i32>,
    /// The on-board light.
    pub light: bool,
}
