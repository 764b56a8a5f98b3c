//! Decimal numbers in text without floating-point formatting.
//!
//! `core::fmt` of one `f32` costs the board 32 KiB of flash; an integer with a
//! fixed point costs a few hundred bytes.

use ufmt::{Formatter, uDisplay, uWrite};

/// A number in thousandths, written with three decimals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Thousandths(pub i32);

impl Thousandths {
    /// Rounds to the nearest thousandth, halves away from zero.
    ///
    /// Saturates at ±2 147 483.647; not-a-number becomes zero.
    pub fn round(number: f32) -> Self {
        let scaled = number * 1000.0;
        // A cast saturates and maps not-a-number to zero, as documented.
        #[allow(clippy::cast_possible_truncation)]
        Self(
            (if scaled < 0.0 {
                scaled - 0.5
            } else {
                scaled + 0.5
            }) as i32,
        )
    }
}

impl Thousandths {
    /// Reads `-12.345`: an optional minus, digits, a point, three digits.
    pub fn parse(text: &[u8]) -> Option<Self> {
        fixed::<3>(text).map(Self)
    }
}

impl uDisplay for Thousandths {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        let size = self.0.unsigned_abs();
        if self.0 < 0 {
            f.write_char('-')?;
        }
        digits(f, size, 3)
    }
}

/// A number in hundredths, written with two decimals: kPa and degrees in
/// telemetry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Hundredths(pub i32);

impl Hundredths {
    /// Rounds to the nearest hundredth, halves away from zero.
    ///
    /// Saturates at ±21 474 836.47; not-a-number becomes zero.
    pub fn round(number: f32) -> Self {
        let scaled = number * 100.0;
        #[allow(clippy::cast_possible_truncation)] // Saturates, as documented.
        Self(
            (if scaled < 0.0 {
                scaled - 0.5
            } else {
                scaled + 0.5
            }) as i32,
        )
    }

    /// The number itself, rounded once.
    pub fn to_f32(self) -> f32 {
        self.0 as f32 / 100.0
    }

    /// Reads `-12.34`: an optional minus, digits, a point, two digits.
    pub fn parse(text: &[u8]) -> Option<Self> {
        fixed::<2>(text).map(Self)
    }
}

impl uDisplay for Hundredths {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        let size = self.0.unsigned_abs();
        if self.0 < 0 {
            f.write_char('-')?;
        }
        digits(f, size, 2)
    }
}

/// A whole number. As `{}` of an integer, but quick on the board; see `digits`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Whole(pub i32);

impl uDisplay for Whole {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        if self.0 < 0 {
            f.write_char('-')?;
        }
        digits(f, self.0.unsigned_abs(), 0)
    }
}

/// A whole number without a sign; see [`Whole`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Count(pub u32);

impl uDisplay for Count {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        digits(f, self.0, 0)
    }
}

/// Reads a number with exactly so many decimals, in units of the last.
fn fixed<const DECIMALS: usize>(text: &[u8]) -> Option<i32> {
    let (negative, text) = match text {
        [b'-', rest @ ..] => (true, rest),
        _ => (false, text),
    };
    let point = text.len().checked_sub(DECIMALS + 1)?;
    if point == 0 || text.get(point) != Some(&b'.') {
        return None;
    }
    let mut size: u32 = 0;
    for (place, byte) in text.iter().enumerate() {
        if place == point {
            continue;
        }
        if !byte.is_ascii_digit() {
            return None;
        }
        size = size.checked_mul(10)?.checked_add(u32::from(byte - b'0'))?;
    }
    if negative {
        0_i32.checked_sub_unsigned(size)
    } else {
        i32::try_from(size).ok()
    }
}

/// Writes a number whose last `decimals` digits stand behind a point.
///
/// By subtracting powers of ten: a division of 32 bits takes the board 600
/// cycles, and telemetry has 3 000 digits a second.
fn digits<W: uWrite + ?Sized>(
    f: &mut Formatter<'_, W>,
    mut size: u32,
    decimals: u8,
) -> Result<(), W::Error> {
    let mut digits = Digits {
        decimals,
        has_begun: false,
    };
    // Most numbers of a line are small, and a place costs even where nothing stands.
    let places = match size {
        ..10_000 => SMALL,
        10_000..1_000_000 => 6,
        _ => 10,
    };
    for place in (SMALL..places).rev() {
        let power = power_of_ten(place);
        let mut digit = b'0';
        while size >= power {
            size -= power;
            digit += 1;
        }
        digits.write(f, place, digit)?;
    }
    // The last four in half of the processor's instructions.
    #[allow(clippy::cast_possible_truncation)] // Less than ten thousand is left.
    let mut size = size as u16;
    for place in (0..SMALL).rev() {
        let power = match place {
            0 => 1,
            1 => 10,
            2 => 100,
            _ => 1_000,
        };
        let mut digit = b'0';
        while size >= power {
            size -= power;
            digit += 1;
        }
        digits.write(f, place, digit)?;
    }
    Ok(())
}

/// Places of a number that fits into sixteen bits whatever its digits are.
const SMALL: u8 = 4;

/// The digits of a number that are written.
struct Digits {
    decimals: u8,
    has_begun: bool,
}

impl Digits {
    /// Writes a digit, unless it is a zero in front, and the point behind it.
    #[inline(always)]
    fn write<W: uWrite + ?Sized>(
        &mut self,
        f: &mut Formatter<'_, W>,
        place: u8,
        digit: u8,
    ) -> Result<(), W::Error> {
        self.has_begun |= digit != b'0' || place <= self.decimals;
        if !self.has_begun {
            return Ok(());
        }
        f.write_char(char::from(digit))?;
        if place == self.decimals && place != 0 {
            f.write_char('.')?;
        }
        Ok(())
    }
}

/// Ten to a power from the fourth on; a table would lie in the board's RAM.
const fn power_of_ten(exponent: u8) -> u32 {
    match exponent {
        4 => 10_000,
        5 => 100_000,
        6 => 1_000_000,
        7 => 10_000_000,
        8 => 100_000_000,
        _ => 1_000_000_000,
    }
}

/// A 32-bit word as eight hexadecimal digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Word(pub u32);

impl uDisplay for Word {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        for byte in self.0.to_be_bytes() {
            f.write_char(digit(byte >> 4))?;
            f.write_char(digit(byte & 0xf))?;
        }
        Ok(())
    }
}

/// A 16-bit word, a checksum, as four hexadecimal digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HalfWord(pub u16);

impl uDisplay for HalfWord {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        for byte in self.0.to_be_bytes() {
            f.write_char(digit(byte >> 4))?;
            f.write_char(digit(byte & 0xf))?;
        }
        Ok(())
    }
}

/// A hexadecimal digit, computed: a table of digits would live in the board's RAM.
pub(crate) const fn digit(nibble: u8) -> char {
    (if nibble < 10 {
        b'0' + nibble
    } else {
        b'a' + nibble - 10
    }) as char
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::{Hundredths, Thousandths, Word};
    use crate::text::Text;
    use std::{format, string::String};
    use ufmt::uwrite;

    fn text(number: f32) -> String {
        let mut out = Text::default();
        uwrite!(out, "{}", Thousandths::round(number)).unwrap();
        out.0
    }

    #[test]
    fn writes_what_the_standard_library_would() {
        for number in [
            0.0, 0.5, 17.188_734, -0.012_4, 999.999_5, -1234.5, 0.1, 0.01,
        ] {
            assert_eq!(text(number), format!("{number:.3}"), "{number}");
        }
    }

    #[test]
    fn saturates_and_has_no_not_a_number() {
        assert_eq!(text(1e12), "2147483.647");
        assert_eq!(text(-1e12), "-2147483.648");
        assert_eq!(text(f32::NAN), "0.000");
    }

    #[test]
    fn hundredths_are_read_back() {
        for value in [
            0,
            5,
            -5,
            99,
            100,
            -6012,
            65_535,
            65_536,
            6_553_600,
            i32::MAX,
            i32::MIN,
            9_999,
            10_000,
            99_999,
            100_000,
        ] {
            let mut out = Text::default();
            uwrite!(out, "{}", Hundredths(value)).unwrap();
            assert_eq!(
                out.0,
                format!("{:.2}", f64::from(value) / 100.0).replace("-0.00", "0.00")
            );
            assert_eq!(Hundredths::parse(out.0.as_bytes()), Some(Hundredths(value)));
            let mut out = Text::default();
            uwrite!(out, "{}", Thousandths(value)).unwrap();
            assert_eq!(out.0, format!("{:.3}", f64::from(value) / 1000.0));
            assert_eq!(
                Thousandths::parse(out.0.as_bytes()),
                Some(Thousandths(value))
            );
        }
        for text in [
            "",
            "1",
            "1.2",
            ".12",
            "1.234",
            "+1.00",
            "--1.00",
            "1.0a",
            "99999999999.00",
            "21474836.48",
            "1.00.",
        ] {
            assert_eq!(Hundredths::parse(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn words_keep_their_leading_zeros() {
        let mut out = Text::default();
        uwrite!(out, "{}", Word(0x0e9a_b0cd)).unwrap();
        assert_eq!(out.0, "0e9ab0cd");
    }
}
