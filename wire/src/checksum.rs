//! The checksum of every line and frame.
//!
//! CRC-16 with polynomial x¹⁶ + x¹² + x⁵ + 1 and an initial value of all ones
//! (the catalogue's CRC-16/IBM-3740, often called CCITT-FALSE). The byte-wise
//! form by shifts costs no table, which on this processor would live in RAM.
//!
//! This file stands alone: the build computes the checksum of the image with it.

/// A running CRC-16/IBM-3740.
///
/// # Examples
///
/// ```
/// use wire::checksum::Crc16;
///
/// let mut crc = Crc16::new();
/// b"123456789".iter().for_each(|&byte| crc.update(byte));
/// assert_eq!(crc.value(), 0x29b1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crc16 {
    // By bytes: an AVR puts sixteen bits together and apart again at every turn.
    high: u8,
    low: u8,
}

impl Crc16 {
    /// Creates the checksum of no bytes.
    pub const fn new() -> Self {
        Self {
            high: 0xff,
            low: 0xff,
        }
    }

    /// Creates the checksum of `bytes`.
    pub fn of(bytes: &[u8]) -> Self {
        let mut crc = Self::new();
        for &byte in bytes {
            crc.update(byte);
        }
        crc
    }

    /// Adds a byte.
    #[inline(always)] // Fifteen instructions, for every byte that is sent.
    pub const fn update(&mut self, byte: u8) {
        let mut x = self.high ^ byte;
        x ^= x >> 4;
        self.high = self.low ^ (x << 4) ^ (x >> 3);
        self.low = x ^ (x << 5);
    }

    /// The checksum of the bytes so far.
    pub const fn value(self) -> u16 {
        u16::from_be_bytes([self.high, self.low])
    }
}

impl Default for Crc16 {
    fn default() -> Self {
        Self::new()
    }
}
