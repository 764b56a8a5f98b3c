//! Watches whether both sensors move alike while nothing is pushed.
//!
//! Pressure bends the actuator, so the voltages of pressure sensor and flex sensor move against each other: the
//! one rises with the pressure, the other falls with the angle. Both by the same voltage in the same
//! direction, with the plunger at rest, is what their common ground does.
//!
//! The price: with a plunger that moves nothing is compared. A ground that drifts during a
//! compression is within the bounds of [`crate::gas`] and of the volume that the pressure loop allows.

use crate::{design::OVERSAMPLING, io::Oversampled};

/// Counts by which both have to have moved: 2 kPa and a degree.
const LEAST: i32 = 3 * SCALE;

/// The one may have moved so many times as far as the other.
const ALIKE: i32 = 2;

/// Weight of a new sum in the smoothed one: 1/16, in which the mains of 50 Hz cancels.
const SHIFT: u32 = 4;

/// A count in smoothed sums.
const SCALE: i32 = (OVERSAMPLING as i32) << SHIFT;

/// Periods of rest after which the smoothed sums are those of rest.
const SETTLING: u8 = 100;

/// The memory of the watch.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Watch {
    /// Smoothed sums of pressure and flex sensor.
    now: [i32; 2],
    /// Those at the beginning of this rest.
    then: [i32; 2],
    /// Periods for which the plunger has been at rest, until they are enough.
    rests: u8,
    steps: i32,
    closed: bool,
}

/// What the watch looks at in a period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Pressure sensor.
    pub pressure: Oversampled,
    /// Flex sensor.
    pub flex: Oversampled,
    /// Where the plunger is (microsteps).
    pub steps: i32,
    /// Whether the valve is closed.
    pub closed: bool,
}

impl Watch {
    /// Lets one control period pass; whether both have moved alike.
    pub fn step(&mut self, seen: &Seen) -> bool {
        if !seen.pressure.is_measured() || !seen.flex.is_measured() {
            return false;
        }
        for (now, sum) in self.now.iter_mut().zip([seen.pressure, seen.flex]) {
            *now += i32::from(sum.0) - (*now >> SHIFT);
        }
        if seen.steps != self.steps || seen.closed != self.closed {
            self.rests = 0;
            self.steps = seen.steps;
            self.closed = seen.closed;
            return false;
        }
        if self.rests < SETTLING {
            self.rests += 1;
            self.then = self.now;
            return false;
        }
        let ([pressure, flex], [pressure_then, flex_then]) = (self.now, self.then);
        let (pressure, flex) = (pressure - pressure_then, flex - flex_then);
        let (less, more) = if pressure.abs() < flex.abs() {
            (pressure.abs(), flex.abs())
        } else {
            (flex.abs(), pressure.abs())
        };
        (pressure < 0) == (flex < 0) && less > LEAST && more < ALIKE * less
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a plunger at rest is a fault after some seconds, with so many counts a second of each sensor.
    fn drifts(pressure: f32, flex: f32, seconds: u16) -> bool {
        let mut watch = Watch::default();
        (0..seconds * 100).any(|period| {
            let time = f32::from(period) * 0.01;
            // Half a count of mains, which changes its sign.
            let mains = if period % 2 == 0 { 8.0 } else { -8.0 };
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let sum = |counts: f32| Oversampled((counts * 16.0 + mains) as u16);
            watch.step(&Seen {
                pressure: sum(330.0 + pressure * time),
                flex: sum(500.0 + flex * time),
                steps: 100_000,
                closed: true,
            })
        })
    }

    #[test]
    fn a_ground_that_moves_is_told_from_what_a_rig_does() {
        for rate in [-2.0, -0.2, 2.0] {
            assert!(drifts(rate, rate, 30), "{rate}");
        }
        // An actuator that creeps, one that lets go with a leak, air that cools, a sensor alone.
        for (pressure, flex) in [
            (0.0, -2.0),
            (-0.2, 0.3),
            (-1.0, 0.1),
            (-2.0, 0.0),
            (0.3, -0.3),
        ] {
            assert!(!drifts(pressure, flex, 30), "{pressure} {flex}");
        }
    }

    #[test]
    fn a_plunger_that_moves_begins_anew() {
        let mut watch = Watch::default();
        for period in 0..3_000_u16 {
            let seen = Seen {
                pressure: Oversampled(5_000 - period),
                flex: Oversampled(8_000 - period),
                steps: i32::from(period / 50),
                closed: true,
            };
            assert!(!watch.step(&seen));
        }
    }
}
