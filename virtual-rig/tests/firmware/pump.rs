// SPDX-License-Identifier: GPL-3.0-or-later
//! The pulses that the driver sees.

use virtual_rig::board::CLOCK_HZ;
use wire::{command::Command, protocol::Named, state::State};

use crate::bench::{Bench, healthy};

/// Seconds between pulses, while a protocol is played.
fn intervals(bench: &mut Bench, seconds: f64) -> Vec<f64> {
    bench.rig.trace_steps(true);
    bench.rig.step_edges();
    bench.run(seconds);
    let edges = bench.rig.step_edges();
    edges
        .windows(2)
        .map(|pair| (pair[1] - pair[0]) as f64 / f64::from(CLOCK_HZ))
        .collect()
}

/// At a constant rate neighbouring intervals differ by less than 2 µs, although
/// the converter, the serial line and the model interrupt one another.
#[test]
fn pulses_do_not_jitter() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.arm();
    bench.obey(Command::Run(Some(Named::Paper)));
    let intervals = intervals(&mut bench, 3.0);
    assert!(intervals.len() > 5_000, "{} pulses", intervals.len());
    // Stretches of the same rate: at its highest, the pump runs for long.
    let fastest = intervals.iter().copied().fold(f64::INFINITY, f64::min);
    let steady: Vec<f64> = intervals
        .windows(21)
        .filter(|window| {
            window
                .iter()
                .all(|interval| (interval - fastest).abs() < 0.02 * fastest)
        })
        .flat_map(|window| window.windows(2).map(|pair| (pair[1] - pair[0]).abs()))
        .collect();
    assert!(steady.len() > 1_000, "{} steady pairs", steady.len());
    let jitter = steady.iter().copied().fold(0.0, f64::max);
    println!(
        "jitter {:.2} us at {:.0} steps/s",
        1e6 * jitter,
        1.0 / fastest
    );
    assert!(jitter < 2e-6, "{jitter} s");
}

/// The rate climbs no faster than the settings allow: 40 000 µl/s² of 0.35 µl.
#[test]
fn the_rate_climbs_as_a_trapezoid() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.arm();
    bench.obey(Command::Run(Some(Named::Paper)));
    let intervals = intervals(&mut bench, 2.0);
    let allowed = 40_000.0 / 0.35;
    let mut time = 0.0;
    let mut rates: Vec<(f64, f64)> = Vec::new();
    for interval in &intervals {
        time += interval;
        rates.push((time, 1.0 / interval));
    }
    let mut steepest: f64 = 0.0;
    for (index, &(start, from)) in rates.iter().enumerate() {
        // Over 20 ms, within which a planner may move in its own steps.
        if let Some(&(end, to)) = rates[index..].iter().find(|(at, _)| at - start >= 0.02)
            && to > from
            && end - start < 0.05
        {
            steepest = steepest.max((to - from) / (end - start));
        }
    }
    println!("steepest {steepest:.0} of {allowed:.0} steps/s^2");
    assert!(steepest > 0.0 && steepest < 1.6 * allowed, "{steepest}");
}

/// Homing finds the same place from anywhere, and no step is lost.
#[test]
fn homing_ends_at_the_same_place() {
    let mut places = Vec::new();
    for seed in [1, 2, 3] {
        let mut options = healthy();
        options.seed = seed;
        let Some(mut bench) = Bench::start(options) else {
            return;
        };
        bench.arm();
        assert_eq!(bench.state(), State::Ready);
        places.push(bench.rig.plant().plunger_mm);
        assert_eq!(bench.rig.plant().steps.lost, 0);
    }
    let spread = places.iter().copied().fold(f64::NEG_INFINITY, f64::max)
        - places.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(spread < 0.05, "{places:?}");
}
