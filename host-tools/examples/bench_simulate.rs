//! Times the simulation that every fit and diagnosis is made of.
//!
//! `cargo xtask bench` runs this beside SciPy on the same two problems: a step
//! to 60° under constant pressure, and a run under a recorded, noisy pressure.
//! It writes JSON to standard output: the problem to the last number, the
//! seconds a simulation took, and the solution.

use std::{
    io,
    time::{Duration, Instant},
};

use host_tools::simulate::{Signal, Start, Trajectory, run, substeps};
use model_core::actuator::{Dynamics, Model};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use serde::Serialize;

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
    simulations: usize,
    angle_rad: Vec<f64>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let model = Model::<f64>::new(DYNAMICS, &[])?;
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
        measure(
            "constant pressure",
            true,
            &model,
            &time,
            vec![hold; SAMPLES],
        ),
        measure("recorded pressure", false, &model, &time, recorded),
    ];
    serde_json::to_writer(io::stdout().lock(), &problems)?;
    Ok(())
}

fn measure(
    name: &'static str,
    pressure_is_constant: bool,
    model: &Model<f64>,
    time: &[f64],
    pressure: Vec<f64>,
) -> Problem {
    let signal = Signal::new(time.to_vec(), pressure.clone());
    let steps = substeps(model, 1.0 / RATE_HZ, 1.5);
    let start = Start {
        angle: 0.0,
        rate: 0.0,
    };
    let simulate = || -> Trajectory<f64> { run(model, &signal, start, steps) };

    let mut solution = simulate();
    let mut seconds = Vec::new();
    let began = Instant::now();
    while began.elapsed() < ENOUGH {
        let one = Instant::now();
        solution = std::hint::black_box(simulate());
        seconds.push(one.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
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
        seconds_per_simulation: seconds[seconds.len() / 2],
        simulations: seconds.len(),
        angle_rad: solution.reading,
    }
}
