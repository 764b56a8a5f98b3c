//! A mirrored start under mirrored pressure gives the mirrored run.
//!
//! An actuator is as stiff in one direction as in the other, so the base model is odd, and so are
//! the effects whose force is odd in θ and ω or linear in the pressure. It holds bit for bit,
//! since a sign costs no rounding: a difference is a branch that treats one side differently.
//!
//! A table is odd if its forces are, but only up to rounding, since a line is interpolated from
//! its left end: its own tests look at that.

use model_core::actuator::{Model, State};
use model_core::catalogue::{Effect, Kind};
use model_core::integrate::Scheme;
use model_core::power::{Exact, GuardedMicromath, Minimax, Power};
use model_core::real::Real;

use crate::support::{F32, F64, SCHEMES, Scalar, lively, run, sample_effects, varied_pressure_pa};

/// The effect in the mirror; none where it has no mirror image.
///
/// Some effects are not odd by themselves, because they carry a direction of their own, and are
/// once that direction is mirrored too:
///
/// - gravity with a tilt: sin(θ + θ₀) − sin θ₀ has an even part, (cos θ − 1) sin θ₀; mirrored, the
///   base tilts the other way;
/// - what adds an even part to the reading, b, r t or c θ²: the motion is odd, the reading is only
///   with −b, −r or −c;
/// - stiffening by pressure: mirrored, it stiffens under the mirrored pressure;
/// - the lag of filling and venting: mirrored, the two change places.
///
/// And some are one-sided, without a mirror image in the catalogue: a stop, a threshold, a damping
/// of one direction, and a disturbance that only another phase would mirror.
fn mirrored(effect: Effect<f64>) -> Option<Effect<f64>> {
    let directed = match effect.kind() {
        Kind::CoulombFriction
        | Kind::QuadraticDamping
        | Kind::CubicStiffness
        | Kind::ExponentShift
        | Kind::MaxwellBranch
        | Kind::PneumaticLag
        | Kind::DeadTime
        | Kind::StribeckFriction
        | Kind::AngleDependentDamping
        | Kind::BoucWenHysteresis
        | Kind::LinearStiffness
        | Kind::StiffnessDrift
        | Kind::MullinsSoftening
        | Kind::SecondMode
        | Kind::InputBacklash
        | Kind::Leak
        | Kind::SensorLag => return Some(effect),
        Kind::AsymmetricDamping
        | Kind::EndStop
        | Kind::PressureThreshold
        | Kind::PeriodicDisturbance
        | Kind::Table => return None,
        Kind::VentAsymmetry => {
            let [fill, vent] = [0, 1].map(|index| effect.value(index).expect("it has two"));
            return Kind::VentAsymmetry.build(&[vent, fill]);
        }
        Kind::Gravity => {
            let [weight, tilt, turned, share] =
                [0, 1, 2, 3].map(|index| effect.value(index).expect("it has four"));
            return Kind::Gravity.build(&[weight, -tilt, -turned, share]);
        }
        Kind::SensorOffset
        | Kind::SensorNonlinearity
        | Kind::SensorDrift
        | Kind::PressureStiffening => 0,
        other => panic!("{}: say here whether it is odd", other.name()),
    };
    let mut effect = effect;
    let value = effect.value(directed).expect("it is in the table");
    effect.set_value(directed, -value);
    Some(effect)
}

/// Whether an effect is odd by itself.
fn is_odd(effect: Effect<f64>) -> bool {
    mirrored(effect) == Some(effect)
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
            // A largest angle has no sign to mirror.
            let remembers = effects.iter().map(Effect::kind);
            if !remembers.eq([Kind::MullinsSoftening]) {
                trace.extend(state.hidden.iter().flatten());
            }
        },
    );
    trace
}

fn assert_odd<R: Real, P: Power<R>>(effects: &[Effect<f64>], scalar: Scalar<R>) {
    let in_mirror: Vec<Effect<f64>> = effects
        .iter()
        .map(|&effect| mirrored(effect).expect("it has a mirror image"))
        .collect();
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
    for effect in sample_effects().filter(|&effect| mirrored(effect).is_some()) {
        assert_odd::<f64, Exact>(&[effect], F64);
        assert_odd::<f32, Minimax>(&[effect], F32);
    }
}

/// Gravity without a tilt has no direction of its own.
#[test]
fn gravity_without_tilt_is_odd() {
    let gravity = Kind::Gravity.build(&[0.8, 0.0, 0.0, 1.0]).unwrap();
    assert!(is_odd(gravity));
    assert_odd::<f32, Minimax>(&[gravity], F32);
}

/// The other half of the claim: what is listed as directed is.
#[test]
fn directed_effects_are_not_odd() {
    let mut directed = 0;
    let names = sample_effects().filter(|effect| effect.kind().is_name());
    for effect in names.filter(|&effect| !is_odd(effect)) {
        let there = trace::<f64, Exact>(Scheme::Rk4, &[effect], 1.0, F64);
        let back = trace::<f64, Exact>(Scheme::Rk4, &[effect], -1.0, F64);
        let entries = there.len() / 1_800;
        let readings = there.iter().zip(&back).step_by(entries);
        let apart = readings.map(|(a, b)| (a + b).abs()).fold(0.0, f64::max);
        assert!(apart > 0.01, "{effect:?}: {apart}");
        directed += 1;
    }
    assert_eq!(directed, 20);
}
