//! Shared by tests of this crate and of the firmware: text in memory, and the parts of random
//! protocols. No image and no tool is built with it.

extern crate std;
use core::ops::{Range, RangeInclusive};
use std::string::String;

use proptest::prelude::*;
use ufmt::uWrite;

use crate::{
    decimal::Hundredths,
    line::Sealed,
    protocol::{ControlMode, MAX_REPEATS, Segment},
};

/// Text in memory.
#[derive(Debug, Default)]
pub struct Text(pub String);

impl uWrite for Text {
    type Error = core::convert::Infallible;

    fn write_str(&mut self, text: &str) -> Result<(), Self::Error> {
        self.0.push_str(text);
        Ok(())
    }

    // The one of the trait takes the address of memory that was never set.
    fn write_char(&mut self, character: char) -> Result<(), Self::Error> {
        self.0.push(character);
        Ok(())
    }
}

/// The text with its checksum and the end of a line.
pub fn sealed(text: &str) -> String {
    let mut out = Text::default();
    let mut line = Sealed::new(&mut out);
    let Ok(()) = line.write_str(text);
    let Ok(()) = line.finish();
    out.0
}

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
