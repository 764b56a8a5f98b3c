//! Lines of text with a checksum.
//!
//! `text *hhhh` and a line end: `hhhh` is the checksum of everything before the
//! space, in hexadecimal.

use core::fmt;

use ufmt::uWrite;

use crate::{checksum::Crc16, decimal::digit};

/// Writes one line and its checksum.
///
/// # Examples
///
/// ```
/// use ufmt::uwrite;
/// use wire::line::{self, Sealed};
/// # struct Out(String);
/// # impl ufmt::uWrite for Out {
/// #     type Error = core::convert::Infallible;
/// #     fn write_str(&mut self, s: &str) -> Result<(), Self::Error> { self.0.push_str(s); Ok(()) }
/// # }
/// # let mut out = Out(String::new());
///
/// let mut line = Sealed::new(&mut out);
/// uwrite!(line, "angle {}", 12)?;
/// line.finish()?;
/// assert_eq!(line::open(&out.0), Ok("angle 12"));
/// # Ok::<(), core::convert::Infallible>(())
/// ```
#[derive(Debug)]
pub struct Sealed<'w, W: ?Sized> {
    out: &'w mut W,
    crc: Crc16,
}

impl<'w, W: uWrite + ?Sized> Sealed<'w, W> {
    /// Creates a line that goes to `out`.
    pub fn new(out: &'w mut W) -> Self {
        Self {
            out,
            crc: Crc16::new(),
        }
    }

    /// Writes one ASCII character: nearly all of telemetry comes this way, so it does
    /// nothing else.
    #[inline(never)]
    pub(crate) fn put(&mut self, byte: u8) -> Result<(), W::Error> {
        self.crc.update(byte);
        self.out.write_char(byte as char)
    }

    /// Apart from [`Sealed::put`], which would make room for the bytes every time.
    #[cold]
    #[inline(never)]
    fn put_wide(&mut self, character: char) -> Result<(), W::Error> {
        self.write_str(character.encode_utf8(&mut [0; 4]))
    }

    /// Writes the checksum and the line end.
    ///
    /// # Errors
    ///
    /// Errors of the output.
    pub fn finish(self) -> Result<(), W::Error> {
        self.out.write_str(" *")?;
        for byte in self.crc.value().to_be_bytes() {
            self.out.write_char(digit(byte >> 4))?;
            self.out.write_char(digit(byte & 0xf))?;
        }
        self.out.write_str("\r\n")
    }
}

impl<W: uWrite + ?Sized> uWrite for Sealed<'_, W> {
    type Error = W::Error;

    fn write_str(&mut self, text: &str) -> Result<(), W::Error> {
        for byte in text.bytes() {
            self.crc.update(byte);
        }
        self.out.write_str(text)
    }

    /// Numbers come a character at a time.
    #[inline(always)] // So that a digit is known to be one.
    fn write_char(&mut self, character: char) -> Result<(), W::Error> {
        if character.is_ascii() {
            self.put(character as u8)
        } else {
            self.put_wide(character)
        }
    }
}

/// Why a line cannot be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum LineError {
    /// It does not end in ` *` and four hexadecimal digits.
    NoChecksum,
    /// The text was damaged on the way.
    WrongChecksum {
        /// The checksum at the end of the line.
        stated: u16,
        /// The checksum of the text that arrived.
        computed: u16,
    },
}

impl fmt::Display for LineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoChecksum => {
                f.write_str("expected a line that ends in ` *` and four hex digits")
            }
            Self::WrongChecksum { stated, computed } => write!(
                f,
                "checksum {stated:04x} stated but {computed:04x} computed: the line was damaged"
            ),
        }
    }
}

impl core::error::Error for LineError {}

/// Returns the text of a sealed line, once its checksum is right.
///
/// # Errors
///
/// [`LineError`] when the checksum is missing or wrong.
pub fn open(line: &str) -> Result<&str, LineError> {
    let text = open_bytes(line.as_bytes())?;
    // What is left of a string up to an ASCII space is a string.
    line.get(..text.len()).ok_or(LineError::NoChecksum)
}

/// Like [`open`], for bytes that may be anything.
///
/// # Errors
///
/// Like [`open`].
pub fn open_bytes(line: &[u8]) -> Result<&[u8], LineError> {
    let (text, [b' ', b'*', digits @ ..]) = trimmed(line)
        .split_last_chunk::<6>()
        .ok_or(LineError::NoChecksum)?
    else {
        return Err(LineError::NoChecksum);
    };
    let mut stated = 0;
    for &digit in digits {
        // No capitals: one wrong bit makes them of small letters, and a damaged
        // line is damaged wherever it is.
        let value = match digit {
            b'0'..=b'9' => digit - b'0',
            b'a'..=b'f' => digit - b'a' + 10,
            _ => return Err(LineError::NoChecksum),
        };
        stated = stated << 4 | u16::from(value);
    }
    let computed = Crc16::of(text).value();
    if stated == computed {
        Ok(text)
    } else {
        Err(LineError::WrongChecksum { stated, computed })
    }
}

/// The line without its end.
pub(crate) fn trimmed(mut line: &[u8]) -> &[u8] {
    while let [rest @ .., b'\r' | b'\n'] = line {
        line = rest;
    }
    line
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::{LineError, open};
    use crate::text::sealed;
    use proptest::prelude::*;
    use std::{string::String, vec::Vec};

    proptest! {
        #[test]
        fn opens_what_was_sealed(text in "[ -~]{0,80}") {
            let line = sealed(&text);
            prop_assert_eq!(open(&line), Ok(text.as_str()));
        }

        #[test]
        fn notices_any_flipped_bit(text in "[ -~]{1,60}", place: prop::sample::Index, bit in 0..7u8) {
            let mut bytes: Vec<u8> = sealed(&text).trim_end().into();
            let place = place.index(text.len());
            bytes[place] ^= 1 << bit;
            let damaged = String::from_utf8(bytes).unwrap();
            prop_assert!(open(&damaged).is_err());
        }
    }

    #[test]
    fn says_what_is_missing() {
        for line in [
            "",
            "angle 12",
            "angle 12 *12",
            "angle 12 *12g4",
            "angle 12 *+123",
        ] {
            assert_eq!(open(line), Err(LineError::NoChecksum), "{line}");
        }
    }
}
