//! Starts of an identification, from the recordings alone.
//!
//! They come from three sources. The first is a regression of the acceleration on rate,
//! stiffness and pressure, all from parabolas through a window of samples. It works if the
//! recording is clean and the window suits the motion, so many windows are tried. The second,
//! for noisy recordings, is a grid of natural frequencies and damping ratios, with the gain
//! from the static relation; it ends with systems of first order. The third, for free swings
//! of hardly any damping, is the spectrum of the angle: a fit finds a long oscillation only
//! from near its frequency.

use std::f64::consts::TAU;

use model_core::dynamics::Dynamics;
use nalgebra::{Matrix4, Vector4};
use rayon::prelude::*;

use super::statics::{self, Level, signed_power};
use crate::estimate::Dataset;
use crate::estimate::smooth::motion;
use softrig_formats::recording::Recording;

/// Motions of a recording that are enough for a regression.
const MOTIONS: usize = 1_500;

/// Natural frequencies of the grid.
const FREQUENCIES: i32 = 13;

/// Damping ratios of the grid: a swing, the paper's actuator, a syrup, honey.
const RATIOS: [f64; 4] = [0.1, 0.7, 3.0, 12.0];

/// Damping ratios of a free swing.
const RATIOS_OF_LINES: [f64; 3] = [0.003, 0.02, 0.15];

/// Time constants of the systems of first order.
const TIME_CONSTANTS: i32 = 9;

/// Samples a period that the fastest motion of the grid has.
const SAMPLES_A_PERIOD: f64 = 4.0;

/// The slowest motion of the grid, in recordings.
const SLOWEST: f64 = 10.0;

/// The fastest time constant of the grid, in intervals between samples.
const FASTEST: f64 = 0.2;

/// Lines of the spectrum.
const LINES: usize = 3;

/// Frequencies of the spectrum for each that the longest recording resolves.
const FINER: f64 = 4.0;

/// Starts beside a line, in steps of the spectrum: a swing that slows down as it grows has
/// its line where it is smallest.
const BESIDE_LINES: [f64; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];

/// Dynamics of unit inertia: only ratios to it move anything.
pub const fn unit(damping: f64, stiffness: f64, exponent: f64, input_gain: f64) -> Dynamics<f64> {
    Dynamics {
        inertia: 1.0,
        damping,
        stiffness,
        exponent,
        input_gain,
    }
}

/// Starts with an exponent, of unit inertia.
pub fn of(
    data: &Dataset,
    recordings: &[Recording],
    levels: &[Level],
    exponent: f64,
) -> Vec<Dynamics<f64>> {
    let mut starts = Vec::new();
    let interval = shortest_interval(data);
    let longest = recordings
        .iter()
        .map(Recording::duration)
        .fold(0.0, f64::max);
    let mut half = 2;
    while (half as f64) * interval * 8.0 <= longest && half <= 128 {
        starts.extend(regression(recordings, exponent, half));
        half *= 2;
    }
    starts.extend(grid(recordings, levels, exponent, interval, longest));
    starts
}

fn shortest_interval(data: &Dataset) -> f64 {
    data.sessions()
        .iter()
        .map(|session| session.interval())
        .fold(f64::INFINITY, f64::min)
}

/// θ̈ = −C θ̇ − K sign(θ)|θ|ⁿ + g p + d by least squares, M = 1, over windows of `half`
/// samples on each side.
fn regression(recordings: &[Recording], exponent: f64, half: usize) -> Option<Dynamics<f64>> {
    let mut rows: Vec<(Vector4<f64>, f64)> = Vec::new();
    for recording in recordings {
        let count = recording.len().saturating_sub(2 * half);
        let stride = half.max(count.div_ceil(MOTIONS)).max(1);
        for at in (half..recording.len().saturating_sub(half)).step_by(stride) {
            let (from, to) = (at - half, at + half + 1);
            let Some(found) = motion(recording, from, to, at) else {
                continue;
            };
            let pressure = crate::statistics::mean(&recording.pressure[from..to]);
            let row = Vector4::new(
                -found.rate,
                -signed_power(found.angle, exponent),
                pressure,
                1.0,
            );
            rows.push((row, found.acceleration));
        }
    }
    // Columns of one size: the pressure is in pascals.
    let mut scale = Vector4::<f64>::zeros();
    for (row, _) in &rows {
        scale += row.component_mul(row);
    }
    let scale = scale.map(|sum| if sum > 0.0 { sum.sqrt() } else { 1.0 });
    let mut normal = Matrix4::<f64>::zeros();
    let mut right = Vector4::<f64>::zeros();
    for (row, acceleration) in &rows {
        let row = row.component_div(&scale);
        normal += row * row.transpose();
        right += row * *acceleration;
    }
    // A column that says nothing beside the others gets nothing.
    for k in 0..4 {
        normal[(k, k)] += 1e-9;
    }
    let solved = normal.cholesky()?.solve(&right).component_div(&scale);
    // A slope of the wrong sign is noise, or a force that is missing: begin beside zero.
    let swing = rows.iter().map(|(_, a)| a.abs()).fold(0.0, f64::max);
    let reach = rows
        .iter()
        .map(|(row, _)| row[1].abs())
        .fold(1e-9, f64::max);
    let stiffness = solved[1].max(0.01 * swing / reach);
    let damping = solved[0].max(0.05 * stiffness.sqrt());
    Some(unit(damping, stiffness, exponent, solved[2]))
}

/// Natural frequencies at the recorded angles and damping ratios, and time constants, with
/// the input gain that the static relation asks for.
fn grid(
    recordings: &[Recording],
    levels: &[Level],
    exponent: f64,
    interval: f64,
    longest: f64,
) -> Vec<Dynamics<f64>> {
    let angles: Vec<f64> = recordings
        .iter()
        .flat_map(|recording| recording.angle.iter().copied())
        .collect();
    let typical = crate::statistics::rms(&angles);
    let (slowest, fastest) = (
        TAU / (SLOWEST * longest),
        TAU / (SAMPLES_A_PERIOD * interval),
    );
    if fastest.is_nan() || fastest <= slowest || typical <= 0.0 {
        return Vec::new();
    }
    // Without a plateau every sample has a say: right in sign where the motion is slow.
    let ratio = statics::ratio(levels, exponent).or_else(|| {
        let samples = recordings.iter().flat_map(|recording| {
            let pairs = recording.pressure.iter().zip(&recording.angle);
            pairs.map(|(&pressure, &angle)| Level { pressure, angle })
        });
        statics::ratio(&samples.collect::<Vec<_>>(), exponent)
    });
    let start = |damping: f64, slope: f64| {
        let stiffness = slope / (exponent * libm::pow(typical, exponent - 1.0));
        let gain = ratio.map_or(0.0, |ratio| stiffness / ratio);
        unit(damping, stiffness, exponent, gain)
    };
    let swing = |frequency: f64, ratio: f64| start(2.0 * ratio * frequency, frequency * frequency);
    let mut starts = Vec::new();
    for frequency in spaced(slowest, fastest, FREQUENCIES) {
        starts.extend(RATIOS.map(|ratio| swing(frequency, ratio)));
    }
    let resolution = TAU / (FINER * longest);
    for line in lines(recordings, resolution, fastest) {
        for offset in BESIDE_LINES {
            let frequency = line + offset * resolution;
            starts.extend(RATIOS_OF_LINES.map(|ratio| swing(frequency, ratio)));
        }
    }
    // The inertia's time constant is one interval.
    let damping = 1.0 / interval;
    let constants = spaced(FASTEST * interval, SLOWEST * longest, TIME_CONSTANTS);
    starts.extend(constants.map(|constant| start(damping, damping / constant)));
    starts
}

/// Numbers at even distances on a logarithmic scale.
fn spaced(from: f64, to: f64, count: i32) -> impl Iterator<Item = f64> {
    (0..count).map(move |step| {
        let share = f64::from(step) / f64::from(count - 1);
        from * libm::pow(to / from, share)
    })
}

/// The strongest lines (rad/s) in the spectra of the angles about their means, every `step`
/// up to `fastest`.
fn lines(recordings: &[Recording], step: f64, fastest: f64) -> Vec<f64> {
    /// Most frequencies.
    const MOST: f64 = 2_000.0;
    /// Most samples of a recording.
    const SAMPLES: usize = 2_000;
    /// Least distance of two lines, as a share of either.
    const APART: f64 = 0.1;
    // At most some thousand.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let count = (fastest / step).min(MOST) as usize;
    let power: Vec<f64> = (1..=count)
        .into_par_iter()
        .map(|k| {
            let frequency = step * k as f64;
            recordings
                .iter()
                .map(|recording| power_at(recording, frequency, SAMPLES))
                .sum()
        })
        .collect();
    let mut peaks: Vec<usize> = (1..count.saturating_sub(1))
        .filter(|&k| power[k] > power[k - 1] && power[k] > power[k + 1])
        .collect();
    peaks.sort_by(|a, b| power[*b].total_cmp(&power[*a]));
    let mut found: Vec<f64> = Vec::new();
    for k in peaks {
        let frequency = step * (k + 1) as f64;
        let is_new = |other: &f64| libm::log(frequency / other).abs() > APART;
        if found.len() < LINES && found.iter().all(is_new) {
            found.push(frequency);
        }
    }
    found
}

/// The power of a recording's angle about its mean at a frequency (rad/s).
fn power_at(recording: &Recording, frequency: f64, most: usize) -> f64 {
    let mean = crate::statistics::mean(&recording.angle);
    let stride = recording.len().div_ceil(most).max(1);
    let samples = recording.time.iter().zip(&recording.angle).step_by(stride);
    let (re, im) = samples.fold((0.0, 0.0), |(re, im), (time, angle)| {
        let (sin, cos) = libm::sincos(frequency * time);
        (re + (angle - mean) * cos, im + (angle - mean) * sin)
    });
    re * re + im * im
}
