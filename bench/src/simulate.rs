//! Times the simulation that every fit and diagnosis is made of.
//!
//! `cargo xtask bench` runs this beside SciPy on the same two problems: a step
//! to 60° under constant pressure, and a run under a recorded, noisy pressure.
//! Its JSON has the problem to the last number, the seconds a simulation took, and
//! the solution.

use std::time::{Duration, Instant};

use model_core::actuator::{Model, ParameterId};
use model_core::dynamics::Dynamics;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use serde::Serialize;
use serde_json::{Value, json};
use softrig::sim::dual::Dual;
use softrig::sim::simulate::{InitialState, Signal, Trajectory, run, substeps};

const DYNAMICS: Dynamics<f64> = Dynamics {
    inertia: 0.36,
    damping: 0.913,
    stiffness: 0.127,
    exponent: 2.365,
    input_gain: 2.17e-5,
};
const RATE_HZ: f64 = 1000.0;
const SAMPLES: usize = 10_001;
const ENOUGH: Duration = Duration::from_secs(1);
/// Derivatives that are carried along: as many as a fit with one effect has.
const DERIVATIVES: usize = 8;
const SEED: u64 = 1;

#[derive(Serialize)]
struct Problem {
    name: &'static str,
    inertia: f64,
    damping: f64,
    stiffness: f64,
    exponent: f64,
    input_gain: f64,
    pressure_is_constant: bool,
    time_s: Vec<f64>,
    pressure_pa: Vec<f64>,
    steps_between_samples: usize,
    seconds_per_simulation: f64,
    /// The same with the derivatives of every sample by so many parameters.
    seconds_with_derivatives: f64,
    derivatives: usize,
    simulations: usize,
    angle_rad: Vec<f64>,
}

/// Times both problems.
///
/// # Errors
///
/// If the model is none.
pub fn measure() -> Result<Value, String> {
    let model = Model::<f64>::new(DYNAMICS, &[]).map_err(|error| error.to_string())?;
    let hold = model.holding_pressure(60_f64.to_radians());
    let time: Vec<f64> = (0..SAMPLES).map(|k| k as f64 / RATE_HZ).collect();
    let mut random = Pcg32::seed_from_u64(SEED);
    let recorded = time
        .iter()
        .map(|t| {
            let slow = 0.75 + 0.25 * (1.3 * t).sin() + 0.1 * (5.1 * t).sin();
            hold * (slow + 0.02 * random.random_range(-1.0..1.0))
        })
        .collect();
    let problems = [
        problem(
            "constant pressure",
            true,
            &model,
            &time,
            vec![hold; SAMPLES],
        ),
        problem("recorded pressure", false, &model, &time, recorded),
    ];
    Ok(json!({ "benchmark": "simulate", "problems": problems }))
}

fn problem(
    name: &'static str,
    pressure_is_constant: bool,
    model: &Model<f64>,
    time: &[f64],
    pressure: Vec<f64>,
) -> Problem {
    let signal = Signal::new(time.to_vec(), pressure.clone());
    let steps = substeps(model, 1.0 / RATE_HZ, 1.5);
    let start = InitialState {
        angle: 0.0,
        rate: 0.0,
    };
    let simulate = || -> Trajectory<f64> { run(model, &signal, start, steps) };

    let (seconds_per_simulation, simulations, solution) = timed(simulate);

    let mut dual: Model<Dual<DERIVATIVES>> = model.map(Dual::constant);
    let parameters = [
        ParameterId::Inertia,
        ParameterId::Damping,
        ParameterId::Stiffness,
        ParameterId::Exponent,
        ParameterId::InputGain,
    ];
    for (column, id) in parameters.into_iter().enumerate() {
        if let Some(value) = model.value(id) {
            dual = dual.with_value(id, Dual::variable(value, column, 1.0));
        }
    }
    let rest = InitialState {
        angle: Dual::variable(0.0, DERIVATIVES - 2, 1.0),
        rate: Dual::variable(0.0, DERIVATIVES - 1, 1.0),
    };
    let (seconds_with_derivatives, ..) = timed(|| run(&dual, &signal, rest, steps));
    Problem {
        name,
        inertia: DYNAMICS.inertia,
        damping: DYNAMICS.damping,
        stiffness: DYNAMICS.stiffness,
        exponent: DYNAMICS.exponent,
        input_gain: DYNAMICS.input_gain,
        pressure_is_constant,
        time_s: time.to_vec(),
        pressure_pa: pressure,
        steps_between_samples: steps,
        seconds_per_simulation,
        seconds_with_derivatives,
        derivatives: DERIVATIVES,
        simulations,
        angle_rad: solution.reading,
    }
}

/// The median seconds of a run, how many there were, and what the last one gave.
fn timed<T>(run: impl Fn() -> T) -> (f64, usize, T) {
    let mut found = run();
    let mut seconds = Vec::new();
    let began = Instant::now();
    while began.elapsed() < ENOUGH {
        let one = Instant::now();
        found = std::hint::black_box(run());
        seconds.push(one.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    (seconds[seconds.len() / 2], seconds.len(), found)
}
