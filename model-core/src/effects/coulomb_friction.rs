//! Coulomb friction: Q = T tanh(ω/ω_s).
//!
//! T is the friction force (N), ω the angular rate (rad/s), ω_s the rate at
//! which the sign function is smoothed (rad/s). Smoothing by a hyperbolic
//! tangent is the usual regularisation (e.g. Armstrong-Hélouvry, Dupont and
//! Canudas de Wit, Automatica 30, 1994); below ω_s the friction is a strong
//! viscous damping T/ω_s, so the actuator creeps instead of sticking.

use super::table::Variable;
use super::{
    Family, Hidden, Info, Instant, Mechanism, Need, Parameter, Place, Sign, Unit, parameters,
};
use crate::actuator::Model;
use crate::dynamics::{Dynamics, Rates};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Nothing, Preparation, RateLaw};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "coulomb_friction",
    title: "Coulomb friction",
    place: Place::Force,
    equation: "Q = T tanh(ω/ω_s)",
    text: "Dry friction opposes the motion with a force that does not depend on speed: a layer \
           that rubs, a sheath, a tube that drags. The angle at which the actuator comes to rest \
           depends on the side from which it came, and a free swing dies away along a straight \
           line instead of an exponential.",
    signature: "sign of angular velocity",
    look_alikes: &["bouc_wen_hysteresis", "input_backlash"],
    family: Family::DryFriction,
    needs: &[Need::Return],
    own_variable: Some(Variable::Rate),
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: false,
    states: &[],
};

parameters! {
    /// Coulomb friction.
    CoulombFriction {
        /// Friction force T (N).
        force: Parameter {
            key: "force_n",
            symbol: "T",
            unit: Unit::Newton,
            lower: 0.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[0.01, 0.1],
        },
        /// Rate ω_s at which the sign is smoothed (rad/s).
        smoothing: Parameter {
            key: "smoothing_rad_per_s",
            symbol: "ω_s",
            unit: Unit::RadianPerSecond,
            lower: 1e-4,
            upper: 10.0,
            held: Some(0.02),
            default: None,
            starts: &[],
        },
    }
}

impl<R: Real> Mechanism<R> for CoulombFriction<R> {
    fn force(&self, at: &Instant<R>, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        self.force * (at.rate / self.smoothing).tanh()
    }

    fn fastest_rate(&self, dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        Rates {
            stiffness: R::zero(),
            relaxation: self.force / (self.smoothing * dynamics.inertia),
        }
    }

    fn sign(&self, dynamics: &Dynamics<R>) -> Option<Sign<R>> {
        Some(Sign {
            width: self.smoothing,
            saturated: self.smoothing * R::from_i16(6),
            relaxation: self.force / (self.smoothing * dynamics.inertia),
        })
    }
}

impl Preparation for CoulombFriction<f32> {
    const CYCLES: u16 = 1_250;
    type Part = Nothing;
    #[cfg(test)]
    const TRIAL: Trial = Trial::with_corner(&[0.15, 0.02], 0.05);

    fn prepare(&self, _base: &Base) -> Self::Part {
        Nothing
    }

    fn rate_law(&self, model: &Model<f32>) -> Option<RateLaw> {
        RateLaw::of_sign(self, model)
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    /// Between turning points the friction is constant, so a lightly loaded
    /// swing loses 2T/K of amplitude every half period (a linear decay).
    #[test]
    fn free_swing_loses_the_same_amplitude_every_half_period() {
        let (stiffness, force) = (4.0, 0.05);
        let friction = Kind::CoulombFriction.build(&[force, 1e-3]).unwrap();
        let model = spring(1.0, 0.0, stiffness, &[friction]);
        let half_period = core::f64::consts::PI / stiffness.sqrt();
        let start = model.at_rest(1.0, 0.0);
        let mut expected = 1.0;
        for swing in 1..=4 {
            expected = -(expected - f64::signum(expected) * 2.0 * force / stiffness);
            let end = run(
                &model,
                start,
                &Held(0.0),
                f64::from(swing) * half_period,
                20_000,
            );
            assert!(
                (end.angle - expected).abs() < 2e-3,
                "swing {swing}: {} instead of {expected}",
                end.angle
            );
        }
    }

    #[test]
    fn force_saturates_at_its_value_and_is_odd() {
        let friction = Kind::CoulombFriction.build(&[0.3, 0.02]).unwrap();
        let force = |rate| crate::effects::testing::force(&friction, 0.0, rate);
        assert!((force(1.0) - 0.3).abs() < 1e-12);
        assert!((force(-1.0) + 0.3).abs() < 1e-12);
        assert!(force(0.0).abs() < 1e-15);
        assert!((force(0.001) - 0.3 * (0.05f64).tanh()).abs() < 1e-12);
    }
}
