//! Order of convergence, by halving the step.
//!
//! The order is what a wrong coefficient destroys first. The input moves within
//! the step, so that a stage at the wrong instant shows as well, and the angle
//! stays well above zero, where a power that is not whole has all derivatives.

use model_core::actuator::{Model, State};
use model_core::catalogue::{Effect, Kind};
use model_core::dynamics::Dynamics;
use model_core::input::Held;
use model_core::integrate::{Scheme, step};

use crate::solver::{Values, solve};
use crate::support::{F64, SCHEMES, lively, run};

const INTERVAL_S: f64 = 0.4;
const INTERVALS: u32 = 4;
const START_RAD: f64 = 0.9;
const START_RAD_PER_S: f64 = 0.5;
const MEAN_PRESSURE_PA: f64 = 86_000.0;

fn pressure_pa(time: f64) -> f64 {
    MEAN_PRESSURE_PA * (1.0 + 0.3 * (5.0 * time).sin())
}

fn model(effects: &[Effect<f64>]) -> Model<f64> {
    Model::new(lively(), effects).expect("test parameters are valid")
}

/// The largest error over the end of every interval, with `steps` steps each.
fn error(
    scheme: Scheme,
    model: &Model<f64>,
    solution: &[Values],
    values: impl Fn(&State<f64>) -> Values,
    steps: u32,
) -> f64 {
    let start = model.moving(START_RAD, START_RAD_PER_S, pressure_pa(0.0));
    let dt = INTERVAL_S / f64::from(steps);
    let mut largest = 0.0_f64;
    run(
        scheme,
        model,
        start,
        pressure_pa,
        (dt, steps * INTERVALS),
        F64,
        |k, state| {
            assert!(state.angle > 0.3, "{scheme:?} left the smooth region");
            if k.is_multiple_of(steps) {
                let at = &solution[usize::try_from(k / steps).expect("few intervals")];
                for (is, should) in values(state).iter().zip(at) {
                    largest = largest.max((is - should).abs());
                }
            }
        },
    );
    largest
}

fn assert_orders(
    name: &str,
    model: &Model<f64>,
    solution: &[Values],
    values: impl Fn(&State<f64>) -> Values + Copy,
) {
    for (scheme, steps, band) in [
        (Scheme::SemiImplicitEuler, 400, 0.01),
        (Scheme::Heun, 100, 0.03),
        (Scheme::ExponentialHeun, 100, 0.03),
        (Scheme::Rk4, 20, 0.05),
    ] {
        let errors = [1, 2, 4].map(|finer| error(scheme, model, solution, values, finer * steps));
        for pair in errors.windows(2) {
            let order = (pair[0] / pair[1]).log2();
            println!(
                "{name}, {scheme:?}: error {:.2e}, order {order:.3}",
                pair[1]
            );
            assert!(
                (order - f64::from(scheme.order())).abs() <= band,
                "{name}, {scheme:?}: order {order}"
            );
        }
    }
}

#[test]
fn base_model_converges_with_the_order_of_the_scheme() {
    let d = lively();
    let solution = solve(
        |time, at| {
            let force = d.input_gain * pressure_pa(time)
                - d.damping * at[1]
                - d.stiffness * at[0].powf(d.exponent);
            [at[1], force / d.inertia, 0.0, 0.0]
        },
        [START_RAD, START_RAD_PER_S, 0.0, 0.0],
        INTERVAL_S,
        INTERVALS,
    );
    assert_orders("base model", &model(&[]), &solution, |state| {
        [state.angle, state.rate, 0.0, 0.0]
    });
}

/// Hidden states are integrated with the motion and must not lag a stage
/// behind it.
#[test]
fn hidden_states_converge_with_the_order_of_the_scheme() {
    let d = lively();
    let (branch, relaxation, lag) = (1.2, 0.7, 0.15);
    let effects = [
        Kind::MaxwellBranch
            .build(&[branch, relaxation, 0.0])
            .unwrap(),
        Kind::PneumaticLag.build(&[lag]).unwrap(),
    ];
    let solution = solve(
        |time, at| {
            let force = d.input_gain * at[3]
                - d.damping * at[1]
                - d.stiffness * at[0].powf(d.exponent)
                - branch * (at[0] - at[2]);
            [
                at[1],
                force / d.inertia,
                (at[0] - at[2]) / relaxation,
                (pressure_pa(time) - at[3]) / lag,
            ]
        },
        [START_RAD, START_RAD_PER_S, START_RAD, pressure_pa(0.0)],
        INTERVAL_S,
        INTERVALS,
    );
    // Pressure counted in units of its mean, as everything else is near 1.
    let scaled: Vec<Values> = solution
        .iter()
        .map(|at| [at[0], at[1], at[2], at[3] / MEAN_PRESSURE_PA])
        .collect();
    assert_orders("with hidden states", &model(&effects), &scaled, |state| {
        let chamber = state.hidden[1][0] / MEAN_PRESSURE_PA;
        [state.angle, state.rate, state.hidden[0][0], chamber]
    });
}

#[test]
fn every_scheme_keeps_the_time() {
    for scheme in SCHEMES {
        let model = model(&[]);
        let start = model.at_rest(START_RAD, MEAN_PRESSURE_PA);
        let end = run(
            scheme,
            &model,
            start,
            pressure_pa,
            (0.125, 8),
            F64,
            |_, _| {},
        );
        assert!((end.time - 1.0).abs() < 1e-15, "{scheme:?}: {}", end.time);
    }
}

/// An overdamped actuator whose damping other schemes would have to resolve: it creeps
/// towards its rest with K/C, and a step fifty times longer than M/C sees that.
#[test]
fn exponential_steps_carry_a_strong_damping() {
    let dynamics = Dynamics {
        inertia: 0.002,
        damping: 1.0,
        stiffness: 2.0,
        exponent: 1.0,
        input_gain: 2e-5,
    };
    let model: Model<f64> = Model::new(dynamics, &[]).expect("test parameters are valid");
    let (dt, steps) = (0.1, 30);
    let mut state = model.at_rest(0.0, 0.0);
    let force = dynamics.input_gain * MEAN_PRESSURE_PA;
    for _ in 0..steps {
        step(
            Scheme::ExponentialHeun,
            &model,
            &mut state,
            &Held(MEAN_PRESSURE_PA),
            dt,
        );
    }
    // Both roots of M s² + C s + K = 0.
    let root = (dynamics.damping.powi(2) - 4.0 * dynamics.inertia * dynamics.stiffness).sqrt();
    let (fast, slow) = (
        (-dynamics.damping - root) / (2.0 * dynamics.inertia),
        (-dynamics.damping + root) / (2.0 * dynamics.inertia),
    );
    let time = dt * f64::from(steps);
    let exact = force / dynamics.stiffness
        * (1.0 + (slow * (fast * time).exp() - fast * (slow * time).exp()) / (fast - slow));
    assert!(
        (state.angle / exact - 1.0).abs() < 2e-3,
        "{} and {exact}",
        state.angle
    );
    // The rest is exact: nothing moves there.
    let mut rest = model.at_rest(force / dynamics.stiffness, MEAN_PRESSURE_PA);
    step(
        Scheme::ExponentialHeun,
        &model,
        &mut rest,
        &Held(MEAN_PRESSURE_PA),
        dt,
    );
    assert!((rest.angle * dynamics.stiffness / force - 1.0).abs() < 1e-12);
}
