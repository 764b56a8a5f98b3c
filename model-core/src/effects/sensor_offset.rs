//! Sensor offset: y = θ + b.
//!
//! b (rad) is what the sensor shows when the actuator is straight: a flex
//! sensor that was not tared, or that was glued on slightly bent.

use super::{
    Doubtful, Family, Hidden, Info, Mechanism, Motion, Parameter, Place, Unit, parameters,
};
use crate::catalogue::Kind;
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Preparation, Shown};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "sensor_offset",
    title: "offset of the sensor",
    place: Place::Sensor,
    equation: "y = θ + b",
    text: "The angle sensor does not show zero where the actuator is straight: it was not tared \
           at rest, or it is fixed slightly bent. The gap is the same at every instant of every \
           run, also at rest.",
    signature: "constant, also at rest",
    look_alikes: &["pressure_threshold"],
    family: Family::Offset,
    needs: &[],
    own_variable: None,
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[Doubtful::Beside(Kind::MaxwellBranch)],
    has_slope: true,
    states: &[],
};

parameters! {
    /// Sensor offset.
    SensorOffset {
        /// Offset b (rad).
        offset: Parameter {
            key: "offset_rad",
            symbol: "b",
            unit: Unit::Radian,
            lower: -3.2,
            upper: 3.2,
            held: None,
            default: None,
            starts: &[0.0],
        },
    }
}

impl<R: Real> Mechanism<R> for SensorOffset<R> {
    fn sensor(&self, angle: R, _time: R, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        angle + self.offset
    }

    fn behind(&self, shown: Motion<R>) -> Motion<R> {
        Motion {
            angle: shown.angle - self.offset,
            ..shown
        }
    }
}

impl Preparation for SensorOffset<f32> {
    const CYCLES: u16 = 450;
    type Part = Shown<Self>;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[0.1]);

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
    fn motion_is_untouched_and_the_reading_shifted() {
        let offset = Kind::SensorOffset.build(&[0.12]).unwrap();
        let shifted = spring(0.4, 0.3, 2.0, &[offset]);
        let plain = spring(0.4, 0.3, 2.0, &[]);
        let end = |model: &crate::actuator::Model<f64>| {
            run(model, model.at_rest(0.2, 0.0), &Held(1.0), 1.3, 500)
        };
        assert!((end(&shifted).angle - end(&plain).angle).abs() < 1e-15);
        assert!(
            (shifted.reading(&end(&shifted)) - plain.reading(&end(&plain)) - 0.12).abs() < 1e-15
        );
    }

    #[test]
    fn angle_behind_a_reading_is_found_again() {
        let offset = Kind::SensorOffset.build(&[0.12]).unwrap();
        let model = spring(0.4, 0.3, 2.0, &[offset]);
        assert!((model.angle_behind(0.5) - 0.38).abs() < 1e-12);
    }
}
