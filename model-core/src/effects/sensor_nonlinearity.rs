//! Curvature of the sensor: y = θ + c θ².
//!
//! c (1/rad) is the first term by which the calibration of the angle sensor
//! departs from a straight line; a gain could not be told from the parameters of
//! the model. The reading rises with the angle as long as 1 + 2cθ > 0; beyond
//! that the sensor would show two angles alike.

use super::{Family, Hidden, Info, Mechanism, Motion, Parameter, Place, Unit, parameters};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Preparation, Shown};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "sensor_nonlinearity",
    title: "curvature of the sensor",
    place: Place::Sensor,
    equation: "y = θ + c θ²",
    text: "The calibration of the angle sensor is not a straight line: it is right near zero and \
           wrong at large angles, or was fitted over another range. The gap is a function of the \
           shown angle alone, whatever the pressure and the speed; a protractor at three angles \
           decides.",
    signature: "shown angle alone",
    look_alikes: &["exponent_shift", "gravity"],
    family: Family::StiffnessShape,
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
    /// Curvature of the sensor.
    SensorNonlinearity {
        /// Curvature c (1/rad).
        curvature: Parameter {
            key: "curvature_per_rad",
            symbol: "c",
            unit: Unit::PerRadian,
            lower: -0.25,
            upper: 0.25,
            held: None,
            default: None,
            starts: &[-0.1, 0.1],
        },
    }
}

impl<R: Real> SensorNonlinearity<R> {
    /// dy/dθ, kept from zero so that a division by it stays finite.
    fn slope(&self, angle: R) -> R {
        let bend = self.curvature * angle;
        (R::one() + bend + bend).max(R::from_f32(0.062_5))
    }
}

impl<R: Real> Mechanism<R> for SensorNonlinearity<R> {
    fn sensor(&self, angle: R, _time: R, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        angle + self.curvature * angle * angle
    }

    fn behind(&self, shown: Motion<R>) -> Motion<R> {
        // Newton's method. From the reading it approaches the root from one side
        // wherever there is one, and the last pass carries its derivatives.
        let mut angle = shown.angle;
        for _ in 0..8 {
            let excess = angle + self.curvature * angle * angle - shown.angle;
            angle -= excess / self.slope(angle);
        }
        Motion {
            angle,
            rate: shown.rate / self.slope(angle),
        }
    }
}

impl Preparation for SensorNonlinearity<f32> {
    const CYCLES: u16 = 650;
    type Part = Shown<Self>;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[-0.1]);

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
    fn motion_is_untouched_and_the_reading_bent() {
        let bend = Kind::SensorNonlinearity.build(&[-0.12]).unwrap();
        let bent = spring(0.4, 0.3, 2.0, &[bend]);
        let plain = spring(0.4, 0.3, 2.0, &[]);
        let end = |model: &crate::actuator::Model<f64>| {
            run(model, model.at_rest(0.2, 0.0), &Held(1.0), 1.3, 500)
        };
        let angle = end(&plain).angle;
        assert!((end(&bent).angle - angle).abs() < 1e-15);
        assert!((bent.reading(&end(&bent)) - (angle - 0.12 * angle * angle)).abs() < 1e-15);
    }

    /// θ = (√(1 + 4cy) − 1)/2c and θ̇ = ẏ/√(1 + 4cy).
    #[test]
    fn motion_behind_a_reading_is_the_root_of_the_quadratic() {
        for (curvature, reading) in [(0.2, 1.4), (-0.12, 1.2), (0.25, -0.7), (-0.25, 0.8f64)] {
            let bend = Kind::SensorNonlinearity.build(&[curvature]).unwrap();
            let start = spring(0.4, 0.3, 2.0, &[bend]).showing(reading, 0.6, 0.0);
            let root = (1.0 + 4.0 * curvature * reading).sqrt();
            let angle = (root - 1.0) / (2.0 * curvature);
            assert!((start.angle - angle).abs() < 1e-12, "{curvature}");
            assert!((start.rate - 0.6 / root).abs() < 1e-12, "{curvature}");
        }
    }
}
