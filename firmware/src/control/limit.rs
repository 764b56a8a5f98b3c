//! Limits of all commands.

/// Brings `value` between `lowest` and `highest`; `lowest` for not-a-number.
///
/// `f32::clamp` panics when its limits are crossed, which damaged settings could
/// bring about; here the highest wins.
pub fn within(value: f32, lowest: f32, highest: f32) -> f32 {
    if value >= highest {
        highest
    } else if value > lowest {
        value
    } else {
        lowest
    }
}

/// The size of a number.
pub fn size(value: f32) -> f32 {
    if value < 0.0 { -value } else { value }
}

/// A set-point's range and speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// The largest set-point (Pa or rad); the smallest is zero.
    pub highest: f32,
    /// The fastest change (Pa/s or rad/s).
    pub rate: f32,
}

/// A set-point that stays in its [`Range`] and moves no faster than allowed,
/// whatever is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setpoint {
    value: f32,
}

impl Setpoint {
    /// The set-point now (Pa or rad).
    pub fn value(self) -> f32 {
        self.value
    }

    /// Starts from what is measured, so that nothing jumps.
    pub fn restart(&mut self, range: &Range, from: f32) {
        self.value = within(from, 0.0, range.highest);
    }

    /// Moves towards `target` for `dt` seconds and returns the new set-point.
    pub fn step(&mut self, range: &Range, target: f32, dt: f32) -> f32 {
        let far = range.rate * dt;
        let next = within(target, self.value - far, self.value + far);
        self.value = within(next, 0.0, range.highest);
        self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn crossed_or_undefined_limits_are_no_panic() {
        assert!((within(3.0, 5.0, 1.0) - 1.0).abs() < f32::EPSILON);
        assert!((within(f32::NAN, -1.0, 1.0) + 1.0).abs() < f32::EPSILON);
        assert!((within(f32::INFINITY, -1.0, 1.0) - 1.0).abs() < f32::EPSILON);
    }

    proptest! {
        #[test]
        fn a_set_point_stays_in_its_range_and_keeps_its_speed(
            targets in prop::collection::vec(any::<f32>(), 1..50),
            start: f32, highest in 0.1..1e6f32, rate in 0.1..1e6f32,
        ) {
            let range = Range { highest, rate };
            let mut setpoint = Setpoint::default();
            setpoint.restart(&range, start);
            let mut before = setpoint.value();
            for target in targets {
                let value = setpoint.step(&range, target, 0.01);
                prop_assert!((0.0..=highest).contains(&value), "{value}");
                let slack = highest * 1e-6;
                prop_assert!(size(value - before) <= rate * 0.01 + slack);
                before = value;
            }
        }
    }

    #[test]
    fn a_set_point_arrives() {
        let range = Range {
            highest: 10.0,
            rate: 100.0,
        };
        let mut setpoint = Setpoint::default();
        for _ in 0..5 {
            setpoint.step(&range, 4.5, 0.01);
        }
        assert!((setpoint.value() - 4.5).abs() < f32::EPSILON);
    }
}
