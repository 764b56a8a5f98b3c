//! Bouc–Wen hysteresis: Q = a w, D ẇ = ω − ½|ω|w − ½ω|w|.
//!
//! a (N) is the largest force of the loop, D (rad) the way over which it builds
//! up, w the share of the loop (between −1 and 1), ω the angular rate (rad/s).
//! Bouc (1967) and Wen (J. Eng. Mech. 102, 1976), with β = γ = ½ and exponent 1,
//! which loads along 1 − e^(−θ/D) and unloads along a straight line of slope
//! 1/D. Every term has one factor of ω, so the loop depends on the way and not
//! on the speed; below D it is a spring a/D, beyond it a friction a.
//!
//! ẇ has corners at ω = 0 and w = 0. w is stiff where D is small: its rate is
//! |ω|/D. A run starts with w = 0, as if the actuator had been worked loose; a
//! piece that was cut out of a longer run starts so too, although its loop was
//! most likely at ±1, which is where this is weak.

use super::{Hidden, Info, Instant, Mechanism, Parameter, Place, Unit, parameters};
use crate::actuator::{Dynamics, Rates};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "bouc_wen_hysteresis",
    title: "hysteresis (Bouc–Wen)",
    place: Place::Force,
    equation: "Q = a w, D ẇ = ω − ½|ω|w − ½ω|w|",
    text: "The way back differs from the way there however slowly it is gone: filled rubber, \
           fibres that slide in the wall, layers that shift. After each reversal the actuator \
           first gives way like a spring, then like a friction; the loop does not shrink as the \
           cycle slows.",
    signature: "angle since the last reversal",
    look_alikes: &["coulomb_friction", "input_backlash", "maxwell_branch"],
};

parameters! {
    /// Bouc–Wen hysteresis.
    BoucWenHysteresis {
        /// Largest force a of the loop (N).
        force: Parameter {
            key: "force_n",
            symbol: "a",
            unit: Unit::Newton,
            lower: 0.0,
            upper: f32::INFINITY,
            held: None,
            starts: &[0.05, 0.2],
        },
        /// Angle D over which it builds up (rad).
        yield_angle: Parameter {
            key: "yield_rad",
            symbol: "D",
            unit: Unit::Radian,
            // 2⁻¹⁰ rad, a twentieth of a degree: finer is a friction.
            lower: 0.000_976_562_5,
            upper: 2.0,
            held: None,
            starts: &[0.03, 0.2],
        },
    }
}

impl<R: Real> Mechanism<R> for BoucWenHysteresis<R> {
    fn integrates(&self) -> bool {
        true
    }

    fn force(&self, at: &Instant<R>, hidden: &Hidden<R>, rates: &mut Hidden<R>) -> R {
        let [w, _] = *hidden;
        let fading = (at.rate.abs() * w + at.rate * w.abs()) * R::half();
        rates[0] = (at.rate - fading) / self.yield_angle;
        self.force * w
    }

    fn fastest_rate(&self, dynamics: &Dynamics<R>, angle: R) -> Rates<R> {
        // The rate is not known here; as for quadratic damping, a swing through
        // the whole range bounds it well enough for a step length.
        let swing = (angle + R::one()) * R::half();
        Rates {
            stiffness: self.force / (self.yield_angle * dynamics.inertia),
            relaxation: swing / self.yield_angle,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::actuator::State;
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    const YIELD: f64 = 0.2;

    /// w after a free mass, too heavy to feel the loop, went `way` at `rate`.
    fn after(mut state: State<f64>, rate: f64, way: f64) -> State<f64> {
        let effect = Kind::BoucWenHysteresis.build(&[1e-12, YIELD]).unwrap();
        let model = spring(1.0, 0.0, 0.0, &[effect]);
        state.rate = rate;
        run(&model, state, &Held(0.0), (way / rate).abs(), 4_000)
    }

    fn at_zero() -> State<f64> {
        let model = spring(1.0, 0.0, 0.0, &[]);
        model.at_rest(0.0, 0.0)
    }

    #[test]
    fn first_loading_is_an_exponential_and_unloading_a_straight_line() {
        let loaded = after(at_zero(), 0.7, 0.3);
        let w = 1.0 - f64::exp(-0.3 / YIELD);
        assert!((loaded.hidden[0][0] - w).abs() < 1e-10);

        let unloaded = after(loaded, -0.7, -0.1);
        assert!((unloaded.hidden[0][0] - (w - 0.1 / YIELD)).abs() < 1e-10);

        // Beyond zero it fades towards −1.
        let to_zero = after(loaded, -0.7, -w * YIELD);
        let reversed = after(to_zero, -0.7, -0.3);
        assert!((reversed.hidden[0][0] + 1.0 - f64::exp(-0.3 / YIELD)).abs() < 1e-8);
    }

    #[test]
    fn loop_does_not_depend_on_the_speed() {
        let end = |rate: f64| {
            let there = after(at_zero(), rate, 0.5);
            after(there, -rate, -0.3).hidden[0][0]
        };
        assert!((end(5.0) - end(0.01)).abs() < 1e-9);
    }
}
