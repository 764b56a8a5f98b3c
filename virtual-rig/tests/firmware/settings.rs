// SPDX-License-Identifier: GPL-3.0-or-later
//! What is kept when the power goes.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use virtual_rig::board::CLOCK_HZ;
use wire::{command::Command, fault::Fault, reply::Refusal, settings::Key};

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
