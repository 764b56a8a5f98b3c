//! Angle, rate and acceleration from a noisy angle.
//!
//! A parabola through a window of samples is the least-squares estimate of the
//! motion at one instant (Savitzky and Golay, 1964). It gives initial states and is used
//! to show forces. Fits and verdicts never use derivatives of measured data.

use nalgebra::{Matrix3, Vector3};

use crate::statistics::noise;
use softrig_formats::recording::Recording;
use softrig_formats::removed::Channel;

/// The motion at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// The sample.
    pub place: usize,
    /// Angle (rad).
    pub angle: f64,
    /// Rate (rad/s).
    pub rate: f64,
    /// Acceleration (rad/s²).
    pub acceleration: f64,
}

/// The motion at sample `at`, from a parabola through the samples `from..to`.
/// `None` if they do not determine one.
pub fn motion(recording: &Recording, from: usize, to: usize, at: usize) -> Option<Motion> {
    let origin = *recording.time.get(at)?;
    let mut normal = Matrix3::<f64>::zeros();
    let mut right = Vector3::<f64>::zeros();
    for j in from..to.min(recording.len()) {
        let t = recording.time[j] - origin;
        let powers = Vector3::new(1.0, t, t * t);
        normal += powers * powers.transpose();
        right += powers * recording.angle[j];
    }
    let solved = normal.cholesky()?.solve(&right);
    Some(Motion {
        place: at,
        angle: solved[0],
        rate: solved[1],
        acceleration: 2.0 * solved[2],
    })
}

/// White noise of a channel, in its unit, from the samples that were measured.
pub fn noise_of(recording: &Recording, channel: Channel) -> f64 {
    let (time, values) = recording.measured(channel);
    noise(&time, &values)
}

/// The motion over a recording, half a window from one estimate to the next.
pub fn motions(recording: &Recording) -> impl Iterator<Item = Motion> {
    let half = half_window(recording);
    (half..recording.len().saturating_sub(half))
        .step_by(half)
        .filter_map(move |at| motion(recording, at - half, at + half + 1, at))
}

/// Half width of the window, in samples: 60 ms for clean signals, 200 ms where noise
/// dominates the acceleration.
pub fn half_window(recording: &Recording) -> usize {
    let swing = recording
        .angle
        .iter()
        .fold(0.0, |largest: f64, angle| largest.max(angle.abs()));
    let noisy = noise_of(recording, Channel::Angle) > 1e-3 * swing;
    let seconds = if noisy { 0.2 } else { 0.06 };
    let samples = (seconds / recording.interval()).round();
    // At most an eighth of the record.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let half = samples.clamp(2.0, (recording.len() as f64 / 8.0).max(2.0)) as usize;
    half
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parabola_is_exact_on_a_parabola() {
        let time: Vec<f64> = (0..20).map(|k| f64::from(k) * 0.05).collect();
        let angle = time.iter().map(|t| 0.3 - 2.0 * t + 4.0 * t * t).collect();
        let recording = Recording {
            time,
            angle,
            ..Recording::default()
        };
        let at = motion(&recording, 5, 15, 8).unwrap();
        let t = 0.4;
        assert!((at.angle - (0.3 - 2.0 * t + 4.0 * t * t)).abs() < 1e-10);
        assert!((at.rate - (-2.0 + 8.0 * t)).abs() < 1e-9);
        assert!((at.acceleration - 8.0).abs() < 1e-8);
        assert_eq!(motion(&recording, 5, 7, 5), None);
    }
}
