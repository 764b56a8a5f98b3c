//! Constants of the design, in one place: times, and limits of safety and mechanics, each with
//! its unit and its reason.
//!
//! Values that differ between rigs are [settings](wire::settings); constants of one algorithm
//! are beside that algorithm. `docs/safety.md` has the resulting figures, measured in the
//! simulator.

use crate::units::RAD_PER_DEG;

// ---- Time ----

/// Cycles of the processor and of the pulse timer in a second: the crystal of an Arduino Mega.
pub const CPU_HZ: u32 = 16_000_000;

/// Control periods a second, each with a line of telemetry: at most 91 % of what the
/// cable carries.
pub const CONTROL_HZ: u16 = 100;

/// Length of a control period (s).
pub const PERIOD_S: f32 = 0.01;

/// Length of a control period (ms): a line of telemetry each.
pub const PERIOD_MS: u16 = 1000 / CONTROL_HZ;
const _: () = assert!(PERIOD_MS == wire::telemetry::PERIOD_MS);

pub use wire::answer::OVERSAMPLING;

// ---- Sensors: rest and tare ----

/// Largest change of the pressure's zero by a tare (Pa).
pub const LARGEST_PRESSURE_TARE_PA: f32 = 5_000.0;

/// Largest change of the angle's zero by a tare (rad): 30°. A larger one means another
/// sensor than the calibrated one.
pub const LARGEST_ANGLE_TARE_RAD: f32 = core::f32::consts::FRAC_PI_6;

/// Spread (Pa) of the smoothed pressure over a second below which it rests.
pub const PRESSURE_REST_PA: f32 = 1_000.0;

/// Spread (rad) of the smoothed angle over a second below which it rests: 2°,
/// the extremes of a hundred samples of the noisiest flex sensors (0.6° rms
/// before the filter).
pub const ANGLE_REST_RAD: f32 = 0.035;

// ---- What arming and venting ask for ----

/// Largest reading of the pressure (Pa) when the rig is armed: a zero error of 10 kPa lets
/// the pressure rise that far above its limit.
pub const LARGEST_AT_REST_PA: f32 = 5_000.0;

/// Periods of venting: 3 s, ten times the time of a tube of one metre.
pub const LONGEST_VENTING_PERIODS: u16 = 300;

/// Periods after that for which a pressure has to persist: half a second. One mixed reading
/// of a wire that breaks or shorts can be anything up to 600 kPa, is held for 50 ms by the
/// fault debounce, and takes 0.12 s more to leave the smoothed pressure.
pub const STILL_PRESSURISED_PERIODS: u16 = 50;

/// Periods for which a plunger has to be back at its start position before the valve closes: the
/// last air goes out in 0.2 s.
pub const VENTING_PERIODS: u8 = 20;

/// Time (s) that a plunger may take for its return beside that of twice the stroke at the fastest
/// flow: for the tube, and eleven time constants of the slowest ramp. A run that waits longer is
/// stopped, since nothing else would end it.
pub const RETURN_S: f32 = 30.0;

// ---- Commanded against observed ----

/// How far (Pa) above the limit the pressure may be by the volume that was pushed and the air that was found
/// behind the plunger: farther is the fault gas law. An actuator that swells by 2 ml per 100 kPa
/// comes 6 kPa beyond at the largest set-point.
pub const BEYOND_LIMIT_PA: f32 = 10_000.0;

/// The same where the pump stands: it goes there ever more slowly, and the fault comes before.
pub const STOPS_PA: f32 = 13_000.0;

/// Sensor and prediction disagree if they differ by more than this (rad), 15°, one of them is
/// less than half of the other, and there is pressure: without pressure the remaining angle is
/// friction and creep.
pub const DISAGREEMENT_RAD: f32 = 15.0 * RAD_PER_DEG;

/// Periods of disagreement that are a fault: longer than the longest dead time.
pub const DISAGREEMENT_PERIODS: u8 = 100;

/// Error (Pa) at the end of the stroke from which a pressure is out of reach: a leak, or
/// more air than the syringe can compress.
pub const OUT_OF_REACH_PA: f32 = 5_000.0;

/// Periods at the end of the stroke that are a fault.
pub const OUT_OF_REACH_PERIODS: u8 = 100;

/// Homing to the retracted switch.
pub mod homing {
    /// Start position of the plunger (µl); less for a small pump.
    pub const START_UL: f32 = 500.0;

    /// Share of the largest volume that the start position may take.
    pub const START_SHARE: f32 = 0.05;

    /// Travel, in largest volumes, after which the search for the switch ends.
    pub const LONGEST_SEARCH: f32 = 1.3;

    /// Travel, in largest volumes, within which a pressed switch has to release.
    pub const LONGEST_BACK_OFF: f32 = 0.1;

    /// Share of the fastest flow for the search of the switch.
    pub const SEARCH_SHARE: f32 = 0.5;

    /// Fastest flow (µl/s) of a search. The plunger draws air in through the tube meanwhile: twice
    /// that flow through 1 mm of bore and 1 m of length needs 7 kPa, which would count as a
    /// blocked vent.
    pub const FASTEST_SEARCH: f32 = 5_000.0;

    /// Share of the fastest flow for finding its edge.
    pub const EDGE_SHARE: f32 = 0.05;

    /// Share of the fastest flow for an edge that the stroke is measured from: two microsteps of the
    /// usual pump between two looks of the board.
    pub const MEASURING_SHARE: f32 = 0.0125;

    /// Travel (µl) after which the search for the pushed-in switch ends: 1.3 times the largest
    /// volume that there may be.
    pub const LONGEST_STROKE_UL: f32 = 130_000.0;

    /// Periods without a step although the pump should move, after which the
    /// firmware gives up: 2 s.
    pub const LONGEST_STANDSTILL: u8 = 200;
}
