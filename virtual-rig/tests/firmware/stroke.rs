// SPDX-License-Identifier: GPL-3.0-or-later
//! What the board finds out about its pump: the stroke, and the steps that were lost.

use virtual_rig::{Fault as Broken, ResetCause};
use wire::{
    answer::Machine, command::Command, fault::Fault, protocol::ControlMode, reply::Refusal,
    settings::Key, state::State,
};

use crate::bench::{Bench, healthy};

/// The way between the switches of the simulated pump (microsteps): 95 mm.
const STROKE: u32 = 152_000;

fn machine(bench: &mut Bench) -> Machine {
    Machine::parse(&bench.obey(Command::Machine)).expect("an answer")
}

/// Measures the stroke (microsteps) and puts the rig at rest.
fn measure(bench: &mut Bench) -> u32 {
    bench.obey(Command::Stroke);
    bench.until(1.0, "homing", |bench| bench.state() == State::Homing);
    bench.until(180.0, "ready", |bench| bench.state() == State::Ready);
    bench.obey(Command::Disarm);
    bench.run(1.0);
    machine(bench).stroke_steps.expect("it was measured")
}

fn save(bench: &mut Bench, largest_ul: f32) -> Result<String, Refusal> {
    bench.set(Key::MaxVolume, largest_ul);
    let saved = bench.ask(Command::Save);
    if saved.is_ok() {
        bench.run(5.0);
    }
    saved
}

#[test]
fn the_stroke_is_measured_kept_and_the_limit_of_the_largest_volume() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    assert_eq!(machine(&mut bench).stroke_steps, None);
    // Unmeasured, it is that of the smallest syringe.
    assert_eq!(save(&mut bench, 52_000.0), Err(Refusal::BeyondStroke));
    let [first, second] = [(); 2].map(|()| measure(&mut bench));
    println!("strokes of {first} and {second} microsteps");
    assert!(first.abs_diff(STROKE) <= 10, "{first}");
    assert!(second.abs_diff(first) <= 10, "{first} {second}");
    assert_eq!(bench.rig.plant().steps.lost, 0);
    assert_eq!(save(&mut bench, 53_500.0), Err(Refusal::BeyondStroke));
    save(&mut bench, 53_000.0).expect("within 53.2 ml");
    bench.rig.reset(ResetCause::PowerOn);
    bench.samples.clear();
    bench.until(3.0, "a sample", |bench| !bench.samples.is_empty());
    assert_eq!(machine(&mut bench).stroke_steps, Some(second));
    // A pressure that takes more than the stroke ends before the switch does.
    bench.load(ControlMode::Pressure, 100.0);
    bench.rig.set_fault(Broken::VentOpen, true);
    bench.obey(Command::Run(None));
    bench.until(30.0, "a fault", |bench| bench.fault().is_some());
    assert_ne!(bench.fault(), Some(Fault::EndSwitch));
    assert!(!bench.rig.plant().pushed_in_pressed);
}

/// The power fails while the stroke is written: the one before, this one, or none.
#[test]
fn a_power_cut_while_the_stroke_is_written_leaves_no_other_one() {
    for cut_s in [0.02, 0.07, 0.12, 0.17, 0.22] {
        let Some(mut bench) = Bench::start(healthy()) else {
            return;
        };
        bench.obey(Command::Stroke);
        bench.until(1.0, "homing", |bench| bench.state() == State::Homing);
        let before = bench.rig.eeprom_writes();
        while bench.rig.eeprom_writes() == before {
            bench.run(0.01);
        }
        bench.run(cut_s);
        bench.rig.reset(ResetCause::PowerOn);
        bench.samples.clear();
        bench.until(3.0, "a sample", |bench| !bench.samples.is_empty());
        assert_eq!(bench.fault(), None);
        if let Some(steps) = machine(&mut bench).stroke_steps {
            assert!(steps.abs_diff(STROKE) <= 10, "{cut_s} s: {steps}");
        }
    }
}

/// Nine steps of ten are lost on the way in, for as long as the pump pushes before a fault or two
/// seconds. The next home counts them.
#[test]
fn lost_steps_are_counted_at_the_next_home() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.load(ControlMode::Pressure, 60.0);
    assert_eq!(machine(&mut bench).lost_steps, None, "no home before");
    bench.rig.set_fault(Broken::LostSteps, true);
    bench.obey(Command::Run(None));
    bench.run(1.0);
    bench.rig.set_fault(Broken::LostSteps, false);
    bench.run(1.0);
    let lost = bench.rig.plant().steps.lost;
    assert!(lost > 1_000, "{lost}");
    bench.obey(Command::Stop);
    if bench.fault().is_some() {
        bench.obey(Command::Clear);
    }
    bench.run(4.0);
    bench.arm();
    let counted = machine(&mut bench).lost_steps.expect("two homes");
    println!("{lost} steps were lost, {counted} counted");
    assert!(counted.abs_diff(i32::try_from(lost).unwrap()) <= 15);
    // And none since.
    bench.obey(Command::Disarm);
    bench.run(1.0);
    bench.arm();
    let counted = machine(&mut bench).lost_steps.expect("three homes");
    assert!(counted.abs() <= 15, "{counted}");
}
