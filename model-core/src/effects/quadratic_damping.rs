//! Quadratic damping: Q = d ω|ω|.
//!
//! d (N·s²/rad²) collects drag in air or water and the pressure drop of a
//! turbulent flow that the motion drives through an orifice; ω is the angular
//! rate (rad/s).

use super::{Hidden, Info, Instant, Mechanism, Parameter, Place, Unit, parameters};
use crate::dynamics::{Dynamics, Rates};
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
