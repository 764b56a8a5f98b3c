//! The line that the board sends a hundred times a second.
//!
//! ```text
//! T 512 5120 pressure:38.42 angle:59.81 predicted:60.02 setpoint:60.00 volume:14.210 x0 *596e
//! ```
//!
//! Its labels are for a serial plotter, which draws a labelled value by itself; all of it is
//! [`Telemetry`].

use core::fmt;

use ufmt::{uWrite, uwrite};

use crate::{
    decimal::{Count, Hundredths, Thousandths},
    fields::{Fields, number},
    label::label,
    line::{LineError, Sealed, open_bytes},
    state::State,
};

/// Lines a second.
pub const RATE_HZ: u16 = 100;

/// Milliseconds between lines.
pub const PERIOD_MS: u16 = 1000 / RATE_HZ;

/// The actuator's set-point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Setpoint {
    /// Nothing: the pump rests.
    None,
    /// A bending angle (°).
    Angle(Hundredths),
    /// A gauge pressure (kPa).
    Pressure(Hundredths),
}

/// One sample of everything.
///
/// In the line are `T`, the sequence number, the device time in milliseconds; then labelled values:
/// `pressure` (kPa), the bending `angle` (°), the angle `predicted` by the model on the board (°),
/// the `setpoint` (°) or, in a pressure protocol, `setpoint_kpa` (kPa), and the pump's `volume` (ml,
/// so that it shares a scale with the others). Last, the letter of the state and the code of the
/// latched fault, with a `!` while the mismatch flag is set. A sensor without a reading sends `nan`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Telemetry {
    /// Counts lines since reset and wraps; a gap means lost lines.
    pub sequence: u16,
    /// Time since reset (ms).
    pub time_ms: u32,
    /// Gauge pressure (kPa); none while its sensor is at fault.
    pub pressure_kpa: Option<Hundredths>,
    /// Measured bending angle (°); none while its sensor is at fault.
    pub angle_deg: Option<Hundredths>,
    /// Angle that is predicted (°); none while it has no model.
    pub predicted_deg: Option<Hundredths>,
    /// The set-point.
    pub setpoint: Setpoint,
    /// Volume that the pump has displaced from the retracted switch (µl).
    pub volume_ul: i32,
    /// The firmware's state.
    pub state: State,
    /// Code of the latched fault, zero for none; see [`crate::fault::Fault`].
    pub fault: u8,
    /// The latched flag: prediction and measurement disagree.
    pub mismatch: bool,
}

impl Telemetry {
    /// Writes the sample as one sealed line.
    ///
    /// # Errors
    ///
    /// Errors of the output.
    pub fn write<W: uWrite + ?Sized>(&self, out: &mut W) -> Result<(), W::Error> {
        let mut line = Sealed::new(out);
        let sequence = Count(u32::from(self.sequence));
        uwrite!(line, "T {} {}", sequence, Count(self.time_ms))?;
        label!(&mut line, " pressure:");
        reading(&mut line, self.pressure_kpa)?;
        label!(&mut line, " angle:");
        reading(&mut line, self.angle_deg)?;
        label!(&mut line, " predicted:");
        reading(&mut line, self.predicted_deg)?;
        match self.setpoint {
            Setpoint::None => {}
            Setpoint::Angle(value) => {
                label!(&mut line, " setpoint:");
                uwrite!(line, "{}", value)?;
            }
            Setpoint::Pressure(value) => {
                label!(&mut line, " setpoint_kpa:");
                uwrite!(line, "{}", value)?;
            }
        }
        label!(&mut line, " volume:");
        uwrite!(line, "{}", Thousandths(self.volume_ul))?;
        line.put(b' ')?;
        line.put(self.state.letter())?;
        uwrite!(line, "{}", Count(u32::from(self.fault)))?;
        if self.mismatch {
            line.put(b'!')?;
        }
        line.finish()
    }

    /// Reads a sample back from its line, with or without the line end.
    ///
    /// # Errors
    ///
    /// [`TelemetryError`] when the line is damaged or says something else.
    pub fn parse(line: &[u8]) -> Result<Self, TelemetryError> {
        let text = open_bytes(line).map_err(TelemetryError::Line)?;
        let rest = text.strip_prefix(b"T ").ok_or(TelemetryError::OtherLine)?;
        Self::parse_fields(Fields::new(rest)).ok_or(TelemetryError::Malformed)
    }

    fn parse_fields(mut fields: Fields<'_>) -> Option<Self> {
        let sequence = fields.number()?;
        let time_ms = fields.number()?;
        let pressure_kpa = sensor(fields.next()?, b"pressure:")?;
        let angle_deg = sensor(fields.next()?, b"angle:")?;
        let predicted_deg = sensor(fields.next()?, b"predicted:")?;
        let mut field = fields.next()?;
        let setpoint = if let Some(value) = field.strip_prefix(b"setpoint:") {
            Setpoint::Angle(Hundredths::parse(value)?)
        } else if let Some(value) = field.strip_prefix(b"setpoint_kpa:") {
            Setpoint::Pressure(Hundredths::parse(value)?)
        } else {
            Setpoint::None
        };
        if setpoint != Setpoint::None {
            field = fields.next()?;
        }
        let Thousandths(volume_ul) = Thousandths::parse(field.strip_prefix(b"volume:")?)?;
        let (letter, rest) = fields.next()?.split_first()?;
        let (code, mismatch) = match rest {
            [code @ .., b'!'] => (code, true),
            code => (code, false),
        };
        let sample = Self {
            sequence,
            time_ms,
            pressure_kpa,
            angle_deg,
            predicted_deg,
            setpoint,
            volume_ul,
            state: State::from_letter(*letter)?,
            fault: number(code)?,
            mismatch,
        };
        fields.is_empty().then_some(sample)
    }
}

/// Writes a reading, or that there is none.
#[inline(never)]
fn reading<W: uWrite + ?Sized>(
    line: &mut Sealed<'_, W>,
    value: Option<Hundredths>,
) -> Result<(), W::Error> {
    if let Some(value) = value {
        uwrite!(line, "{}", value)?;
    } else {
        label!(line, "nan");
    }
    Ok(())
}

/// `pressure:12.34` or `pressure:nan`; the outer option is none when it is neither.
#[allow(clippy::option_option)]
fn sensor(field: &[u8], label: &[u8]) -> Option<Option<Hundredths>> {
    parse_reading(field.strip_prefix(label)?)
}

/// `12.34`, or `nan` where there is no reading; the outer option is none when it is neither.
#[allow(clippy::option_option)]
pub(crate) fn parse_reading(field: &[u8]) -> Option<Option<Hundredths>> {
    match field {
        b"nan" => Some(None),
        value => Hundredths::parse(value).map(Some),
    }
}

/// Why a line is no telemetry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TelemetryError {
    /// The line itself cannot be trusted.
    Line(LineError),
    /// A line of another kind.
    OtherLine,
    /// The checksum is right and the fields are not: another version wrote it.
    Malformed,
}

impl fmt::Display for TelemetryError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(error) => error.fmt(f),
            Self::OtherLine => f.write_str("expected a line that starts with `T `"),
            Self::Malformed => f.write_str(
                "unknown fields in a telemetry line: do the firmware and `softrig` match?",
            ),
        }
    }
}

impl core::error::Error for TelemetryError {
    fn source(&self) -> Option<&(dyn core::error::Error + 'static)> {
        match self {
            Self::Line(error) => Some(error),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::text::Text;
    use proptest::prelude::*;
    use std::string::String;

    fn line(sample: &Telemetry) -> String {
        let mut out = Text::default();
        sample.write(&mut out).unwrap();
        out.0
    }

    fn hundredths() -> impl Strategy<Value = Hundredths> {
        any::<i32>().prop_map(|n| Hundredths(n.max(-i32::MAX)))
    }

    prop_compose! {
        fn samples()(
            sequence: u16, time_ms: u32,
            pressure_kpa in prop::option::of(hundredths()),
            angle_deg in prop::option::of(hundredths()),
            predicted_deg in prop::option::of(hundredths()),
            kind in 0..3u8, level in hundredths(),
            volume_ul: i32, state in 0..State::ALL.len(), fault: u8, mismatch: bool,
        ) -> Telemetry {
            let setpoint = match kind {
                0 => Setpoint::None,
                1 => Setpoint::Angle(level),
                _ => Setpoint::Pressure(level),
            };
            Telemetry {
                sequence, time_ms, pressure_kpa, angle_deg, predicted_deg, setpoint,
                volume_ul, state: State::ALL[state], fault, mismatch,
            }
        }
    }

    proptest! {
        #[test]
        fn is_read_back_as_it_was_written(sample in samples()) {
            prop_assert_eq!(Telemetry::parse(line(&sample).as_bytes()), Ok(sample));
        }

        #[test]
        fn a_truncated_line_is_refused(sample in samples(), cut: prop::sample::Index) {
            let text = line(&sample);
            let text = text.trim_end();
            prop_assert!(Telemetry::parse(&text.as_bytes()[..cut.index(text.len())]).is_err());
        }
    }

    /// 115 200 baud, which the board's clock rounds to 117 647, are 11 764 bytes
    /// a second. The longest usual line takes 91 % of them, which leaves a thousand
    /// bytes: four beats a second want 64.
    #[test]
    fn the_longest_usual_line_leaves_room_on_the_cable() {
        let sample = Telemetry {
            sequence: 65_535,
            time_ms: 9_999_990,
            pressure_kpa: Some(Hundredths(17_000)),
            angle_deg: Some(Hundredths(12_012)),
            predicted_deg: Some(Hundredths(12_045)),
            setpoint: Setpoint::Pressure(Hundredths(15_000)),
            volume_ul: 53_200,
            state: State::Running,
            fault: 0,
            mismatch: true,
        };
        let text = line(&sample);
        assert!(text.len() <= 107, "{} bytes: {text}", text.len());
    }

    #[test]
    fn a_sealed_line_of_another_kind_is_told_apart() {
        let sealed = crate::text::sealed;
        assert_eq!(
            Telemetry::parse(sealed("# hello").as_bytes()),
            Err(TelemetryError::OtherLine)
        );
        assert_eq!(
            Telemetry::parse(sealed("T 1 2 pressure:1.00").as_bytes()),
            Err(TelemetryError::Malformed)
        );
        let good = "T 1 2 pressure:1.00 angle:nan predicted:nan volume:0.000 i0";
        assert!(Telemetry::parse(sealed(good).as_bytes()).is_ok());
        let longer = std::format!("{good} more");
        assert_eq!(
            Telemetry::parse(sealed(&longer).as_bytes()),
            Err(TelemetryError::Malformed)
        );
    }
}
