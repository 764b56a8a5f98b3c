//! The board's clock against the computer's.

use crate::Received;
use crate::rig_file::ClockRate;

/// Parts of the watch; the quickest line of each counts.
const PARTS: usize = 24;

/// Shortest watch (s) that says something.
const SHORTEST_S: f64 = 3.0;

/// Seconds of the computer in one of the board's, by a straight line through the lines that
/// arrived soonest.
///
/// A line can be late on its way and never early, so of each part of the watch only the one with
/// the least delay counts: what USB and a busy computer add then is nearly constant, and drops out
/// of the slope. The error is that of the line through these points, and at least a millisecond,
/// the resolution of the board's time stamps, over the watch.
///
/// Nothing where the watch is too short or the board restarted within it.
pub fn rate(samples: &[Received]) -> Option<ClockRate> {
    let first = samples.first()?;
    if samples.iter().skip(1).any(|it| it.restarted) {
        return None;
    }
    let points: Vec<(f64, f64)> = samples
        .iter()
        .map(|it| {
            let board = it.sample.time_ms.wrapping_sub(first.sample.time_ms);
            let ours = it.arrived.saturating_duration_since(first.arrived);
            (f64::from(board) / 1000.0, ours.as_secs_f64())
        })
        .collect();
    let seconds = points.last()?.0;
    if seconds < SHORTEST_S {
        return None;
    }
    let part = points.len().div_ceil(PARTS);
    let soonest: Vec<(f64, f64)> = points
        .chunks(part)
        .filter_map(|part| {
            let delay = |point: &&(f64, f64)| point.1 - point.0;
            part.iter().min_by(|a, b| delay(a).total_cmp(&delay(b)))
        })
        .map(|&(board, ours)| (board, ours - board))
        .collect();
    let count = soonest.len() as f64;
    let mean = |pick: fn(&(f64, f64)) -> f64| soonest.iter().map(pick).sum::<f64>() / count;
    let (x, y) = (mean(|it| it.0), mean(|it| it.1));
    let spread: f64 = soonest.iter().map(|it| (it.0 - x).powi(2)).sum();
    let slope = soonest
        .iter()
        .map(|it| (it.0 - x) * (it.1 - y))
        .sum::<f64>()
        / spread;
    let left: f64 = soonest
        .iter()
        .map(|it| (it.1 - y - slope * (it.0 - x)).powi(2))
        .sum();
    let of_line = (left / (count - 2.0).max(1.0) / spread).sqrt();
    Some(ClockRate {
        factor: 1.0 + slope,
        standard_error: of_line.max(1e-3 / seconds / 12.0_f64.sqrt()),
        seconds,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commission::lines::tests::sample;
    use std::time::{Duration, Instant};

    /// A minute of a board whose second takes `factor`, each line late by up to 16 ms.
    fn minute(factor: f64) -> Vec<Received> {
        let start = Instant::now();
        let mut random = 1_u32;
        (0..6_000_u32)
            .map(|index| {
                random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let late = f64::from(random >> 8) / f64::from(1 << 24) * 0.016;
                let ours = f64::from(index) * 0.01 * factor + late;
                Received {
                    arrived: start + Duration::from_secs_f64(ours),
                    ..sample(index)
                }
            })
            .collect()
    }

    #[test]
    fn a_resonators_error_is_found_through_the_delays_of_usb() {
        for factor in [0.995, 1.0, 1.0043] {
            let rate = rate(&minute(factor)).unwrap();
            assert!((rate.factor - factor).abs() < 5e-5, "{rate:?}");
            assert!((rate.factor - factor).abs() < 5.0 * rate.standard_error);
            assert!(rate.standard_error < 1e-4, "{rate:?}");
        }
    }

    #[test]
    fn a_restart_and_a_short_watch_say_nothing() {
        let mut samples = minute(1.0);
        assert_eq!(rate(&samples[..200]), None);
        samples[3_000].restarted = true;
        assert_eq!(rate(&samples), None);
    }
}
