//! Maxwell branch: Q = k₁ [(1 − s)(θ − z) + s(θ − z₂)], ż = (θ − z)/τ, ż₂ = (θ − z₂)/(10 τ).
//!
//! A spring k₁ (N/rad) in series with a dashpot k₁τ, in parallel with the base
//! spring: the standard linear solid, the simplest model of viscoelastic
//! creep. z (rad) is the dashpot's extension, τ (s) its time constant.
//!
//! Elastomers creep over decades of time, as a power of it. The share s of the stiffness
//! relaxes ten times more slowly: without it the branch is one exponential, with [`DECADES`]
//! it follows a power law over two decades and has as many parameters to find.

use super::{
    Family, Hidden, Info, Instant, Mechanism, Parameter, Place, Rest, State, Unit, parameters,
};
use crate::carried::Branch;
use crate::catalogue::Kind;
use crate::dynamics::{Dynamics, Rates};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, Step};
use crate::real::Real;

/// The share s of a creep over decades: two branches with time constants a decade apart
/// whose stiffnesses are as 1 to 10^(−α), as in a relaxation spectrum τ^(−α) with α = 0.2.
pub const DECADES: f32 = 0.387;

/// The time constant of the slow share, in multiples of τ.
const SLOWER: i16 = 10;

/// The square root of [`SLOWER`].
const CENTRE: f32 = 3.162_277_7;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "maxwell_branch",
    title: "viscoelastic creep (Maxwell branch)",
    place: Place::Force,
    equation: "Q = k₁ (θ − z), ż = (θ − z)/τ; share s: 10 τ",
    text: "The elastomer creeps: a part of its stiffness relaxes with a time constant of seconds. \
           After a pressure step the angle does not settle but goes on growing \
           slowly at constant pressure, and after the release it returns slowly. Many \
           elastomers do so over decades of time: with a slow share of 0.387 the branch follows \
           a power law, and `softrig diagnose` takes that where it leaves a tenth less.",
    signature: "time since the last command edge",
    look_alikes: &["stiffness_drift", "mullins_softening", "sensor_drift"],
    family: Family::Creep,
    needs: &[],
    own_variable: None,
    special_case: Some(Kind::LinearStiffness),
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: true,
    states: &[
        State {
            key: "relaxed_rad",
            text: "z, angle that has relaxed (rad)",
        },
        State {
            key: "slowly_relaxed_rad",
            text: "z₂, the slow share's (rad)",
        },
    ],
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
        /// Share s of the stiffness that relaxes ten times more slowly.
        slow_share: Parameter {
            key: "slow_share",
            symbol: "s",
            unit: Unit::One,
            lower: 0.0,
            upper: 1.0,
            held: Some(0.0),
            default: None,
            starts: &[],
        },
    }
}

impl<R: Real> MaxwellBranch<R> {
    /// The branch as a creep over decades about the same time constant, which is then the
    /// geometric mean of both.
    #[must_use]
    pub fn over_decades(self) -> Self {
        Self {
            time_constant: self.time_constant / R::from_f32(CENTRE),
            slow_share: R::from_f32(DECADES),
            ..self
        }
    }
}

impl<R: Real> Mechanism<R> for MaxwellBranch<R> {
    fn integrates(&self) -> bool {
        true
    }

    fn at_rest(&self, rest: &Rest<R>) -> Hidden<R> {
        [rest.angle; 2]
    }

    fn force(&self, at: &Instant<R>, hidden: &Hidden<R>, rates: &mut Hidden<R>) -> R {
        let [fast, slow] = hidden.map(|relaxed| at.angle - relaxed);
        *rates = [
            fast / self.time_constant,
            slow / (self.time_constant * R::from_i16(SLOWER)),
        ];
        self.stiffness * (fast + self.slow_share * (slow - fast))
    }

    fn fastest_rate(&self, dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        Rates {
            stiffness: self.stiffness / dynamics.inertia,
            relaxation: R::one() / self.time_constant,
        }
    }
}

impl Preparation for MaxwellBranch<f32> {
    const CYCLES: u16 = 1_500;
    type Part = Relaxing;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[0.5, 0.4, 0.3]);

    fn prepare(&self, base: &Base) -> Self::Part {
        let branch = |share: f32, time_constant: f32| {
            let stiffness = share * self.stiffness * base.leapfrog.per_newton();
            Branch::new(stiffness, time_constant, base.flow.dt)
        };
        let slower = f32::from(SLOWER) * self.time_constant;
        Relaxing {
            fast: branch(1.0 - self.slow_share, self.time_constant),
            slow: (self.slow_share > 0.0).then(|| branch(self.slow_share, slower)),
        }
    }

    fn recall(&self, base: &Base, step: &Step, hidden: Hidden<f32>, memory: &mut Hidden<f32>) {
        let shares = [1.0 - self.slow_share, self.slow_share];
        for ((force, relaxed), share) in memory.iter_mut().zip(hidden).zip(shares) {
            let stiffness = share * self.stiffness * base.leapfrog.per_newton();
            *force = stiffness * (step.angle - relaxed);
        }
    }
}

/// The branch and its slow share; each remembers its force (rad of way).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relaxing {
    fast: Branch<f32>,
    slow: Option<Branch<f32>>,
}

impl Part for Relaxing {
    fn phases(&self) -> Phases {
        Phases::AFTER
    }

    #[inline(always)]
    fn force(&self, _base: &Base, step: &mut Step, memory: &mut Hidden<f32>) -> f32 {
        let [fast, slow] = memory;
        self.fast.carry(fast, step.moved);
        let Some(branch) = &self.slow else {
            return *fast;
        };
        branch.carry(slow, step.moved);
        *fast + *slow
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
        let maxwell = Kind::MaxwellBranch.build(&[branch, tau, 0.0]).unwrap();
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

    /// A creep over decades relaxes as a power of time: over the two decades around its time
    /// constants the force at a held angle follows t^(−α), and one exponential does not.
    #[test]
    fn creep_over_decades_relaxes_as_a_power_of_time() {
        let stiffness = 1.0;
        let single = super::MaxwellBranch {
            stiffness,
            time_constant: 1.0,
            slow_share: 0.0,
        };
        // The largest departure of ln Q from a line over ln t, from τ/3 to 10 τ/3 of the
        // two time constants' geometric mean.
        let departure = |branch: &super::MaxwellBranch<f64>| {
            let points: Vec<[f64; 2]> = (-5..=5)
                .map(|k| {
                    let time = 10_f64.powf(0.1 * f64::from(k));
                    let slower = 10.0 * branch.time_constant;
                    let force = (1.0 - branch.slow_share) * (-time / branch.time_constant).exp()
                        + branch.slow_share * (-time / slower).exp();
                    [time.ln(), force.ln()]
                })
                .collect();
            let count = f64::from(u32::try_from(points.len()).unwrap());
            let [x, y] = [0, 1].map(|i| points.iter().map(|p| p[i]).sum::<f64>() / count);
            let slope = points.iter().map(|p| (p[0] - x) * (p[1] - y)).sum::<f64>()
                / points.iter().map(|p| (p[0] - x).powi(2)).sum::<f64>();
            points
                .iter()
                .map(|p| (p[1] - y - slope * (p[0] - x)).abs())
                .fold(0.0, f64::max)
        };
        let (one, two) = (departure(&single), departure(&single.over_decades()));
        assert!(two < 0.25 * one, "{two} beside {one}");
    }

    /// The slow share relaxes ten times later: under a held angle the force is the sum of
    /// two exponentials.
    #[test]
    fn a_held_angle_relaxes_in_two_exponentials() {
        use super::super::{Instant, Mechanism};
        let branch = super::MaxwellBranch {
            stiffness: 2.0,
            time_constant: 0.5,
            slow_share: 0.3,
        };
        let at = Instant {
            time: 0.0,
            angle: 0.8,
            rate: 0.0,
            pressure: 0.0,
        };
        let mut hidden = [0.0_f64; 2];
        let steps = 20_000;
        let dt = 3.0 / f64::from(steps);
        for _ in 0..steps {
            let mut rates = [0.0; 2];
            branch.force(&at, &hidden, &mut rates);
            for (state, rate) in hidden.iter_mut().zip(rates) {
                *state += dt * rate;
            }
        }
        let expected = 2.0 * 0.8 * (0.7 * (-6.0_f64).exp() + 0.3 * (-0.6_f64).exp());
        let force = branch.force(&at, &hidden, &mut [0.0; 2]);
        assert!((force / expected - 1.0).abs() < 1e-4, "{force}");
    }

    #[test]
    fn long_rest_leaves_no_force() {
        let maxwell = Kind::MaxwellBranch.build(&[5.0, 4.0, 0.3]).unwrap();
        let model = spring(1.0, 0.1, 2.0, &[maxwell]);
        assert!((model.holding_pressure(0.8) - 1.6).abs() < 1e-12);
    }
}
