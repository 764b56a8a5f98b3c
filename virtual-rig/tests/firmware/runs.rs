// SPDX-License-Identifier: GPL-3.0-or-later
//! What a lab does: look, home, run a protocol, stop.

use wire::{
    command::Command,
    decimal::Hundredths,
    protocol::{ControlMode, Named, Segment},
    reply::Refusal,
    settings::Key,
    state::State,
    telemetry::Setpoint,
};

use crate::{
    bench::{Bench, healthy},
    steps,
};

#[test]
fn a_monitor_shows_angles_without_a_command() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    assert!(
        bench.remarks.iter().any(|line| line.contains("softrig")),
        "{:?}",
        bench.remarks
    );
    bench.beating = false;
    bench.samples.clear();
    bench.run(3.0);
    assert_eq!(bench.garbage, 0);
    assert!(
        (299..=301).contains(&bench.samples.len()),
        "{}",
        bench.samples.len()
    );
    for pair in bench.samples.windows(2) {
        assert_eq!(pair[1].sequence, pair[0].sequence.wrapping_add(1));
        assert_eq!(pair[1].time_ms, pair[0].time_ms + 10);
    }
    let last = bench.now();
    assert_eq!(last.state, State::Idle);
    let angle = last.angle_deg.expect("an angle").to_f32();
    let pressure = last.pressure_kpa.expect("a pressure").to_f32();
    // Half a count of the converter, noise, and the table's chords.
    assert!(angle.abs() < 2.0 && pressure.abs() < 1.5, "{last:?}");
    assert!(bench.is_safe());
}

/// While a protocol runs, when the lines are longest, as in the first ten seconds after a reset: later
/// the number of a line and its time have a digit more each.
#[test]
fn the_cable_is_idle_for_a_fifth_of_the_time() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.arm();
    bench.obey(Command::Run(Some(Named::Paper)));
    bench.run(4.0);
    bench.rig.take_output();
    let mut output = Vec::new();
    for _ in 0..20 {
        bench.rig.run_for(0.05).expect("the board runs");
        output.extend(bench.rig.take_output());
    }
    let text = String::from_utf8_lossy(&output);
    let counters = text.lines().filter_map(|line| line.strip_prefix("T "));
    let more_digits: usize = counters
        .filter_map(|line| {
            let mut fields = line.split(' ');
            Some(fields.next()?.len() + fields.next()?.len())
        })
        .map(|digits| digits.saturating_sub("512 5120".len() - 1))
        .sum();
    let bytes = output.len() - more_digits;
    // 16 MHz / 8 / 17, ten bits a byte.
    let capacity = 11_764.7;
    assert!(
        f64::from(u32::try_from(bytes).unwrap()) < 0.8 * capacity,
        "{bytes} bytes"
    );
}

#[test]
fn the_papers_steps_are_reached() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.arm();
    assert!(!bench.rig.plant().valve_open && bench.rig.plant().driver_enabled);
    bench.obey(Command::Run(Some(Named::Paper)));
    bench.until(1.0, "the start", |bench| bench.state() == State::Running);
    bench.samples.drain(..bench.samples.len() - 1);
    bench.until(300.0, "the end", |bench| bench.state() == State::Ready);
    let asked = bench.angles_held_deg();
    assert_eq!(asked.len(), 14, "{asked:?}");
    assert!(asked[..7].iter().all(|level| (level - 60.0).abs() < 0.01));
    assert!(asked[7..].iter().all(|level| (level - 90.0).abs() < 0.01));
    // Where a hold ends, the sensor shows what was asked for: the model is right.
    for pair in bench.samples.windows(2) {
        if let (Setpoint::Angle(level), Setpoint::None) = (pair[0].setpoint, pair[1].setpoint) {
            let reached = pair[0].angle_deg.expect("an angle").to_f32();
            assert!(
                (reached - level.to_f32()).abs() < 3.0,
                "{level:?}: {reached}"
            );
        }
    }
    assert!(bench.samples.iter().all(|sample| !sample.mismatch));
    let worst = bench
        .samples
        .iter()
        .map(|sample| {
            sample.angle_deg.expect("an angle").to_f32()
                - sample.predicted_deg.expect("a prediction").to_f32()
        })
        .fold(0.0_f32, |worst, gap| worst.max(gap.abs()));
    assert!(worst < 5.0, "{worst}° between prediction and sensor");
    assert_eq!(bench.garbage, 0);
}

#[test]
fn every_named_protocol_runs_to_its_end() {
    for &named in Named::ALL {
        if named == Named::Paper {
            continue; // Has its own test.
        }
        let Some(mut bench) = Bench::start(healthy()) else {
            return;
        };
        bench.arm();
        bench.obey(Command::Run(Some(named)));
        bench.until(
            2.0 + f64::from(wire::protocol::total_ms(&named)) / 1000.0 * 1.3,
            named.name(),
            |bench| bench.state() == State::Ready,
        );
        assert_eq!(bench.fault(), None, "{named:?}");
    }
}

#[test]
fn a_protocol_is_downloaded_checked_and_played() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    let step = |degrees: i32| Segment::Step {
        mode: ControlMode::AngleClosedLoop,
        level: Hundredths(degrees * 100),
        duration_ms: 5_000,
    };
    let program = [
        step(40),
        Segment::Hold { duration_ms: 1_000 },
        Segment::Release { duration_ms: 2_000 },
    ];
    let load = |bench: &mut Bench, program: &[Segment]| -> Result<String, Refusal> {
        bench.ask(Command::Load(u8::try_from(program.len()).unwrap()))?;
        let mut last = Ok(String::new());
        for (index, &segment) in (0..).zip(program) {
            last = bench.ask(Command::Segment { index, segment });
            last.as_ref().map_err(|refusal| *refusal)?;
        }
        last
    };
    bench.arm();
    assert_eq!(bench.ask(Command::Run(None)), Err(Refusal::BadProtocol));
    // Half of a protocol is none.
    bench.obey(Command::Load(2));
    bench.obey(Command::Segment {
        index: 0,
        segment: step(40),
    });
    assert_eq!(bench.ask(Command::Run(None)), Err(Refusal::BadProtocol));
    // 200° are beyond the limit on set-points, whoever asks.
    let refused = load(&mut bench, &[step(200)]).and_then(|_| bench.ask(Command::Run(None)));
    assert!(refused.is_err(), "{refused:?}");
    assert_ne!(bench.state(), State::Running);

    load(&mut bench, &program).expect("a good protocol is taken");
    bench.obey(Command::Run(None));
    bench.run(4.8);
    let truth = bench.rig.plant().angle_deg;
    assert!((truth - 40.0).abs() < 1.5, "the closed loop holds {truth}°");
    bench.until(10.0, "the end", |bench| bench.state() == State::Ready);
    assert_eq!(bench.fault(), None);
}

#[test]
fn stop_stops_at_once_and_needs_no_checksum() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.arm();
    bench.obey(Command::Run(Some(Named::Paper)));
    bench.run(1.0);
    assert!(bench.rig.plant().pressure_kpa > 5.0);
    bench.rig.send(b"stop\r\n").expect("bytes are queued");
    bench.run(0.05);
    assert!(bench.is_safe(), "{:?}", bench.rig.plant());
    bench.run(1.0);
    assert!(bench.rig.plant().pressure_kpa < 1.0);
    assert_eq!((bench.state(), bench.fault()), (State::Idle, None));
}

#[test]
fn set_points_are_limited_whatever_the_protocol_says() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.set(Key::SetpointMax, 50.0);
    bench.save();
    bench.arm();
    // A named protocol that asks for more is refused or held to the limit.
    let _ = bench.ask(Command::Run(Some(Named::Paper)));
    bench.run(8.0);
    let highest = bench
        .samples
        .iter()
        .filter_map(|sample| match sample.setpoint {
            Setpoint::Angle(level) => Some(level.to_f32()),
            _ => None,
        })
        .fold(0.0_f32, f32::max);
    assert!(highest <= 50.0, "{highest}");
    assert!(bench.rig.plant().angle_deg < 55.0);
}

#[test]
fn a_tare_at_rest_makes_zero_and_one_in_motion_is_refused() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.run(1.5);
    bench.obey(Command::Tare);
    bench.samples.clear();
    bench.run(1.0);
    let mean = |of: fn(&wire::telemetry::Telemetry) -> f32, bench: &Bench| {
        bench.samples.iter().map(of).sum::<f32>() / bench.samples.len() as f32
    };
    let angle = mean(
        |sample| sample.angle_deg.expect("an angle").to_f32(),
        &bench,
    );
    let pressure = mean(
        |sample| sample.pressure_kpa.expect("a pressure").to_f32(),
        &bench,
    );
    assert!(
        angle.abs() < 0.15 && pressure.abs() < 0.15,
        "{angle}°, {pressure} kPa"
    );

    bench.arm();
    bench.obey(Command::Run(Some(Named::Paper)));
    bench.run(0.8);
    assert!(bench.ask(Command::Tare).is_err());
}

/// Ten minutes of everything at a hundred lines a second: nothing is lost and
/// nothing comes twice.
#[test]
fn ten_minutes_without_a_lost_line() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.arm();
    bench.samples.drain(..bench.samples.len() - 1);
    // What is sent to a board that starts is lost: it reads its flash first.
    let lost_at_start = bench.rig.overruns();
    let mut first = Some(bench.now());
    let mut counted = 0_u32;
    let end = bench.rig.time_s() + 600.0;
    while bench.rig.time_s() < end {
        if bench.state() == State::Ready {
            bench.obey(Command::Run(Some(Named::Steps)));
        }
        bench.run(1.0);
        let samples = std::mem::take(&mut bench.samples);
        for sample in &samples {
            if let Some(last) = first {
                if sample.sequence == last.sequence {
                    continue; // The one we started from.
                }
                assert_eq!(sample.sequence, last.sequence.wrapping_add(1));
                assert_eq!(sample.time_ms, last.time_ms + 10);
            }
            first = Some(*sample);
            counted += 1;
        }
        bench.samples.extend(samples.last());
    }
    assert!(counted >= 59_990, "{counted} lines");
    assert_eq!((bench.garbage, bench.fault()), (0, None));
    assert_eq!(bench.rig.overruns(), lost_at_start, "bytes read too late");
}

/// The same as in the firmware's own tests, with the converter's noise, the pump's steps
/// and everything else that only the image has. The table of all is in docs/control.md.
#[test]
fn closed_loop_steps_settle_without_overshoot() {
    for degrees in [10.0, 60.0] {
        for stiffness in steps::STIFFNESSES {
            let Some(response) = steps::step(degrees, stiffness) else {
                return;
            };
            let (overshoot, settled) = (response.overshoot_percent(), response.settling_s());
            assert!(overshoot < 10.0, "{degrees} x{stiffness}: {overshoot} %");
            assert!(
                settled < response.pump_s + 2.0,
                "{degrees} x{stiffness}: {settled} s"
            );
        }
    }
}

/// A pump that is slow and quick to start comes back to its place all the same, and the run ends.
#[test]
fn a_run_with_a_slow_pump_ends() {
    for (flow, acceleration) in [(500.0, 40_000.0), (200.0, 500_000.0), (1_000.0, 500.0)] {
        let Some(mut bench) = Bench::start(healthy()) else {
            return;
        };
        bench.set(Key::MaxFlow, flow);
        bench.set(Key::MaxFlowRate, acceleration);
        bench.save();
        bench.obey(Command::Load(2));
        let segments = [
            Segment::Step {
                mode: ControlMode::Pressure,
                level: Hundredths(500),
                duration_ms: 8_000,
            },
            Segment::Release { duration_ms: 1_000 },
        ];
        for (index, segment) in (0..).zip(segments) {
            bench.obey(Command::Segment { index, segment });
        }
        // Homing moves at half of the fastest flow.
        bench.obey(Command::Arm);
        bench.until(200.0, "ready", |bench| bench.state() == State::Ready);
        bench.obey(Command::Run(None));
        bench.run(1.0);
        bench.until(60.0, "the end of the run", |bench| {
            bench.state() != State::Running
        });
        assert_eq!((bench.state(), bench.fault()), (State::Ready, None));
    }
}

/// One that would need minutes to come to rest is refused.
#[test]
fn a_pump_that_hardly_starts_is_refused() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.set(Key::MaxFlow, 20_000.0);
    bench.set(Key::MaxFlowRate, 100.0);
    assert_eq!(bench.ask(Command::Save), Err(Refusal::BadSettings));
}
