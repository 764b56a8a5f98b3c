// SPDX-License-Identifier: GPL-3.0-or-later
//! The board moves the plant, and sees it through its pins.

use super::common::{ask, obeying, tell, wait};
use virtual_rig::{Fault, Options};

/// Means of many conversions.
fn mean(rig: &mut virtual_rig::VirtualRig, letter: &str, name: &str) -> f64 {
    mean_of(200, rig, letter, name)
}

fn mean_of(count: u32, rig: &mut virtual_rig::VirtualRig, letter: &str, name: &str) -> f64 {
    (0..count)
        .map(|_| ask(rig, letter, name) as f64)
        .sum::<f64>()
        / f64::from(count)
}

#[test]
fn sensors_read_their_zeros() {
    let Some(mut rig) = obeying(Options::default()) else {
        return;
    };
    // A tenth of 1024 counts, and 47 kΩ of 72 kΩ; noise
    // of 0.37 and 1.2 counts.
    let pressure = mean(&mut rig, "p", "pressure");
    assert!((pressure - 102.4).abs() < 0.1, "{pressure}");
    let flex = mean(&mut rig, "f", "flex");
    assert!((flex - 668.4).abs() < 0.3, "{flex}");
}

/// An ideal converter has its first transition at half a count, so that white
/// noise averages to the voltage. What is left of the steps under the pressure's
/// noise of 0.37 counts is exp(−2π² 0.37²)/π = 0.02 counts.
#[test]
fn readings_average_to_the_voltage() {
    for (at_counts, seed) in [(102.4, 1), (102.9, 2), (256.25, 3), (511.5, 4), (870.75, 5)] {
        let mut options = Options {
            seed,
            ..Options::default()
        };
        options.plant.pressure_sensor.offset_millivolts = (at_counts - 102.4) / 1024.0 * 5000.0;
        let Some(mut rig) = obeying(options) else {
            return;
        };
        let counts = mean_of(4000, &mut rig, "p", "pressure");
        assert!((counts - at_counts).abs() < 0.05, "{at_counts}: {counts}");
    }
}

#[test]
fn each_conversion_has_white_noise_of_its_own() {
    let Some(mut rig) = obeying(Options::default()) else {
        return;
    };
    let values: Vec<f64> = (0..3000)
        .map(|_| ask(&mut rig, "f", "flex") as f64)
        .collect();
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let moment = |lag: usize| {
        let pairs = values.iter().zip(&values[lag..]);
        pairs.map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>() / count
    };
    // 0.4° at 2.655 counts a degree (dU/dθ of the divider at 0°), and the
    // converter's own rounding.
    let expected = (0.4f64 * 2.655).powi(2) + 1.0 / 12.0;
    assert!(
        (moment(0) / expected - 1.0).abs() < 0.1,
        "{} {expected}",
        moment(0)
    );
    for lag in 1..5 {
        let correlation = moment(lag) / moment(0);
        assert!(correlation.abs() < 0.08, "{correlation} at lag {lag}");
    }
}

#[test]
fn pushing_in_compresses_and_bends_and_venting_releases() {
    let Some(mut rig) = obeying(Options::default()) else {
        return;
    };
    tell(&mut rig, "xcei");
    let start = rig.plant();
    assert!(!start.valve_open && start.driver_enabled);
    assert!((2.0..8.0).contains(&start.plunger_mm));
    for _ in 0..4 {
        tell(&mut rig, "S");
        rig.run_for(1.0).unwrap();
    }
    rig.run_for(3.0).unwrap();
    let pushed = rig.plant();
    assert_eq!(pushed.steps.edges, 64_000);
    assert_eq!(pushed.steps.lost, 0);
    assert!((pushed.plunger_mm - start.plunger_mm - 40.0).abs() < 1e-9);
    let volume = |plunger: f64| 4.0 + 0.559_90 * (100.0 - plunger);
    let boyle = 101.325 * (volume(start.plunger_mm) / volume(pushed.plunger_mm) - 1.0);
    // A leak of 2500 s for some seconds.
    assert!(
        (pushed.pressure_kpa / boyle - 1.0).abs() < 5e-3,
        "{pushed:?} {boyle}"
    );
    assert!(pushed.angle_deg > 40.0, "{pushed:?}");
    let counts = mean(&mut rig, "p", "pressure");
    let psi = pushed.pressure_kpa / 6.894_757;
    assert!(
        (counts - 1024.0 * (0.1 + psi / 100.0)).abs() < 0.5,
        "{counts}"
    );

    tell(&mut rig, "v");
    rig.run_for(0.5).unwrap();
    assert!(rig.plant().pressure_kpa < 0.5);
    rig.run_for(4.0).unwrap();
    assert!(rig.plant().angle_deg.abs() < 15.0, "{:?}", rig.plant());
}

#[test]
fn steps_are_lost_at_the_stop_and_while_disabled_or_stalled() {
    let Some(mut rig) = obeying(Options::default()) else {
        return;
    };
    tell(&mut rig, "xo");
    let start = rig.plant();
    tell(&mut rig, "s");
    assert_eq!(rig.plant().steps, start.steps, "the driver is off");
    tell(&mut rig, "es");
    assert!((start.plunger_mm - rig.plant().plunger_mm - 0.01).abs() < 1e-9);
    tell(&mut rig, "is");
    assert!((start.plunger_mm - rig.plant().plunger_mm).abs() < 1e-9);
    rig.set_fault(Fault::Stall, true);
    tell(&mut rig, "s");
    assert_eq!(rig.plant().steps.lost, 16);
    assert!((start.plunger_mm - rig.plant().plunger_mm).abs() < 1e-9);
    rig.set_fault(Fault::Stall, false);

    assert_eq!(ask(&mut rig, "k", "switches"), 0);
    tell(&mut rig, "o");
    for _ in 0..2 {
        tell(&mut rig, "S");
        rig.run_for(1.0).unwrap();
    }
    let end = rig.plant();
    assert!((end.plunger_mm + 2.0).abs() < 1e-9, "{end:?}");
    let travelled = (start.plunger_mm + 2.0) * 1600.0;
    assert!(
        (end.steps.lost as f64 - (32_016.0 - travelled)).abs() < 1e-6,
        "{end:?}"
    );
    assert_eq!(ask(&mut rig, "k", "switches"), 1);
    rig.set_fault(Fault::EmergencyStop, true);
    rig.set_fault(Fault::EndSwitch, true);
    assert_eq!(ask(&mut rig, "k", "switches"), 7);
}

#[test]
fn step_pulses_are_recorded_to_the_cycle() {
    let Some(mut rig) = obeying(Options::default()) else {
        return;
    };
    rig.trace_steps(true);
    tell(&mut rig, "xes");
    let edges = rig.step_edges();
    assert_eq!(edges.len(), 16);
    let gaps: Vec<u64> = edges.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(gaps.iter().all(|&gap| gap == gaps[0]), "{gaps:?}");
    assert!((50..300).contains(&gaps[0]));
}

#[test]
fn broken_sensors_read_the_rails_or_stand_still() {
    let Some(mut rig) = obeying(Options::default()) else {
        return;
    };
    for (fault, letter, name, expected) in [
        (Fault::OpenFlex, "f", "flex", 0),
        (Fault::ShortFlex, "f", "flex", 1023),
        (Fault::OpenPressure, "p", "pressure", 0),
        (Fault::ShortPressure, "p", "pressure", 1023),
    ] {
        rig.set_fault(fault, true);
        rig.run_for(0.001).unwrap();
        assert_eq!(ask(&mut rig, letter, name), expected, "{fault}");
        rig.set_fault(fault, false);
        rig.run_for(0.001).unwrap();
    }
    rig.set_fault(Fault::StuckFlex, true);
    rig.run_for(0.001).unwrap();
    let first = ask(&mut rig, "f", "flex");
    for _ in 0..20 {
        assert_eq!(ask(&mut rig, "f", "flex"), first);
    }
}

#[test]
fn the_same_seed_and_input_give_the_same_output() {
    let run = |seed| {
        let mut rig = obeying(Options {
            seed,
            ..Options::default()
        })?;
        rig.set_fault(Fault::Noise, true);
        for _ in 0..40 {
            tell(&mut rig, "pfpf");
        }
        Some((rig.take_output(), rig.cycle(), rig.plant().plunger_mm))
    };
    let Some(first) = run(5) else { return };
    assert_eq!(Some(&first), run(5).as_ref());
    assert_ne!(Some(first), run(6));
}

#[test]
fn a_planned_leak_lets_the_air_out() {
    let Some(mut rig) = obeying(Options {
        faults: vec!["leak@3..6".parse().unwrap()],
        ..Options::default()
    }) else {
        return;
    };
    tell(&mut rig, "xceiS");
    rig.run_for(2.9 - rig.time_s()).unwrap();
    let before = rig.plant().pressure_kpa;
    rig.run_for(3.2).unwrap();
    let after = rig.plant().pressure_kpa;
    let expected = before * (-1.0f64).exp();
    assert!((after / expected - 1.0).abs() < 0.01, "{before} {after}");
    rig.run_for(1.0).unwrap();
    assert!((rig.plant().pressure_kpa / after - 1.0).abs() < 0.01);
}

#[test]
fn bytes_arrive_at_the_pace_of_the_line_and_none_is_lost() {
    let Some(mut rig) = obeying(Options::default()) else {
        return;
    };
    let begin = rig.cycle();
    rig.send(&[b'z'; 100]).unwrap();
    rig.send(b"!").unwrap();
    wait(&mut rig, "!");
    let bytes = (rig.cycle() - begin) as f64 / (10.0 * 136.0);
    // Each byte is echoed with a line end at the same pace: 202 bytes.
    assert!((202.0..218.0).contains(&bytes), "{bytes} byte times");
    assert!(rig.overruns() > 0, "the echo is slower than the input");
}
