//! Initial guesses for the fit of a first model.
//!
//! They come from two sources. The first is a regression of the acceleration on rate,
//! stiffness and pressure, all from parabolas through a window of samples. It works if the
//! recording is clean and the window suits the motion, so many windows are tried. The second,
//! for noisy recordings, is a grid of natural frequencies and damping ratios, with the
//! stiffness from the static relation. The score test of
//! [`Fitter::predicted_sse`](crate::estimate::fit::Fitter::predicted_sse) ranks all guesses.

use std::f64::consts::TAU;

use model_core::actuator::Model;
use model_core::dynamics::Dynamics;
use nalgebra::{Matrix4, Vector4};

use super::statics::{self, Level, signed_power};
use crate::estimate::Dataset;
use crate::estimate::smooth::motion;
use crate::io::recording::Recording;

/// Motions of a recording that are enough for a regression.
const MOTIONS: usize = 1_500;

/// Natural frequencies of the grid.
const FREQUENCIES: i32 = 10;

/// Damping ratios of the grid: a swing, the paper's actuator, a syrup.
const RATIOS: [f64; 3] = [0.15, 0.7, 3.0];

/// Samples a period that the fastest motion of the grid has.
const SAMPLES_A_PERIOD: f64 = 8.0;

/// A model of unit inertia: only ratios to it move anything.
pub fn unit(damping: f64, stiffness: f64, exponent: f64, input_gain: f64) -> Option<Model<f64>> {
    let dynamics = Dynamics {
        inertia: 1.0,
        damping,
        stiffness,
        exponent,
        input_gain,
    };
    Model::new(dynamics, &[]).ok()
}

/// Starts with an exponent.
pub fn of(data: &Dataset, levels: &[Level], exponent: f64) -> Vec<Model<f64>> {
    let recordings = data.recordings(true);
    let mut starts = Vec::new();
    let interval = shortest_interval(data);
    let longest = recordings
        .iter()
        .map(Recording::duration)
        .fold(0.0, f64::max);
    let mut half = 2;
    while (half as f64) * interval * 8.0 <= longest && half <= 128 {
        starts.extend(regression(&recordings, exponent, half));
        half *= 2;
    }
    starts.extend(grid(&recordings, levels, exponent, interval, longest));
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
fn regression(recordings: &[Recording], exponent: f64, half: usize) -> Option<Model<f64>> {
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
    unit(damping, stiffness, exponent, solved[2])
}

/// Natural frequencies at the recorded angles and damping ratios, with the input gain that
/// the static relation asks for.
fn grid(
    recordings: &[Recording],
    levels: &[Level],
    exponent: f64,
    interval: f64,
    longest: f64,
) -> Vec<Model<f64>> {
    let (slowest, fastest) = (TAU / longest, TAU / (SAMPLES_A_PERIOD * interval));
    let angles: Vec<f64> = recordings
        .iter()
        .flat_map(|recording| recording.angle.iter().copied())
        .collect();
    let typical = crate::statistics::rms(&angles);
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
    let mut starts = Vec::new();
    for step in 0..FREQUENCIES {
        let share = f64::from(step) / f64::from(FREQUENCIES - 1);
        let frequency = slowest * (fastest / slowest).powf(share);
        let stiffness = frequency * frequency / (exponent * typical.powf(exponent - 1.0));
        let gain = ratio.map_or(0.0, |ratio| stiffness / ratio);
        let damped = RATIOS
            .iter()
            .filter_map(|zeta| unit(2.0 * zeta * frequency, stiffness, exponent, gain));
        starts.extend(damped);
    }
    starts
}
