//! Linear stiffness: Q = k θ.
//!
//! A spring k (N/rad) beside the base spring, which for n > 1 has no slope at
//! θ = 0: a strain-limiting layer, the sensor itself, a tube that bends with the
//! actuator.

use super::table::Variable;
use super::{Family, Hidden, Info, Instant, Mechanism, Parameter, Place, Unit, parameters};
use crate::dynamics::{Dynamics, Rates};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Forced, Preparation};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "linear_stiffness",
    title: "linear stiffness",
    place: Place::Force,
    equation: "Q = k θ",
    text: "Something bends along with the actuator and obeys Hooke's law: a strain-limiting \
           layer, the angle sensor, a tube. It shows at small angles, where the power law of the \
           elastomer has hardly any stiffness of its own.",
    signature: "small angles",
    look_alikes: &["exponent_shift", "pressure_threshold"],
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
    /// Linear stiffness.
    LinearStiffness {
        /// Stiffness k (N/rad).
        stiffness: Parameter {
            key: "stiffness_n_per_rad",
            symbol: "k",
            unit: Unit::NewtonPerRad,
            lower: 0.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[0.05, 0.3],
        },
    }
}

impl<R: Real> Mechanism<R> for LinearStiffness<R> {
    fn force(&self, at: &Instant<R>, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        self.stiffness * at.angle
    }

    fn fastest_rate(&self, dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        Rates {
            stiffness: self.stiffness / dynamics.inertia,
            relaxation: R::zero(),
        }
    }
}

impl Preparation for LinearStiffness<f32> {
    const CYCLES: u16 = 1_250;
    type Part = Forced<Self>;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[0.3]);

    fn prepare(&self, _base: &Base) -> Self::Part {
        Forced(*self)
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    #[test]
    fn adds_to_a_spring_that_is_linear_itself() {
        let extra = Kind::LinearStiffness.build(&[1.3]).unwrap();
        let two = spring(0.4, 0.2, 2.0, &[extra]);
        let one = spring(0.4, 0.2, 3.3, &[]);
        let end = |model: &crate::actuator::Model<f64>| {
            run(model, model.at_rest(0.7, 0.0), &Held(1.0), 2.0, 500).angle
        };
        assert!((end(&two) - end(&one)).abs() < 1e-13);
    }
}
