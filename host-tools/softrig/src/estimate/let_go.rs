//! Recognises that a hand moved the actuator, and when it let go.
//!
//! A passive actuator that rests under a constant pressure goes on resting. Where the angle
//! leaves such a rest, something acted that is not recorded: a hand that lifts a pendulum, a
//! valve without a sensor. No model follows that, and the effect that comes nearest would be
//! named for it. What can be used begins when the hand lets go. Creep is something else: it
//! is fastest at first, and no rest precedes it.

use crate::statistics::{mean, noise, swing};
use softrig_formats::recording::Recording;

/// Shortest rest without pressure (s), and in samples.
const REST_S: f64 = 0.5;
const REST_SAMPLES: usize = 20;

/// Shortest rest under a pressure (s): the longest dead time of the catalogue. Until then
/// the motion may be late.
const LATE_S: f64 = 5.0;

/// A pressure below this share of the largest is none.
const NO_PRESSURE: f64 = 0.05;

/// A pressure stays if it changes by no more than this share of the largest, beside its noise.
const STAYS: f64 = 0.001;

/// Departure that counts, as a share of the swing of the recording.
const LEAVES: f64 = 0.1;

/// An angle within this share of the farthest is still held there.
const HELD: f64 = 0.98;

/// Least share of what follows the rest that follows the release as well: a hand that holds
/// to the end never lets go.
const FOLLOWS: f64 = 1.0 / 3.0;

/// A rest that a hand ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HandRelease {
    /// The first sample after the rest.
    pub taken: usize,
    /// The first sample after the release.
    pub released: usize,
}

/// Finds whether a recording begins with a rest that is left although the pressure stays.
pub fn handled(recording: &Recording) -> Option<HandRelease> {
    let Recording {
        time,
        pressure,
        angle,
        ..
    } = recording;
    let first = *angle.first()?;
    let swing_of_angle = swing(angle);
    let still = (5.0 * noise(time, angle)).max(0.002 * swing_of_angle);
    let taken = angle.iter().position(|a| (a - first).abs() > still)?;
    if taken < REST_SAMPLES {
        return None;
    }
    // A pressure that moves the actuator changes a little before the angle does.
    let at_rest = &pressure[..taken - taken / 5];
    let mean = mean(at_rest);
    let largest_pressure = pressure.iter().fold(0.0, |most: f64, p| most.max(p.abs()));
    let is_driven = mean.abs() > NO_PRESSURE * largest_pressure;
    if time[taken] - time[0] < if is_driven { LATE_S } else { REST_S } {
        return None;
    }
    let still_pressure = 6.0 * noise(&time[..at_rest.len()], at_rest) + STAYS * largest_pressure;
    let stays = |p: &f64| (p - mean).abs() <= still_pressure;
    // One that changed before and moved nothing may be what moves it now.
    if !at_rest.iter().all(stays) {
        return None;
    }
    let steady = pressure.iter().take_while(|p| stays(p)).count();
    let departs = |k: usize| (angle[k] - first).abs();
    let farthest = (taken..steady).map(departs).fold(0.0, f64::max);
    if farthest < LEAVES * swing_of_angle {
        return None;
    }
    let is_held = |k: &usize| departs(*k) >= HELD * farthest;
    let peak = (taken..steady).find(is_held)?;
    let after = (peak..steady).take_while(is_held).last()? + 1;
    let enough = FOLLOWS * (steady - taken) as f64;
    let released = if (steady - after) as f64 >= enough {
        after
    } else {
        taken
    };
    Some(HandRelease { taken, released })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A recording at 50 Hz of the angle and the pressure over time.
    fn recording(angle: impl Fn(f64) -> f64, pressure: impl Fn(f64) -> f64) -> Recording {
        let time: Vec<f64> = (0..1_000).map(|k| 0.02 * f64::from(k)).collect();
        let sensor = |k: usize| 1e-4 * (7.0 * k as f64).sin();
        Recording {
            angle: time
                .iter()
                .enumerate()
                .map(|(k, &t)| angle(t) + sensor(k))
                .collect(),
            pressure: time.iter().map(|&t| pressure(t)).collect(),
            time,
            ..Recording::default()
        }
    }

    /// Rests for 3 s, is lifted to 1 rad within 1 s, held for 1 s and let go.
    fn lifted(t: f64) -> f64 {
        match t {
            ..3.0 => 0.0,
            3.0..4.0 => t - 3.0,
            4.0..5.0 => 1.0,
            _ => (-0.2 * (t - 5.0)).exp() * (5.0 * (t - 5.0)).cos(),
        }
    }

    #[test]
    fn a_pendulum_swings_from_where_it_is_let_go() {
        let found = handled(&recording(lifted, |_| 0.0)).unwrap();
        let seconds = |sample: usize| 0.02 * sample as f64;
        assert!((seconds(found.taken) - 3.0).abs() < 0.1, "{found:?}");
        assert!((seconds(found.released) - 5.0).abs() < 0.2, "{found:?}");
    }

    #[test]
    fn what_the_pressure_moves_is_not_handled() {
        let step = |t: f64| if t < 3.0 { 0.0 } else { 3e4 };
        assert_eq!(handled(&recording(lifted, step)), None);
        // Under pressure from the start, it may be late.
        assert_eq!(handled(&recording(lifted, |_| 3e4)), None);
        let late = handled(&recording(|t| lifted(t - 5.0), |_| 3e4));
        assert!(late.is_some());
        // A pressure that friction held up to here.
        let stairs = |t: f64| 1e4 * t.floor();
        assert_eq!(handled(&recording(lifted, stairs)), None);
    }

    #[test]
    fn creep_and_rest_are_not_handled() {
        let creep = |t: f64| 0.5 * (1.0 - (-0.3 * t).exp());
        assert_eq!(handled(&recording(creep, |_| 0.0)), None);
        assert_eq!(handled(&recording(|_| 0.3, |_| 0.0)), None);
    }

    #[test]
    fn what_runs_away_begins_where_it_was_at_rest() {
        let runs = |t: f64| if t < 3.0 { 0.0 } else { 1.0 - (3.0 - t).exp() };
        let found = handled(&recording(runs, |_| 0.0)).unwrap();
        assert_eq!(found.taken, found.released);
    }
}
