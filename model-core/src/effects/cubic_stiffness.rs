//! Cubic stiffness: Q = k₃ θ³.
//!
//! k₃ (N/rad³); the first odd term by which a spring that hardens (k₃ > 0) or
//! softens (k₃ < 0) departs from the base model: Duffing's oscillator.

use super::table::Variable;
use super::{Family, Hidden, Info, Instant, Mechanism, Parameter, Place, Unit, parameters};
use crate::dynamics::{Dynamics, Rates};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Forced, Preparation};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "cubic_stiffness",
    title: "cubic stiffness",
    place: Place::Force,
    equation: "Q = k₃ θ³",
    text: "The spring hardens or softens at large angle: the wall strains beyond the range of \
           the material law, or the chamber touches itself. It is static and symmetric, so the \
           free frequency of a swing depends on its amplitude.",
    signature: "large angles",
    look_alikes: &["exponent_shift", "end_stop"],
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
    /// Cubic stiffness.
    CubicStiffness {
        /// Coefficient k₃ (N/rad³).
        stiffness: Parameter {
            key: "stiffness_n_per_rad3",
            symbol: "k₃",
            unit: Unit::NewtonPerRad3,
            lower: f32::NEG_INFINITY,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[-0.05, 0.05, 0.5],
        },
    }
}

impl<R: Real> Mechanism<R> for CubicStiffness<R> {
    fn force(&self, at: &Instant<R>, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        self.stiffness * at.angle * at.angle * at.angle
    }

    fn fastest_rate(&self, dynamics: &Dynamics<R>, angle: R) -> Rates<R> {
        Rates {
            stiffness: R::from_i16(3) * self.stiffness.abs() * angle * angle / dynamics.inertia,
            relaxation: R::zero(),
        }
    }
}

impl Preparation for CubicStiffness<f32> {
    const CYCLES: u16 = 1_600;
    type Part = Forced<Self>;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[0.2]);

    fn prepare(&self, _base: &Base) -> Self::Part {
        Forced(*self)
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    /// A pure cubic spring swings with the period
    /// T = 4 (1/A) √(2M/k₃) ∫₀¹ dx/√(1 − x⁴) = 4·1.311028777…·√(2M/k₃)/A.
    #[test]
    fn pure_cubic_spring_has_the_lemniscate_period() {
        let (inertia, cubic, amplitude) = (0.8, 3.0, 0.9);
        let spring3 = Kind::CubicStiffness.build(&[cubic]).unwrap();
        let model = spring(inertia, 0.0, 0.0, &[spring3]);
        let lemniscate = 1.311_028_777_146_06;
        let period = 4.0 * lemniscate * f64::sqrt(2.0 * inertia / cubic) / amplitude;
        let end = run(
            &model,
            model.at_rest(amplitude, 0.0),
            &Held(0.0),
            period,
            4_000,
        );
        assert!((end.angle - amplitude).abs() < 1e-8, "{}", end.angle);
        assert!(end.rate.abs() < 1e-7, "{}", end.rate);
    }

    #[test]
    fn force_is_odd_in_the_angle() {
        let spring3 = Kind::CubicStiffness.build(&[2.0]).unwrap();
        let force = |angle| crate::effects::testing::force(&spring3, angle, 0.0);
        assert!((force(0.5) - 0.25).abs() < 1e-15);
        assert!((force(-0.5) + 0.25).abs() < 1e-15);
    }
}
