//! What holds for any model, on random ones.

use model_core::actuator::{InvalidModel, MAX_EFFECTS, Model, ParameterId};
use model_core::catalogue::{Effect, Kind};
use model_core::dynamics::Dynamics;
use model_core::effects::table::{Table, Variable};
use model_core::input::Held;
use model_core::integrate::step;
use model_core::power::{GuardedMicromath, Minimax, Power};
use model_core::real::Real;
use proptest::prelude::*;

use crate::support::{F32, F64, SCHEMES, Scalar, effect_of, lively, sample_values};

/// Far beyond any actuator, in both directions.
fn any_dynamics() -> impl Strategy<Value = Dynamics<f64>> {
    (0.01..5.0, 0.0..20.0, 0.0..50.0, 0.3..4.0, 1e-7..1e-3).prop_map(
        |(inertia, damping, stiffness, exponent, input_gain)| Dynamics {
            inertia,
            damping,
            stiffness,
            exponent,
            input_gain,
        },
    )
}

/// Any table of five nodes: the last three shares are what it is of, where it
/// begins, and how wide it is.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "small, positive, and rounded on purpose"
)]
fn any_table(shares: [f64; 8]) -> Effect<f64> {
    let forces = [0, 1, 2, 3, 4].map(|k: usize| 10.0 * shares[k] - 5.0);
    let [of, begin, width] = [shares[5], shares[6], shares[7]];
    let of = match (4.0 * of) as usize {
        0 => Variable::Angle,
        1 => Variable::Rate,
        2 => Variable::Pressure,
        _ => Variable::Time,
    };
    let scale = if of == Variable::Pressure { 1e5 } else { 1.0 };
    let nodes = [0.0, 0.1, 0.4, 0.5, 1.0].map(|node| {
        let node = scale * (2.0 * begin - 2.0 + node * (0.2 + 3.0 * width));
        node as f32
    });
    Effect::Table(Table::new(of, &nodes, &forces).expect("increasing"))
}

/// Any effect with values anywhere within its bounds, or within ±5 where the
/// table has none.
fn any_effect() -> impl Strategy<Value = Effect<f64>> {
    (0..Kind::ALL.len(), proptest::array::uniform8(0.0..=1.0)).prop_map(|(kind, shares)| {
        let kind = Kind::ALL[kind];
        if kind == Kind::Table {
            return any_table(shares);
        }
        let rows = kind.parameters();
        let values: Vec<f64> = rows
            .iter()
            .zip(shares)
            .map(|(row, share): (_, f64)| {
                let (lower, upper) = (row.lower.max(-5.0), row.upper.min(5.0));
                let value = f64::from(lower) * (1.0 - share) + f64::from(upper) * share;
                value.clamp(f64::from(lower), f64::from(upper))
            })
            .collect();
        kind.build(&values).expect("as many as in the table")
    })
}

fn any_model() -> impl Strategy<Value = Model<f64>> {
    let effects = proptest::collection::vec(any_effect(), 0..=MAX_EFFECTS);
    (any_dynamics(), effects).prop_map(|(dynamics, mut effects)| {
        let mut tables = 0;
        effects.retain(|effect| {
            tables += usize::from(effect.kind() == Kind::Table);
            effect.kind().is_name() || tables == 1
        });
        Model::new(dynamics, &effects).expect("within bounds")
    })
}

/// Where a model is put before its step: angle (rad), rate (rad/s), pressure (Pa).
fn any_instant() -> impl Strategy<Value = [f64; 3]> {
    (-3.2..3.2, -4.0..4.0, -3e5..3e5).prop_map(|(angle, rate, pressure)| [angle, rate, pressure])
}

fn softens(effect: &Effect<f64>) -> bool {
    effect.kind() == Kind::CubicStiffness && effect.values().any(|stiffness| stiffness < 0.0)
}

/// Takes some steps that resolve the model's own rates; whether all is finite.
fn stays_finite<R: Real, P: Power<R>>(
    model: &Model<R, P>,
    instant: [f64; 3],
    scalar: Scalar<R>,
) -> bool {
    let [angle, rate, pressure] = instant.map(scalar.from_f64);
    let rates = model.fastest_rate((scalar.from_f64)(4.0));
    let oscillation = (scalar.to_f64)(rates.stiffness).sqrt();
    let fastest = oscillation.max((scalar.to_f64)(rates.relaxation));
    let dt = (scalar.from_f64)((0.2 / fastest).min(5e-3));
    // Two effects are the stiffer the larger the rate, and their step is chosen for swings of an
    // actuator, not for what snaps back within milliseconds.
    let grows_with_rate = |effect: &Effect<R>| {
        matches!(
            effect.kind(),
            Kind::BoucWenHysteresis | Kind::QuadraticDamping
        )
    };
    let grows = model.effects().any(|effect| grows_with_rate(&effect));
    let snaps = |rate: R| grows && (scalar.to_f64)(rate).abs() > 4.0;
    SCHEMES.into_iter().all(|scheme| {
        let mut state = model.moving(angle, rate, pressure);
        for _ in 0..20 {
            if snaps(state.rate) {
                break;
            }
            step(scheme, model, &mut state, &Held(pressure), dt);
        }
        let hidden = state.hidden.iter().flatten().copied();
        hidden
            .chain([state.time, state.angle, state.rate, model.reading(&state)])
            .all(Real::is_finite)
    })
}

fn with_parameter(mut d: Dynamics<f64>, id: ParameterId, value: f64) -> Dynamics<f64> {
    match id {
        ParameterId::Inertia => d.inertia = value,
        ParameterId::Damping => d.damping = value,
        ParameterId::Stiffness => d.stiffness = value,
        ParameterId::Exponent => d.exponent = value,
        ParameterId::InputGain => d.input_gain = value,
        ParameterId::Effect { .. } => unreachable!("not a parameter of the base equation"),
    }
    d
}

const BASE: [ParameterId; 5] = [
    ParameterId::Inertia,
    ParameterId::Damping,
    ParameterId::Stiffness,
    ParameterId::Exponent,
    ParameterId::InputGain,
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn random_models_stay_finite_over_steps_that_resolve_them(
        model in any_model(),
        instant in any_instant(),
    ) {
        // A spring that softens without limit runs away in finite time once it
        // is past its peak; so do the equations.
        if model.effects().any(|effect| softens(&effect)) {
            return Ok(());
        }
        prop_assert!(stays_finite(&model, instant, F64));
        prop_assert!(stays_finite(&model.map::<_, Minimax>(F32.from_f64), instant, F32));
        prop_assert!(stays_finite(&model.map::<_, GuardedMicromath>(F32.from_f64), instant, F32));
    }

    /// What a step length is chosen by: no slope of the force is steeper.
    #[test]
    fn fastest_rate_bounds_the_slopes_of_the_acceleration(
        model in any_model(),
        angle in -3.0..3.0,
        rate in -2.0..2.0,
    ) {
        // A softer law than Hooke's is infinitely steep at zero.
        let shifts = model.effects().filter(|effect| effect.kind() == Kind::ExponentShift);
        let shift: f64 = shifts.filter_map(|effect| effect.value(0)).sum();
        if model.dynamics().exponent + shift < 1.0 {
            return Ok(());
        }
        let acceleration = |angle, rate| {
            let mut state = model.at_rest(0.0, 0.0);
            (state.angle, state.rate) = (angle, rate);
            model.derivative(&state, &Held(0.0), 0.0).acceleration
        };
        let (size, d) = (acceleration(angle, rate).abs(), 1e-6);
        let along_angle = acceleration(angle + d, rate) - acceleration(angle - d, rate);
        let along_rate = acceleration(angle, rate + d) - acceleration(angle, rate - d);
        // Rates up to 2 rad/s are within the swing that quadratic damping assumes.
        let most = model.fastest_rate(3.2);
        let rounding = 1e-9 * (1.0 + size);
        prop_assert!(along_angle.abs() / (2.0 * d) <= most.stiffness + rounding / d);
        prop_assert!(along_rate.abs() / (2.0 * d) <= most.relaxation + rounding / d);
    }

    #[test]
    fn holding_pressure_balances(model in any_model(), angle in -3.0..3.0) {
        let pressure = model.holding_pressure(angle);
        let of_kind = |kind| model.effects().filter(move |effect| effect.kind() == kind);
        // Below a threshold nothing holds but nothing, two stiffenings make a parabola over
        // the pressure, and with a table of it the stiffness may end on any of its lines.
        let is_zigzag = model.table().is_some_and(|table| table.of() == Variable::Pressure);
        let threshold: f64 =
            of_kind(Kind::PressureThreshold).filter_map(|effect| effect.value(0)).sum();
        let growth: f64 =
            of_kind(Kind::PressureStiffening).filter_map(|effect| effect.value(0)).sum();
        if of_kind(Kind::PressureThreshold).count() > 0 && pressure <= threshold
            || of_kind(Kind::PressureStiffening).count() > 1
            || is_zigzag && 1.0 + growth * (pressure - threshold) <= 1e-3
            || !pressure.is_finite()
            || pressure.abs() > 1e9
        {
            return Ok(());
        }
        let state = model.at_rest(angle, pressure);
        let rates = model.derivative(&state, &Held(pressure), 0.0);
        let d = model.dynamics();
        // The size of the forces that have to cancel.
        let scale = d.input_gain * pressure.abs() + d.stiffness * angle.abs().powf(d.exponent)
            * (1.0 + growth.abs() * pressure.abs())
            // And of a table, ±5.
            + 6.0;
        // Where the stiffness grows nearly as fast as the force, little is left
        // of both.
        let rounding = if growth == 0.0 { 1e-13 } else { 1e-9 };
        prop_assert!(
            (rates.acceleration * d.inertia).abs() <= rounding * scale,
            "{} N left of {} N", rates.acceleration * d.inertia, scale
        );
        // And the hidden states have settled there, but for a leak and a phase,
        // which never do.
        for (effect, rates) in model.effects().zip(&rates.hidden) {
            if !matches!(effect.kind(), Kind::Leak | Kind::PeriodicDisturbance) {
                let largest = rates[0].abs().max(rates[1].abs());
                // A second mode answers to the acceleration that rounding left.
                let bound = rounding * scale * 10.0 * (1.0 + 8.0 / d.inertia);
                prop_assert!(largest <= bound.max(1e-12 * (1.0 + pressure.abs())));
            }
        }
    }

    #[test]
    fn angle_behind_a_reading_is_found_again(model in any_model(), angle in -3.0..3.0) {
        // A curved sensor shows two angles alike beyond its turning point.
        let curved = |effect: &Effect<f64>| effect.kind() == Kind::SensorNonlinearity;
        let offset = |effect: Effect<f64>| effect.kind() == Kind::SensorOffset;
        let angle = match model.effects().filter(curved).count() {
            0 => angle,
            1 if !model.effects().any(offset) => 0.4 * angle,
            _ => return Ok(()),
        };
        let reading = model.reading(&model.at_rest(angle, 0.0));
        prop_assert!((model.angle_behind(reading) - angle).abs() < 1e-12);
    }

    #[test]
    fn negative_parameters_are_rejected(
        dynamics in any_dynamics(),
        which in 0..4_usize,
        value in -1e3..-1e-12,
    ) {
        let id = BASE[which];
        let expected = match id {
            ParameterId::Inertia | ParameterId::Exponent => InvalidModel::NotPositive(id),
            _ => InvalidModel::Negative(id),
        };
        let rejected = Model::<f64>::new(with_parameter(dynamics, id, value), &[]);
        prop_assert_eq!(rejected.unwrap_err(), expected);
    }

    #[test]
    fn effects_out_of_bounds_are_rejected_and_named(
        effect in any_effect(),
        slot in 0..MAX_EFFECTS,
        which in 0..8_usize,
        beyond in 1e-3..10.0,
        below in any::<bool>(),
    ) {
        let rows = effect.parameters();
        let parameter = which % rows.len();
        let row = &rows[parameter];
        let bound = f64::from(if below { row.lower } else { row.upper });
        if bound.is_infinite() {
            return Ok(());
        }
        let mut bad = effect;
        bad.set_value(parameter, if below { bound - beyond } else { bound + beyond });
        // Everything before the bad one is good.
        let mut effects = vec![Kind::SensorOffset.build(&[0.1]).unwrap(); slot];
        effects.push(bad);
        prop_assert_eq!(
            Model::<f64>::new(lively(), &effects).unwrap_err(),
            InvalidModel::OutOfBounds(ParameterId::Effect { slot, parameter })
        );
    }
}

#[test]
fn numbers_that_are_not_finite_are_rejected_and_named() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for id in BASE {
            assert_eq!(
                Model::<f64>::new(with_parameter(lively(), id, bad), &[]).unwrap_err(),
                InvalidModel::NotFinite(id)
            );
        }
        for &kind in Kind::ALL {
            for parameter in 0..sample_values(kind)[0].len() {
                let mut effect = effect_of(kind, sample_values(kind)[0]);
                effect.set_value(parameter, bad);
                assert_eq!(
                    Model::<f64>::new(lively(), &[effect]).unwrap_err(),
                    InvalidModel::NotFinite(ParameterId::Effect { slot: 0, parameter })
                );
            }
        }
    }
}

#[test]
fn zero_is_a_damping_and_a_stiffness_but_no_inertia_and_no_exponent() {
    let with_zero = |id| Model::<f64>::new(with_parameter(lively(), id, 0.0), &[]);
    for id in [ParameterId::Inertia, ParameterId::Exponent] {
        assert_eq!(with_zero(id).unwrap_err(), InvalidModel::NotPositive(id));
    }
    for id in [
        ParameterId::Damping,
        ParameterId::Stiffness,
        ParameterId::InputGain,
    ] {
        assert!(with_zero(id).is_ok(), "{id:?}");
    }
}

#[test]
fn as_many_effects_as_there_are_slots_and_no_more() {
    let offset = Kind::SensorOffset.build(&[0.1]).unwrap();
    for count in 0..=MAX_EFFECTS {
        let model = Model::<f64>::new(lively(), &vec![offset; count]).unwrap();
        assert_eq!(model.effects().count(), count);
    }
    assert_eq!(
        Model::<f64>::new(lively(), &[offset; MAX_EFFECTS + 1]).unwrap_err(),
        InvalidModel::TooManyEffects
    );
}
