//! A mirrored start under mirrored pressure gives the mirrored run.
//!
//! An actuator is as stiff in one direction as in the other, so the base model
//! is odd, and so are the effects whose force is odd in θ and ω or linear in
//! the pressure. It holds bit for bit, since a sign costs no rounding: a
//! difference is a branch that treats one side differently.
//!
//! Two effects are not odd by themselves, because they carry a direction of
//! their own, and are once that direction is mirrored too:
//!
//! - gravity with a tilt: sin(θ + θ₀) − sin θ₀ has an even part, (cos θ − 1)
//!   sin θ₀; mirrored, the base tilts the other way;
//! - the sensor offset: θ + b does not change sign with θ; the motion is odd,
//!   the reading is only with −b.

use model_core::actuator::{Model, State};
use model_core::catalogue::{Effect, Kind};
use model_core::integrate::Scheme;
use model_core::power::{Exact, GuardedMicromath, Minimax, Power};
use model_core::real::Real;

use crate::support::{F32, F64, SCHEMES, Scalar, lively, run, sample_effects, varied_pressure_pa};

/// The effect in the mirror, and whether it is another one there.
fn mirrored(effect: Effect<f64>) -> (Effect<f64>, bool) {
    let directed = match effect.kind() {
        Kind::CoulombFriction
        | Kind::QuadraticDamping
        | Kind::CubicStiffness
        | Kind::ExponentShift
        | Kind::MaxwellBranch
        | Kind::PneumaticLag
        | Kind::DeadTime => return (effect, false),
        Kind::Gravity => 1,
        Kind::SensorOffset => 0,
        other => panic!("{}: say here whether it is odd", other.name()),
    };
    let mut effect = effect;
    let value = effect.value(directed).expect("it is in the table");
    effect.set_value(directed, -value);
    (effect, true)
}

/// Every reading, angle, rate and hidden state of a run; `side` is 1 or −1.
fn trace<R: Real, P: Power<R>>(
    scheme: Scheme,
    effects: &[Effect<f64>],
    side: f64,
    scalar: Scalar<R>,
) -> Vec<R> {
    let model: Model<f64> = Model::new(lively(), effects).expect("within bounds");
    let model: Model<R, P> = model.map(scalar.from_f64);
    let [angle, rate, pressure] =
        [0.3, -0.7, varied_pressure_pa(0.0)].map(|x| (scalar.from_f64)(side * x));
    let start = model.moving(angle, rate, pressure);
    let mut trace = Vec::new();
    run(
        scheme,
        &model,
        start,
        |time| side * varied_pressure_pa(time),
        (5e-3, 1_800),
        scalar,
        |_, state: &State<R>| {
            trace.extend([model.reading(state), state.angle, state.rate]);
            trace.extend(state.hidden.iter().flatten());
        },
    );
    trace
}

fn assert_odd<R: Real, P: Power<R>>(effects: &[Effect<f64>], scalar: Scalar<R>) {
    let in_mirror: Vec<Effect<f64>> = effects.iter().map(|&effect| mirrored(effect).0).collect();
    for scheme in SCHEMES {
        let there = trace::<R, P>(scheme, effects, 1.0, scalar);
        let back = trace::<R, P>(scheme, &in_mirror, -1.0, scalar);
        assert!(there.iter().any(|x| *x < R::zero()) && there.iter().any(|x| *x > R::zero()));
        for (k, (there, back)) in there.iter().zip(&back).enumerate() {
            // Numbers that compare equal have equal bits, but for the sign of
            // zero, and NaN equals nothing.
            assert!(
                *there == -*back,
                "{scheme:?}, {effects:?}, entry {k}: {there:?}, {back:?}"
            );
        }
    }
}

#[test]
fn base_model_is_odd_to_the_last_bit() {
    assert_odd::<f64, Exact>(&[], F64);
    assert_odd::<f32, Minimax>(&[], F32);
    assert_odd::<f32, GuardedMicromath>(&[], F32);
}

#[test]
fn effects_are_odd_to_the_last_bit() {
    for effect in sample_effects() {
        assert_odd::<f64, Exact>(&[effect], F64);
        assert_odd::<f32, Minimax>(&[effect], F32);
    }
}

/// Gravity without a tilt has no direction of its own.
#[test]
fn gravity_without_tilt_is_odd() {
    let gravity = Kind::Gravity.build(&[0.8, 0.0]).unwrap();
    assert_eq!(mirrored(gravity).0, gravity);
    assert_odd::<f32, Minimax>(&[gravity], F32);
}

/// The other half of the claim: what is listed as directed is.
#[test]
fn directed_effects_are_not_odd() {
    let mut directed = 0;
    for effect in sample_effects().filter(|&effect| mirrored(effect).1) {
        let there = trace::<f64, Exact>(Scheme::Rk4, &[effect], 1.0, F64);
        let back = trace::<f64, Exact>(Scheme::Rk4, &[effect], -1.0, F64);
        let readings = there.iter().zip(&back).step_by(9);
        let apart = readings.map(|(a, b)| (a + b).abs()).fold(0.0, f64::max);
        assert!(apart > 0.01, "{effect:?}: {apart}");
        directed += 1;
    }
    assert_eq!(directed, 4);
}
