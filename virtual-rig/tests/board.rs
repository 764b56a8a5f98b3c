// SPDX-License-Identifier: GPL-3.0-or-later
//! What the board does by itself: EEPROM, resets, power, sleep, marks.

use super::common::{ask, compile, obeying, tell, wait};
use virtual_rig::{Fault, Image, Options, ResetCause, VirtualRig};

const POWER_ON: i64 = 1;
const EXTERNAL: i64 = 2;
const BROWN_OUT: i64 = 4;
const WATCHDOG: i64 = 8;

fn rig() -> Option<VirtualRig> {
    obeying(Options {
        keeps_reset_flags: true,
        ..Options::default()
    })
}

#[test]
fn a_byte_of_eeprom_takes_its_time() {
    let Some(mut rig) = rig() else { return };
    let begin = rig.cycle();
    let turns = ask(&mut rig, "w", "turns");
    let milliseconds = (rig.cycle() - begin) as f64 / 16e3;
    assert!(turns > 1000, "EEPE was set for {turns} turns");
    // 3.3 ms and the answer's bytes at 85 µs each.
    assert!((3.3..5.3).contains(&milliseconds), "{milliseconds} ms");
    assert_eq!(wait(&mut rig, "reads"), "90");
    assert_eq!(rig.eeprom()[100], 0x5a);
    assert_eq!(rig.eeprom_writes(), 1);
}

#[test]
fn who_does_not_wait_for_eeprom_loses_a_byte() {
    let Some(mut rig) = rig() else { return };
    tell(&mut rig, "WL");
    rig.run_for(0.01).unwrap();
    let eeprom = rig.eeprom();
    assert_eq!(eeprom[200], 1);
    assert_eq!(eeprom[201], 0xff, "a write during another is ignored");
    assert_eq!(eeprom[300], 0xff, "EEPE came too late after EEMPE");
}

#[test]
fn a_power_cut_tears_the_byte_that_is_written() {
    let torn = |seed| {
        let mut rig = obeying(Options {
            seed,
            ..Options::default()
        })?;
        rig.send(b"w").unwrap();
        rig.run_for(0.002).unwrap();
        assert_eq!(rig.eeprom_writing(), Some(100));
        assert_eq!(rig.power_cut(), Some(100));
        rig.run_for(0.1).unwrap();
        rig.power_on();
        wait(&mut rig, "ready");
        let eeprom = rig.eeprom();
        assert!(
            eeprom
                .iter()
                .enumerate()
                .all(|(at, &b)| at == 100 || b == 0xff)
        );
        Some(eeprom[100])
    };
    let Some(first) = torn(1) else { return };
    assert_eq!(Some(first), torn(1));
    let values: Vec<_> = (2..8).filter_map(torn).collect();
    assert!(values.iter().any(|&value| value != first), "{values:?}");
    assert!(values.iter().any(|&value| value != 0x5a), "{values:?}");
}

#[test]
fn a_write_outlives_a_reset() {
    let Some(mut rig) = rig() else { return };
    rig.send(b"w").unwrap();
    rig.run_for(0.001).unwrap();
    rig.reset(ResetCause::External);
    assert_eq!(rig.eeprom_writing(), Some(100));
    rig.run_for(0.01).unwrap();
    assert_eq!(rig.eeprom()[100], 0x5a);
}

#[test]
fn resets_say_their_cause_and_keep_or_lose_memory() {
    let Some(mut rig) = rig() else { return };
    assert_eq!(ask(&mut rig, "m", "cause"), POWER_ON);
    tell(&mut rig, "Mxc");
    assert!(!rig.plant().valve_open);

    rig.reset(ResetCause::External);
    assert!(rig.plant().valve_open, "a reset lets go of every pin");
    wait(&mut rig, "ready");
    assert_eq!(ask(&mut rig, "m", "cause"), EXTERNAL);
    assert_eq!(ask(&mut rig, "r", "kept"), 42);
    assert_eq!(ask(&mut rig, "k", "switches"), 0);

    rig.set_fault(Fault::BrownOut, true);
    wait(&mut rig, "ready");
    assert_eq!(ask(&mut rig, "m", "cause"), BROWN_OUT);
    assert_eq!(ask(&mut rig, "r", "kept"), 42);

    rig.reset(ResetCause::PowerOn);
    wait(&mut rig, "ready");
    assert_eq!(ask(&mut rig, "m", "cause"), POWER_ON);
    assert_ne!(ask(&mut rig, "r", "kept"), 42);
    assert_eq!(rig.resets(), 3);
}

#[test]
fn the_watchdog_brings_the_board_back() {
    let Some(mut rig) = rig() else { return };
    tell(&mut rig, "MxcD");
    let begin = rig.time_s();
    wait(&mut rig, "ready");
    let waited = rig.time_s() - begin;
    assert!((0.008..0.03).contains(&waited), "{waited} s");
    assert!(rig.plant().valve_open);
    assert_eq!(ask(&mut rig, "m", "cause"), WATCHDOG);
    assert_eq!(ask(&mut rig, "r", "kept"), 42);
    assert_eq!(rig.resets(), 1);
    // It was switched off after the reset and does not bite again.
    rig.run_for(0.2).unwrap();
    assert_eq!(rig.resets(), 1);
}

#[test]
fn the_watchdog_wakes_a_halted_board() {
    let Some(mut rig) = rig() else { return };
    let slept = rig.slept_cycles();
    tell(&mut rig, "H");
    let begin = rig.time_s();
    wait(&mut rig, "ready");
    let waited = rig.time_s() - begin;
    assert!((0.02..0.05).contains(&waited), "{waited} s");
    let slept = (rig.slept_cycles() - slept) as f64 / 16e6;
    assert!((0.02..0.05).contains(&slept), "{slept} s asleep");
    assert_eq!(ask(&mut rig, "m", "cause"), WATCHDOG);
}

#[test]
fn a_halted_board_stands_still_while_time_goes_on() {
    let Some(mut rig) = rig() else { return };
    tell(&mut rig, "xceiSh");
    rig.run_for(3.0).unwrap();
    let before = rig.plant();
    assert!(
        !before.valve_open && before.pressure_kpa > 5.0,
        "{before:?}"
    );
    rig.run_for(1.0).unwrap();
    assert!((rig.time_s() - before.time_s - 1.0).abs() < 1e-3);
    rig.reset(ResetCause::External);
    wait(&mut rig, "ready");
}

#[test]
fn without_power_nothing_moves_or_answers() {
    let Some(mut rig) = obeying(Options {
        keeps_reset_flags: true,
        faults: vec!["power-cut@1".parse().unwrap()],
        ..Options::default()
    }) else {
        return;
    };
    tell(&mut rig, "xcei");
    rig.run_for(1.1 - rig.time_s()).unwrap();
    let dead = rig.plant();
    assert!(dead.valve_open && !dead.driver_enabled && !dead.powered);
    rig.take_output();
    rig.send(b"m").unwrap();
    rig.run_for(0.3).unwrap();
    assert!(rig.take_output().is_empty());
    rig.run_for(0.2).unwrap();
    wait(&mut rig, "ready");
    assert!((rig.time_s() - 1.5).abs() < 0.11);
    assert_eq!(ask(&mut rig, "m", "cause"), POWER_ON);
}

#[test]
fn unplugged_bytes_are_lost_both_ways() {
    let Some(mut rig) = rig() else { return };
    rig.set_fault(Fault::Unplugged, true);
    tell(&mut rig, "m");
    rig.set_fault(Fault::Unplugged, false);
    assert!(rig.take_output().is_empty());
    assert_eq!(ask(&mut rig, "m", "cause"), POWER_ON);
}

#[test]
fn marked_stretches_add_up() {
    let Some(mut rig) = rig() else { return };
    rig.keep_marks(true);
    tell(&mut rig, "xess");
    let total = rig.mark_total(0x7f);
    let marks = rig.take_marks();
    assert_eq!((total.count, marks.len()), (4, 4));
    assert_eq!(
        total.cycles,
        marks.iter().map(|mark| mark.cycles).sum::<u64>()
    );
    assert_eq!(
        Some(total.longest),
        marks.iter().map(|mark| mark.cycles).max()
    );
    assert!(total.longest > 16 * 50);
    assert!(
        (4..100).contains(&rig.stack_bytes()),
        "{}",
        rig.stack_bytes()
    );
}

#[test]
fn an_eeprom_of_another_size_is_refused() {
    let Some(elf) = super::common::obey_elf() else {
        return;
    };
    let image = virtual_rig::Image::parse(elf).unwrap();
    let options = Options {
        eeprom: Some(vec![0; 100]),
        ..Options::default()
    };
    let refused = VirtualRig::new(&image, options).err().unwrap();
    assert!(refused.to_string().contains("4096"), "{refused}");
}

/// simavr alone misses a match soon after a turn of the counter, and one at zero.
#[test]
fn a_match_soon_after_a_turn_of_the_counter_is_not_missed() {
    let Some(elf) = compile("turn.c") else {
        return;
    };
    let image = Image::parse(&elf).expect("an image");
    let mut rig = VirtualRig::new(&image, Options::default()).expect("a rig");
    rig.trace_steps(true);
    rig.run_for(82.0 * 65_536.0 / 16e6).expect("the board runs");
    let edges = rig.step_edges();
    assert!(edges.len() >= 40, "{} edges", edges.len());
    for pair in edges.windows(2) {
        let turns = pair[1] - pair[0];
        assert!(turns.abs_diff(2 * 65_536) <= 32, "{turns} cycles");
    }
}
