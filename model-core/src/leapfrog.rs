//! Leapfrog with exact damping: one power a step and no division.
//!
//! Runge–Kutta's four evaluations cost 35 000 cycles on the board, and no model runs at 1 kHz.
//! The equation of motion is a damped drift that is solved exactly, between kicks by the forces
//! (Strang splitting, order 2). At rest the way is 0 and the forces balance: static equilibria
//! are exact for any step, and so is the decay of the rate by damping alone, however strong.
//!
//! Linear memories (a tube, a Maxwell branch) are carried beside it ([`crate::carried`]), their
//! forces added to the kick by [`crate::prepared`]; the order stays two.

use crate::dynamics::Dynamics;
use crate::power::{Power, signed_power};
use crate::power_table::PowerTable;
use crate::real::Real;

/// What a spring takes from the way of the next drift: γ·K·sign(θ)|θ|ⁿ (rad).
pub trait Pull<R> {
    /// At an angle (rad).
    fn pull(&self, angle: R) -> R;
}

impl Pull<f32> for PowerTable {
    #[inline]
    fn pull(&self, angle: f32) -> f32 {
        self.at(angle)
    }
}

/// The pull by a power function of any base and exponent: the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accurate<R, P> {
    scale: R,
    exponent: R,
    power: core::marker::PhantomData<P>,
}

impl<R: Real, P: Power<R>> Accurate<R, P> {
    /// `scale`·sign(θ)|θ|^`exponent`.
    pub const fn new(scale: R, exponent: R) -> Self {
        Self {
            scale,
            exponent,
            power: core::marker::PhantomData,
        }
    }
}

impl<R: Real, P: Power<R>> Pull<R> for Accurate<R, P> {
    fn pull(&self, angle: R) -> R {
        self.scale * signed_power::<R, P>(angle, self.exponent)
    }
}

/// Where an actuator is, and how far it will drift in the next step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drift<R> {
    /// Bending angle (rad).
    pub angle: R,
    /// Way of the next drift (rad), the kick at this angle in it.
    way: R,
}

/// The base equation, prepared for steps of one length. Its spring is kept beside it
/// ([`Pull`]), made from [`Leapfrog::pull_scale`] and the exponent.
///
/// ```text
/// ω ← ω + (h/2M)·F      kick        F = g·p − K·sign(θ)|θ|ⁿ
/// θ ← θ + A·ω           drift       A = (1 − B)·M/C
/// ω ← B·ω                           B = e^(−C·h/M)
/// ω ← ω + (h/2M)·F      kick, at the new angle and pressure
/// ```
///
/// The second kick of a step and the first of the next are one and the same force. So the state
/// carries the way of the next drift, with that kick in it, and a step is two multiplications,
/// three additions and one power:
///
/// ```text
/// θ ← θ + way
/// way ← B·way + (γ·g·p − γ·K·sign(θ)|θ|ⁿ)      γ = h·A/M
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leapfrog<R> {
    /// B: what damping leaves of a rate after a step.
    keep: R,
    /// A: way of a rate of one in a step (s).
    reach: R,
    /// γ: what a force adds to the way (rad/N).
    per_newton: R,
    /// γ·g: what a pressure adds to the way (rad/Pa).
    push: R,
    /// γ·K (rad).
    pull_scale: R,
}

impl<R: Real> Leapfrog<R> {
    /// Nothing that moves.
    #[inline]
    pub(crate) fn empty() -> Self {
        let zero = R::zero();
        Self {
            keep: zero,
            reach: zero,
            per_newton: zero,
            push: zero,
            pull_scale: zero,
        }
    }

    /// Prepares steps of `dt` seconds.
    pub fn new(dynamics: &Dynamics<R>, dt: R) -> Self {
        let decay = dynamics.damping * dt / dynamics.inertia;
        let keep = (-decay).exp();
        // Where next to nothing is damped, the difference 1 − B has no digits left.
        let reach = if decay > R::from_f32(0.01) {
            (R::one() - keep) * dynamics.inertia / dynamics.damping
        } else {
            let sixth = R::one() / R::from_i16(6);
            dt * (R::one() - decay * (R::half() - decay * sixth))
        };
        let per_newton = dt * reach / dynamics.inertia;
        Self {
            keep,
            reach,
            per_newton,
            push: per_newton * dynamics.input_gain,
            pull_scale: per_newton * dynamics.stiffness,
        }
    }

    /// An actuator at an angle (rad) with a rate (rad/s) under a pressure (Pa).
    #[inline(always)] // LLVM for the AVR loses arguments on the stack (llvm#163015).
    pub fn at(&self, spring: &impl Pull<R>, angle: R, rate: R, pressure: R) -> Drift<R> {
        Drift {
            angle,
            way: self.way(rate) + self.kick(spring, angle, pressure) * R::half(),
        }
    }

    /// Steps to the next sample, whose pressure (Pa) this is.
    #[inline(always)]
    pub fn step(&self, spring: &impl Pull<R>, drift: &mut Drift<R>, pressure: R) {
        drift.angle += drift.way;
        drift.way = self.kept(drift.way) + self.kick(spring, drift.angle, pressure);
    }

    /// B·way: what damping leaves of a way (rad) for the next drift.
    #[inline]
    pub fn kept(&self, way: R) -> R {
        way * self.keep
    }

    /// A: the way of a rate of one in a step (s).
    pub fn reach(&self) -> R {
        self.reach
    }

    /// γ: what a force of 1 N adds to the way of the next drift (rad/N).
    pub fn per_newton(&self) -> R {
        self.per_newton
    }

    /// γ·K: what a [`Pull`] is scaled by (rad).
    pub fn pull_scale(&self) -> R {
        self.pull_scale
    }

    /// What the pressure (Pa) adds to the way of the next drift (rad).
    #[inline]
    pub fn push(&self, pressure: R) -> R {
        pressure * self.push
    }

    /// The way of a step (rad) that begins with this rate (rad/s).
    pub fn way(&self, rate: R) -> R {
        rate * self.reach
    }

    /// The rate (rad/s) at a sample whose kick (rad) this is.
    pub fn rate_under(&self, way: R, kick: R) -> R {
        (way - kick * R::half()) / self.reach
    }

    /// The rate (rad/s) at a sample with this pressure (Pa).
    #[inline(always)] // LLVM for the AVR loses arguments on the stack (llvm#163015).
    pub fn rate(&self, spring: &impl Pull<R>, drift: &Drift<R>, pressure: R) -> R {
        self.rate_under(drift.way, self.kick(spring, drift.angle, pressure))
    }

    #[inline(always)]
    fn kick(&self, spring: &impl Pull<R>, angle: R, pressure: R) -> R {
        self.push(pressure) - spring.pull(angle)
    }
}

/// The largest phase of a step (rad) that [`substeps`] is content with: it keeps the angle
/// within 0.013° over ten seconds of steps of pressure.
pub const PHASE: f32 = 0.03;

/// The largest phase of a step (rad) that still follows an oscillation: its frequency is
/// off by (0.3)²/24, 0.4 %.
pub const COARSEST_PHASE: f32 = 0.3;

/// Steps into which a sampling interval (s) is cut for motions as fast as `frequency`
/// (rad/s) that decay at `decay` (1/s): each at most `phase` (rad) and half a time constant
/// of the decay. Damping is exact however strong, but a force that holds against it is
/// felt only once a step.
///
/// At least 1, at most 255.
///
/// The relative frequency error of an oscillation of ω₀ with steps of h is the usual (ω₀h)²/24.
pub fn substeps(frequency: f32, decay: f32, interval: f32, phase: f32) -> u8 {
    /// Time constants of the damping in a step.
    const DAMPED: f32 = 0.5;
    let needed = (interval * frequency / phase).max(interval * decay / DAMPED);
    // In range by the comparison.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    if needed < 254.0 {
        let whole = needed as u8;
        whole + u8::from(f32::from(whole) < needed).max(u8::from(whole == 0))
    } else {
        255
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuator::{Model, State};
    use crate::carried::{Branch, Lag};
    use crate::catalogue::{Effect, Kind};
    use crate::input::{Held, Input};
    use crate::integrate::{Scheme, step};
    use crate::power::{Exact, Minimax};

    /// A pressure (Pa) and its slope (Pa/s).
    struct Line(f64, f64);

    impl Input<f64> for Line {
        fn pressure(&self, offset: f64) -> f64 {
            self.0 + self.1 * offset
        }
    }

    fn lively<R: Real>() -> Dynamics<R> {
        Dynamics {
            inertia: R::from_f32(0.01),
            damping: R::from_f32(0.05),
            stiffness: R::from_f32(1.0),
            exponent: R::from_f32(1.5),
            input_gain: R::from_f32(1e-5),
        }
    }

    fn accurate(dynamics: &Dynamics<f64>, dt: f64) -> (Leapfrog<f64>, Accurate<f64, Exact>) {
        let leapfrog = Leapfrog::new(dynamics, dt);
        let spring = Accurate::new(leapfrog.pull_scale(), dynamics.exponent);
        (leapfrog, spring)
    }

    /// Angle and rate after `seconds` under a steady pressure, by steps of `dt`.
    fn run(dynamics: &Dynamics<f64>, dt: f64, steps: u32, pressure: f64) -> [f64; 2] {
        let (leapfrog, spring) = accurate(dynamics, dt);
        let mut drift = leapfrog.at(&spring, 0.9, 0.5, pressure);
        for _ in 0..steps {
            leapfrog.step(&spring, &mut drift, pressure);
        }
        [drift.angle, leapfrog.rate(&spring, &drift, pressure)]
    }

    /// The same by Runge–Kutta with short steps.
    fn reference(dynamics: &Dynamics<f64>, seconds: f64, pressure: f64) -> [f64; 2] {
        const STEPS: u32 = 20_000;
        let none: [Effect<f64>; 0] = [];
        let model: Model<f64> = Model::new(*dynamics, &none).unwrap();
        let mut state: State<f64> = model.moving(0.9, 0.5, pressure);
        let dt = seconds / f64::from(STEPS);
        for _ in 0..STEPS {
            step(Scheme::Rk4, &model, &mut state, &Held(pressure), dt);
        }
        [state.angle, state.rate]
    }

    #[test]
    fn order_two_in_angle_and_rate() {
        let dynamics = lively();
        let pressure = 60_000.0;
        let truth = reference(&dynamics, 0.8, pressure);
        let errors = [100_u32, 200, 400].map(|steps| {
            let found = run(&dynamics, 0.8 / f64::from(steps), steps, pressure);
            [0, 1].map(|k| (found[k] - truth[k]).abs())
        });
        for pair in errors.windows(2) {
            for (coarse, fine) in pair[0].iter().zip(&pair[1]) {
                let order = (coarse / fine).log2();
                assert!((order - 2.0).abs() < 0.1, "{order}: {errors:?}");
            }
        }
    }

    /// A tube before the chamber and a Maxwell branch beside the spring, carried over the
    /// steps, against Runge–Kutta with the effects of the catalogue.
    #[test]
    fn order_two_with_carried_memories() {
        const SECONDS: f64 = 0.8;
        let dynamics = lively::<f64>();
        let (tube, branch) = (0.05, [0.4, 0.3, 0.0]);
        let pressure = |time: f64| 50_000.0 + 40_000.0 * (6.0 * time).sin();
        let effects = [
            Kind::PneumaticLag.build(&[tube]).unwrap(),
            Kind::MaxwellBranch.build(&branch).unwrap(),
        ];
        let model: Model<f64> = Model::new(dynamics, &effects).unwrap();
        let mut truth = model.moving(0.9, 0.5, pressure(0.0));
        let count = 20_000;
        for k in 0..count {
            let dt = SECONDS / f64::from(count);
            let [p0, p1] = [k, k + 1].map(|k| pressure(dt * f64::from(k)));
            step(
                Scheme::Rk4,
                &model,
                &mut truth,
                &Line(p0, (p1 - p0) / dt),
                dt,
            );
        }
        let errors = [100_u32, 200, 400].map(|steps| {
            let dt = SECONDS / f64::from(steps);
            let (leapfrog, spring) = accurate(&dynamics, dt);
            let lag = Lag::new(tube, dt);
            let [stiffness, time_constant, _] = branch;
            let maxwell = Branch::new(stiffness * leapfrog.per_newton(), time_constant, dt);
            let mut chamber = pressure(0.0);
            let mut relaxing = 0.0;
            let mut drift = leapfrog.at(&spring, 0.9, 0.5, chamber);
            for k in 0..steps {
                let [p0, p1] = [k, k + 1].map(|k| pressure(dt * f64::from(k)));
                lag.carry(&mut chamber, p0, p1);
                maxwell.carry(&mut relaxing, drift.way);
                drift.angle += drift.way;
                let kick = leapfrog.kick(&spring, drift.angle, chamber) - relaxing;
                drift.way = leapfrog.kept(drift.way) + kick;
            }
            (drift.angle - truth.angle).abs()
        });
        for pair in errors.windows(2) {
            let order = (pair[0] / pair[1]).log2();
            assert!((order - 2.0).abs() < 0.1, "{order}: {errors:?}");
        }
    }

    /// Whatever the step, at rest in balance nothing moves.
    #[test]
    fn static_equilibrium_is_exact() {
        let dynamics = lively::<f64>();
        let angle = 0.8_f64;
        let pressure = dynamics.stiffness * angle.powf(dynamics.exponent) / dynamics.input_gain;
        for dt in [1e-4, 1e-2, 0.1] {
            let (leapfrog, spring) = accurate(&dynamics, dt);
            let mut drift = leapfrog.at(&spring, angle, 0.0, pressure);
            for _ in 0..1000 {
                leapfrog.step(&spring, &mut drift, pressure);
            }
            assert!((drift.angle - angle).abs() < 1e-12, "{dt} s");
        }
    }

    /// Without a spring the rate decays as e^(−Ct/M), and so far does the actuator coast.
    #[test]
    fn damping_alone_is_exact_however_strong() {
        for damping in [1e-6, 0.05, 5.0, 500.0] {
            let dynamics = Dynamics {
                damping,
                stiffness: 0.0,
                ..lively::<f64>()
            };
            let (dt, steps) = (0.01, 30);
            let (leapfrog, spring) = accurate(&dynamics, dt);
            let mut drift = leapfrog.at(&spring, 0.2, 3.0, 0.0);
            for _ in 0..steps {
                leapfrog.step(&spring, &mut drift, 0.0);
            }
            let decay = damping / dynamics.inertia;
            let left = (-decay * dt * f64::from(steps)).exp();
            let coasted = 3.0 * -(-decay * dt * f64::from(steps)).exp_m1() / decay;
            assert!((leapfrog.rate(&spring, &drift, 0.0) - 3.0 * left).abs() < 1e-8);
            assert!((drift.angle - 0.2 - coasted).abs() < 1e-8, "{damping}");
        }
    }

    /// Undamped, the energy swings about its value and does not drift.
    #[test]
    fn energy_does_not_drift() {
        let dynamics = Dynamics {
            damping: 0.0,
            ..lively::<f64>()
        };
        let (leapfrog, spring) = accurate(&dynamics, 0.005);
        let mut drift = leapfrog.at(&spring, 0.9, 0.0, 0.0);
        let energy = |drift: &Drift<f64>| {
            let rate = leapfrog.rate(&spring, drift, 0.0);
            let n = dynamics.exponent + 1.0;
            0.5 * dynamics.inertia * rate * rate
                + dynamics.stiffness * drift.angle.abs().powf(n) / n
        };
        let start = energy(&drift);
        let mut largest = [0.0_f64; 2];
        for largest in &mut largest {
            for _ in 0..100_000 {
                leapfrog.step(&spring, &mut drift, 0.0);
                *largest = largest.max((energy(&drift) / start - 1.0).abs());
            }
        }
        assert!(largest[0] < 1e-3, "{largest:?}");
        assert!(largest[1] < 1.05 * largest[0], "{largest:?}");
    }

    /// Steps of pressure to 60° and 90° at the board's 10 ms, in the board's arithmetic,
    /// with as many steps in between as the rule asks for.
    #[test]
    fn as_near_to_the_truth_as_the_rule_of_substeps_says() {
        for exponent in [0.5_f32, 0.8, 1.0, 1.5, 2.0, 2.4, 3.0] {
            let dynamics = Dynamics {
                inertia: 0.05_f32,
                damping: 0.4,
                stiffness: 0.6,
                exponent,
                input_gain: 1e-5,
            };
            let interval = 0.01_f32;
            let steps = substeps(4.0, dynamics.damping / dynamics.inertia, interval, PHASE);
            let fast = Leapfrog::new(&dynamics, interval / f32::from(steps));
            let table = PowerTable::new(fast.pull_scale(), exponent);
            let wide = Dynamics {
                inertia: f64::from(dynamics.inertia),
                damping: f64::from(dynamics.damping),
                stiffness: f64::from(dynamics.stiffness),
                exponent: f64::from(exponent),
                input_gain: f64::from(dynamics.input_gain),
            };
            let (slow, exact) = accurate(&wide, f64::from(interval) / 200.0);
            let mut drift = fast.at(&table, 0.0, 0.0, 0.0);
            let mut truth = slow.at(&exact, 0.0, 0.0, 0.0);
            let mut worst = 0.0_f64;
            let mut before = 0.0_f32;
            for sample in 0..1000_u32 {
                let target = if sample < 500 { 60_f32 } else { 90.0 };
                let pressure = dynamics.stiffness * Minimax::pow(target.to_radians(), exponent)
                    / dynamics.input_gain;
                // A sensor's samples are joined by straight lines.
                let line = |part: f32| before + (pressure - before) * part;
                for k in 1..=steps {
                    fast.step(&table, &mut drift, line(f32::from(k) / f32::from(steps)));
                }
                for k in 1..=200_u8 {
                    slow.step(&exact, &mut truth, f64::from(line(f32::from(k) / 200.0)));
                }
                before = pressure;
                worst = worst.max((f64::from(drift.angle) - truth.angle).abs());
            }
            println!("n = {exponent}, {steps} steps: {:.4}°", worst.to_degrees());
            assert!(worst.to_degrees() < 0.02, "n = {exponent}");
        }
    }

    #[test]
    fn substeps_follow_the_faster_of_oscillation_and_decay() {
        assert_eq!(substeps(1.0, 5.0, 0.001, PHASE), 1);
        assert_eq!(substeps(30.0, 5.0, 0.01, PHASE), 10);
        assert_eq!(substeps(30.0, 5.0, 0.01, COARSEST_PHASE), 1);
        assert_eq!(substeps(1.0, 500.0, 0.01, PHASE), 10);
        assert_eq!(substeps(1e6, 5.0, 0.01, PHASE), 255);
        assert_eq!(substeps(f32::NAN, 5.0, 0.01, PHASE), 1);
    }
}
