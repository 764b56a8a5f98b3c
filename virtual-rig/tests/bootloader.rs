// SPDX-License-Identifier: GPL-3.0-or-later
//! Opening the port resets the board, and a programmer can replace its flash.

use super::common::{obeying, wait};
use virtual_rig::{Image, Options, VirtualRig, stk500::seal};

#[test]
fn opening_the_port_resets_and_waits_a_second_before_the_program() {
    for (keeps_reset_flags, cause) in [(true, "2"), (false, "0")] {
        let Some(mut rig) = obeying(Options {
            keeps_reset_flags,
            ..Options::default()
        }) else {
            return;
        };
        rig.open_port();
        let begin = rig.time_s();
        wait(&mut rig, "ready");
        assert!((1.0..1.02).contains(&(rig.time_s() - begin)));
        rig.send(b"m").unwrap();
        assert_eq!(wait(&mut rig, "cause"), cause);

        // Whoever is no programmer need not wait.
        rig.open_port();
        let begin = rig.time_s();
        rig.send(b"\nm").unwrap();
        wait(&mut rig, "ready");
        assert!(rig.time_s() - begin < 0.02);
        assert_eq!(wait(&mut rig, "cause"), cause);
    }
}

#[test]
fn a_programmer_writes_an_erased_board_and_starts_it() {
    let Some(elf) = super::common::obey_elf() else {
        return;
    };
    let flash = Image::parse(elf).unwrap().flash().to_vec();
    let mut rig = VirtualRig::new(&Image::erased(), Options::default()).unwrap();
    rig.run_for(3.0).unwrap();
    assert!(rig.in_bootloader() && rig.take_output().is_empty());

    rig.open_port();
    let ask = |rig: &mut VirtualRig, body: &[u8]| {
        rig.take_output();
        rig.send(&seal(9, body)).unwrap();
        let answer = rig.take_output();
        assert_eq!(answer[6], 0, "{body:x?} failed");
    };
    ask(&mut rig, &[1]);
    ask(&mut rig, &[6, 0x80, 0, 0, 0]);
    for page in flash.chunks(256) {
        let [high, low] = u16::try_from(page.len()).unwrap().to_be_bytes();
        let header = [0x13, high, low, 0xc1, 10, 0x40, 0x4c, 0x20, 0, 0];
        ask(&mut rig, &[&header, page].concat());
    }
    assert!(rig.in_bootloader());
    ask(&mut rig, &[0x11, 1, 1]);
    wait(&mut rig, "ready");
}

#[test]
fn a_programmer_that_leaves_without_a_word_lets_the_program_run() {
    let Some(mut rig) = obeying(Options::default()) else {
        return;
    };
    rig.open_port();
    rig.send(&seal(1, &[1])).unwrap();
    rig.run_for(3.0).unwrap();
    assert!(rig.in_bootloader(), "a session has no time-out");
    rig.take_output();
    rig.close_port();
    wait(&mut rig, "ready");
}
