//! One model step as the board computed it: readable, and exact to the bit.

use core::fmt;

use ufmt::{uWrite, uwrite};

use crate::{
    decimal::{Thousandths, Word},
    line::{self, LineError, Sealed},
};

const DEGREES_PER_RADIAN: f32 = 57.295_78;

/// The state after one step.
///
/// Equality is that of the numbers; compare [`f32::to_bits`] for the bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepReport<'t> {
    /// The power function that was used.
    pub power: &'t str,
    /// The one effect in the model, as its place in the catalogue.
    pub effect: Option<u8>,
    /// Bending angle in radians.
    pub angle_rad: f32,
    /// Angular velocity in rad/s.
    pub rate_rad_per_s: f32,
}

impl<'t> StepReport<'t> {
    /// Writes the report as one sealed line.
    ///
    /// # Errors
    ///
    /// Errors of the output.
    pub fn write<W: uWrite + ?Sized>(&self, out: &mut W) -> Result<(), W::Error> {
        let mut line = Sealed::new(out);
        uwrite!(line, "step {}", self.power)?;
        if let Some(effect) = self.effect {
            uwrite!(line, " with effect {}", effect)?;
        }
        uwrite!(
            line,
            ": angle {} deg, rate {} deg/s, bits {} {}",
            Thousandths::round(self.angle_rad * DEGREES_PER_RADIAN),
            Thousandths::round(self.rate_rad_per_s * DEGREES_PER_RADIAN),
            Word(self.angle_rad.to_bits()),
            Word(self.rate_rad_per_s.to_bits()),
        )?;
        line.finish()
    }

    /// Whether the same step led to the same state, to the last bit.
    pub fn is_same_to_the_bit(&self, other: &StepReport<'_>) -> bool {
        let bits =
            |report: &StepReport<'_>| [report.angle_rad, report.rate_rad_per_s].map(f32::to_bits);
        (self.power, self.effect) == (other.power, other.effect) && bits(self) == bits(other)
    }

    /// Reads a report back from its line; the bits count, not the degrees.
    ///
    /// # Errors
    ///
    /// [`StepReportError`] when the line is damaged or says something else.
    pub fn parse(line: &'t str) -> Result<Self, StepReportError> {
        let text = line::open(line).map_err(StepReportError::Line)?;
        let (what, rest) = text
            .strip_prefix("step ")
            .and_then(|rest| rest.split_once(": "))
            .ok_or(StepReportError::OtherLine)?;
        let (power, effect) = match what.split_once(" with effect ") {
            None => (what, None),
            Some((power, index)) => (
                power,
                Some(index.parse().map_err(|_| StepReportError::OtherLine)?),
            ),
        };
        let (_, bits) = rest.split_once(", bits ").ok_or(StepReportError::NoBits)?;
        let (angle, rate) = bits.split_once(' ').ok_or(StepReportError::NoBits)?;
        let number = |digits: &str| {
            u32::from_str_radix(digits, 16)
                .map(f32::from_bits)
                .map_err(|_| StepReportError::NoBits)
        };
        Ok(Self {
            power,
            effect,
            angle_rad: number(angle)?,
            rate_rad_per_s: number(rate)?,
        })
    }
}

/// Why a line is no step report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum StepReportError {
    /// The line itself cannot be trusted.
    Line(LineError),
    /// A line of another kind.
    OtherLine,
    /// The two hexadecimal words are missing.
    NoBits,
}

impl fmt::Display for StepReportError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(error) => error.fmt(f),
            Self::OtherLine => f.write_str("expected a line that starts with `step NAME: `"),
            Self::NoBits => f.write_str("expected `, bits ` and two hexadecimal words"),
        }
    }
}

impl core::error::Error for StepReportError {
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
    use super::{StepReport, StepReportError};
    use crate::{
        line::LineError,
        text::{Text, sealed},
    };
    use proptest::prelude::*;

    fn written(report: &StepReport<'_>) -> std::string::String {
        let mut out = Text::default();
        report.write(&mut out).unwrap();
        out.0
    }

    #[test]
    fn reads_like_a_sentence() {
        let report = StepReport {
            power: "minimax",
            effect: None,
            angle_rad: 0.3,
            rate_rad_per_s: -0.1,
        };
        assert!(written(&report).starts_with(
            "step minimax: angle 17.189 deg, rate -5.730 deg/s, bits 3e99999a bdcccccd *"
        ));
    }

    proptest! {
        #[test]
        fn keeps_every_bit(angle: u32, rate: u32, effect: Option<u8>) {
            let report = StepReport {
                power: "micromath",
                effect,
                angle_rad: f32::from_bits(angle),
                rate_rad_per_s: f32::from_bits(rate),
            };
            let line = written(&report);
            let read = StepReport::parse(&line).unwrap();
            prop_assert_eq!(read.power, "micromath");
            prop_assert_eq!(read.effect, effect);
            prop_assert_eq!(read.angle_rad.to_bits(), angle);
            prop_assert_eq!(read.rate_rad_per_s.to_bits(), rate);
        }
    }

    #[test]
    fn refuses_other_lines() {
        assert_eq!(
            StepReport::parse("step minimax: nothing"),
            Err(StepReportError::Line(LineError::NoChecksum))
        );
        assert_eq!(
            StepReport::parse(&sealed("softrig 0.1.0")),
            Err(StepReportError::OtherLine)
        );
        assert_eq!(
            StepReport::parse(&sealed("step minimax: angle 1 deg, bits 12 xy")),
            Err(StepReportError::NoBits)
        );
    }
}
