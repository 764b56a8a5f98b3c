//! Test recordings: only their first samples say where they start, and nothing is fitted to the
//! rest.

use model_core::actuator::Model;
use model_core::dynamics::Dynamics;
use softrig::diagnose::{Job, Request, diagnose};
use softrig::estimate::start_from::{StartFrom, error_of, simulate_from};
use softrig::estimate::{Dataset, Nuisance};
use softrig::synth::example::Hidden;
use softrig_formats::recording::Recording;

const INTERVAL: f64 = 0.01;

fn oscillator() -> Model<f64> {
    let dynamics = Dynamics {
        inertia: 1.0,
        damping: 1.0,
        stiffness: 40.0,
        exponent: 1.0,
        input_gain: 1e-3,
    };
    Model::new(dynamics, &[]).unwrap()
}

/// One period of a pressure of two tones.
fn undriven(samples: u16) -> Recording {
    let time: Vec<f64> = (0..samples).map(|k| INTERVAL * f64::from(k)).collect();
    let turn = std::f64::consts::TAU / (INTERVAL * f64::from(samples));
    let pressure = |t: &f64| 1e4 * ((3.0 * turn * t).sin() + (7.0 * turn * t + 1.0).sin());
    Recording {
        pressure: time.iter().map(pressure).collect(),
        angle: vec![0.0; time.len()],
        time,
        ..Recording::default()
    }
}

/// What the model makes of a recording's pressure from a start.
fn simulated(recording: &Recording, zeros: &Nuisance, start: StartFrom) -> Vec<f64> {
    let data = Dataset::of(std::slice::from_ref(recording));
    simulate_from(&oscillator(), &data.sessions()[0], zeros, start)
}

/// A run of the model that starts where it is said.
fn measured(angle: f64, rate: f64) -> Recording {
    let blank = undriven(600);
    let mut start = Nuisance::AT_ZERO;
    (start.start.angle, start.start.rate) = (angle, rate);
    let data = Dataset::of(std::slice::from_ref(&blank));
    Recording {
        angle: data.sessions()[0].simulate(&oscillator(), &start),
        ..blank
    }
}

#[test]
fn the_first_samples_give_the_true_start() {
    let start = StartFrom::Samples(20);
    let run = measured(0.3, -1.5);
    let found = simulated(&run, &Nuisance::AT_ZERO, start);
    assert!(error_of(&found, &run, start) < 1e-5);
    // At rest it is not.
    let found = simulated(&run, &Nuisance::AT_ZERO, StartFrom::Rest);
    assert!(error_of(&found, &run, StartFrom::Rest) > 0.02);
}

#[test]
fn an_offset_of_the_rest_is_not_absorbed() {
    const OFFSET: f64 = 0.05;
    let start = StartFrom::Samples(20);
    let mut run = measured(0.3, -1.5);
    for angle in &mut run.angle[20..] {
        *angle += OFFSET;
    }
    let found = simulated(&run, &Nuisance::AT_ZERO, start);
    let error = error_of(&found, &run, start);
    assert!((error - OFFSET).abs() < 1e-4, "{error}");
}

/// What is measured after the first samples changes nothing of the simulation.
#[test]
fn the_rest_is_not_looked_at() {
    let start = StartFrom::Samples(20);
    let run = measured(0.3, -1.5);
    let mut other = run.clone();
    for angle in &mut other.angle[20..] {
        *angle *= 0.9;
    }
    let zeros = Nuisance {
        pressure_zero: 200.0,
        angle_zero: 0.01,
        ..Nuisance::AT_ZERO
    };
    let [one, two] = [&run, &other].map(|it| simulated(it, &zeros, start));
    let apart = one.iter().zip(&two).map(|(a, b)| (a - b).abs());
    assert!(apart.fold(0.0, f64::max) < 1e-5);
}

#[test]
fn a_period_starts_in_its_steady_state() {
    let steady = undriven(2_000);
    let start = StartFrom::Period;
    let found = simulated(&steady, &Nuisance::AT_ZERO, start);
    assert_eq!(found.len(), steady.len());
    // The state after a period is that before it: the decay is over.
    let jump = (found[0] - found[found.len() - 1]).abs();
    let step = (found[1] - found[0]).abs();
    assert!(jump < 3.0 * step + 1e-4, "{jump} after steps of {step}");
    assert!(found[0].abs() > 1e-3);
}

#[test]
fn starts_are_read_and_wrong_ones_refused() {
    assert_eq!("0".parse(), Ok(StartFrom::Rest));
    assert_eq!("rest".parse(), Ok(StartFrom::Rest));
    assert_eq!("20".parse(), Ok(StartFrom::Samples(20)));
    assert_eq!("period".parse(), Ok(StartFrom::Period));
    for wrong in ["-3", "2.5", "all"] {
        let error = wrong.parse::<StartFrom>().unwrap_err();
        assert!(error.contains("such as 20"), "{error}");
    }
    for few in [1, 2, 5] {
        let start = StartFrom::Samples(few);
        let run = measured(0.1, 0.0);
        let found = simulated(&run, &Nuisance::AT_ZERO, start);
        assert!(found.iter().all(|it| it.is_finite()), "{few} samples");
    }
}

/// A test changes nothing of the answer, and its errors stand beside it.
#[test]
fn a_test_chooses_nothing() {
    let (file, all) = super::steps(Hidden::Nothing, 0.2, 5);
    let (fitted, test) = all.split_at(4);
    let alone = Request::of(&file, fitted);
    let tested = Request {
        holdout: test,
        start_from: &[StartFrom::Samples(20)],
        ..alone
    };
    let [without, with] = [alone, tested].map(|it| diagnose(&it, &Job::default()).unwrap());
    assert_eq!(without.finding, with.finding);
    assert!(without.test.is_empty());
    assert_eq!(with.test.len(), 1);
    assert_eq!(with.test[0].samples, test[0].len() - 20);
    let verdict = serde_json::to_value(with.verdict(&tested, 0.0)).unwrap();
    assert_eq!(verdict["test"][0]["start_from"], "20");

    let wrong = Request {
        start_from: &[StartFrom::Rest, StartFrom::Rest],
        ..tested
    };
    let error = diagnose(&wrong, &Job::default()).unwrap_err().to_string();
    assert!(error.contains("2 starts for 1"), "{error}");
    let long = Request {
        start_from: &[StartFrom::Samples(1_000_000)],
        ..tested
    };
    let error = diagnose(&long, &Job::default()).unwrap_err().to_string();
    assert!(error.contains("start from fewer"), "{error}");
}
