// SPDX-License-Identifier: GPL-3.0-or-later
//! Interference on the serial line: bursts in which bytes are damaged.
//!
//! A motor cable beside the USB cable does not flip single bits: it damages a few bytes
//! in a row.

use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// Probability that a burst starts at a byte: one in eight lines of telemetry
/// is hit, and most requests arrive.
const BURST: f64 = 0.002;
/// The longest burst in bytes.
const LONGEST: u32 = 8;

/// A noisy line.
#[derive(Clone, Debug)]
pub(crate) struct Noise {
    random: Pcg64Mcg,
    left: u32,
}

impl Noise {
    pub(crate) fn new(random: Pcg64Mcg) -> Self {
        Self { random, left: 0 }
    }

    /// The bytes that arrive of `bytes`.
    pub(crate) fn pass(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut arrived = Vec::with_capacity(bytes.len());
        for &byte in bytes {
            if self.left == 0 && self.random.random_bool(BURST) {
                self.left = self.random.random_range(1..=LONGEST);
            }
            if self.left == 0 {
                arrived.push(byte);
                continue;
            }
            self.left -= 1;
            match self.random.random_range(0..4) {
                0 => {}
                1 => arrived.extend([byte, self.random.random()]),
                _ => arrived.push(byte ^ (1 << self.random.random_range(0..8))),
            }
        }
        arrived
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn some_lines_are_damaged_and_some_are_not() {
        let mut noise = Noise::new(Pcg64Mcg::seed_from_u64(1));
        let line = b"t 1024 12.50 90.0 *abcd\r\n";
        let whole = (0..2000).filter(|_| noise.pass(line) == line).count();
        // 0.998 to the power of 25 bytes, and what a burst spills into the next.
        assert!(
            (1820..1940).contains(&whole),
            "{whole} of 2000 lines arrived"
        );
    }
}
