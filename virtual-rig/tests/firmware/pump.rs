// SPDX-License-Identifier: GPL-3.0-or-later
//! The pulses that the driver sees.

use virtual_rig::board::CLOCK_HZ;
use wire::{
    command::Command,
    protocol::Named,
    settings::{Key, Settings},
    state::State,
};

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

/// Intervals around one that tell which was planned.
const NEIGHBOURS: usize = 21;

/// Cycles within which simavr moves a pin: it does so between instructions.
const BETWEEN_INSTRUCTIONS: u64 = 4;

/// The intervals (cycles) that a plan gave one rate: those around which most are the planned
/// one. What was late there is not thrown away: it is what is looked for.
fn steady(intervals: &[u64], planned: u64) -> Vec<u64> {
    let near = |window: &[u64]| {
        let is_near = |interval: &&u64| interval.abs_diff(planned) <= BETWEEN_INSTRUCTIONS;
        2 * window.iter().filter(is_near).count() > NEIGHBOURS
    };
    let planned_around: Vec<bool> = intervals.windows(NEIGHBOURS).map(near).collect();
    // An interval in the middle of so many windows has no ramp within any of them.
    planned_around
        .windows(NEIGHBOURS)
        .zip(intervals.iter().skip(NEIGHBOURS - 1))
        .filter(|(windows, _)| windows.iter().all(|&is_planned| is_planned))
        .map(|(_, &interval)| interval)
        .collect()
}

/// At full flow every interval is the planned one within 1.5 µs, although the converter, the
/// serial line and the model interrupt one another.
#[test]
fn pulses_do_not_jitter() {
    /// 1.5 µs. Simulated, an edge soon after a turn of the counter comes up to 16 cycles later
    /// (`shim.c`), and any pin moves up to 13 late, after the entry of an interrupt.
    const MOST_CYCLES: u64 = 24;
    // The pump starts in different phases of the control period, the converter and the line.
    for delay_s in [0.0, 0.0011, 0.0023, 0.0037] {
        let Some(mut bench) = Bench::start(healthy()) else {
            return;
        };
        bench.arm();
        bench.run(delay_s);
        bench.obey(Command::Run(Some(Named::Paper)));
        bench.rig.trace_steps(true);
        bench.rig.step_edges();
        bench.run(3.0);
        let edges = bench.rig.step_edges();
        let intervals: Vec<u64> = edges.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let settings = Settings::DEFAULT;
        let rate = settings.number(Key::MaxFlow) / settings.number(Key::VolumePerStep);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // Some 1 120.
        let planned = (CLOCK_HZ as f32 / rate) as u64;
        let mut late: Vec<u64> = steady(&intervals, planned)
            .iter()
            .map(|interval| interval.abs_diff(planned))
            .collect();
        late.sort_unstable();
        assert!(late.len() > 5_000, "{} steady intervals", late.len());
        let mean = late.iter().sum::<u64>() as f64 / late.len() as f64;
        let [p999, maximum] = [late[late.len() * 999 / 1_000], late[late.len() - 1]];
        println!(
            "{} intervals of {planned} cycles: mean {mean:.3}, p99.9 {p999}, maximum {maximum} cycles",
            late.len()
        );
        assert!(maximum <= MOST_CYCLES, "{maximum} cycles of 62.5 ns");
    }
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
