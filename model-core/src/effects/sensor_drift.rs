//! Drift of the sensor: y = θ + r t.
//!
//! r (rad/s) is the rate at which the zero of the angle sensor wanders, t (s) the
//! time on the rig's clock, which begins with the first recording after a reset: a
//! flex sensor that warms up or whose resistance decays under a bend. There the drift
//! is zero by definition; what has drifted before a session that starts later is in
//! its first reading.

use super::{Family, Hidden, Info, Mechanism, Motion, Parameter, Place, Unit, parameters};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Preparation, Shown};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "sensor_drift",
    title: "drift of the sensor",
    place: Place::Sensor,
    equation: "y = θ + r t",
    text: "The zero of the angle sensor wanders during the run: it warms up, or its resistance \
           decays while it is bent. The gap grows evenly with time, at rest as well as at large \
           angles, and is gone after a new tare.",
    signature: "time in the run, also at rest",
    look_alikes: &["stiffness_drift", "maxwell_branch"],
    family: Family::Drift,
    needs: &[],
    own_variable: None,
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: true,
    states: &[],
};

parameters! {
    /// Drift of the sensor.
    SensorDrift {
        /// Rate r of the drift (rad/s).
        rate: Parameter {
            key: "rate_rad_per_s",
            symbol: "r",
            unit: Unit::RadianPerSecond,
            lower: -1.0,
            upper: 1.0,
            held: None,
            default: None,
            starts: &[-0.003, 0.003],
        },
    }
}

impl<R: Real> Mechanism<R> for SensorDrift<R> {
    fn sensor(&self, angle: R, time: R, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        angle + self.rate * time
    }

    fn behind(&self, shown: Motion<R>) -> Motion<R> {
        Motion {
            rate: shown.rate - self.rate,
            ..shown
        }
    }
}

impl Preparation for SensorDrift<f32> {
    const CYCLES: u16 = 450;
    type Part = Shown<Self>;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[0.01]);

    fn prepare(&self, _base: &Base) -> Self::Part {
        Shown(*self)
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    #[test]
    fn motion_is_untouched_and_the_reading_grows_with_time() {
        let drift = Kind::SensorDrift.build(&[0.03]).unwrap();
        let drifting = spring(0.4, 0.3, 2.0, &[drift]);
        let plain = spring(0.4, 0.3, 2.0, &[]);
        for time in [0.5, 4.0] {
            let end = |model: &crate::actuator::Model<f64>| {
                run(model, model.at_rest(0.2, 0.0), &Held(1.0), time, 800)
            };
            let (here, there) = (end(&drifting), end(&plain));
            assert!((here.angle - there.angle).abs() < 1e-15);
            let apart = drifting.reading(&here) - plain.reading(&there);
            assert!((apart - 0.03 * time).abs() < 1e-13);
        }
    }

    #[test]
    fn a_start_that_shows_a_rate_moves_at_what_the_drift_leaves() {
        let drift = Kind::SensorDrift.build(&[0.03]).unwrap();
        let start = spring(0.4, 0.3, 2.0, &[drift]).showing(0.5, 0.2, 0.0);
        assert!((start.angle - 0.5).abs() < 1e-15 && (start.rate - 0.17).abs() < 1e-15);
    }
}
