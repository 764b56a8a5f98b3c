//! c·sign(θ)|θ|ⁿ for a fixed exponent, in a few hundred cycles.
//!
//! [`Minimax`] finds a logarithm and an exponential of every base: 4 300 cycles on the
//! board. The exponent of a model that runs does not change, and mⁿ over one octave is a
//! smooth curve that every other octave repeats, 2ⁿ times as large. So a table of that
//! octave is prepared when a model is uploaded.
//!
//! Preparing it costs 65 powers, too long for one control period; [`PowerTable::prepare`]
//! spreads it.

use wide_mul::{product, share};

use crate::power::{Minimax, Power, signed_power};

/// Chords of an octave.
const CHORDS: usize = 64;

const OCTAVES: usize = 16;

/// The biased exponent of the lowest octave: 2⁻¹⁴ rad.
const LOWEST: u8 = 127 - 14;

/// c·sign(θ)|θ|ⁿ with c ≥ 0 and n fixed.
///
/// The exponent byte of θ picks the octave, the first six bits of its mantissa one of 64 chords,
/// the next sixteen the place on it. All of it is integer arithmetic; a result is put together as
/// an `f32` at the end.
///
/// | | |
/// |---|---|
/// | largest relative error, 1 mrad ≤ θ < 4 rad, ½ ≤ n ≤ 3 | 2·10⁻⁴ |
/// | below 2⁻¹⁴ rad (0.0035°) | a chord through 0 |
/// | from 4 rad on | [`Minimax`] itself |
/// | memory | 256 bytes |
///
/// It never falls from one `f32` to the next, is odd to the bit, and 0 at 0. The nodes of chords
/// are moved by half of what a chord is off in its middle, so that the error goes both ways;
/// octaves are chained downwards, so that they meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PowerTable {
    /// The low sixteen bits of mⁿ at the ends of the chords, in units of the table.
    low: [u16; CHORDS + 1],
    /// The bits above them.
    high: [u8; CHORDS + 1],
    /// What a unit is worth in each octave: sixteen bits of an `f32`'s mantissa, the
    /// first of them 1.
    mantissa: [u16; OCTAVES],
    /// Its biased exponent.
    exponent: [u8; OCTAVES],
    /// The slope of the chord below the lowest octave.
    chord: f32,
    scale: f32,
    power: f32,
    /// Units in which 1ⁿ is written.
    unit: f32,
    /// Nodes that are prepared.
    nodes: u8,
}

/// The exponents of which a table can be made.
pub const EXPONENTS: core::ops::RangeInclusive<f32> = 0.25..=5.0;

impl PowerTable {
    /// The table of `scale`·sign(θ)|θ|^`power`, at once.
    ///
    /// `scale` ≥ 0 has the unit of the result (θ and n are pure numbers); `power` is one of
    /// [`EXPONENTS`]: beyond, units of the table are too coarse for it not to fall.
    pub fn new(scale: f32, power: f32) -> Self {
        let mut table = Self::begin(scale, power);
        while !table.prepare() {}
        table
    }

    /// The same without its nodes, which [`PowerTable::prepare`] computes.
    pub fn begin(scale: f32, power: f32) -> Self {
        let mut table = Self::empty();
        table.restart(scale, power);
        table
    }

    /// Room for a table. No constant, which a board would keep in its memory beside it.
    #[inline(always)]
    pub fn empty() -> Self {
        Self {
            low: [0; CHORDS + 1],
            high: [0; CHORDS + 1],
            mantissa: [0; OCTAVES],
            exponent: [0; OCTAVES],
            chord: 0.0,
            scale: 0.0,
            power: 1.0,
            unit: 1.0,
            nodes: 0,
        }
    }

    /// Begins anew in place, for a board that has no room for two. A table of the same
    /// numbers stays as it is.
    #[inline(never)]
    pub fn restart(&mut self, scale: f32, power: f32) {
        #[expect(clippy::float_cmp)] // The same setting, not a measured value.
        if self.unit > 1.0 && self.scale == scale && self.power == power {
            return;
        }
        // The last chord of the octave rises most, by n·2^(n−1)/64 of the unit, and has
        // to fit into sixteen bits.
        let steepest = power * Minimax::pow(2.0, power) * 0.5;
        self.unit = 262_144.0;
        while self.unit > 2.0 && steepest * self.unit >= 4_194_304.0 {
            self.unit *= 0.5;
        }
        self.scale = scale;
        self.power = power;
        self.nodes = 0;
    }

    /// Computes the next node, one power; whether the table is complete.
    #[inline(never)]
    pub fn prepare(&mut self) -> bool {
        /// Half the length of a chord, of the octave's.
        const HALF: f32 = 0.5 / CHORDS as f32;
        let node = usize::from(self.nodes);
        // Behind the nodes come the octaves.
        if node > CHORDS + 1 {
            return true;
        }
        self.nodes += 1;
        let (Some(low), Some(high)) = (self.low.get_mut(node), self.high.get_mut(node)) else {
            self.octaves();
            return true;
        };
        let n = self.power;
        let m = 1.0 + node as f32 / CHORDS as f32;
        // A chord is off by (length²/8)·f″ in its middle: nodes are moved by half of it.
        let moved = 1.0 - n * (n - 1.0) * HALF * HALF * 0.25;
        let units = Minimax::pow(m, n) * moved * self.unit + 0.5;
        // Below 2²⁴ by the choice of the unit.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let [u0, u1, u2, _] = (units as u32).to_le_bytes();
        *low = u16::from_le_bytes([u0, u1]);
        *high = u2;
        false
    }

    /// What a unit is worth in each octave, from the top downwards: an octave ends where
    /// the one above begins.
    #[inline(never)]
    fn octaves(&mut self) {
        let node = |index: usize| match (self.low.get(index), self.high.get(index)) {
            (Some(&low), Some(&high)) => f32::from(low) + 65_536.0 * f32::from(high),
            _ => 1.0,
        };
        let seam = node(0) / node(CHORDS);
        // 2 rad, where the highest octave begins.
        let mut worth = self.scale * Minimax::pow(2.0, self.power) / self.unit;
        let octaves = self.mantissa.iter_mut().zip(&mut self.exponent);
        for (mantissa, exponent) in octaves.rev() {
            let [_, b1, b2, b3] = worth.to_bits().to_le_bytes();
            *mantissa = u16::from_le_bytes([b1, b2]) | 0x8000;
            *exponent = (b3 << 1) | (b2 >> 7);
            // As it was written, rounded down, times the seam: no octave begins above
            // the end of the one below.
            worth = f32::from_bits(worth.to_bits() & !0xff) * seam;
        }
        let lowest = f32::from_bits(u32::from(LOWEST) << 23);
        self.chord = self.at(lowest) / lowest;
    }

    /// `scale`·sign(θ)|θ|ⁿ at an angle (rad).
    #[inline]
    pub fn at(&self, angle: f32) -> f32 {
        let [b0, b1, b2, b3] = angle.to_bits().to_le_bytes();
        let octave = usize::from(((b3 << 1) | (b2 >> 7)).wrapping_sub(LOWEST));
        let (Some(&mantissa), Some(&exponent)) =
            (self.mantissa.get(octave), self.exponent.get(octave))
        else {
            return self.outside(angle);
        };
        let chord = usize::from((b2 & 0x7f) >> 1);
        let along = (u16::from_le_bytes([b0, b1]) >> 1) | (u16::from(b2 & 1) << 15);
        let (Some(&low), Some(&high), Some(&next)) = (
            self.low.get(chord),
            self.high.get(chord),
            self.low.get(chord + 1),
        ) else {
            return self.outside(angle);
        };
        let (low, carry) = low.overflowing_add(share(next.wrapping_sub(low), along));
        let high = u16::from(high) + u16::from(carry);
        // Units of up to 21 bits times a mantissa of sixteen, of which 24 are kept.
        let units = (product(low, mantissa) >> 13) + (product(high, mantissa) << 3);
        assemble(units, exponent, b3 & 0x80)
    }

    #[cold]
    #[inline(never)]
    fn outside(&self, angle: f32) -> f32 {
        if angle.abs() < 1.0 {
            angle * self.chord
        } else {
            self.scale * signed_power::<f32, Minimax>(angle, self.power)
        }
    }
}

/// `units`·2^(`exponent` − 129) with a sign, for 0 < `units` < 2²⁴; 0 where that is not a normal
/// number.
#[inline]
fn assemble(units: u32, exponent: u8, sign: u8) -> f32 {
    let [u0, u1, mut top, _] = units.to_le_bytes();
    let mut rest = u16::from_le_bytes([u0, u1]);
    let mut shift: u8 = 0;
    while top & 0x80 == 0 && shift < 24 {
        top = (top << 1) | u8::from(rest & 0x8000 != 0);
        rest <<= 1;
        shift += 1;
    }
    let Some(exponent) = exponent
        .checked_add(21)
        .and_then(|it| it.checked_sub(shift))
    else {
        return f32::from_bits(u32::from(sign) << 24);
    };
    if exponent == 0 {
        return f32::from_bits(u32::from(sign) << 24);
    }
    let [r0, r1] = rest.to_le_bytes();
    f32::from_bits(u32::from_le_bytes([
        r0,
        r1,
        (top & 0x7f) | (exponent << 7),
        (exponent >> 1) | sign,
    ]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::power::Exact;

    /// A pull of 3 N at 1 rad.
    const SCALE: f32 = 3.0;

    const TRIED: [f32; 9] = [0.5, 0.8, 1.0, 1.2, 1.5, 2.0, 2.4, 2.7, 3.0];

    fn exact(angle: f32, power: f32) -> f64 {
        f64::from(SCALE) * Exact::pow(f64::from(angle), f64::from(power))
    }

    #[test]
    fn relative_error_from_a_milliradian_on() {
        for power in TRIED {
            let table = PowerTable::new(SCALE, power);
            let mut worst = 0.0_f64;
            let mut angle = 1e-3_f32;
            while angle < 4.0 {
                let error = f64::from(table.at(angle)) / exact(angle, power) - 1.0;
                worst = worst.max(error.abs());
                angle *= 1.000_37;
            }
            println!("n = {power}: {worst:.1e}");
            assert!(worst <= 2e-4, "n = {power}: {worst}");
        }
    }

    /// A dip would be a second equilibrium.
    #[test]
    fn never_falls_from_one_number_to_the_next() {
        for power in TRIED.into_iter().chain([0.25, 4.0, 5.0]) {
            let table = PowerTable::new(SCALE, power);
            let highest = 3.999_f32.to_bits();
            let mut before = 0.0;
            // A step of 97 lies beside the length of a chord (2¹⁷) and of its places (2).
            for bits in (0..highest).step_by(97) {
                let at = table.at(f32::from_bits(bits));
                assert!(at >= before, "n = {power}, {}", f32::from_bits(bits));
                before = at;
            }
        }
    }

    /// Every seam between chords and octaves, number by number.
    #[test]
    fn never_falls_over_a_seam() {
        for power in TRIED {
            let table = PowerTable::new(SCALE, power);
            for octave in u32::from(LOWEST)..u32::from(LOWEST) + 16 {
                for chord in 0..64 {
                    let seam = (octave << 23) | (chord << 17);
                    let mut before = 0.0;
                    for bits in seam - 8..seam + 8 {
                        let at = table.at(f32::from_bits(bits));
                        assert!(at >= before, "n = {power}, {}", f32::from_bits(bits));
                        before = at;
                    }
                }
            }
        }
    }

    #[test]
    fn odd_and_zero_at_zero() {
        let table = PowerTable::new(SCALE, 2.4);
        assert_eq!(table.at(0.0).to_bits(), 0.0_f32.to_bits());
        for angle in [1e-6, 1e-4, 0.01, 0.7, 1.0, 3.9, 4.0, 7.0] {
            assert_eq!(table.at(-angle).to_bits(), (-table.at(angle)).to_bits());
        }
    }

    #[test]
    fn beyond_the_octaves_it_is_the_accurate_one() {
        let table = PowerTable::new(SCALE, 1.7);
        for angle in [4.0_f32, 6.3, 100.0] {
            let error = f64::from(table.at(angle)) / exact(angle, 1.7) - 1.0;
            assert!(error.abs() < 1e-5, "{angle}: {error}");
        }
        assert!(table.at(f32::NAN).is_nan());
    }

    /// A soft spring has no pull, and no pull is no number to divide by.
    #[test]
    fn a_scale_of_zero_pulls_by_next_to_nothing() {
        let table = PowerTable::new(0.0, 2.0);
        for angle in [0.0, 1e-3, 0.5, 3.0, 5.0] {
            assert!(table.at(angle).abs() < 1e-25, "{angle}");
        }
    }

    #[test]
    fn a_table_is_prepared_a_node_at_a_time() {
        let mut table = PowerTable::begin(SCALE, 2.4);
        let mut calls = 1;
        while !table.prepare() {
            calls += 1;
        }
        assert_eq!(calls, CHORDS + 2);
        assert_eq!(table, PowerTable::new(SCALE, 2.4));
        table.restart(SCALE, 2.4);
        assert!(table.prepare(), "what is there is kept");
        table.restart(SCALE, 0.7);
        while !table.prepare() {}
        assert_eq!(table, PowerTable::new(SCALE, 0.7));
    }
}
