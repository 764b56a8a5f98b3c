//! From counts to the bending angle.
//!
//! The resistance of a flex sensor is not linear in the angle and differs between
//! sensors, so each sensor has a table of a few points with linear interpolation. Beyond
//! its ends the table is extrapolated by a fifth of its range, since an actuator
//! overshoots the largest calibrated angle; farther out there is no reading.

use super::{HIGHEST_SUM, LOWEST_SUM, SensorFault, within_wires};
use crate::{design::OVERSAMPLING, io::Oversampled};

/// The fewest points of a table.
pub const FEWEST_POINTS: u8 = 2;
/// The most points of a table.
pub const MOST_POINTS: u8 = 8;

/// How far the outer segments go on, as a share of the table's range.
const EXTRAPOLATION: f32 = 0.2;

/// The closest that two points may be (counts of ten bits): below that the
/// slope is that of the noise.
const CLOSEST_COUNTS: f32 = 1.0;

/// A straight piece of the table.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Segment {
    /// Sum of conversions where it starts.
    sum: f32,
    /// Angle (rad) there.
    angle: f32,
    /// Slope (rad for one in the sum): the division is done once.
    slope: f32,
}

/// The calibration of the flex sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flex {
    /// In the order of rising sums; unused ones are zero.
    segments: [Segment; MOST_POINTS as usize - 1],
    used: u8,
    /// Smallest and largest sum that has an angle.
    lowest: f32,
    highest: f32,
}

impl Flex {
    /// Creates the table from `points` points, given by their index as counts
    /// of ten bits and angle (°).
    ///
    /// The counts must rise or fall strictly along the list, by a count at
    /// least, and so must the angles; all counts must be voltages that are not
    /// those of a broken wire. None for anything else.
    pub fn new(points: u8, point: impl Fn(u8) -> (f32, f32)) -> Option<Self> {
        if !(FEWEST_POINTS..=MOST_POINTS).contains(&points) {
            return None;
        }
        let last = points - 1;
        let falling = point(0).0 > point(last).0;
        let at = |index: u8| {
            let (counts, degrees) = point(if falling { last - index } else { index });
            (counts * f32::from(OVERSAMPLING), degrees.to_radians())
        };

        let mut segments = [Segment::default(); MOST_POINTS as usize - 1];
        let (mut sum, mut angle) = at(0);
        let (first_sum, first_angle) = (sum, angle);
        let (last_sum, last_angle) = at(last);
        let rising = last_angle > first_angle;
        for (segment, index) in segments.iter_mut().zip(1..points) {
            let (next_sum, next_angle) = at(index);
            // Written so that not-a-number fails.
            let apart = next_sum - sum >= CLOSEST_COUNTS * f32::from(OVERSAMPLING);
            let onwards = if rising {
                next_angle > angle
            } else {
                next_angle < angle
            };
            let slope = (next_angle - angle) / (next_sum - sum);
            if !(apart && onwards && slope.is_finite()) {
                return None;
            }
            *segment = Segment { sum, angle, slope };
            (sum, angle) = (next_sum, next_angle);
        }
        let within = first_sum >= f32::from(LOWEST_SUM) && last_sum <= f32::from(HIGHEST_SUM);
        let beyond = EXTRAPOLATION * (last_sum - first_sum);
        within.then_some(Self {
            segments,
            used: last,
            lowest: first_sum - beyond,
            highest: last_sum + beyond,
        })
    }

    /// The bending angle (rad) behind a reading.
    ///
    /// # Errors
    ///
    /// [`SensorFault::Low`] (the sensor is on the high side of its divider, so
    /// this is an open one) or [`SensorFault::High`] (a shorted one) for a
    /// voltage that the divider does not give; [`SensorFault::BeyondTable`] for
    /// one too far beyond the table's ends.
    pub fn angle(&self, reading: Oversampled) -> Result<f32, SensorFault> {
        let sum = f32::from(within_wires(reading)?);
        if sum < self.lowest || sum > self.highest {
            return Err(SensorFault::BeyondTable);
        }
        Ok(self.line(sum))
    }

    fn line(&self, sum: f32) -> f32 {
        let mut at = &self.segments[0];
        for segment in self.segments.iter().take(usize::from(self.used)) {
            if sum >= segment.sum {
                at = segment;
            }
        }
        at.angle + (sum - at.sum) * at.slope
    }

    /// The largest angle (rad) that has a reading.
    pub fn largest(&self) -> f32 {
        let low = self.line(self.lowest.max(f32::from(LOWEST_SUM)));
        let high = self.line(self.highest.min(f32::from(HIGHEST_SUM)));
        if low > high { low } else { high }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn flex(points: &[(f32, f32)]) -> Option<Flex> {
        #[allow(clippy::cast_possible_truncation)]
        Flex::new(points.len() as u8, |index| points[usize::from(index)])
    }

    const FALLING: [(f32, f32); 3] = [(700.0, -10.0), (500.0, 60.0), (300.0, 130.0)];

    #[test]
    fn a_table_may_rise_or_fall_but_not_turn() {
        assert!(flex(&FALLING).is_some());
        let mut other = FALLING;
        other.reverse();
        assert_eq!(flex(&other), flex(&FALLING));
        // With the sensor on the low side the counts rise with the angle.
        assert!(flex(&[(300.0, 0.0), (500.0, 90.0)]).is_some());

        assert_eq!(flex(&[(700.0, 0.0)]), None);
        for turned in [
            [(700.0, -10.0), (300.0, 60.0), (500.0, 130.0)],
            [(700.0, -10.0), (500.0, 60.0), (300.0, 50.0)],
            [(700.0, -10.0), (500.0, -10.0), (300.0, 50.0)],
            [(700.0, -10.0), (700.0, 60.0), (300.0, 130.0)],
            [(700.0, -10.0), (699.5, 60.0), (300.0, 130.0)],
            [(700.0, -10.0), (f32::NAN, 60.0), (300.0, 130.0)],
            [(700.0, -10.0), (500.0, f32::NAN), (300.0, 130.0)],
            [(f32::NAN, -10.0), (500.0, 60.0), (300.0, 130.0)],
            [(1000.0, -10.0), (500.0, 60.0), (300.0, 130.0)],
            [(700.0, -10.0), (500.0, 60.0), (20.0, 130.0)],
        ] {
            assert_eq!(flex(&turned), None, "{turned:?}");
        }
    }

    #[test]
    fn beyond_the_table_the_outer_segments_go_on_for_a_fifth() {
        let sensor = flex(&FALLING).unwrap();
        let angle = |counts: u16| sensor.angle(Oversampled(counts * 16)).map(f32::to_degrees);
        // The range is 400 counts, so 80 more on either side.
        let close = |value: Result<f32, _>, to: f32| (value.unwrap() - to).abs() < 1e-3;
        assert!(close(angle(221), 130.0 + 79.0 * 0.35));
        assert!(close(angle(779), -10.0 - 79.0 * 0.35));
        assert_eq!(angle(219), Err(SensorFault::BeyondTable));
        assert_eq!(angle(781), Err(SensorFault::BeyondTable));
        assert_eq!(angle(2), Err(SensorFault::Low));
        assert_eq!(angle(1020), Err(SensorFault::High));
        assert!((sensor.largest().to_degrees() - 158.0).abs() < 1e-3);
    }

    prop_compose! {
        fn tables()(
            steps in prop::collection::vec((2.0..90.0_f32, 1.0..50.0_f32), 1..8),
            start in -20.0..20.0_f32, falling: bool,
        ) -> Vec<(f32, f32)> {
            let (mut counts, mut degrees) = (100.0, start);
            let mut points = std::vec![(counts, degrees)];
            for (dc, da) in steps {
                counts += dc;
                degrees += da;
                points.push((counts, degrees));
            }
            if falling {
                for point in &mut points {
                    point.0 = 900.0 - point.0;
                }
            }
            points
        }
    }

    proptest! {
        #[test]
        fn between_the_points_it_is_linear(points in tables(), sum in 820..15_564_u16) {
            let sensor = flex(&points).unwrap();
            let counts = f32::from(sum) / 16.0;
            let inside = points.windows(2).find(|pair| {
                let (a, b) = (pair[0].0.min(pair[1].0), pair[0].0.max(pair[1].0));
                (a..=b).contains(&counts)
            });
            if let Some(&[(c0, a0), (c1, a1)]) = inside {
                let expected = a0 + (counts - c0) / (c1 - c0) * (a1 - a0);
                let angle = sensor.angle(Oversampled(sum)).unwrap().to_degrees();
                prop_assert!((angle - expected).abs() < 0.01, "{angle} {expected}");
            }
        }

        #[test]
        fn the_angle_is_monotone_wherever_there_is_one(points in tables()) {
            let sensor = flex(&points).unwrap();
            let rising = points[1].0 > points[0].0;
            let mut before: Option<f32> = None;
            for sum in LOWEST_SUM..=HIGHEST_SUM {
                let Ok(angle) = sensor.angle(Oversampled(sum)) else { continue };
                prop_assert!(angle <= sensor.largest() + 1e-5);
                if let Some(before) = before {
                    let onwards = if rising { angle - before } else { before - angle };
                    prop_assert!(onwards >= -1e-6);
                }
                before = Some(angle);
            }
            prop_assert!(before.is_some());
        }

        #[test]
        fn no_numbers_are_a_panic(points: u8, bits: [u32; 16], sum: u16) {
            let number = |index: usize| bits.get(index).map_or(0.0, |&bits| f32::from_bits(bits));
            let table = Flex::new(points, |index| {
                (number(usize::from(index)), number(8 + usize::from(index % 8)))
            });
            if let Some(table) = table {
                let _ = table.angle(Oversampled(sum));
            }
        }
    }
}
