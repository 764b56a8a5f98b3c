//! Removes the noise of the measured pressure.
//!
//! A simulation is driven by the measured pressure, and the actuator filters its
//! noise. But an effect that depends on the *sign* of a flow or reversal rectifies the
//! noise: a vent that is faster than the pump settles below a noisy pressure, and a fit
//! takes the bias for a second effect.
//!
//! A pressure whose fast part is not white has no separable noise and is left unchanged.

use crate::statistics::{agreed_noise, median};
use softrig_formats::recording::Recording;

/// Half widths of the windows, in samples. A parabola goes through three samples
/// as they are, so windows begin with five.
const HALF_WIDTHS: [usize; 5] = [2, 4, 8, 16, 32];

/// Half the width of confidence intervals, in standard errors.
const CONFIDENCE: f64 = 2.5;

/// Half width (s) of the window over which the difference is added back.
const GIVEN_BACK: f64 = 0.16;

/// Noise counts as white if its typical size agrees with its RMS within this share.
const AGREEMENT: f64 = 0.2;

/// The pressure (Pa) of a recording without its white noise.
///
/// Each sample is replaced by the middle of a parabola through a window around it (Savitzky and
/// Golay, 1964). The window is as wide as the data allow: it grows until the confidence intervals
/// no longer intersect (Goldenshluger and Nemirovski, 1997). So plateaus are averaged over many
/// samples, and edges stay where they are.
///
/// Windows of different widths do not preserve the integral exactly, and an actuator integrates the
/// difference. So the slow part of the difference is added back: over a third of a second and
/// longer the pressure is as measured.
pub fn pressure(recording: &Recording) -> Vec<f64> {
    let values = &recording.pressure;
    let Some(noise) = white_noise(&recording.time, values) else {
        return values.clone();
    };
    let interval = recording.interval();
    let even: Vec<bool> = recording
        .time
        .windows(2)
        .map(|pair| pair[1] - pair[0] < 1.5 * interval)
        .collect();
    let levels: Vec<(f64, Vec<f64>)> = HALF_WIDTHS
        .iter()
        .map(|&half| (weight(half, 0.0).sqrt(), smoothed(values, &even, half)))
        .collect();
    let calm: Vec<f64> = values
        .iter()
        .enumerate()
        .map(|(at, &value)| {
            let wider = levels.iter().map(|(gain, level)| (level[at], noise * gain));
            widest_that_agrees(value, noise, wider)
        })
        .collect();
    let taken: Vec<f64> = values.iter().zip(&calm).map(|(a, b)| a - b).collect();
    let samples = (GIVEN_BACK / interval).round();
    // Clamped to the length of the recording.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let half = samples.clamp(HALF_WIDTHS[0] as f64, values.len() as f64) as usize;
    let given_back = smoothed(&taken, &even, half);
    calm.iter().zip(&given_back).map(|(a, b)| a + b).collect()
}

/// The last of several estimates with standard errors whose confidence intervals
/// all intersect, from the most local one on.
fn widest_that_agrees(local: f64, error: f64, wider: impl Iterator<Item = (f64, f64)>) -> f64 {
    let mut found = local;
    let (mut lowest, mut highest) = (local - CONFIDENCE * error, local + CONFIDENCE * error);
    for (estimate, error) in wider {
        lowest = lowest.max(estimate - CONFIDENCE * error);
        highest = highest.min(estimate + CONFIDENCE * error);
        if lowest > highest {
            break;
        }
        found = estimate;
    }
    found
}

/// The middles of parabolas through windows of `half` samples either side, narrower
/// near the ends and beside gaps.
fn smoothed(values: &[f64], even: &[bool], half: usize) -> Vec<f64> {
    (0..values.len())
        .map(|at| {
            let before = even[..at].iter().rev().take_while(|even| **even);
            let after = even[at..].iter().take_while(|even| **even);
            let half = before.take(half).count().min(after.take(half).count());
            if half < HALF_WIDTHS[0] {
                values[at]
            } else {
                values[at - half..=at + half]
                    .iter()
                    .enumerate()
                    .map(|(index, value)| weight(half, index as f64 - half as f64) * value)
                    .sum()
            }
        })
        .collect()
}

/// The standard deviation of a signal's noise, if it is white: differences of all
/// orders agree on it, and it is everywhere, not in a few edges.
fn white_noise(time: &[f64], values: &[f64]) -> Option<f64> {
    let low = agreed_noise(time, values)?;
    let typical = typical_noise(values);
    let agree = |other: f64| other <= (1.0 + AGREEMENT) * low && low <= (1.0 + AGREEMENT) * other;
    agree(typical).then_some(low)
}

/// Noise from the median of fourth differences, which a few edges do not move.
fn typical_noise(values: &[f64]) -> f64 {
    /// Root of the sum of squares of 1, −4, 6, −4, 1.
    const GAIN: f64 = 8.366_600_265_340_756;
    /// The standard deviation of a normal distribution over its median
    /// absolute value.
    const NORMAL: f64 = 1.482_6;
    let mut sizes: Vec<f64> = values
        .windows(5)
        .map(|w| (w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]).abs())
        .collect();
    NORMAL * median(&mut sizes) / GAIN
}

/// The weight of the sample `offset` away in the middle of the least-squares
/// parabola through `half` even samples either side. That of the sample itself
/// is the variance that is left of white noise.
fn weight(half: usize, offset: f64) -> f64 {
    let m = half as f64;
    let scale = (2.0 * m - 1.0) * (2.0 * m + 1.0) * (2.0 * m + 3.0);
    3.0 * (3.0 * m * m + 3.0 * m - 1.0 - 5.0 * offset * offset) / scale
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::{mean, rms};
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    const NOISE: f64 = 600.0;

    /// A pump's step: a ramp, rounded by a lag, at 100 Hz.
    fn step(noise: f64) -> (Recording, Vec<f64>) {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(5);
        let time: Vec<f64> = (0..800).map(|k| f64::from(k) * 0.01).collect();
        let mut lagged = 0.0;
        let clean: Vec<f64> = time
            .iter()
            .map(|t| {
                let ramp = (200e3 * (t - 1.0)).clamp(0.0, 60e3);
                lagged += (ramp - lagged) * 0.01 / 0.05;
                lagged
            })
            .collect();
        let pressure = clean
            .iter()
            .map(|p| {
                let draw: f64 = StandardNormal.sample(&mut random);
                p + noise * draw
            })
            .collect();
        let recording = Recording {
            angle: vec![0.0; time.len()],
            pressure,
            time,
            ..Recording::default()
        };
        (recording, clean)
    }

    fn error(found: &[f64], clean: &[f64], range: std::ops::Range<usize>) -> f64 {
        let differences: Vec<f64> = range.map(|k| found[k] - clean[k]).collect();
        rms(&differences)
    }

    #[test]
    fn plateaus_lose_their_noise_and_edges_stay() {
        let (recording, clean) = step(NOISE);
        let found = pressure(&recording);
        assert!(error(&found, &clean, 400..760) < 0.45 * NOISE);
        // Across the edge it is no worse than what was measured.
        assert!(error(&found, &clean, 95..140) < NOISE);
    }

    #[test]
    fn the_integral_is_kept() {
        let (recording, _) = step(NOISE);
        let taken: Vec<f64> = pressure(&recording)
            .iter()
            .zip(&recording.pressure)
            .map(|(a, b)| a - b)
            .collect();
        for second in taken.chunks_exact(100).skip(1).take(6) {
            // White noise would leave a tenth.
            assert!(mean(second).abs() < 0.04 * NOISE);
        }
    }

    #[test]
    fn a_signal_without_white_noise_is_left_alone() {
        let (clean, _) = step(0.0);
        assert!(pressure(&clean) == clean.pressure);
        // A band-limited excitation looks like noise and is the input.
        let fast = Recording {
            pressure: clean
                .time
                .iter()
                .map(|t| 1e3 * (150.0 * t).sin() + 1e3 * (97.0 * t).cos())
                .collect(),
            ..clean
        };
        assert!(pressure(&fast) == fast.pressure);
    }

    #[test]
    fn a_cubic_is_kept_as_it_is() {
        let values: Vec<f64> = (0..40).map(|k| f64::from(k * k * k - 9 * k * k)).collect();
        let found = smoothed(&values, &[true; 39], 8);
        let far = found.iter().zip(&values).map(|(a, b)| (a - b).abs());
        assert!(far.fold(0.0, f64::max) < 1e-8);
    }

    #[test]
    fn nothing_is_averaged_across_a_gap() {
        let (mut recording, mut clean) = step(NOISE);
        let shift = |values: &mut [f64], by: f64| values.iter_mut().for_each(|v| *v += by);
        shift(&mut recording.time[500..], 3.0);
        shift(&mut recording.pressure[500..], 3e3);
        shift(&mut clean[500..], 3e3);
        let found = pressure(&recording);
        assert!(error(&found, &clean, 490..510) < NOISE);
    }
}
