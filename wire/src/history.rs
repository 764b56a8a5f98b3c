//! What the board remembers: its last faults, and the second before the latest.

use ufmt::{Formatter, uDisplay, uWrite, uwrite};

use crate::{
    decimal::{Hundredths, Thousandths},
    fields::Fields,
    state::State,
    telemetry::parse_reading,
};

/// Faults in the log.
pub const LOGGED: u8 = 8;

/// Control periods between two moments of [`Moment`]: 20 ms.
pub const MOMENT_PERIODS: u16 = 2;

/// Moments that are remembered: a second and the fault itself.
pub const MOMENTS: u8 = 51;

/// Why the processor started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum ResetCause {
    /// Power came on, or the reset line was pulled: opening the port does that.
    #[default]
    Ordinary = 0,
    /// The supply dipped.
    BrownOut = 1,
    /// The watchdog was not fed.
    Watchdog = 2,
    /// The rig was armed, and nothing says why the processor started: the reset line, or a cause
    /// whose flag the bootloader has cleared.
    WhileArmed = 3,
}

impl ResetCause {
    /// Every one, in the order of the codes.
    pub const ALL: [Self; 4] = [
        Self::Ordinary,
        Self::BrownOut,
        Self::Watchdog,
        Self::WhileArmed,
    ];

    /// The number in a record.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The cause behind a number.
    pub const fn from_code(code: u8) -> Option<Self> {
        Some(match code {
            0 => Self::Ordinary,
            1 => Self::BrownOut,
            2 => Self::Watchdog,
            3 => Self::WhileArmed,
            _ => return None,
        })
    }

    /// A short name for tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ordinary => "power or reset",
            Self::BrownOut => "brown-out",
            Self::Watchdog => "watchdog",
            Self::WhileArmed => "reset while armed",
        }
    }
}

/// A fault in the board's log: the answer to `log N`.
///
/// ```text
/// 12 2 x 0 512340 181.20 14.210
/// ```
///
/// Number, code, the state before, the cause of the last reset, time (ms), pressure (kPa or
/// `nan`), volume (ml).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultRecord {
    /// Counts the faults of this board, and wraps.
    pub number: u16,
    /// Code of the fault; see [`crate::fault::Fault`].
    pub fault: u8,
    /// The state in which it struck.
    pub state: State,
    /// Why the board had started.
    pub reset: ResetCause,
    /// Time from that start (ms).
    pub time_ms: u32,
    /// Gauge pressure (kPa); none while its sensor is at fault.
    pub pressure_kpa: Option<Hundredths>,
    /// Volume that the pump had displaced (µl).
    pub volume_ul: i32,
}

impl FaultRecord {
    /// Reads it.
    pub fn parse(text: &str) -> Option<Self> {
        let mut fields = Fields::new(text.as_bytes());
        let record = Self {
            number: fields.number()?,
            fault: fields.number()?,
            state: state(fields.next()?)?,
            reset: ResetCause::from_code(fields.number()?)?,
            time_ms: fields.number()?,
            pressure_kpa: parse_reading(fields.next()?)?,
            volume_ul: Thousandths::parse(fields.next()?)?.0,
        };
        fields.is_empty().then_some(record)
    }
}

impl uDisplay for FaultRecord {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        uwrite!(f, "{} {} ", self.number, self.fault)?;
        f.write_char(char::from(self.state.letter()))?;
        uwrite!(f, " {} {} ", self.reset.code(), self.time_ms)?;
        write_reading(f, self.pressure_kpa)?;
        uwrite!(f, " {}", Thousandths(self.volume_ul))
    }
}

/// The rig at a moment before a fault: the answer to `past N`.
///
/// ```text
/// 512340 181.20 85.10 14.210 x 4
/// ```
///
/// Time (ms), pressure (kPa or `nan`), angle (° or `nan`), volume (ml), state, and the segment
/// of a protocol while one is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Moment {
    /// Time since reset (ms), that of telemetry.
    pub time_ms: u32,
    /// Gauge pressure (kPa); none while its sensor is at fault.
    pub pressure_kpa: Option<Hundredths>,
    /// Measured bending angle (°); none while its sensor is at fault.
    pub angle_deg: Option<Hundredths>,
    /// Volume that the pump had displaced (µl).
    pub volume_ul: i32,
    /// The state; at the fault the one in which it struck.
    pub state: State,
    /// Number of the segment that was played, from 0.
    pub segment: Option<u8>,
}

impl Moment {
    /// Reads it.
    pub fn parse(text: &str) -> Option<Self> {
        let mut fields = Fields::new(text.as_bytes());
        let mut moment = Self {
            time_ms: fields.number()?,
            pressure_kpa: parse_reading(fields.next()?)?,
            angle_deg: parse_reading(fields.next()?)?,
            volume_ul: Thousandths::parse(fields.next()?)?.0,
            state: state(fields.next()?)?,
            segment: None,
        };
        if !fields.is_empty() {
            moment.segment = Some(fields.number()?);
        }
        fields.is_empty().then_some(moment)
    }
}

impl uDisplay for Moment {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        uwrite!(f, "{} ", self.time_ms)?;
        write_reading(f, self.pressure_kpa)?;
        f.write_char(' ')?;
        write_reading(f, self.angle_deg)?;
        uwrite!(f, " {} ", Thousandths(self.volume_ul))?;
        f.write_char(char::from(self.state.letter()))?;
        if let Some(segment) = self.segment {
            uwrite!(f, " {}", segment)?;
        }
        Ok(())
    }
}

fn state(field: &[u8]) -> Option<State> {
    match field {
        [letter] => State::from_letter(*letter),
        _ => None,
    }
}

#[inline(never)]
fn write_reading<W: uWrite + ?Sized>(
    f: &mut Formatter<'_, W>,
    value: Option<Hundredths>,
) -> Result<(), W::Error> {
    let Some(value) = value else {
        // Letters, since a string would be in the board's RAM.
        f.write_char('n')?;
        f.write_char('a')?;
        return f.write_char('n');
    };
    uwrite!(f, "{}", value)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::String;

    use proptest::prelude::*;

    use super::*;
    use crate::text::Text;

    fn text(answer: &impl uDisplay) -> String {
        let mut out = Text::default();
        let Ok(()) = uwrite!(out, "{}", answer);
        out.0
    }

    proptest! {
        #[test]
        fn what_is_remembered_is_read_back(
            number: u16, code: u8, times: [u32; 2], cause in 0..4_usize,
            readings in any::<[Option<i16>; 3]>(), volumes: [i16; 2],
            state in proptest::sample::select(&State::ALL[..]), segment: Option<u8>,
        ) {
            let [pressure, angle, logged] =
                readings.map(|value| value.map(|value| Hundredths(value.into())));
            let record = FaultRecord {
                number,
                fault: code,
                state,
                reset: ResetCause::ALL[cause],
                time_ms: times[0],
                pressure_kpa: logged,
                volume_ul: volumes[0].into(),
            };
            prop_assert_eq!(FaultRecord::parse(&text(&record)), Some(record));
            let moment = Moment {
                time_ms: times[1],
                pressure_kpa: pressure,
                angle_deg: angle,
                volume_ul: volumes[1].into(),
                state,
                segment,
            };
            prop_assert_eq!(Moment::parse(&text(&moment)), Some(moment));
        }

        #[test]
        fn any_text_is_read_or_refused(text in "\\PC{0,60}") {
            let _ = (FaultRecord::parse(&text), Moment::parse(&text));
        }
    }

    #[test]
    fn the_text_is_that_of_the_manual() {
        for line in ["12 2 x 0 512340 181.20 14.210", "0 4 i 3 10 nan -0.350"] {
            assert_eq!(text(&FaultRecord::parse(line).unwrap()), line);
        }
        for line in ["512340 181.20 85.10 14.210 x 4", "20 nan nan 0.000 i"] {
            assert_eq!(text(&Moment::parse(line).unwrap()), line);
        }
        assert_eq!(FaultRecord::parse("12 2 x 4 512340 181.20 14.210"), None);
        assert_eq!(Moment::parse("512340 181.20 85.10 14.210 x 4 5"), None);
    }

    #[test]
    fn causes_lead_back() {
        for cause in ResetCause::ALL {
            assert_eq!(ResetCause::from_code(cause.code()), Some(cause));
        }
        assert_eq!(ResetCause::from_code(4), None);
    }
}
