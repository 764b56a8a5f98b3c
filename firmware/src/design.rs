//! What the design of the rig fixes, in one place: time, and where a limit of safety or of the
//! mechanics was chosen. Each with its unit and its reason.
//!
//! What can differ between rigs is a [setting](wire::settings); what an algorithm needs for
//! itself stands where the algorithm does. What these figures lead to, measured in the
//! simulator, is in `docs/safety.md`.

use crate::control::RAD_PER_DEG;

// ---- Time ----

/// Cycles of the processor and of the pulse timer in a second: the crystal of an Arduino Mega.
pub const CPU_HZ: u32 = 16_000_000;

/// Control periods a second, each with a line of telemetry: 60 % of what the cable carries.
pub const CONTROL_HZ: u16 = 100;

/// Length of a control period (s).
pub const PERIOD_S: f32 = 0.01;

/// Length of a control period (ms): a line of telemetry each.
pub const PERIOD_MS: u16 = 1000 / CONTROL_HZ;
const _: () = assert!(PERIOD_MS == wire::telemetry::PERIOD_MS);

pub use wire::answer::OVERSAMPLING;

// ---- Sensors: rest and tare ----

/// Farthest from the calibration that a tare may move the pressure's zero (Pa).
pub const LARGEST_PRESSURE_TARE_PA: f32 = 5_000.0;

/// Farthest that a tare may move the angle's zero (rad): 30°. More is another
/// sensor than the one that was calibrated.
pub const LARGEST_ANGLE_TARE_RAD: f32 = core::f32::consts::FRAC_PI_6;

/// Spread (Pa) of the smoothed pressure over a second below which it rests.
pub const PRESSURE_REST_PA: f32 = 1_000.0;

/// Spread (rad) of the smoothed angle over a second below which it rests: 2°,
/// the extremes of a hundred samples of the noisiest flex sensors (0.6° rms
/// before the filter).
pub const ANGLE_REST_RAD: f32 = 0.035;

// ---- What arming and venting ask for ----

/// Farthest from zero that the pressure may read (Pa) when the rig is armed: a sensor
/// that is 10 kPa off lets the pressure rise that far above its limit.
pub const LARGEST_AT_REST_PA: f32 = 5_000.0;

/// Periods in which an open valve has to let the air out: 3 s, ten times what a tube of a
/// metre takes.
pub const LONGEST_VENTING_PERIODS: u16 = 300;

/// Periods for which it then has to be there all the same: half a second. One mixed reading
/// of a wire that breaks or shorts can be anything up to 600 kPa, is bridged for 50 ms, and
/// takes 0.12 s more to leave the smoothed pressure.
pub const STILL_PRESSURISED_PERIODS: u16 = 50;

/// Periods for which a plunger has to be back at its start position before the valve closes: the
/// last air goes out in 0.2 s.
pub const VENTING_PERIODS: u8 = 20;

// ---- Commanded against observed ----

/// Sensor and prediction part if they are farther apart than this (rad), 15°, one of them
/// shows less than half of the other, and there is pressure behind it: what is left of an
/// angle when the air is out is friction and creep.
pub const PARTED_RAD: f32 = 15.0 * RAD_PER_DEG;

/// Periods after which they have: longer than the longest dead time.
pub const PARTED_PERIODS: u8 = 100;

/// Farther (Pa) than this from the set-point at the end of the stroke, the pump
/// does not get there: a leak, or more air than the syringe can compress.
pub const OUT_OF_REACH_PA: f32 = 5_000.0;

/// Periods at the end of the stroke after which it has not got there.
pub const OUT_OF_REACH_PERIODS: u8 = 100;

/// Looking for the retracted switch.
pub mod homing {
    /// Where a plunger at its start position stands (µl); less for a small pump.
    pub const START_UL: f32 = 500.0;

    /// Share of the largest volume that the start position may take.
    pub const START_SHARE: f32 = 0.05;

    /// Travel, in largest volumes, after which there is no switch to be found.
    pub const LONGEST_SEARCH: f32 = 1.3;

    /// Travel, in largest volumes, in which a pressed switch has to let go, either of them.
    pub const LONGEST_BACK_OFF: f32 = 0.1;

    /// Share of the fastest flow with which the switch is looked for.
    pub const SEARCH_SHARE: f32 = 0.5;

    /// Fastest flow (µl/s) of a search. The plunger sucks air in through the tube meanwhile: twice
    /// that through 1 mm of bore and 1 m of length takes 7 kPa, which would be taken for a
    /// blocked vent.
    pub const FASTEST_SEARCH: f32 = 5_000.0;

    /// Share of the fastest flow with which its edge is taken.
    pub const EDGE_SHARE: f32 = 0.05;

    /// Periods without a step although the pump should move, after which the
    /// firmware gives up: 2 s.
    pub const LONGEST_STANDSTILL: u8 = 200;
}
