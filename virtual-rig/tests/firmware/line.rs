// SPDX-License-Identifier: GPL-3.0-or-later
//! A cable that lies.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use softrig_link::line::request_text;
use virtual_rig::Fault as Broken;
use wire::{
    command::{Command, Request},
    protocol::Named,
    reply::Refusal,
    state::State,
};

use crate::bench::{Bench, healthy};

/// Random bytes, random words, and requests with one wrong bit, at the full pace
/// of the line: the pump does not move.
#[test]
fn noise_never_moves_the_pump() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.beating = false;
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let before = bench.rig.plant().steps;
    for _ in 0..400 {
        let bytes: Vec<u8> = match random.random_range(0..3) {
            0 => (0..random.random_range(1..120))
                .map(|_| random.random())
                .collect(),
            1 => (0..random.random_range(1..90))
                .map(|_| b"arm run set paper 0123456789*\n "[random.random_range(0..31)])
                .collect(),
            _ => {
                let mut bytes = request_text(&Request {
                    id: random.random(),
                    command: Command::Arm,
                })
                .into_bytes();
                let place = random.random_range(0..bytes.len() - 2);
                bytes[place] ^= 1 << random.random_range(0..7);
                bytes
            }
        };
        bench.rig.send(&bytes).expect("bytes are queued");
        bench.run(0.012);
    }
    bench.rig.send(b"\n").expect("bytes are queued");
    bench.run(0.5);
    assert_eq!(bench.rig.plant().steps, before);
    assert!(bench.is_safe());
    assert_eq!((bench.state(), bench.fault()), (State::Idle, None));
    // They were counted, and the board still listens.
    let status = bench.obey(Command::Status);
    let counted: u32 = status
        .split(' ')
        .skip(2)
        .take(3)
        .map(|field| field.parse::<u32>().expect("a counter"))
        .sum();
    assert!(counted > 100, "{status}");
}

#[test]
fn bursts_on_the_line_do_not_end_a_run_or_change_it() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.arm();
    bench.obey(Command::Run(Some(Named::Reversals)));
    bench.rig.set_fault(Broken::Noise, true);
    let sent = bench.samples.len();
    bench.run(10.0);
    bench.rig.set_fault(Broken::Noise, false);
    bench.run(1.0);
    assert!(bench.garbage > 0, "the noise did not reach the line");
    assert!(
        bench.samples.len() - sent > 800,
        "hardly a line came through"
    );
    assert_eq!((bench.state(), bench.fault()), (State::Running, None));
}

#[test]
fn a_request_that_comes_twice_is_not_obeyed_twice() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.arm();
    assert_eq!(bench.ask(Command::Arm), Err(Refusal::NotNow));
    bench.obey(Command::Run(Some(Named::Steps)));
    assert_eq!(
        bench.ask(Command::Run(Some(Named::Steps))),
        Err(Refusal::NotNow)
    );
    assert_eq!(bench.state(), State::Running);
}

#[test]
fn a_person_may_ask_without_a_checksum_but_not_move() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench
        .rig
        .send(b"help\r\nstatus\r\n")
        .expect("bytes are queued");
    bench.run(0.5);
    assert!(bench.remarks.len() > 3, "{:?}", bench.remarks);
    bench.rig.send(b"arm\r\n").expect("bytes are queued");
    bench.run(0.5);
    assert_eq!(bench.state(), State::Idle);
}
