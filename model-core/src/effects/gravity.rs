//! Gravity: Q = G [sin(κθ + θ₀ + φ) − sin θ₀].
//!
//! G (N) is the generalised weight (mass × g × lever over the length that makes the force
//! generalised), θ₀ (rad) the tilt of the base: 0 hangs down, π upside down (the same as a
//! negative G). The constant sin θ₀ is taken off because the angle is zeroed at rest with the
//! weight already on.
//!
//! Nothing but a weight changes when a rig is turned by φ, so two sessions tell it from every
//! curve of a spring.

use super::table::Variable;
use super::{
    Change, Doubtful, Family, Hidden, Info, Instant, Mechanism, Parameter, Place, Unit, parameters,
};
use crate::dynamics::{Dynamics, Rates};
use crate::elementary::sin_near;
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, Step};
use crate::real::Real;

/// κ of an actuator that bends under its own weight.
///
/// On a rigid arm at a joint κ is 1. Along an actuator that bends with constant curvature the
/// weight at the share u of its length turns by uθ with the lever 1 − u, so that
/// Q = W ∫₀¹ u (1 − u) sin(uθ + α) du, which is within θ²/40 of (W/6) sin(θ/2 + α): κ = ½. For a
/// weight at its tip κ is 2/3.
pub const BENDING: f32 = 0.5;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "gravity",
    title: "gravity",
    place: Place::Force,
    equation: "Q = G [sin(κθ + θ₀ + φ) − sin θ₀]",
    text: "The weight of the actuator, or of what it carries, pulls with the sine of the angle. \
           It is static: it bends the curve of angle against pressure, and it changes its sign \
           when the base is turned over.",
    signature: "sine of the angle",
    look_alikes: &["exponent_shift", "sensor_nonlinearity"],
    family: Family::StiffnessShape,
    needs: &[],
    own_variable: Some(Variable::Angle),
    special_case: None,
    imitates: &[],
    told_by: &[Change::Turned],
    doubtful: &[Doubtful::TakesBack],
    has_slope: true,
    states: &[],
};

parameters! {
    /// Gravity.
    Gravity {
        /// Generalised weight G (N); negative for a base turned over.
        weight: Parameter {
            key: "force_n",
            symbol: "G",
            unit: Unit::Newton,
            lower: f32::NEG_INFINITY,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[-0.3, 0.3, 1.0],
        },
        /// Tilt θ₀ of the base (rad).
        tilt: Parameter {
            key: "tilt_rad",
            symbol: "θ₀",
            unit: Unit::Radian,
            lower: -3.2,
            upper: 3.2,
            held: Some(0.0),
            default: None,
            starts: &[-1.5, 1.5],
        },
        /// Turn φ of the base since the angle was zeroed (rad).
        ///
        /// It belongs to a session and not to the actuator; a session's metadata (`[setup] tilt_deg`)
        /// give it.
        turned: Parameter {
            key: "turned_rad",
            symbol: "φ",
            unit: Unit::Radian,
            lower: -6.3,
            upper: 6.3,
            held: Some(0.0),
            default: None,
            starts: &[],
        },
        /// Share κ of the bending angle by which the weight turns.
        angle_share: Parameter {
            key: "angle_share",
            symbol: "κ",
            unit: Unit::One,
            lower: 0.1,
            upper: 1.0,
            held: Some(1.0),
            default: None,
            starts: &[],
        },
    }
}

impl<R: Real> Gravity<R> {
    /// The weight of an actuator that bends, with as much change of its force by the angle.
    #[must_use]
    pub fn bending(self) -> Self {
        let share = R::from_f32(BENDING);
        Self {
            weight: self.weight * self.angle_share / share,
            angle_share: share,
            ..self
        }
    }
}

impl<R: Real> Mechanism<R> for Gravity<R> {
    fn turn(&mut self, by: R) {
        self.turned += by;
    }

    fn force(&self, at: &Instant<R>, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        let turned = self.angle_share * at.angle + self.tilt + self.turned;
        self.weight * (turned.sin() - self.tilt.sin())
    }

    fn fastest_rate(&self, dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        Rates {
            stiffness: self.weight.abs() * self.angle_share / dynamics.inertia,
            relaxation: R::zero(),
        }
    }
}

impl Preparation for Gravity<f32> {
    const CYCLES: u16 = 2_200;
    type Part = Weight;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[0.3, 0.4, 0.5, 0.7]);

    fn prepare(&self, base: &Base) -> Self::Part {
        let weight = self.weight * base.leapfrog.per_newton();
        Weight {
            force: weight,
            share: self.angle_share,
            tilt: self.tilt + self.turned,
            at_zero: weight * sin_near(self.tilt),
        }
    }
}

/// The weight with the force of its tilt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weight {
    /// γ·G (rad).
    force: f32,
    /// κ.
    share: f32,
    /// θ₀ + φ (rad).
    tilt: f32,
    /// γ·G·sin θ₀ (rad).
    at_zero: f32,
}

impl Part for Weight {
    fn phases(&self) -> Phases {
        Phases::AFTER
    }

    #[inline(always)]
    fn force(&self, _base: &Base, step: &mut Step, _memory: &mut Hidden<f32>) -> f32 {
        self.force * sin_near(self.share * step.angle + self.tilt) - self.at_zero
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::{Effect, Kind};
    use crate::effects::testing::{force as force_at, run, spring};
    use crate::input::Held;

    /// The period of a free pendulum is 4 √(M/G) K(sin(θ₀/2)), with the
    /// complete elliptic integral from the arithmetic–geometric mean.
    #[test]
    fn free_pendulum_has_the_elliptic_period() {
        let (inertia, weight, amplitude) = (0.5, 2.0, 2.0f64);
        let gravity = Kind::Gravity.build(&[weight, 0.0, 0.0, 1.0]).unwrap();
        let model = spring(inertia, 0.0, 0.0, &[gravity]);
        let (mut a, mut b) = (1.0, (amplitude / 2.0).cos());
        for _ in 0..8 {
            (a, b) = (f64::midpoint(a, b), f64::sqrt(a * b));
        }
        let period = core::f64::consts::TAU / a * f64::sqrt(inertia / weight);
        let end = run(
            &model,
            model.at_rest(amplitude, 0.0),
            &Held(0.0),
            period,
            4_000,
        );
        assert!((end.angle - amplitude).abs() < 1e-9);
        assert!(end.rate.abs() < 1e-7);
    }

    /// The weight of an arm that bends with constant curvature, by the integral along it.
    #[test]
    fn a_bending_arm_turns_its_weight_by_half_of_its_angle() {
        let along = |angle: f64, base: f64| {
            let parts = 2_000;
            let sum: f64 = (0..parts)
                .map(|k| {
                    let u = (f64::from(k) + 0.5) / f64::from(parts);
                    u * (1.0 - u) * (u * angle + base).sin()
                })
                .sum();
            sum / f64::from(parts)
        };
        for angle in [-0.6, 0.3, 0.9, 1.5_f64] {
            for base in [-0.8, 0.0, 0.5, 1.57] {
                // The levers add up to a sixth.
                let gravity = super::Gravity {
                    weight: 1.0 / 6.0,
                    tilt: 0.0,
                    turned: base,
                    angle_share: f64::from(super::BENDING),
                };
                let force = force_at(&Effect::Gravity(gravity), angle, 0.0);
                let exact = along(angle, base);
                let within = angle * angle / 40.0 / 6.0;
                assert!(
                    (force - exact).abs() <= within,
                    "{angle} {base}: {force} {exact}"
                );
            }
        }
    }

    #[test]
    fn base_turned_over_flips_the_sign_and_rest_is_free_of_force() {
        let force = |weight, tilt, angle| {
            let gravity = Kind::Gravity.build(&[weight, tilt, 0.0, 1.0]).unwrap();
            crate::effects::testing::force(&gravity, angle, 0.0)
        };
        let pi = core::f64::consts::PI;
        assert!((force(0.4, 0.0, 0.7) + force(0.4, pi, 0.7)).abs() < 1e-12);
        assert!(force(0.4, 1.1, 0.0).abs() < 1e-15);
        assert!((force(0.4, pi / 2.0, pi / 2.0) + 0.4).abs() < 1e-12);
    }
}
