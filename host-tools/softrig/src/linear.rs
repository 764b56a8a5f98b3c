//! A model for small motions about a rest: what controllers are designed with.
//!
//! At a rest θ₀ under the pressure that holds it, a small change of the pressure moves the reading of
//! the angle sensor as a linear system does. A friction or a play has no slope: motions smaller than
//! it do not happen at all. Such effects are left out and named, so that the system holds for
//! motions which are large beside them.

use model_core::actuator::{MAX_EFFECTS, Model, State};
use model_core::catalogue::{Effect, Kind};
use model_core::input::Held;
use nalgebra::{Complex, DMatrix, DVector, RowDVector};

use crate::sim::dual::Dual;

/// Most states of a model: angle, rate, and two of each effect.
const STATES: usize = 2 + 2 * MAX_EFFECTS;

/// The states, and the pressure.
const INPUTS: usize = STATES + 1;

type Slopes = Dual<INPUTS>;

/// Why there is no linear model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NotLinear {
    /// No pressure holds the actuator there.
    #[error("no pressure holds the actuator at that angle")]
    NothingHolds,
    /// The slope of the power law, or of an effect, is not finite there.
    #[error("the equations have no finite slope there, as a power law below 1 has none at 0°")]
    NoSlope,
}

/// A model for small motions about a rest.
///
/// ```text
/// x' = A x + B p,   y = C x,   x = (θ − θ₀, θ', hidden states of the effects)
/// G(s) = C (s I − A)⁻¹ B e^(−s·delay)
/// ```
///
/// A, B and C are derivatives of the model's own equations by dual numbers.
#[derive(Clone, Debug)]
pub struct Linear {
    /// The angle of the rest (rad).
    pub angle: f64,
    /// What the sensor shows there (rad).
    pub reading: f64,
    /// The pressure that holds it there (Pa).
    pub pressure: f64,
    /// Names of the states, with their units where they have one.
    pub states: Vec<String>,
    /// A (1/s and mixed units).
    pub dynamics: DMatrix<f64>,
    /// B, by the pressure (Pa).
    pub input: DVector<f64>,
    /// C, of the reading (rad).
    pub output: RowDVector<f64>,
    /// How late the pressure comes (s).
    pub delay: f64,
    /// Effects without a slope, which are left out.
    pub left_out: Vec<Kind>,
}

/// A pole of a linear model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pole {
    /// Its place (1/s).
    pub place: Complex<f64>,
}

impl Pole {
    /// Its natural frequency |s| (rad/s).
    pub fn natural_frequency(self) -> f64 {
        self.place.norm()
    }

    /// Its damping ratio −Re(s)/|s|: 1 for a decay without a swing, below 0 for a growth.
    pub fn damping_ratio(self) -> f64 {
        -self.place.re / self.place.norm().max(f64::MIN_POSITIVE)
    }
}

impl Linear {
    /// Of a model that rests at `angle` (rad).
    ///
    /// # Errors
    ///
    /// Where nothing holds the actuator, or the equations have no slope.
    pub fn at(model: &Model<f64>, angle: f64) -> Result<Self, NotLinear> {
        let (smooth, left_out) = smooth(model);
        let pressure = smooth.holding_pressure(angle);
        if !pressure.is_finite() {
            return Err(NotLinear::NothingHolds);
        }
        // Dual numbers take the slope there for none.
        let is_steep = smooth.shifted_exponent() < 1.0 && smooth.dynamics().stiffness > 0.0;
        if is_steep && angle.abs() < f64::MIN_POSITIVE {
            return Err(NotLinear::NoSlope);
        }
        let rest = smooth.at_rest(angle, pressure);
        let duals: Model<Slopes> = smooth.map(Dual::constant);
        let at = State {
            time: Dual::constant(rest.time),
            angle: Dual::variable(rest.angle, 0, 1.0),
            rate: Dual::variable(rest.rate, 1, 1.0),
            hidden: std::array::from_fn(|slot| {
                let hidden = rest.hidden[slot];
                std::array::from_fn(|k| Dual::variable(hidden[k], 2 + 2 * slot + k, 1.0))
            }),
        };
        let held = Held(Dual::variable(pressure, STATES, 1.0));
        let rates = duals.derivative(&at, &held, Dual::constant(0.0));
        let hidden = rates.hidden.iter().flatten().map(Dual::partials);
        let rows: Vec<[f64; INPUTS]> = [rates.rate.partials(), rates.acceleration.partials()]
            .into_iter()
            .chain(hidden)
            .collect();
        let shown = duals.reading(&at);
        // What has no rate is a memory of events, which small motions leave as it is.
        let moves = |place: &usize| *place < 2 || rows[*place].iter().any(|slope| *slope != 0.0);
        let places: Vec<usize> = (0..STATES).filter(moves).collect();
        let order = places.len();
        let this = Self {
            angle,
            reading: shown.value(),
            pressure,
            states: places.iter().map(|&place| name(&smooth, place)).collect(),
            dynamics: DMatrix::from_fn(order, order, |row, column| {
                rows[places[row]][places[column]]
            }),
            input: DVector::from_fn(order, |row, _| rows[places[row]][STATES]),
            output: RowDVector::from_fn(order, |_, column| shown.partials()[places[column]]),
            delay: delay(&smooth),
            left_out,
        };
        let numbers = this.dynamics.iter().chain(&this.input).chain(&this.output);
        if numbers.into_iter().all(|number| number.is_finite()) {
            Ok(this)
        } else {
            Err(NotLinear::NoSlope)
        }
    }

    /// The poles, slowest first.
    pub fn poles(&self) -> Vec<Pole> {
        let places = self.dynamics.complex_eigenvalues();
        let mut poles: Vec<Pole> = places.iter().map(|&place| Pole { place }).collect();
        let key = |pole: &Pole| (pole.natural_frequency(), pole.place.im);
        poles.sort_by(|a, b| {
            let ((a, up), (b, down)) = (key(a), key(b));
            a.total_cmp(&b).then(down.total_cmp(&up))
        });
        poles
    }

    /// Whether every small motion dies away.
    pub fn is_stable(&self) -> bool {
        self.poles().iter().all(|pole| pole.place.re < 0.0)
    }

    /// G(i ω) at an angular frequency (rad/s), in rad/Pa; none where it is not finite, as that of
    /// an integrator at zero.
    pub fn response(&self, frequency: f64) -> Option<Complex<f64>> {
        let order = self.states.len();
        let s = Complex::new(0.0, frequency);
        let system = DMatrix::from_fn(order, order, |row, column| {
            let diagonal = if row == column { s } else { Complex::ZERO };
            diagonal - self.dynamics[(row, column)]
        });
        let states = system.lu().solve(&self.input.map(Complex::from))?;
        let shown: Complex<f64> = self
            .output
            .iter()
            .zip(&states)
            .map(|(&slope, state)| *state * slope)
            .sum();
        let late = Complex::from_polar(1.0, -frequency * self.delay);
        Some(shown * late).filter(|it| it.re.is_finite() && it.im.is_finite())
    }

    /// What a lasting change of the pressure changes in the end (rad/Pa); none where something
    /// integrates, or a motion grows.
    pub fn steady_gain(&self) -> Option<f64> {
        self.is_stable().then_some(())?;
        self.response(0.0).map(|it| it.re)
    }

    /// The angular frequency (rad/s) from which on the response is 3 dB below the steady one;
    /// none without a steady gain.
    pub fn bandwidth(&self) -> Option<f64> {
        let limit = self.steady_gain()?.abs() * std::f64::consts::FRAC_1_SQRT_2;
        let passes = |frequency: f64| {
            self.response(frequency)
                .is_some_and(|it| it.norm() >= limit)
        };
        // The highest at which it passes, from far above every pole: beyond that it never does.
        let fastest = self.poles().last()?.natural_frequency();
        let grid = Self::frequencies([1e-6 * fastest, 1e2 * fastest], 800);
        let last = grid.iter().rposition(|&frequency| passes(frequency))?;
        let [mut low, mut high] = [grid[last], *grid.get(last + 1)?];
        for _ in 0..60 {
            let middle = (low * high).sqrt();
            if passes(middle) {
                low = middle;
            } else {
                high = middle;
            }
        }
        Some(low)
    }

    /// The highest response beside the steady one, and its angular frequency (rad/s); none where
    /// none is higher.
    pub fn resonance(&self) -> Option<(f64, f64)> {
        let steady = self.steady_gain()?.abs();
        let fastest = self.poles().last()?.natural_frequency();
        let ratio = |frequency: f64| self.response(frequency).map(|it| it.norm() / steady);
        let grid = Self::frequencies([1e-4 * fastest, 10.0 * fastest], 4000).into_iter();
        let highest = grid
            .filter_map(|frequency| Some((ratio(frequency)?, frequency)))
            .max_by(|a, b| a.0.total_cmp(&b.0))?;
        (highest.0 > 1.0 + 1e-6).then_some(highest)
    }

    /// So many frequencies between two, each the same factor above the one before.
    pub fn frequencies([low, high]: [f64; 2], count: usize) -> Vec<f64> {
        let step = libm::log(high / low) / (count.max(2) - 1) as f64;
        (0..count)
            .map(|k| low * libm::exp(step * k as f64))
            .collect()
    }

    /// Frequencies (rad/s) over which a Bode plot shows all of it: two decades beside the poles.
    pub fn span(&self) -> [f64; 2] {
        let poles = self.poles();
        let sizes = || {
            let sizes = poles.iter().map(|pole| pole.natural_frequency());
            sizes.filter(|size| *size > 0.0)
        };
        let slowest = sizes().fold(f64::INFINITY, f64::min);
        let fastest = sizes().fold(0.0, f64::max);
        if fastest > 0.0 {
            [0.1 * slowest, 10.0 * fastest]
        } else {
            [0.1, 100.0]
        }
    }
}

/// The angle (rad) at which a pressure (Pa) holds the actuator, within half a turn; none if it
/// does not get there.
pub fn angle_under(model: &Model<f64>, pressure: f64) -> Option<f64> {
    let (smooth, _) = smooth(model);
    let missing = |angle: f64| smooth.holding_pressure(angle) - pressure;
    let half_turn = std::f64::consts::PI;
    let (mut low, mut high) = (-half_turn, half_turn);
    let [least, most] = [missing(low), missing(high)];
    if least * most > 0.0 || !(least.is_finite() && most.is_finite()) {
        return None;
    }
    let rises = most > least;
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if (missing(middle) > 0.0) == rises {
            high = middle;
        } else {
            low = middle;
        }
    }
    Some(0.5 * (low + high))
}

/// The model without effects that have no slope, and these.
fn smooth(model: &Model<f64>) -> (Model<f64>, Vec<Kind>) {
    let (kept, left_out): (Vec<_>, Vec<_>) = model
        .effects()
        .partition(|effect| effect.kind().info().has_slope);
    let left_out = left_out.iter().map(Effect::kind).collect();
    // Each effect is as valid without the others.
    let smooth = Model::new(*model.dynamics(), &kept).unwrap_or(*model);
    (smooth, left_out)
}

/// The sum of the dead times (s).
fn delay(model: &Model<f64>) -> f64 {
    use model_core::effects::Mechanism;
    // Not `sum`, which of nothing is −0.
    let delays = model.effects().map(|effect| effect.delay());
    delays.fold(0.0, |sum, delay| sum + delay)
}

/// The name of the state at a place.
fn name(model: &Model<f64>, place: usize) -> String {
    match place {
        0 => "angle_rad".to_owned(),
        1 => "rate_rad_per_s".to_owned(),
        _ => {
            let effect = model.effects().nth((place - 2) / 2);
            let name = effect.map_or("effect", |effect| effect.kind().name());
            if place.is_multiple_of(2) {
                name.to_owned()
            } else {
                format!("{name}_2")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use model_core::dynamics::Dynamics;
    use model_core::integrate::{Scheme, step};
    use proptest::prelude::*;

    use super::*;

    fn base(exponent: f64) -> Dynamics<f64> {
        Dynamics {
            inertia: 0.02,
            damping: 0.1,
            stiffness: 2.0,
            exponent,
            input_gain: 4e-5,
        }
    }

    /// With n = 1 the poles are the roots of M s² + C s + K, whatever the angle.
    #[test]
    fn a_linear_spring_has_the_poles_of_the_textbook() {
        let model = Model::new(base(1.0), &[]).unwrap();
        let linear = Linear::at(&model, 0.7).unwrap();
        let decay = 0.1 / (2.0 * 0.02);
        let swing = (2.0f64 / 0.02 - decay * decay).sqrt();
        let poles = linear.poles();
        assert_eq!(poles.len(), 2);
        for pole in poles {
            assert!((pole.place.re + decay).abs() < 1e-9, "{pole:?}");
            assert!((pole.place.im.abs() - swing).abs() < 1e-9, "{pole:?}");
            assert!((pole.natural_frequency() - 10.0).abs() < 1e-9);
            assert!((pole.damping_ratio() - 0.25).abs() < 1e-9);
        }
        // Of a second order below critical damping, Mr = 1/(2ζ√(1−ζ²)) at ωn√(1−2ζ²).
        let (ratio, frequency) = linear.resonance().unwrap();
        assert!((ratio - 2.0656).abs() < 1e-3, "{ratio}");
        assert!((frequency - 9.354).abs() < 0.02, "{frequency}");
        // And ωb = ωn √(1 − 2ζ² + √(2 − 4ζ² + 4ζ⁴)).
        let square = 0.0625f64;
        let wide = 10.0
            * (1.0 - 2.0 * square + (2.0 - 4.0 * square + 4.0 * square * square).sqrt()).sqrt();
        assert!((linear.bandwidth().unwrap() - wide).abs() < 1e-6 * wide);
    }

    #[test]
    fn what_has_no_slope_is_left_out_and_said() {
        let friction = Kind::CoulombFriction.build(&[0.05, 0.02]).unwrap();
        let with = Model::new(base(1.3), &[friction]).unwrap();
        let without = Model::new(base(1.3), &[]).unwrap();
        let [with, without] = [with, without].map(|model| Linear::at(&model, 0.5).unwrap());
        assert_eq!(with.left_out, [Kind::CoulombFriction]);
        assert_eq!(with.dynamics, without.dynamics);
        // A power law below one is infinitely stiff at zero.
        let steep = Model::new(base(0.6), &[]).unwrap();
        assert_eq!(Linear::at(&steep, 0.0).unwrap_err(), NotLinear::NoSlope);
        assert_eq!(
            angle_under(&steep, steep.holding_pressure(0.4)).map(|it| (it - 0.4).abs() < 1e-9),
            Some(true)
        );
        assert_eq!(angle_under(&steep, 1e9), None);
    }

    proptest! {
        /// A small step of the pressure moves the model's own simulation as it moves the linear
        /// system, with a creep, a lag of the air and one of the sensor.
        #[test]
        fn small_steps_agree_with_the_model(
            exponent in 0.7..1.8f64,
            angle in 0.3..1.2f64,
            creep in 0.1..0.8f64,
            lag in 0.02..0.3f64,
        ) {
            let effects = [
                Kind::MaxwellBranch.build(&[creep, 0.5, 0.0]).unwrap(),
                Kind::PneumaticLag.build(&[lag]).unwrap(),
                Kind::SensorLag.build(&[0.5 * lag]).unwrap(),
            ];
            let model = Model::new(base(exponent), &effects).unwrap();
            let linear = Linear::at(&model, angle).unwrap();
            let small = 1e-4 * linear.pressure;
            let held = Held(linear.pressure + small);
            let mut state = model.at_rest(angle, linear.pressure);
            let mut x = DVector::zeros(linear.states.len());
            let dt = 1e-3;
            // Of the linear system by the same scheme, from its own matrices.
            let rate = |x: &DVector<f64>| &linear.dynamics * x + &linear.input * small;
            let mut largest = 0.0f64;
            let mut off = 0.0f64;
            for _ in 0..1500 {
                step(Scheme::Rk4, &model, &mut state, &held, dt);
                let k1 = rate(&x);
                let k2 = rate(&(&x + &k1 * (0.5 * dt)));
                let k3 = rate(&(&x + &k2 * (0.5 * dt)));
                let k4 = rate(&(&x + &k3 * dt));
                x += (k1 + (k2 + k3) * 2.0 + k4) * (dt / 6.0);
                let moved = model.reading(&state) - linear.reading;
                largest = largest.max(moved.abs());
                off = off.max((moved - (&linear.output * &x)[0]).abs());
            }
            prop_assert!(largest > 0.0);
            prop_assert!(off < 2e-3 * largest, "{off} of {largest}");
            // What it comes to is what the curve at rest says.
            let steady = linear.steady_gain().unwrap();
            let slope = (model.holding_pressure(angle + 1e-6) - model.holding_pressure(angle - 1e-6)) / 2e-6;
            prop_assert!((steady * slope - 1.0).abs() < 1e-4, "{steady} {slope}");
        }
    }
}
