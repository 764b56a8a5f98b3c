//! Exponent shift: n → n + Δn.
//!
//! The paper's own remedy for an uncertain material (its "n + Δn"): the
//! exponent of Ludwick's law, taken from a data sheet or predicted from other
//! properties, is off by Δn. The sum is kept at 0.25 or above: a power law with
//! an exponent near zero is a switch, not a spring.

use super::table::Variable;
use super::{Family, Hidden, Info, Instant, Mechanism, Parameter, Place, Unit, parameters};
use crate::dynamics::Dynamics;
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Nothing, Preparation};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "exponent_shift",
    title: "shift of the exponent",
    place: Place::Force,
    equation: "n → n + Δn",
    text: "The material's exponent is not the one in the model: a wrong data sheet, another \
           batch, or a strain range that Ludwick's law fits with another n. It is static: the \
           curve of angle against pressure has another slope on logarithmic axes.",
    signature: "slope of the static curve on logarithmic axes",
    look_alikes: &["gravity", "cubic_stiffness", "sensor_nonlinearity"],
    family: Family::StiffnessShape,
    needs: &[],
    own_variable: Some(Variable::Angle),
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: true,
    states: &[],
};

parameters! {
    /// Shift of the exponent.
    ExponentShift {
        /// Shift Δn.
        delta: Parameter {
            key: "delta",
            symbol: "Δn",
            unit: Unit::One,
            lower: -3.0,
            upper: 3.0,
            held: None,
            default: None,
            starts: &[-0.3, 0.3],
        },
    }
}

impl<R: Real> Mechanism<R> for ExponentShift<R> {
    fn modulates(&self) -> bool {
        true
    }

    fn modulate(&self, _at: &Instant<R>, _hidden: &Hidden<R>, dynamics: &mut Dynamics<R>) {
        dynamics.exponent = (dynamics.exponent + self.delta).max(R::from_f32(0.25));
    }

    fn enlarge(&self, _angle: R, dynamics: &mut Dynamics<R>) {
        dynamics.exponent = (dynamics.exponent + self.delta).max(R::from_f32(0.25));
    }
}

impl Preparation for ExponentShift<f32> {
    const CYCLES: u16 = 0;
    type Part = Nothing;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[-0.5]);

    fn prepare(&self, _base: &Base) -> Self::Part {
        Nothing
    }
}

#[cfg(test)]
mod tests {
    use crate::actuator::Model;
    use crate::catalogue::Kind;
    use crate::dynamics::Dynamics;
    use crate::effects::testing::run;
    use crate::input::Held;

    #[test]
    fn shifted_model_is_the_model_with_the_other_exponent() {
        let dynamics = |exponent| Dynamics {
            inertia: 0.36,
            damping: 0.9,
            stiffness: 1.2,
            exponent,
            input_gain: 1.0,
        };
        let shift = Kind::ExponentShift.build(&[0.4]).unwrap();
        let shifted: Model<f64> = Model::new(dynamics(1.6), &[shift]).unwrap();
        let plain: Model<f64> = Model::new(dynamics(2.0), &[]).unwrap();
        let end = |model: &Model<f64>| run(model, model.at_rest(0.0, 0.0), &Held(0.9), 3.0, 3_000);
        assert!((end(&shifted).angle - end(&plain).angle).abs() < 1e-12);
    }

    /// At n + Δn = 2 the holding force is K θ², whatever integrates it.
    #[test]
    fn holding_pressure_has_the_shifted_slope() {
        let shift = Kind::ExponentShift.build(&[-0.5]).unwrap();
        let model: Model<f64> = Model::new(
            Dynamics {
                inertia: 1.0,
                damping: 0.0,
                stiffness: 3.0,
                exponent: 2.5,
                input_gain: 2.0,
            },
            &[shift],
        )
        .unwrap();
        assert!((model.holding_pressure(0.7) - 3.0 * 0.49 / 2.0).abs() < 1e-12);
    }
}
