// SPDX-License-Identifier: GPL-3.0-or-later
//! What is kept when the power goes.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use virtual_rig::{Fault as Broken, board::CLOCK_HZ};
use wire::{
    command::Command,
    fault::Fault,
    history::{FaultRecord, Moment},
    protocol::Named,
    reply::Refusal,
    settings::Key,
    state::State,
};

use crate::bench::{Bench, healthy};

/// Damping as shipped (N·s/rad).
const SHIPPED: f32 = 1.5;

fn damping(bench: &mut Bench) -> f32 {
    let bits = bench.obey(Command::Get(Key::Damping));
    f32::from_bits(u32::from_str_radix(&bits, 16).expect("eight digits"))
}

#[test]
fn settings_survive_the_power() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.set(Key::Damping, 2.5);
    assert!(
        (damping(&mut bench) - SHIPPED).abs() < 1e-6,
        "a draft is not in use"
    );
    bench.save();
    assert!((damping(&mut bench) - 2.5).abs() < 1e-6);
    bench.rig.power_cut();
    bench.rig.run_for(0.2).expect("time passes");
    bench.rig.power_on();
    bench.until(3.0, "a sample", |bench| {
        bench
            .samples
            .last()
            .is_some_and(|sample| sample.time_ms < 1000)
    });
    assert!((damping(&mut bench) - 2.5).abs() < 1e-6);
    assert_eq!(bench.fault(), None);
}

#[test]
fn nonsense_is_refused_before_it_is_used() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    let nan = Command::Set {
        key: Key::Exponent,
        bits: f32::NAN.to_bits(),
    };
    assert_eq!(bench.ask(nan), Err(Refusal::OutOfBounds));
    bench.obey(Command::Set {
        key: Key::EffectKind { slot: 0 },
        bits: 0xffff,
    });
    assert_eq!(bench.ask(Command::Save), Err(Refusal::BadSettings));
    bench.obey(Command::Discard);
    // A calibration table that goes back on itself.
    bench.set(Key::FlexCounts(3), 900.0);
    assert_eq!(bench.ask(Command::Save), Err(Refusal::BadSettings));
    bench.obey(Command::Discard);
    bench.arm();
    bench.set(Key::Damping, 2.0);
    assert_eq!(bench.ask(Command::Save), Err(Refusal::NotNow));
}

#[test]
fn damaged_settings_are_a_fault_and_defaults() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.set(Key::Damping, 2.5);
    bench.save();
    let mut eeprom = bench.rig.eeprom();
    let used: Vec<usize> = (0..eeprom.len()).filter(|&at| eeprom[at] != 0xff).collect();
    eeprom[used[used.len() / 2]] ^= 0x10;
    let mut options = healthy();
    options.eeprom = Some(eeprom);
    let Some(mut bench) = Bench::start(options) else {
        return;
    };
    assert_eq!(bench.fault(), Some(Fault::Settings));
    assert!((damping(&mut bench) - SHIPPED).abs() < 1e-6);
}

/// Two hundred power cuts at random cycles of a write: always the old or the new
/// settings, whole, never a fault.
#[test]
fn power_cuts_leave_the_old_or_the_new_settings() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.set(Key::Damping, 1.0);
    bench.set(Key::Stiffness, 1.0);
    bench.save();
    let mut random = Pcg64Mcg::seed_from_u64(11);
    let mut kept: f32 = 1.0;
    let (mut old, mut new, mut torn) = (0, 0, 0);
    for cut in 0..200_u16 {
        let wanted = 2.0 + f32::from(cut) / 100.0;
        bench.set(Key::Damping, wanted);
        bench.set(Key::Stiffness, wanted);
        bench.obey(Command::Save);
        // The few bytes that differ are written, and all are read back, within
        // three quarters of a second. Every second cut waits for a byte to be written.
        let mut cycles = random.random_range(0..u64::from(CLOCK_HZ) * 3 / 4);
        bench.rig.run_cycles(cycles).expect("the board runs");
        if cut % 2 == 0 {
            let last = cycles + u64::from(CLOCK_HZ);
            while bench.rig.eeprom_writing().is_none() && cycles < last {
                let more = random.random_range(4_000..40_000);
                bench.rig.run_cycles(more).expect("the board runs");
                cycles += more;
            }
        }
        torn += usize::from(bench.rig.power_cut().is_some());
        bench.rig.run_for(0.01).expect("time passes");
        bench.rig.power_on();
        bench.samples.clear();
        bench.rig.take_output();
        bench.until(3.0, "a sample", |bench| !bench.samples.is_empty());
        assert_eq!(bench.fault(), None, "cut {cut} after {cycles} cycles");
        let found = damping(&mut bench);
        let stiffness = bench.obey(Command::Get(Key::Stiffness));
        assert_eq!(
            stiffness,
            format!("{:08x}", found.to_bits()),
            "half old, half new after cut {cut}"
        );
        if found.to_bits() == wanted.to_bits() {
            new += 1;
        } else {
            assert_eq!(found.to_bits(), kept.to_bits(), "cut {cut}");
            old += 1;
        }
        kept = found;
    }
    println!("{old} old, {new} new, {torn} cut within a byte");
    assert!(old > 20 && new > 20 && torn > 20, "{old} {new} {torn}");
}

/// The faults in the log, the latest first.
fn log(bench: &mut Bench) -> Vec<FaultRecord> {
    let ask = |back| bench.ask(Command::Log(back)).ok();
    (0..8)
        .filter_map(ask)
        .map(|text| FaultRecord::parse(&text).expect("a record"))
        .collect()
}

/// Presses the emergency stop at rest, and clears it when a moment has passed.
fn press(bench: &mut Bench, seconds: f64) {
    bench.rig.set_fault(Broken::EmergencyStop, true);
    bench.run(seconds);
    bench.rig.set_fault(Broken::EmergencyStop, false);
}

/// The fault of a run is in the log after the power was off, and until it is cleared the second
/// before it can be read without a line of telemetry being lost.
#[test]
fn a_fault_is_remembered() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.arm();
    bench.obey(Command::Run(Some(Named::Paper)));
    bench.run(2.0);
    assert_eq!(bench.ask(Command::Log(0)), Err(Refusal::NotNow));
    bench.rig.set_fault(Broken::OpenPressure, true);
    bench.expect_fault(Fault::PressureSensor, 0.3);
    bench.run(0.4);
    let at = bench
        .samples
        .iter()
        .position(|line| line.state == State::Fault)
        .expect("the fault");
    let fault = bench.samples[at];
    let record = log(&mut bench)[0];
    assert_eq!(
        (record.fault, record.state, record.time_ms),
        (fault.fault, State::Running, fault.time_ms)
    );
    assert_eq!(record.volume_ul, fault.volume_ul);
    let before = bench.samples.len();
    for back in 0..51 {
        let text = bench.obey(Command::Past(back));
        let moment = Moment::parse(&text).expect("a moment");
        let line = bench
            .samples
            .iter()
            .find(|line| line.time_ms == moment.time_ms)
            .expect("its line");
        assert_eq!(
            (moment.pressure_kpa, moment.angle_deg, moment.volume_ul),
            (line.pressure_kpa, line.angle_deg, line.volume_ul)
        );
    }
    for pair in bench.samples[before - 1..].windows(2) {
        assert_eq!(pair[1].sequence, pair[0].sequence.wrapping_add(1));
    }
    assert!(bench.is_safe());
    bench.rig.power_cut();
    bench.rig.run_for(0.2).expect("time passes");
    bench.rig.set_fault(Broken::OpenPressure, false);
    bench.rig.power_on();
    bench.samples.clear();
    bench.until(3.0, "a sample", |bench| !bench.samples.is_empty());
    assert_eq!(log(&mut bench), [record]);
}

/// A hundred power cuts while a fault is written: those before are there, each with its number,
/// and the new one is whole or not there.
#[test]
fn power_cuts_leave_a_log_without_torn_records() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    for _ in 0..9 {
        press(&mut bench, 0.4);
        bench.run(0.1);
        bench.obey(Command::Clear);
        bench.run(0.1);
    }
    let mut random = Pcg64Mcg::seed_from_u64(12);
    let mut before = log(&mut bench);
    assert_eq!(before.len(), 8);
    let (mut old, mut new, mut torn) = (0, 0, 0);
    for cut in 0..100 {
        bench.rig.set_fault(Broken::EmergencyStop, true);
        let cycles = random.random_range(0..u64::from(CLOCK_HZ) * 3 / 10);
        bench.rig.run_cycles(cycles).expect("the board runs");
        torn += usize::from(bench.rig.power_cut().is_some());
        bench.rig.run_for(0.01).expect("time passes");
        bench.rig.set_fault(Broken::EmergencyStop, false);
        bench.rig.power_on();
        bench.samples.clear();
        bench.rig.take_output();
        bench.until(3.0, "a sample", |bench| !bench.samples.is_empty());
        assert_eq!(bench.fault(), None, "cut {cut} after {cycles} cycles");
        let after = log(&mut bench);
        if after == before {
            old += 1;
        } else {
            new += 1;
            assert_eq!(after[1..], before[..7], "cut {cut} after {cycles} cycles");
            let expected = (
                before[0].number.wrapping_add(1),
                Fault::EmergencyStop.code(),
                State::Idle,
            );
            let latest = after[0];
            assert_eq!((latest.number, latest.fault, latest.state), expected);
        }
        before = after;
    }
    println!("{old} old, {new} new, {torn} cut within a byte");
    assert!(old > 20 && new > 10 && torn > 5, "{old} {new} {torn}");
}
