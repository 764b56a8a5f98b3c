//! The static relation between pressure and angle.
//!
//! Where pressure and angle are constant, the stiffness alone balances the pressure,
//! g p = K sign(θ)|θ|ⁿ. So the plateaus of a step test give K/g for any n, and n itself from
//! two levels. They contain no inertia and damping, and creep and friction appear as
//! stiffness: they are initial guesses only.

use crate::statistics::{mean, median, moves, noise, swing};
use softrig_formats::recording::Recording;

/// A level at which a recording stood still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Median pressure (Pa).
    pub pressure: f64,
    /// Median angle (rad).
    pub angle: f64,
}

/// Blocks into which a recording is cut to look for plateaus.
const BLOCKS: f64 = 40.0;

/// Fewest samples of a block.
const FEWEST: f64 = 8.0;

/// A block in which a signal moves by less than this share of its swing stands still.
const STILL: f64 = 0.015;

/// Two levels nearer than this share of the largest angle are one.
const APART: f64 = 0.1;

/// The levels of a recording's plateaus: at least two blocks in a row in which both signals
/// stand still. None where nothing moves, which shows no relation.
pub fn plateaus(recording: &Recording) -> Vec<Level> {
    if !moves(&recording.time, &recording.angle) {
        return Vec::new();
    }
    // A fraction of the samples.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let length = (recording.len() as f64 / BLOCKS).max(FEWEST) as usize;
    let still = |signal: &[f64]| {
        let limit = STILL * swing(signal) + noise(&recording.time, signal);
        signal
            .chunks_exact(length)
            .map(|block| {
                let (first, last) = block.split_at(length / 2);
                2.0 * (mean(last) - mean(first)).abs() <= limit
            })
            .collect::<Vec<bool>>()
    };
    let both: Vec<bool> = still(&recording.angle)
        .into_iter()
        .zip(still(&recording.pressure))
        .map(|(angle, pressure)| angle && pressure)
        .collect();
    let mut found = Vec::new();
    let mut begin = 0;
    while begin < both.len() {
        let blocks = both[begin..].iter().take_while(|still| **still).count();
        if blocks >= 2 {
            // What is left of the motion before it is in its first half.
            let half = (begin + blocks / 2) * length..(begin + blocks) * length;
            found.push(Level {
                pressure: median(&mut recording.pressure[half.clone()].to_vec()),
                angle: median(&mut recording.angle[half].to_vec()),
            });
        }
        begin += blocks.max(1);
    }
    found
}

/// sign(θ)|θ|ⁿ.
pub fn signed_power(angle: f64, exponent: f64) -> f64 {
    libm::pow(angle.abs(), exponent).copysign(angle)
}

/// K/g (Pa/radⁿ) for an exponent, by least squares; none without a level beside the
/// rest.
pub fn ratio(levels: &[Level], exponent: f64) -> Option<f64> {
    let of = |level: &Level| signed_power(level.angle, exponent);
    let squares: f64 = levels.iter().map(|level| of(level).powi(2)).sum();
    let products: f64 = levels.iter().map(|level| of(level) * level.pressure).sum();
    let ratio = products / squares;
    (ratio.is_finite() && ratio != 0.0).then_some(ratio)
}

/// The exponent from the slope of ln p over ln θ; none unless two levels away from rest
/// differ.
pub fn exponent(levels: &[Level]) -> Option<f64> {
    let largest = levels
        .iter()
        .fold(0.0, |most: f64, at| most.max(at.angle.abs()));
    let points: Vec<(f64, f64)> = levels
        .iter()
        .filter(|at| at.angle.abs() > APART * largest && at.pressure * at.angle != 0.0)
        .map(|at| (libm::log(at.angle.abs()), libm::log(at.pressure.abs())))
        .collect();
    let (x, y): (Vec<f64>, Vec<f64>) = points.iter().copied().unzip();
    if swing(&x) < libm::log(1.0 + APART) || points.len() < 2 {
        return None;
    }
    let (x_mean, y_mean) = (mean(&x), mean(&y));
    let squares: f64 = x.iter().map(|x| (x - x_mean).powi(2)).sum();
    let products: f64 = points
        .iter()
        .map(|(x, y)| (x - x_mean) * (y - y_mean))
        .sum();
    Some(products / squares)
}

/// Levels that differ, rest included: how many a person would count.
pub fn distinct(levels: &[Level]) -> usize {
    let mut angles: Vec<f64> = levels.iter().map(|level| level.angle).collect();
    angles.sort_by(f64::total_cmp);
    let apart = APART * angles.iter().fold(0.0, |most: f64, at| most.max(at.abs()));
    let steps = angles.windows(2).filter(|pair| pair[1] - pair[0] > apart);
    steps.count() + usize::from(!angles.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three levels held for two seconds each, reached exponentially, with the exponent 2.
    fn staircase() -> Recording {
        const RATIO: f64 = 30e3;
        let time: Vec<f64> = (0..600).map(|k| f64::from(k) * 0.01).collect();
        let mut angle = 0.0;
        let mut recording = Recording::default();
        for (k, target) in [0.3_f64, 0.6, 0.9].into_iter().enumerate() {
            for &t in &time[200 * k..200 * (k + 1)] {
                angle += 0.01 * (target - angle) / 0.15;
                recording.time.push(t);
                recording.pressure.push(RATIO * target * target);
                recording.angle.push(angle);
            }
        }
        recording
    }

    #[test]
    fn plateaus_give_exponent_and_ratio() {
        let levels = plateaus(&staircase());
        assert_eq!(distinct(&levels), 3, "{levels:?}");
        assert!((exponent(&levels).unwrap() - 2.0).abs() < 0.05);
        assert!((ratio(&levels, 2.0).unwrap() / 30e3 - 1.0).abs() < 0.03);
    }

    #[test]
    fn one_level_gives_a_ratio_and_no_exponent() {
        let level = Level {
            pressure: 20e3,
            angle: -0.5,
        };
        assert_eq!(exponent(&[level]), None);
        // Pressure straightens it.
        assert!((ratio(&[level], 1.0).unwrap() + 40e3).abs() < 1e-6);
        assert_eq!(ratio(&[], 1.0), None);
    }

    #[test]
    fn what_never_stands_still_has_no_plateaus() {
        let time: Vec<f64> = (0..500).map(|k| f64::from(k) * 0.01).collect();
        let recording = Recording {
            angle: time.iter().map(|t| (9.0 * t).sin()).collect(),
            pressure: time.iter().map(|t| 1e3 * (9.0 * t).cos()).collect(),
            time,
            ..Recording::default()
        };
        assert!(plateaus(&recording).is_empty());
        let resting = Recording {
            angle: vec![0.2; 500],
            ..recording
        };
        assert!(plateaus(&resting).is_empty());
    }
}
