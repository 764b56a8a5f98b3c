//! What is left and does not matter is said to be that, and only where somebody says so.

use softrig::diagnose::decide::finding::Finding;
use softrig::diagnose::{Diagnosis, Job, Request, diagnose};
use softrig::synth::example::Hidden;

use super::steps;

/// What the angle sensor adds in run number `run` (rad): five slow sines, other ones in every
/// run, of 0.2° in all. No effect of the catalogue does that.
fn wandering(run: usize, time: f64) -> f64 {
    const RATES: [f64; 5] = [0.9, 1.7, 2.6, 3.8, 5.1];
    let each = 0.2_f64.to_radians() * (2.0 / RATES.len() as f64).sqrt();
    RATES
        .iter()
        .enumerate()
        .map(|(place, rate)| {
            let run = run as f64;
            each * (rate * (1.0 + 0.07 * run) * time + run * (1.3 + place as f64)).sin()
        })
        .sum()
}

/// The diagnosis of runs in which nothing else is missing.
fn diagnosed(tolerance_deg: f64) -> Diagnosis {
    let (file, mut recordings) = steps(Hidden::Nothing, 0.05, 5);
    for (run, recording) in recordings.iter_mut().enumerate() {
        for (angle, time) in recording.angle.iter_mut().zip(&recording.time) {
            *angle += wandering(run, *time);
        }
        recording.meta.tolerance_deg = Some(tolerance_deg);
    }
    let request = Request::of(&file, &recordings);
    diagnose(&request, &Job::default()).unwrap()
}

#[test]
fn what_is_left_below_the_tolerance_does_not_matter() {
    let found = diagnosed(1.0);
    let Finding::Quiet { immaterial, .. } = found.finding else {
        panic!("{:?}", found.finding);
    };
    assert!(immaterial);
    assert!(found.beyond_noise() < found.tolerance);
    let left = found.beyond_noise().to_degrees();
    assert!((0.1..0.3).contains(&left), "{left}");

    let found = diagnosed(0.02);
    assert!(!found.finding.is_quiet(), "{:?}", found.finding);
}
