//! Detects standstill of a reading, and gives its level.
//!
//! A tare while the actuator still creeps or the pressure still falls would be
//! wrong for the whole day. A reading stands still if the spread of its smoothed
//! samples over the last second is small; its level is their mean, which
//! is far quieter than any one of them. Extremes and sums of blocks stand for
//! the hundred samples, which would not fit.

use crate::design::CONTROL_HZ;

/// Blocks that a second is cut into.
const BLOCKS: u8 = 2;
/// Samples of a block.
#[allow(clippy::cast_possible_truncation)] // Fifty.
const BLOCK: u8 = (CONTROL_HZ / BLOCKS as u16) as u8;

/// A sample's share in the mean of all blocks.
const SHARE: f32 = 1.0 / (BLOCK as u16 * BLOCKS as u16) as f32;

#[derive(Clone, Copy, Debug, PartialEq)]
struct Block {
    low: f32,
    high: f32,
    sum: f32,
}

impl Block {
    fn starting(sample: f32) -> Self {
        Self {
            low: sample,
            high: sample,
            sum: sample,
        }
    }

    fn add(&mut self, sample: f32) {
        if sample < self.low {
            self.low = sample;
        }
        if sample > self.high {
            self.high = sample;
        }
        self.sum += sample;
    }
}

/// The standstill detector of one sensor, over its last second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Standstill {
    /// The last complete blocks, the newer first.
    complete: [Option<Block>; BLOCKS as usize],
    current: Option<Block>,
    /// Samples in it.
    samples: u8,
}

impl Standstill {
    /// Takes a sample.
    pub fn update(&mut self, sample: f32) {
        match &mut self.current {
            Some(block) => block.add(sample),
            none => *none = Some(Block::starting(sample)),
        }
        self.samples += 1;
        if self.samples >= BLOCK {
            self.complete = [self.current.take(), self.complete[0]];
            self.samples = 0;
        }
    }

    /// The mean of the last second if nothing in it, nor since, is farther
    /// apart than `spread`; none otherwise, or before a second has passed.
    pub fn level(&self, spread: f32) -> Option<f32> {
        let [Some(newer), Some(older)] = self.complete else {
            return None;
        };
        let (mut low, mut high) = (newer.low, newer.high);
        for block in [Some(older), self.current].into_iter().flatten() {
            if block.low < low {
                low = block.low;
            }
            if block.high > high {
                high = block.high;
            }
        }
        let mean = (newer.sum + older.sum) * SHARE;
        (high - low < spread).then_some(mean)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_of_calm_is_standstill_at_its_mean() {
        let mut standstill = Standstill::default();
        for n in 0..99_u8 {
            assert_eq!(standstill.level(1.0), None);
            standstill.update(if n % 2 == 0 { 4.8 } else { 5.2 });
        }
        standstill.update(5.2);
        assert!((standstill.level(1.0).unwrap() - 5.0).abs() < 1e-5);
        assert_eq!(standstill.level(0.3), None);
    }

    #[test]
    fn a_jolt_is_remembered_for_a_second() {
        let mut standstill = Standstill::default();
        for _ in 0..130 {
            standstill.update(5.0);
        }
        standstill.update(9.0);
        assert_eq!(standstill.level(1.0), None, "seen at once");
        let mut samples = 0;
        while standstill.level(1.0).is_none() {
            standstill.update(5.0);
            samples += 1;
        }
        assert!((100..=150).contains(&samples), "{samples}");
    }

    #[test]
    fn a_slow_drift_is_no_standstill() {
        let mut standstill = Standstill::default();
        for n in 0..250_u8 {
            standstill.update(f32::from(n) * 0.01);
        }
        assert_eq!(standstill.level(0.9), None);
    }
}
