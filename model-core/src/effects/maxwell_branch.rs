//! Maxwell branch: Q = k₁ (θ − z), ż = (θ − z)/τ.
//!
//! A spring k₁ (N/rad) in series with a dashpot k₁τ, in parallel with the base
//! spring: the standard linear solid, the simplest model of viscoelastic
//! creep. z (rad) is the dashpot's extension, τ (s) its time constant.

use super::{Hidden, Info, Instant, Mechanism, Parameter, Place, Rest, Unit, parameters};
use crate::carried::Branch;
use crate::dynamics::{Dynamics, Rates};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, Step};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "maxwell_branch",
    title: "viscoelastic creep (Maxwell branch)",
    place: Place::Force,
    equation: "Q = k₁ (θ − z), ż = (θ − z)/τ",
    text: "The elastomer creeps: a part of its stiffness relaxes with a time constant of seconds. \
           After a pressure step the angle does not settle but goes on growing \
           slowly at constant pressure, and after the release it returns slowly.",
    signature: "time since the last command edge",
    look_alikes: &["stiffness_drift", "mullins_softening", "sensor_drift"],
};

parameters! {
    /// Maxwell branch.
    MaxwellBranch {
        /// Stiffness k₁ of the branch (N/rad).
        stiffness: Parameter {
            key: "stiffness_n_per_rad",
            symbol: "k₁",
            unit: Unit::NewtonPerRad,
            lower: 0.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[0.2],
        },
        /// Time constant τ (s).
        time_constant: Parameter {
            key: "time_constant_s",
            symbol: "τ",
            unit: Unit::Second,
            lower: 0.01,
            upper: 1000.0,
            held: None,
            default: None,
            starts: &[0.5, 3.0, 15.0],
        },
    }
}

impl<R: Real> Mechanism<R> for MaxwellBranch<R> {
    fn integrates(&self) -> bool {
        true
    }

    fn at_rest(&self, rest: &Rest<R>) -> Hidden<R> {
        [rest.angle, R::zero()]
    }

    fn force(&self, at: &Instant<R>, hidden: &Hidden<R>, rates: &mut Hidden<R>) -> R {
        let extension = at.angle - hidden[0];
        rates[0] = extension / self.time_constant;
        self.stiffness * extension
    }

    fn fastest_rate(&self, dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        Rates {
            stiffness: self.stiffness / dynamics.inertia,
            relaxation: R::one() / self.time_constant,
        }
    }
}

impl Preparation for MaxwellBranch<f32> {
    const CYCLES: u16 = 1_000;
    type Part = Relaxing;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[0.5, 0.4]);

    fn prepare(&self, base: &Base) -> Self::Part {
        Relaxing(Branch::new(
            self.stiffness * base.leapfrog.per_newton(),
            self.time_constant,
            base.flow.dt,
        ))
    }

    fn recall(&self, base: &Base, step: &Step, hidden: Hidden<f32>, memory: &mut Hidden<f32>) {
        let extension = step.angle - hidden[0];
        memory[0] = self.stiffness * base.leapfrog.per_newton() * extension;
    }
}

/// The branch; it remembers its force (rad of way).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relaxing(Branch<f32>);

impl Part for Relaxing {
    fn phases(&self) -> Phases {
        Phases::AFTER
    }

    #[inline(always)]
    fn force(&self, _base: &Base, step: &mut Step, memory: &mut Hidden<f32>) -> f32 {
        self.0.carry(&mut memory[0], step.moved);
        memory[0]
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    /// With a damping that outweighs the inertia the standard linear solid
    /// creeps from F/(K + k₁) to F/K with the retardation time
    /// τ (K + k₁)/K.
    #[test]
    fn creep_under_constant_force_follows_the_standard_linear_solid() {
        let (stiffness, branch, tau) = (2.0, 1.0, 4.0);
        let maxwell = Kind::MaxwellBranch.build(&[branch, tau]).unwrap();
        let model = spring(1e-4, 0.01, stiffness, &[maxwell]);
        let retardation = tau * (stiffness + branch) / stiffness;
        for time in [1.0, 3.0, 10.0] {
            let end = run(&model, model.at_rest(0.0, 0.0), &Held(1.0), time, 200_000);
            let glassy = 1.0 / (stiffness + branch);
            let relaxed = 1.0 / stiffness;
            let expected = relaxed + (glassy - relaxed) * f64::exp(-time / retardation);
            // The damper of the base adds a lag of about C/K.
            assert!(
                (end.angle - expected).abs() < 3e-4,
                "{time}: {}",
                end.angle - expected
            );
        }
    }

    #[test]
    fn long_rest_leaves_no_force() {
        let maxwell = Kind::MaxwellBranch.build(&[5.0, 4.0]).unwrap();
        let model = spring(1.0, 0.1, 2.0, &[maxwell]);
        assert!((model.holding_pressure(0.8) - 1.6).abs() < 1e-12);
    }
}
