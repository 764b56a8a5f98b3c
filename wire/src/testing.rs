//! Shared by tests of this crate and of the firmware: the parts of random protocols. No image
//! and no tool is built with it.

use core::ops::{Range, RangeInclusive};

use proptest::prelude::*;

use crate::{
    decimal::Hundredths,
    protocol::{ControlMode, MAX_REPEATS, Segment},
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
