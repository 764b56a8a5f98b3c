//! Bouc–Wen hysteresis: Q = a w, D ẇ = ω − ½|ω|w − B ω|w|.
//!
//! Every term has one factor of ω, so the loop depends on the way and not on the
//! speed; below D it is a spring a/D. Unloading is steeper than loading for every
//! B, so a closed loop takes energy.
//!
//! Bouc (1967) and Wen (J. Eng. Mech. 102, 1976), with exponent 1, β = ½ and
//! γ = B. β is no parameter: a, D and β scale each other.

use super::{
    Family, Hidden, Info, Instant, Mechanism, Need, Parameter, Place, Rest, State, Unit, parameters,
};
use crate::catalogue::Kind;
use crate::dynamics::{Dynamics, Rates};
use crate::elementary::MODERATE;
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, Step};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "bouc_wen_hysteresis",
    title: "hysteresis (Bouc–Wen)",
    place: Place::Force,
    equation: "Q = a w, D ẇ = ω − ½|ω|w − B ω|w|",
    text: "Loading and unloading paths differ however slow the motion: filled rubber, fibres that \
           slide in the wall, layers that shift. After each reversal the force first acts like a \
           spring, then like a friction of a/(½ + B); the loop does not \
           shrink as the cycle slows. The shape B makes its ends round or pointed; at −½ and \
           below, the force grows as far as the actuator bends (Bouc 1967, Wen 1976, with β = ½ \
           and γ = B).",
    signature: "angle since the last reversal",
    look_alikes: &["coulomb_friction", "input_backlash", "maxwell_branch"],
    family: Family::DryFriction,
    needs: &[Need::Return],
    own_variable: None,
    special_case: Some(Kind::CoulombFriction),
    imitates: &[Kind::CoulombFriction],
    told_by: &[],
    doubtful: &[],
    has_slope: true,
    states: &[State {
        key: "hysteresis",
        text: "w, share of the loop",
    }],
};

parameters! {
    /// Bouc–Wen hysteresis.
    ///
    /// w is the share of the loop, ω the angular rate (rad/s). Along the way, with w > 0, loading
    /// has the slope D dw/dθ = 1 − (½ + B)w and unloading 1 + (½ − B)w. So
    ///
    /// - for B > −½ loading ends at w = 1/(½ + B): the largest force is a/(½ + B), which is a
    ///   itself for B = ½;
    /// - for B = ½ it loads along 1 − e^(−θ/D) and unloads along a straight line of slope 1/D; for
    ///   smaller B unloading is steeper than that, for larger B it bends the other way and the loop
    ///   is thin;
    /// - for B ≤ −½ loading does not end: it goes on along a straight line (B = −½) or stiffens,
    ///   and nothing but the range of the angle bounds the force.
    ///
    /// ẇ has corners at ω = 0 and w = 0. w is stiff where D is small: its rate is |ω|/D.
    BoucWenHysteresis {
        /// Force a of the loop (N); the largest is a/(½ + B).
        force: Parameter {
            key: "force_n",
            symbol: "a",
            unit: Unit::Newton,
            lower: 0.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
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
            default: None,
            starts: &[0.03, 0.2],
        },
        /// Shape B of the loop (dimensionless), Wen's γ beside β = ½.
        shape: Parameter {
            key: "shape",
            symbol: "B",
            unit: Unit::One,
            lower: -1.0,
            upper: 1.0,
            held: None,
            // The only shape of earlier model files.
            default: Some(0.5),
            starts: &[0.5, 0.0],
        },
    }
}

impl<R: Real> BoucWenHysteresis<R> {
    /// ½ + B; where no end bounds the loop, an eighth.
    fn end(&self) -> R {
        (R::half() + self.shape).max(R::from_f32(0.125))
    }
}

impl<R: Real> Mechanism<R> for BoucWenHysteresis<R> {
    fn integrates(&self) -> bool {
        true
    }

    /// A run starts with w = 0, as if the actuator had been worked loose. A piece that was cut out
    /// of a longer run starts on its loop, at w = tanh((½ + B) x/D)/(½ + B), with the way x from
    /// where w was zero: nearly the loading curve, and smooth, since x has to be estimated.
    fn at_rest(&self, rest: &Rest<R>) -> Hidden<R> {
        let way = (rest.start - rest.angle) / self.yield_angle;
        [(self.end() * way).tanh() / self.end(), R::zero()]
    }

    fn force(&self, at: &Instant<R>, hidden: &Hidden<R>, rates: &mut Hidden<R>) -> R {
        let [w, _] = *hidden;
        let fading = at.rate.abs() * w * R::half() + at.rate * w.abs() * self.shape;
        rates[0] = (at.rate - fading) / self.yield_angle;
        self.force * w
    }

    fn winds(&self, angle: R) -> Option<[R; 2]> {
        // The rate is not known here; as for quadratic damping, a swing through
        // the whole range bounds it well enough for a step length.
        let swing = (angle + R::one()) * R::half();
        let relaxation = swing * (R::half() + self.shape.abs()) / self.yield_angle;
        Some([swing, relaxation])
    }

    fn fastest_rate(&self, dynamics: &Dynamics<R>, angle: R) -> Rates<R> {
        // Unloading from the end of the loop is the steepest: 1/(½ + B) times
        // the slope at w = 0. Where no end bounds the loop, eight times.
        let steepest = (R::one() / self.end()).max(R::one());
        Rates {
            stiffness: self.force * steepest / (self.yield_angle * dynamics.inertia),
            relaxation: self.winds(angle).map_or(R::zero(), |[_, it]| it),
        }
    }
}

impl Preparation for BoucWenHysteresis<f32> {
    const CYCLES: u16 = 2_400;
    type Part = Loop;
    #[cfg(test)]
    const TRIAL: Trial = Trial::with_corner(&[0.2, 0.05, 0.5], 0.02);

    fn prepare(&self, base: &Base) -> Self::Part {
        Loop {
            force: self.force * base.leapfrog.per_newton(),
            per_yield: 1.0 / self.yield_angle,
            onwards: 0.5 + self.shape,
            back: 0.5 - self.shape,
        }
    }

    fn recall(&self, _base: &Base, _step: &Step, hidden: Hidden<f32>, memory: &mut Hidden<f32>) {
        memory[0] = hidden[0];
    }
}

/// The loop in yield angles; it remembers w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loop {
    /// γ·a (rad).
    force: f32,
    /// 1/D (1/rad).
    per_yield: f32,
    /// ½ + B, the rate of its exponential away from zero.
    onwards: f32,
    /// ½ − B, the rate back to it.
    back: f32,
}

impl Part for Loop {
    fn phases(&self) -> Phases {
        Phases::AFTER
    }

    #[inline(always)]
    fn force(&self, _base: &Base, step: &mut Step, memory: &mut Hidden<f32>) -> f32 {
        let way = step.moved * self.per_yield;
        memory[0] = wound(memory[0], way, self.onwards, self.back);
        self.force * memory[0]
    }
}

/// A Bouc–Wen loop after a way of `sigma` yield angles.
#[inline]
fn wound(w: f32, sigma: f32, onwards: f32, back: f32) -> f32 {
    let against = w.is_sign_negative() != sigma.is_sign_negative();
    let end = loaded(w, sigma, if against { back } else { onwards });
    if against && w.is_sign_negative() != end.is_sign_negative() {
        // What is left of the way beyond zero, along a straight line.
        return loaded(0.0, sigma * (end / (end - w)), onwards);
    }
    end
}

/// w after dw = (1 − c·w·sign σ)·dσ: w + (σ − z·w)·(1 − e^(−z))/z with z = c·|σ|. By its series
/// within 7·10⁻⁴ up to ¼, beyond by a rational approximation of the exponential that is
/// stable for any z (Padé 1/2).
fn loaded(w: f32, sigma: f32, c: f32) -> f32 {
    let z = Real::max(c * sigma.abs(), -1.0);
    let share = if z.abs().to_bits() < MODERATE {
        1.0 - z * (0.5 - z * (1.0 / 6.0))
    } else {
        (6.0 + z) / (6.0 + z * (4.0 + z))
    };
    w + (sigma - z * w) * share
}

#[cfg(test)]
mod tests {
    use crate::actuator::State;
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::effects::{Instant, Mechanism, Motion};
    use crate::input::Held;

    const YIELD: f64 = 0.2;

    /// The same for the shape ½.
    fn after(state: State<f64>, rate: f64, way: f64) -> State<f64> {
        after_shape(0.5, state, rate, way)
    }

    /// w after a free mass, too heavy to feel the loop, went `way` at `rate`.
    fn after_shape(shape: f64, mut state: State<f64>, rate: f64, way: f64) -> State<f64> {
        let values = [1e-12, YIELD, shape];
        let effect = Kind::BoucWenHysteresis.build(&values).unwrap();
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

    /// The state that is estimated where a recording begins on the loop: none where it has
    /// settled, along the loading curve near it, at the end of the loop far from it.
    #[test]
    fn a_past_is_a_place_on_the_loop() {
        let effect = Kind::BoucWenHysteresis.build(&[1.0, YIELD, 0.25]).unwrap();
        let model = spring(1.0, 0.0, 0.0, &[effect]);
        let end = 1.0 / 0.75;
        let at = |way: f64| {
            let motion = Motion {
                angle: 0.4,
                rate: 0.0,
            };
            model.coming_from(0.4 - way, motion, 0.0).hidden[0][0]
        };
        assert!((at(0.0) - model.at_rest(0.4, 0.0).hidden[0][0]).abs() < 1e-15);
        let little = 1e-4 * YIELD;
        assert!((at(little) / 1e-4 - 1.0).abs() < 1e-6);
        assert!((at(-little) + at(little)).abs() < 1e-12);
        assert!((at(40.0 * YIELD) - end).abs() < 1e-9);
    }

    #[test]
    fn loop_does_not_depend_on_the_speed() {
        let end = |rate: f64| {
            let there = after(at_zero(), rate, 0.5);
            after(there, -rate, -0.3).hidden[0][0]
        };
        assert!((end(5.0) - end(0.01)).abs() < 1e-9);
    }

    #[test]
    fn loading_ends_at_one_over_a_half_plus_the_shape() {
        for shape in [1.0, 0.5, 0.0, -0.25] {
            let end = 1.0 / (0.5 + shape);
            let way = 40.0 * YIELD * end;
            let there = after_shape(shape, at_zero(), 0.7, way).hidden[0][0];
            let back = after_shape(shape, at_zero(), -0.7, -way).hidden[0][0];
            assert!((there - end).abs() < 1e-9, "{shape}: {there}");
            assert!((back + end).abs() < 1e-9, "{shape}: {back}");
        }
        // Without an end: a straight line, and an exponential.
        let straight = after_shape(-0.5, at_zero(), 0.7, 0.8).hidden[0][0];
        assert!((straight - 0.8 / YIELD).abs() < 1e-9);
        let stiffening = after_shape(-1.0, at_zero(), 0.7, 0.8).hidden[0][0];
        let expected = 2.0 * (f64::exp(0.5 * 0.8 / YIELD) - 1.0);
        assert!((stiffening - expected).abs() < 1e-8, "{stiffening}");
    }

    #[test]
    fn unloading_follows_its_own_exponential() {
        for shape in [1.0, 0.25, 0.0, -0.4, -0.8] {
            let loaded = after_shape(shape, at_zero(), 0.7, 0.3);
            let w = loaded.hidden[0][0];
            let unloaded = after_shape(shape, loaded, -0.7, -0.05).hidden[0][0];
            // D dw/dθ = 1 + b w, backwards.
            let b = 0.5 - shape;
            let expected = ((1.0 + b * w) * f64::exp(-b * 0.05 / YIELD) - 1.0) / b;
            assert!((unloaded - expected).abs() < 1e-9, "{shape}: {unloaded}");
        }
    }

    /// The same rate to the last bit as the formula of the files that had no
    /// shape.
    #[test]
    fn shape_of_one_half_is_the_loop_of_earlier_files() {
        let effect = Kind::BoucWenHysteresis.build(&[0.3_f32, 0.1, 0.5]).unwrap();
        for (rate, w) in [(0.7, 0.3), (-0.2, 0.91), (1.3, -0.77), (-3.1, -0.013)] {
            let at = Instant {
                time: 0.0,
                angle: 0.2,
                rate,
                pressure: 0.0,
            };
            let mut rates = [0.0; 2];
            let force = effect.force(&at, &[w, 0.0], &mut rates);
            let before: f32 = (rate - (rate.abs() * w + rate * w.abs()) * 0.5) / 0.1;
            assert_eq!(rates[0].to_bits(), before.to_bits());
            assert_eq!(force.to_bits(), (0.3 * w).to_bits());
        }
    }
}
