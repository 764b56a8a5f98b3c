//! Quadratic damping: Q = d ω|ω|.
//!
//! d (N·s²/rad²) collects drag in air or water and the pressure drop of a
//! turbulent flow that the motion drives through an orifice; ω is the angular
//! rate (rad/s).

use super::table::Variable;
use super::{Family, Hidden, Info, Instant, Mechanism, Parameter, Place, Unit, parameters};
use crate::dynamics::{Dynamics, Rates};
use crate::elementary::{SMALL, ln};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, Step};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "quadratic_damping",
    title: "quadratic damping",
    place: Place::Force,
    equation: "Q = d ω|ω|",
    text: "Drag that grows with the square of the speed: air or water around the actuator, or \
           turbulent flow through a fitting. Only the fast parts of a run show it; the damping \
           that a linear model would need grows with the amplitude.",
    signature: "angular velocity, fast parts only",
    look_alikes: &["angle_dependent_damping", "vent_asymmetry"],
    family: Family::RateDamping,
    needs: &[],
    own_variable: Some(Variable::Rate),
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: true,
    states: &[],
};

parameters! {
    /// Quadratic damping.
    QuadraticDamping {
        /// Drag coefficient d (N·s²/rad²).
        drag: Parameter {
            key: "damping_n_s2_per_rad2",
            symbol: "d",
            unit: Unit::NewtonSecond2PerRad2,
            lower: 0.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[0.02, 0.2],
        },
    }
}

impl<R: Real> Mechanism<R> for QuadraticDamping<R> {
    fn force(&self, at: &Instant<R>, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        self.drag * at.rate * at.rate.abs()
    }

    fn fastest_rate(&self, dynamics: &Dynamics<R>, angle: R) -> Rates<R> {
        // The rate is not known here; a swing through the whole range at the
        // base model's own frequency bounds it well enough for a step length.
        let one = R::one();
        let swing = angle + one;
        Rates {
            stiffness: R::zero(),
            relaxation: self.drag * swing / dynamics.inertia,
        }
    }
}

impl Preparation for QuadraticDamping<f32> {
    const CYCLES: u16 = 2_200;
    type Part = Drag;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[0.08]);

    fn prepare(&self, base: &Base) -> Self::Part {
        Drag {
            per_way: self.drag / base.model.dynamics().inertia,
        }
    }

    fn brakes(&self, dynamics: &Dynamics<f32>, farthest: f32) -> Option<f32> {
        Some(self.fastest_rate(dynamics, farthest).relaxation)
    }
}

/// Drag in closed form: the flow ẋ = −c·x − (d/M)·x·|x|/A leaves B·x/(1 + u) of a rate, and its
/// way is x·ln(1 + u)/u, with u = (d/M)·|x|.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drag {
    /// d/M: the share of a way that it takes, per way (1/rad).
    per_way: f32,
}

impl Part for Drag {
    fn phases(&self) -> Phases {
        Phases::BEFORE
    }

    #[inline(always)]
    fn before(&self, step: &mut Step, _memory: &mut Hidden<f32>) -> f32 {
        let more = step.moved.abs() * self.per_way;
        let lost = more / (1.0 + more);
        step.moved -= step.moved
            * if more.to_bits() < SMALL {
                lost * 0.5
            } else {
                1.0 - ln(1.0 + more) / more
            };
        lost
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    /// Without spring and viscous damping, M ω̇ = −d ω² has the closed form
    /// θ(t) = (M/d) ln(1 + ω₀ d t/M).
    #[test]
    fn coasting_follows_its_logarithm() {
        let (inertia, drag, rate) = (0.7, 0.4, 3.0);
        let damping = Kind::QuadraticDamping.build(&[drag]).unwrap();
        let model = spring(inertia, 0.0, 0.0, &[damping]);
        let end = run(&model, model.moving(0.0, rate, 0.0), &Held(0.0), 2.0, 2_000);
        let expected = inertia / drag * (rate * drag * 2.0 / inertia).ln_1p();
        assert!(
            (end.angle - expected).abs() < 1e-9,
            "{}",
            end.angle - expected
        );
    }

    #[test]
    fn force_is_odd_in_the_rate() {
        let damping = Kind::QuadraticDamping.build(&[0.4]).unwrap();
        let force = |rate| crate::effects::testing::force(&damping, 0.0, rate);
        assert!((force(-2.0) + 1.6).abs() < 1e-12);
        assert!((force(2.0) - 1.6).abs() < 1e-12);
    }
}
