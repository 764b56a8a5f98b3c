//! Shared by tests of this crate and, as a file, of the firmware: every command, and the parts of
//! random protocols. A feature for it would compile the crate once more for everything else.

extern crate std;

use std::{vec, vec::Vec};

use core::ops::{Range, RangeInclusive};

use proptest::prelude::*;

use wire::{
    command::Command,
    decimal::Hundredths,
    protocol::{ControlMode, MAX_REPEATS, Named, Segment},
    settings::Key,
};

/// Segments of every kind; a repeat goes back to one of `from`. Whether a protocol of them is
/// valid is another question.
pub fn segments(
    hundredths: Range<i32>,
    duration_ms: RangeInclusive<u32>,
    from: Range<u8>,
) -> impl Strategy<Value = Segment> + Clone {
    let mode = prop::sample::select(
        &[
            ControlMode::Pressure,
            ControlMode::AngleOpenLoop,
            ControlMode::AngleClosedLoop,
        ][..],
    );
    let level = hundredths.prop_map(Hundredths);
    let target = (mode, level.clone(), duration_ms.clone());
    prop_oneof![
        target
            .clone()
            .prop_map(|(mode, level, duration_ms)| Segment::Step {
                mode,
                level,
                duration_ms,
            }),
        target
            .clone()
            .prop_map(|(mode, level, duration_ms)| Segment::Ramp {
                mode,
                level,
                duration_ms,
            }),
        (target, level, duration_ms.clone()).prop_map(
            |((mode, centre, duration_ms), amplitude, period_ms)| Segment::Multisine {
                mode,
                centre,
                amplitude,
                period_ms,
                duration_ms,
            }
        ),
        duration_ms
            .clone()
            .prop_map(|duration_ms| Segment::Hold { duration_ms }),
        duration_ms.prop_map(|duration_ms| Segment::Release { duration_ms }),
        (from, 1..=MAX_REPEATS).prop_map(|(from, times)| Segment::Repeat { from, times }),
    ]
}

/// Every command, with each name and each key that it can have.
pub fn every_command() -> Vec<Command> {
    let mut all = vec![
        Command::Hello,
        Command::Beat,
        Command::Help,
        Command::Status,
        Command::SelfTest,
        Command::Arm,
        Command::Disarm,
        Command::Run(None),
        Command::Stop,
        Command::Clear,
        Command::Tare,
        Command::Load(32),
        Command::Segment {
            index: 31,
            segment: Segment::Multisine {
                mode: ControlMode::AngleClosedLoop,
                centre: Hundredths(12_345),
                amplitude: Hundredths(2_345),
                period_ms: 600_000,
                duration_ms: 600_000,
            },
        },
        Command::Save,
        Command::Discard,
        Command::Raw,
        Command::Exact,
        Command::Log(7),
        Command::Past(50),
        Command::Switches,
        Command::Stroke,
        Command::Machine,
    ];
    all.extend(Named::ALL.iter().map(|&named| Command::Run(Some(named))));
    for key in Key::all() {
        all.push(Command::Get(key));
        all.push(Command::Set {
            key,
            bits: 0x1234_abcd,
        });
    }
    all
}
