//! Energy: conserved without damping, spent as ∫Cω² dt with it.
//!
//! E = ½Mω² + K|θ|ⁿ⁺¹/(n+1) − g p θ, the last term for a pressure that is
//! held. A wrong sign or a wrong power shows here without any solution to
//! compare with.

use model_core::actuator::{Model, State};
use model_core::catalogue::Kind;
use model_core::dynamics::Dynamics;
use model_core::effects::{Instant, Mechanism};
use model_core::integrate::Scheme;
use proptest::prelude::*;

use crate::support::{ANGLE_NODES, F64, effect_of, lively, model_of, run, sample_values};

fn energy(d: &Dynamics<f64>, state: &State<f64>, pressure_pa: f64) -> f64 {
    let whole = d.exponent + 1.0;
    0.5 * d.inertia * state.rate * state.rate + d.stiffness * state.angle.abs().powf(whole) / whole
        - d.input_gain * pressure_pa * state.angle
}

fn undamped(exponent: f64) -> Dynamics<f64> {
    Dynamics {
        damping: 0.0,
        exponent,
        ..lively()
    }
}

/// The largest departure from the first energy over `duration` seconds.
fn largest_departure(
    scheme: Scheme,
    d: &Dynamics<f64>,
    (start_rad, pressure_pa): (f64, f64),
    duration: f64,
    steps: u32,
) -> f64 {
    let model = model_of(*d);
    let start = model.at_rest(start_rad, pressure_pa);
    let first = energy(d, &start, pressure_pa);
    let mut largest = 0.0_f64;
    let dt = duration / f64::from(steps);
    run(
        scheme,
        &model,
        start,
        |_| pressure_pa,
        (dt, steps),
        F64,
        |_, state| {
            largest = largest.max((energy(d, state, pressure_pa) - first).abs());
        },
    );
    largest
}

/// θ³ is smooth through zero; a power that is not whole is smooth only away
/// from it, so there a pressure keeps the swing on one side.
#[test]
fn undamped_energy_is_kept_within_the_order_of_the_scheme() {
    for (name, exponent, start_rad, pressure_pa) in [
        ("through zero", 3.0, 1.1, 0.0),
        ("on one side", 2.365, 0.6, 80_000.0),
        ("on one side", 1.4, 0.3, 60_000.0),
    ] {
        let d = undamped(exponent);
        for (scheme, steps, band) in [
            (Scheme::SemiImplicitEuler, 4_000, 0.05),
            (Scheme::Heun, 4_000, 0.05),
            (Scheme::Rk4, 600, 0.1),
        ] {
            let departure =
                |steps| largest_departure(scheme, &d, (start_rad, pressure_pa), 2.0, steps);
            let (coarse, fine) = (departure(steps), departure(2 * steps));
            let order = (coarse / fine).log2();
            println!("{name}, n = {exponent}, {scheme:?}: {fine:.2e} N·rad, order {order:.3}");
            assert!(
                (order - f64::from(scheme.order())).abs() <= band,
                "{name}, n = {exponent}, {scheme:?}: order {order}"
            );
        }
    }
}

/// For a linear swing theory gives the energy after every step exactly. With
/// z = ω₀ dt, Heun gains 1 + z⁴/4 a step, RK4 loses 1 − z⁶/72 + z⁸/576, and
/// semi-implicit Euler keeps ω² + ω₀²θ² − dt ω₀² θω for ever.
#[test]
fn energy_of_a_linear_swing_drifts_exactly_as_theory_says() {
    let d = undamped(1.0);
    let model = model_of(d);
    let start = model.moving(0.4, -0.9, 0.0);
    let square = d.stiffness / d.inertia;
    let (dt, steps) = (0.1, 200);
    let z2 = square * dt * dt;

    for (scheme, factor) in [
        (Scheme::Heun, 1.0 + z2 * z2 / 4.0),
        (Scheme::Rk4, 1.0 - z2.powi(3) / 72.0 + z2.powi(4) / 576.0),
    ] {
        let end = run(scheme, &model, start, |_| 0.0, (dt, steps), F64, |_, _| {});
        let ratio = energy(&d, &end, 0.0) / energy(&d, &start, 0.0);
        let expected = factor.powf(f64::from(steps));
        assert!(
            (ratio / expected - 1.0).abs() < 1e-12,
            "{scheme:?}: {ratio} instead of {expected}"
        );
    }

    let kept = |at: &State<f64>| {
        at.rate * at.rate + square * at.angle * at.angle - dt * square * at.angle * at.rate
    };
    run(
        Scheme::SemiImplicitEuler,
        &model,
        start,
        |_| 0.0,
        (dt, 20_000),
        F64,
        |k, state| {
            let ratio = kept(state) / kept(&start);
            assert!((ratio - 1.0).abs() < 1e-10, "step {k}: {ratio}");
        },
    );
}

/// What a symplectic scheme is for: its energy is wrong, but never more wrong.
#[test]
fn semi_implicit_euler_does_not_drift_over_hundreds_of_swings() {
    let d = undamped(2.365);
    let departure = |duration: f64, steps| {
        largest_departure(Scheme::SemiImplicitEuler, &d, (0.9, 0.0), duration, steps)
    };
    let (early, late) = (departure(10.0, 1_000), departure(1_000.0, 100_000));
    println!("semi-implicit Euler: {early:.3e} N·rad in 10 s, {late:.3e} N·rad in 1000 s");
    assert!(late < 1.05 * early, "{late} after {early}");
    assert!(early > 1e-3, "a step this coarse must show: {early}");
}

/// ∫Cω² dt by Simpson's rule over the steps of the run.
#[test]
fn damping_spends_what_the_energy_loses() {
    for (exponent, start_rad, pressure_pa) in [
        (3.0, 1.1, 0.0),
        (2.365, 0.6, 80_000.0),
        (1.0, 1.0, -50_000.0),
    ] {
        let d = Dynamics {
            exponent,
            ..lively()
        };
        let model = model_of(d);
        let start = model.at_rest(start_rad, pressure_pa);
        let (dt, steps) = (1e-3, 3_000_u32);
        let mut simpson = 0.0;
        let end = run(
            Scheme::Rk4,
            &model,
            start,
            |_| pressure_pa,
            (dt, steps),
            F64,
            |k, state| {
                // The first point has no rate and adds nothing.
                let weight = match k {
                    k if k == steps => 1.0,
                    k if k % 2 == 1 => 4.0,
                    _ => 2.0,
                };
                simpson += weight * d.damping * state.rate * state.rate;
            },
        );
        let spent = simpson * dt / 3.0;
        let lost = energy(&d, &start, pressure_pa) - energy(&d, &end, pressure_pa);
        println!(
            "n = {exponent}: lost {lost:.6} N·rad, {:.1e} unaccounted",
            lost - spent
        );
        assert!(lost > 0.05, "nothing was lost: {lost}");
        assert!(
            (lost - spent).abs() < 1e-10 * lost.abs(),
            "{lost} and {spent}"
        );
    }
}

/// What an effect stores (N·rad), for those that only store and spend.
fn stored(kind: Kind, values: &[f64], d: &Dynamics<f64>, state: &State<f64>) -> Option<f64> {
    let [hidden, _] = state.hidden[0];
    Some(match kind {
        Kind::CoulombFriction
        | Kind::StribeckFriction
        | Kind::QuadraticDamping
        | Kind::AngleDependentDamping
        | Kind::AsymmetricDamping => 0.0,
        Kind::MaxwellBranch => {
            let [fast, slow] = state.hidden[0].map(|relaxed| (state.angle - relaxed).powi(2));
            0.5 * values[0] * ((1.0 - values[2]) * fast + values[2] * slow)
        }
        Kind::BoucWenHysteresis => values[0] * values[1] * released(hidden, values[2]),
        Kind::LinearStiffness => 0.5 * values[0] * state.angle * state.angle,
        Kind::CubicStiffness => 0.25 * values[0] * state.angle.powi(4),
        Kind::EndStop => 0.5 * values[0] * (state.angle - values[1]).max(0.0).powi(2),
        Kind::Gravity => {
            let [weight, at_zero, turned, share] = [0, 1, 2, 3].map(|index| values[index]);
            let tilt = at_zero + turned;
            let lifted = (tilt.cos() - (share * state.angle + tilt).cos()) / share;
            weight * (lifted - state.angle * at_zero.sin())
        }
        // The base spring less what is lost.
        Kind::MullinsSoftening => {
            let lost = values[0] * (1.0 - (-hidden / values[1]).exp());
            let whole = d.exponent + 1.0;
            -lost * d.stiffness * state.angle.abs().powf(whole) / whole
        }
        // Six forces are of the rate and always against it.
        Kind::Table if values.len() == 6 => 0.0,
        Kind::Table => {
            let table = |angle: f64| {
                let pieces = ANGLE_NODES.windows(2).zip(values.windows(2));
                // Trapezia up to the angle, and the constant ends.
                let between: f64 = pieces
                    .map(|(ends, q)| {
                        let [start, end] = [ends[0], ends[1]].map(f64::from);
                        let way = angle.clamp(start, end) - start;
                        way * q[0] + 0.5 * way * way * (q[1] - q[0]) / (end - start)
                    })
                    .sum();
                let [first, last] = [ANGLE_NODES[0], ANGLE_NODES[3]].map(f64::from);
                between + (angle - first).min(0.0) * values[0] + (angle - last).max(0.0) * values[3]
            };
            table(state.angle) - table(0.0)
        }
        _ => return None,
    })
}

/// What the loop of a Bouc–Wen hysteresis gives back on the way from `w` to zero,
/// by a and D: the integral of w dw/(1 + b w), b = ½ − B.
fn released(w: f64, shape: f64) -> f64 {
    let (w, b) = (w.abs(), 0.5 - shape);
    if b.abs() < 1e-6 {
        return 0.5 * w * w;
    }
    (w - (b * w).ln_1p() / b) / b
}

/// A swing without pressure never gains energy from an effect that has no
/// source of its own, and what only stores keeps all of it.
#[test]
fn effects_without_a_source_never_add_energy() {
    for &kind in Kind::ALL {
        for values in sample_values(kind) {
            // A damping that an effect only changes has to be there.
            let damped = matches!(kind, Kind::AngleDependentDamping | Kind::AsymmetricDamping);
            let d = Dynamics {
                damping: if damped { lively().damping } else { 0.0 },
                ..lively()
            };
            let effect = effect_of(kind, values);
            let model: Model<f64> = Model::new(d, &[effect]).expect("within bounds");
            let start = model.moving(0.2, 2.0, 0.0);
            let Some(extra) = stored(kind, values, &d, &start) else {
                continue;
            };
            let first = energy(&d, &start, 0.0) + extra;
            let (mut before, mut largest_gain) = (first, 0.0_f64);
            run(
                Scheme::Rk4,
                &model,
                start,
                |_| 0.0,
                (5e-4, 20_000),
                F64,
                |_, state| {
                    let extra = stored(kind, values, &d, state).expect("it stores");
                    let now = energy(&d, state, 0.0) + extra;
                    largest_gain = largest_gain.max(now - before);
                    before = now;
                },
            );
            let name = kind.name();
            println!(
                "{name} {values:?}: {first:.3} to {before:.3} N·rad, at most +{largest_gain:.0e} a step"
            );
            assert!(largest_gain < 1e-6, "{name} {values:?}: {largest_gain}");
            let keeps = match kind {
                Kind::Table => values.len() != 6,
                _ => matches!(
                    kind,
                    Kind::LinearStiffness | Kind::CubicStiffness | Kind::EndStop | Kind::Gravity
                ),
            };
            let lost = (first - before) / first;
            assert!(
                if keeps {
                    lost.abs() < 1e-5
                } else {
                    lost > 0.005
                },
                "{name} {values:?}: {lost}"
            );
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A hysteresis takes energy on any closed way, whatever the shape of its loop,
    /// and the force stays below a/(½ + B) where that is a bound.
    #[test]
    fn closed_hysteresis_loops_take_energy(
        shape in -1.0..=1.0_f64,
        yield_rad in 0.05..1.0_f64,
        turns in proptest::collection::vec(-1.5..1.5_f64, 1..6),
    ) {
        const STEPS: u32 = 500;
        let effect = Kind::BoucWenHysteresis.build(&[1.0, yield_rad, shape]).unwrap();
        let mut hidden = [0.0; 2];
        let mut angle = 0.0;
        // From turn to turn and back to the first one, so that the way is closed.
        let mut taken = 0.0;
        let mut stored_before = 0.0;
        let way = [0.3].iter().chain(&turns).chain(&[0.3]);
        for (leg, &turn) in way.enumerate() {
            let rate = (turn - angle) / f64::from(STEPS);
            let rate_of = |hidden: [f64; 2]| {
                let at = Instant { time: 0.0, angle: 0.0, rate, pressure: 0.0 };
                let mut rates = [0.0; 2];
                let force = effect.force(&at, &hidden, &mut rates);
                (force, rates[0])
            };
            for _ in 0..STEPS {
                // Runge–Kutta over the way, with the work beside it.
                let (q1, k1) = rate_of(hidden);
                let (q2, k2) = rate_of([hidden[0] + 0.5 * k1, 0.0]);
                let (q3, k3) = rate_of([hidden[0] + 0.5 * k2, 0.0]);
                let (q4, k4) = rate_of([hidden[0] + k3, 0.0]);
                hidden[0] += (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0;
                if leg > 0 {
                    taken += (q1 + 2.0 * q2 + 2.0 * q3 + q4) * rate / 6.0;
                }
                if shape > -0.5 {
                    prop_assert!(hidden[0].abs() <= (1.0 + 1e-9) / (0.5 + shape));
                }
            }
            angle = turn;
            if leg == 0 {
                stored_before = yield_rad * released(hidden[0], shape);
            }
        }
        let stored = yield_rad * released(hidden[0], shape) - stored_before;
        // A loop that is closed in w too stores nothing: it takes what was put in.
        let rounding = 1e-4 * (1.0 + taken.abs() + stored.abs());
        prop_assert!(taken - stored >= -rounding, "{taken} and {stored}");
    }
}
