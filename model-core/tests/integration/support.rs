//! What the tests share: parameters, runs, random numbers.

use model_core::actuator::{Model, State};
use model_core::catalogue::{Effect, Kind};
use model_core::dynamics::Dynamics;
use model_core::effects::table::{Table, Variable};
use model_core::input::FromFn;
use model_core::integrate::{Scheme, step};
use model_core::power::Power;
use model_core::real::Real;

pub const SCHEMES: [Scheme; 3] = [Scheme::SemiImplicitEuler, Scheme::Heun, Scheme::Rk4];

/// A lively actuator: it overshoots, its exponent is not a whole number, and
/// its pressure has the size of a real one.
pub fn lively() -> Dynamics<f64> {
    Dynamics {
        inertia: 0.36,
        damping: 0.913,
        stiffness: 1.5,
        exponent: 2.365,
        input_gain: 2.17e-5,
    }
}

pub fn model_of(dynamics: Dynamics<f64>) -> Model<f64> {
    Model::new(dynamics, &[]).expect("test parameters are valid")
}

/// Takes `steps` steps of `dt` (s) from `start` and shows every state that it
/// reaches to `visit`. `pressure` (Pa) is a function of the time of the run (s).
///
/// Times are counted in `f64` whatever the scalar of the model, so that the
/// input is not what an error in `f32` comes from.
pub fn run<R: Real, P: Power<R>>(
    scheme: Scheme,
    model: &Model<R, P>,
    start: State<R>,
    pressure: impl Fn(f64) -> f64,
    (dt, steps): (f64, u32),
    scalar: Scalar<R>,
    mut visit: impl FnMut(u32, &State<R>),
) -> State<R> {
    let mut state = start;
    for k in 0..steps {
        let begin = f64::from(k) * dt;
        let input =
            FromFn(|offset: R| (scalar.from_f64)(pressure(begin + (scalar.to_f64)(offset))));
        step(scheme, model, &mut state, &input, (scalar.from_f64)(dt));
        visit(k + 1, &state);
    }
    state
}

/// How a scalar of the model comes from and goes to `f64`.
#[derive(Clone, Copy)]
pub struct Scalar<R> {
    pub from_f64: fn(f64) -> R,
    pub to_f64: fn(R) -> f64,
}

pub const F64: Scalar<f64> = Scalar {
    from_f64: |x| x,
    to_f64: |x| x,
};

#[expect(clippy::cast_possible_truncation, reason = "the rounding is wanted")]
pub const F32: Scalar<f32> = Scalar {
    from_f64: |x| x as f32,
    to_f64: f64::from,
};

/// Pseudo-random numbers that are the same on every machine (SplitMix64).
pub struct Random(pub u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        // 2⁻⁵³ times the upper 53 bits.
        low + (high - low) * ((self.next() >> 11) as f64 / 9_007_199_254_740_992.0)
    }

    /// Even in the logarithm: what spans decades.
    pub fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        self.uniform(low.ln(), high.ln()).exp()
    }
}

/// Values in SI units with which each effect is felt but does not drown the
/// rest; two sets, of both signs where both are allowed.
///
/// # Panics
///
/// If an effect is missing, which is how a new one is told to come here.
pub fn sample_values(kind: Kind) -> [&'static [f64]; 2] {
    match kind {
        Kind::CoulombFriction => [&[0.1, 0.02], &[0.3, 0.1]],
        Kind::QuadraticDamping => [&[0.4], &[1.5]],
        Kind::Gravity => [&[0.8, 0.7, 0.0, 1.0], &[-0.4, -1.2, 0.9, 0.5]],
        Kind::CubicStiffness => [&[0.5], &[-0.1]],
        Kind::ExponentShift => [&[0.4], &[-0.9]],
        Kind::MaxwellBranch => [&[1.2, 0.7, 0.0], &[0.4, 1.5, 0.4]],
        Kind::PneumaticLag => [&[0.15], &[1.1]],
        Kind::DeadTime => [&[0.137], &[0.8]],
        Kind::SensorOffset => [&[0.12], &[-0.3]],
        Kind::StribeckFriction => [&[0.1, 0.2, 0.3], &[0.3, 0.1, 0.5]],
        Kind::AngleDependentDamping => [&[0.8], &[-0.9]],
        Kind::AsymmetricDamping => [&[1.5], &[-0.6]],
        Kind::BoucWenHysteresis => [&[0.3, 0.1, 0.5], &[0.2, 0.4, -0.2]],
        Kind::LinearStiffness => [&[0.8], &[0.3]],
        Kind::EndStop => [&[6.0, 0.5], &[2.0, 0.3]],
        Kind::StiffnessDrift => [&[0.05], &[-0.04]],
        Kind::MullinsSoftening => [&[0.5, 0.5], &[0.3, 0.2]],
        Kind::SecondMode => [&[1.2, 0.1, 0.8], &[1.7, 0.05, -1.5]],
        Kind::VentAsymmetry => [&[0.1, 0.6], &[0.8, 0.15]],
        Kind::PressureThreshold => [&[12e3], &[25e3]],
        Kind::PressureStiffening => [&[1e-5], &[-4e-6]],
        Kind::InputBacklash => [&[10e3], &[4e3]],
        Kind::Leak => [&[3.0], &[12.0]],
        Kind::SensorLag => [&[0.1], &[0.6]],
        Kind::SensorNonlinearity => [&[0.15], &[-0.2]],
        Kind::SensorDrift => [&[0.02], &[-0.05]],
        Kind::PeriodicDisturbance => [&[0.3, 1.37, 0.8], &[0.2, 0.73, -2.0]],
        // Of the rate with a jump at zero, and of the angle: see `effect_of`.
        Kind::Table => [&[-0.5, -0.2, -0.1, 0.1, 0.2, 0.5], &[-0.3, 0.0, 0.2, 0.9]],
        _ => panic!("{}: no values to test it with", kind.name()),
    }
}

/// Nodes of a table of the rate (rad/s).
pub const RATE_NODES: [f32; 6] = [-2.0, -0.5, -0.125, 0.125, 0.5, 2.0];
/// Nodes of a table of the angle (rad).
pub const ANGLE_NODES: [f32; 4] = [-0.5, 0.0, 0.25, 1.0];

/// The effect with some of its [`sample_values`]; how many there are tells what a
/// table is of.
///
/// # Panics
///
/// If they are not as many as in the table.
pub fn effect_of(kind: Kind, values: &[f64]) -> Effect<f64> {
    let table = match (kind, values.len()) {
        (Kind::Table, 6) => Table::new(Variable::Rate, &RATE_NODES, values),
        (Kind::Table, _) => Table::new(Variable::Angle, &ANGLE_NODES, values),
        _ => return kind.build(values).expect("as many as in the table"),
    };
    Effect::Table(table.expect("as many as nodes"))
}

/// Every effect of the catalogue, with the first and then the second of its
/// [`sample_values`].
pub fn sample_effects() -> impl Iterator<Item = Effect<f64>> {
    Kind::ALL
        .iter()
        .flat_map(|&kind| sample_values(kind).map(|values| effect_of(kind, values)))
}

/// A pressure (Pa) with a sine, two smoothed steps, and both signs: it crosses
/// θ = 0, rests nowhere, and comes back.
pub fn varied_pressure_pa(time: f64) -> f64 {
    let edge = |at: f64| 0.5 * (1.0 + ((time - at) / 0.08).tanh());
    50_000.0 * (0.6 + 0.5 * (1.9 * time).sin() + 0.9 * edge(3.0) - 1.7 * edge(6.0))
}
