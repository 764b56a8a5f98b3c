//! Stiffening by pressure: K → K(1 + k_p p).
//!
//! p (Pa) is the gauge pressure in the chamber, k_p (1/Pa inside, 1/kPa in
//! files) the share by which the stiffness K grows with it: an inflated wall is
//! stretched, and a stretched membrane resists bending. The factor is kept at
//! zero or above; there it has a corner.
//!
//! The force g p grows with the pressure as well. Where K k_p θⁿ exceeds g, more
//! pressure bends the actuator back, and no pressure holds that angle.

use super::{Family, Hidden, Info, Instant, Mechanism, Parameter, Place, Unit, parameters};
use crate::dynamics::Dynamics;
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Preparation, Stiffened};
use crate::real::Real;

/// The pressure (Pa) up to which a step length is to resolve the stiffness.
const LARGE_PRESSURE: f32 = 100_000.0;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "pressure_stiffening",
    title: "stiffening by pressure",
    place: Place::Force,
    equation: "K → K(1 + k_p p)",
    text: "An inflated actuator is stiffer than an empty one at the same angle: the wall is \
           stretched and the chamber rounds. Swings are faster at high pressure, and each further \
           step of pressure bends less than the one before it.",
    signature: "pressure times the spring's force",
    look_alikes: &["exponent_shift", "cubic_stiffness"],
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
    /// Stiffening by pressure.
    PressureStiffening {
        /// Growth k_p of the stiffness (1/Pa).
        growth: Parameter {
            key: "per_kpa",
            symbol: "k_p",
            unit: Unit::PerKiloPascal,
            // ∓2⁻¹⁵ and 2⁻¹² per pascal, which f32 and f64 hold alike.
            lower: -0.000_030_517_578,
            upper: 0.000_244_140_63,
            held: None,
            default: None,
            starts: &[-0.2, 0.3, 1.0],
        },
    }
}

impl<R: Real> Mechanism<R> for PressureStiffening<R> {
    fn modulates(&self) -> bool {
        true
    }

    fn modulate(&self, at: &Instant<R>, _hidden: &Hidden<R>, dynamics: &mut Dynamics<R>) {
        let factor = (R::one() + self.growth * at.pressure).max(R::zero());
        dynamics.stiffness = dynamics.stiffness * factor;
    }

    fn enlarge(&self, _angle: R, dynamics: &mut Dynamics<R>) {
        let growth = self.growth.abs() * R::from_f32(LARGE_PRESSURE);
        dynamics.stiffness = dynamics.stiffness * (R::one() + growth);
    }

    fn stiffens(&self) -> bool {
        true
    }
}

impl Preparation for PressureStiffening<f32> {
    const CYCLES: u16 = 1_900;
    type Part = Stiffened<Self>;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[4e-6]);

    fn prepare(&self, _base: &Base) -> Self::Part {
        Stiffened(*self)
    }
}

#[cfg(test)]
mod tests {
    use crate::actuator::Model;
    use crate::catalogue::Kind;
    use crate::dynamics::Dynamics;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    /// At a pressure that is held, the run is that of the stiffer spring.
    #[test]
    fn held_pressure_is_a_stiffer_spring() {
        let effect = Kind::PressureStiffening.build(&[1e-4]).unwrap();
        let stiffening = spring(0.4, 0.2, 2.0, &[effect]);
        let stiffer = spring(0.4, 0.2, 2.0 * 1.0003, &[]);
        let end = |model: &Model<f64>| run(model, model.at_rest(0.7, 0.0), &Held(3.0), 2.0, 500);
        assert!((end(&stiffening).angle - end(&stiffer).angle).abs() < 1e-13);
    }

    /// g p = K(1 + k_p p)θⁿ gives p = Kθⁿ/(g − K k_p θⁿ).
    #[test]
    fn holding_pressure_reckons_with_its_own_stiffening() {
        let (stiffness, gain, growth) = (3.0, 1e-4, 1e-5);
        let effect = Kind::PressureStiffening.build(&[growth]).unwrap();
        let dynamics = Dynamics {
            inertia: 0.3,
            damping: 1.0,
            stiffness,
            exponent: 2.0,
            input_gain: gain,
        };
        let model: Model<f64> = Model::new(dynamics, &[effect]).unwrap();
        let spring = stiffness * 0.64;
        let expected = spring / (gain - growth * spring);
        assert!((model.holding_pressure(0.8) / expected - 1.0).abs() < 1e-12);
    }

    /// Under a push that takes more than all stiffness away, g p = −Q.
    #[test]
    fn without_stiffness_the_pressure_holds_the_other_forces() {
        let (gain, force) = (6e-4, 3.4);
        let stiffening = Kind::PressureStiffening.build(&[2e-4]).unwrap();
        let push = Kind::PeriodicDisturbance.build(&[force, 1.0, -core::f64::consts::FRAC_PI_2]);
        let dynamics = Dynamics {
            inertia: 0.01,
            damping: 0.0,
            stiffness: 6.4,
            exponent: 1.5,
            input_gain: gain,
        };
        let model: Model<f64> = Model::new(dynamics, &[stiffening, push.unwrap()]).unwrap();
        let held = model.holding_pressure(0.48);
        assert!(1.0 + 2e-4 * held < 0.0);
        assert!((held + force / gain).abs() < 1e-8 * force / gain, "{held}");
    }
}
