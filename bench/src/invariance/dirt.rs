//! What cables, sensors and loggers do to a recording.
//!
//! Each way makes time, pressure and angle of a recording dirty as benches do, by an amount that
//! people meet: one wild sample, three dropouts, a third of the rows. The answer should not mind.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::ways::Way;

/// Makes a recording dirty. Its number of rows decides where, so that the same recording is
/// always dirty in the same places.
pub fn soil(way: Way, recording: &mut Rows) {
    let count = recording.time.len();
    let mut random = Pcg64Mcg::seed_from_u64(count as u64);
    let late = |random: &mut Pcg64Mcg| random.random_range(count / 4..count);
    let middle = random.random_range(count / 3..2 * count / 3);
    let stretch = middle..(middle + (count / 40).max(3)).min(count);
    match way {
        Way::Spike => {
            let place = late(&mut random);
            recording.angle[place] = beyond(&recording.angle, 10.0);
        }
        Way::Sentinel => {
            let value = beyond(&recording.angle, 3.0);
            for angle in &mut recording.angle {
                if random.random_bool(0.002) {
                    *angle = value;
                }
            }
        }
        Way::Zeros => {
            for _ in 0..3 {
                recording.angle[late(&mut random)] = 0.0;
            }
        }
        Way::WildPressure => {
            let place = late(&mut random);
            recording.pressure[place] = beyond(&recording.pressure, 10.0);
        }
        Way::Dropped => {
            let kept = (0..count).filter(|&row| row == 0 || random.random_bool(0.7));
            recording.keep(&kept.collect::<Vec<_>>());
        }
        Way::Jitter => {
            let true_times = recording.time.clone();
            for (row, pair) in true_times.windows(2).enumerate() {
                let part = random.random_range(-0.3..0.3);
                recording.time[row + 1] += part * (pair[1] - pair[0]);
            }
        }
        Way::Bursts => {
            let true_times = recording.time.clone();
            for (row, time) in recording.time.iter_mut().enumerate() {
                let last = (row / 5 * 5 + 4).min(count - 1);
                *time = true_times[last] + 1e-4 * (row % 5) as f64;
            }
        }
        Way::Held => {
            for row in (1..count).step_by(2) {
                recording.pressure[row] = recording.pressure[row - 1];
                recording.angle[row] = recording.angle[row - 1];
            }
        }
        Way::Coarse => {
            round(&mut recording.pressure, 120.0);
            round(&mut recording.angle, 350.0);
        }
        Way::Offset => {
            let offset = 0.01 * span(&recording.pressure);
            for pressure in &mut recording.pressure {
                *pressure += offset;
            }
        }
        Way::Frozen => {
            let value = recording.angle[middle];
            recording.angle[stretch].fill(value);
        }
        Way::Gap => {
            let kept = (0..count).filter(|row| !stretch.contains(row));
            recording.keep(&kept.collect::<Vec<_>>());
        }
        Way::Twice => {
            let mut rows: Vec<usize> = (0..count).collect();
            rows.extend((0..(count / 100).max(1)).map(|_| random.random_range(0..count)));
            rows.sort_unstable();
            recording.keep(&rows);
        }
        Way::Restart => {
            let half = count / 2;
            let again = recording.time[half];
            for time in &mut recording.time[half..] {
                *time -= again;
            }
        }
        // The others leave a recording clean.
        _ => {}
    }
}

/// Columns of a recording, and the row of the clean one that each is of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rows {
    /// Rows of the clean recording.
    pub of: Vec<usize>,
    /// Time (s).
    pub time: Vec<f64>,
    /// Pressure (kPa).
    pub pressure: Vec<f64>,
    /// Angle (°).
    pub angle: Vec<f64>,
}

impl Rows {
    /// Time, pressure and angle of a clean recording.
    pub fn new([time, pressure, angle]: [Vec<f64>; 3]) -> Self {
        Self {
            of: (0..time.len()).collect(),
            time,
            pressure,
            angle,
        }
    }

    fn keep(&mut self, rows: &[usize]) {
        let pick = |values: &[f64]| rows.iter().map(|&row| values[row]).collect();
        *self = Self {
            of: rows.iter().map(|&row| self.of[row]).collect(),
            time: pick(&self.time),
            pressure: pick(&self.pressure),
            angle: pick(&self.angle),
        };
    }
}

/// The range of nearly all values.
fn span(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let aside = sorted.len() / 200;
    sorted[sorted.len() - 1 - aside] - sorted[aside]
}

/// A value above the largest by so many ranges.
fn beyond(values: &[f64], ranges: f64) -> f64 {
    let largest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    largest + ranges * span(values)
}

/// Rounds values to so many steps of their range.
fn round(values: &mut [f64], steps: f64) {
    let step = span(values).max(1e-9) / steps;
    for value in values {
        *value = (*value / step).round() * step;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clean() -> Rows {
        let time: Vec<f64> = (0..1_000).map(|row| f64::from(row) * 0.01).collect();
        let pressure = time.iter().map(|t| 40.0 + 40.0 * (3.0 * t).sin()).collect();
        let angle = time.iter().map(|t| 30.0 + 20.0 * (3.0 * t).cos()).collect();
        Rows::new([time, pressure, angle])
    }

    /// Every way does something, and only what it says.
    #[test]
    fn dirt_is_where_it_belongs() {
        for way in Way::DIRTY {
            let mut dirty = clean();
            soil(way, &mut dirty);
            assert_ne!(dirty, clean(), "{way:?}");
            let mut again = clean();
            soil(way, &mut again);
            assert_eq!(dirty, again, "{way:?} is not the same twice");
            let differ = |(a, b): &(&f64, &f64)| a.total_cmp(b).is_ne();
            let changed = |a: &[f64], b: &[f64]| a.iter().zip(b).filter(differ).count();
            let (time, pressure, angle) = (
                changed(&dirty.time, &clean().time),
                changed(&dirty.pressure, &clean().pressure),
                changed(&dirty.angle, &clean().angle),
            );
            match way {
                Way::Spike => assert_eq!((time, pressure, angle), (0, 0, 1)),
                Way::Zeros => assert!((time, pressure) == (0, 0) && angle <= 3),
                Way::WildPressure => assert_eq!((time, pressure, angle), (0, 1, 0)),
                Way::Offset => assert_eq!((time, angle), (0, 0)),
                Way::Jitter | Way::Bursts | Way::Restart => {
                    assert_eq!((pressure, angle), (0, 0));
                }
                Way::Dropped => assert!((600..800).contains(&dirty.time.len())),
                Way::Gap => assert_eq!(dirty.time.len(), 975),
                Way::Twice => assert_eq!(dirty.time.len(), 1_010),
                _ => assert_eq!(time, 0),
            }
        }
    }
}
