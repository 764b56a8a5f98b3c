//! What reaches the file: sensors whose zeros are off, converters, an angle that
//! is cut off, a clock that jitters.

use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};
use softrig_formats::recording::Recording;

use super::super::sensors::PRESSURE_COUNT;
use super::super::world::Line;

/// Share of the angle's range that is left where the sensor is cut off.
pub const LEFT_OF_RANGE: f64 = 0.99;
/// Standard deviation of the pressure's zero (Pa).
const PRESSURE_ZERO: f64 = 300.0;
/// The most that the pressure's zero is off (Pa).
const MOST_PRESSURE_ZERO: f64 = 700.0;
/// The most that the angle's zero is off (°).
const MOST_ANGLE_ZERO: f64 = 1.5;
/// Share of the cases whose angle is cut off.
const CUT_OFF: f64 = 0.3;
/// Shortest interval between samples, over the usual one.
const SHORTEST: f64 = 0.3;

/// The instruments of a case.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Instruments {
    /// Samples per second.
    pub rate_hz: f64,
    /// Standard deviation of an interval over the usual one.
    pub jitter: f64,
    /// RMS of the angle's white noise (rad).
    pub angle_noise: f64,
    /// Angle of one count (rad).
    pub angle_count: f64,
    /// What the angle sensor shows at zero (rad).
    pub angle_zero: f64,
    /// Whether the top of the angle's range is cut off.
    pub cut_off: bool,
    /// RMS of the white noise of one conversion of the pressure (Pa).
    pub pressure_noise: f64,
    /// Conversions of the pressure that are averaged.
    pub averaged: u32,
    /// What the pressure sensor shows at zero (Pa).
    pub pressure_zero: f64,
}

/// What perfect sensors would have shown over one drive.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a> {
    /// Pressure in the line.
    pub line: &'a Line,
    /// Angle (rad).
    pub reading: &'a [f64],
    /// Samples of it a second.
    pub rate_hz: f64,
}

impl Instruments {
    /// Draws instruments.
    pub fn draw(random: &mut Pcg64Mcg) -> Self {
        let pressure_zero = loop {
            let normal: f64 = StandardNormal.sample(random);
            let zero = PRESSURE_ZERO * normal;
            if zero.abs() <= MOST_PRESSURE_ZERO {
                break zero;
            }
        };
        Self {
            rate_hz: *[50.0, 80.0, 100.0, 125.0, 160.0, 200.0]
                .choose(random)
                .unwrap_or(&100.0),
            jitter: random.random_range(0.03..0.15),
            angle_noise: random.random_range(0.1f64..0.5).to_radians(),
            angle_count: [0.05f64, 0.1, 0.26]
                .choose(random)
                .unwrap_or(&0.1)
                .to_radians(),
            angle_zero: random
                .random_range(-MOST_ANGLE_ZERO..MOST_ANGLE_ZERO)
                .to_radians(),
            cut_off: random.random_bool(CUT_OFF),
            pressure_noise: random.random_range(150.0..600.0),
            averaged: *[4, 8, 16].choose(random).unwrap_or(&8),
            pressure_zero,
        }
    }

    /// RMS of everything random that the angle's sensor adds (rad).
    pub fn angle_floor(&self) -> f64 {
        self.angle_noise.hypot(self.angle_count / 12f64.sqrt())
    }

    /// The largest angle (rad) that the sensor shows, if it is cut off: so much of
    /// the range of the readings is left.
    pub fn limit<'a>(&self, readings: impl IntoIterator<Item = &'a Vec<f64>>) -> Option<f64> {
        let (low, high) = readings
            .into_iter()
            .flatten()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), angle| {
                (angle.min(low), angle.max(high))
            });
        let limit = low + LEFT_OF_RANGE * (high - low) + self.angle_zero;
        let whole = (limit / self.angle_count).floor() * self.angle_count;
        self.cut_off.then_some(whole)
    }

    /// Times of samples (s) from 0 to the last one within `seconds`: what the
    /// clock truly did, as it is recorded.
    pub fn times(&self, seconds: f64, random: &mut Pcg64Mcg) -> Vec<f64> {
        let mut now = 0.0;
        let mut times = Vec::new();
        while now <= seconds {
            times.push(now);
            let normal: f64 = StandardNormal.sample(random);
            let interval = (1.0 + self.jitter * normal).max(SHORTEST) / self.rate_hz;
            // Files hold microseconds.
            now = ((now + interval) * 1e6).round() / 1e6;
        }
        times
    }

    /// What is recorded of a drive.
    pub fn record(
        &self,
        shown: &Shown<'_>,
        limit: Option<f64>,
        random: &mut Pcg64Mcg,
    ) -> Recording {
        let last = shown.reading.len() - 1;
        let time = self.times(last as f64 / shown.rate_hz, random);
        let mut noisy = |value: f64, noise: f64, count: f64| {
            let normal: f64 = StandardNormal.sample(random);
            ((value + noise * normal) / count).round() * count
        };
        let mut samples = Recording::default();
        for &time in &time {
            let position = time * shown.rate_hz;
            // Not negative, and within the readings.
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let k = (position.floor() as usize).min(last);
            let (before, after) = (shown.reading[k], shown.reading[(k + 1).min(last)]);
            let reading = before + (position - k as f64) * (after - before) + self.angle_zero;
            let angle = noisy(reading, self.angle_noise, self.angle_count);
            let sum: f64 = (0..self.averaged)
                .map(|_| {
                    let pressure = shown.line.at(time) + self.pressure_zero;
                    noisy(pressure, self.pressure_noise, PRESSURE_COUNT)
                })
                .sum();
            samples
                .angle
                .push(limit.map_or(angle, |limit| angle.min(limit)));
            samples.pressure.push(sum / f64::from(self.averaged));
        }
        samples.time = time;
        samples
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    fn random() -> Pcg64Mcg {
        Pcg64Mcg::seed_from_u64(5)
    }

    fn drawn() -> Instruments {
        Instruments::draw(&mut random())
    }

    #[test]
    fn the_clock_jitters_as_stated_and_never_stands_still() {
        for jitter in [0.03, 0.15] {
            let instruments = Instruments {
                jitter,
                rate_hz: 125.0,
                ..drawn()
            };
            let times = instruments.times(160.0, &mut random());
            let steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
            assert!(steps.iter().all(|step| *step > 0.0));
            let count = steps.len() as f64;
            let mean = steps.iter().sum::<f64>() / count;
            let square = steps.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / count;
            assert!((mean * 125.0 - 1.0).abs() < 0.005, "{mean}");
            assert!((square.sqrt() / mean / jitter - 1.0).abs() < 0.03);
        }
    }

    #[test]
    fn zeros_stay_within_their_limits() {
        let mut random = random();
        let zeros: Vec<f64> = (0..3000)
            .map(|_| Instruments::draw(&mut random).pressure_zero)
            .collect();
        assert!(zeros.iter().all(|zero| zero.abs() <= 700.0));
        let square = zeros.iter().map(|z| z * z).sum::<f64>() / 3000.0;
        // Cut at 2.33 standard deviations, 0.94 of one is left.
        assert!((square.sqrt() / 300.0 - 0.94).abs() < 0.03, "{square}");
    }

    #[test]
    fn only_the_top_hundredth_of_the_range_is_cut_off() {
        let instruments = Instruments {
            cut_off: true,
            angle_noise: 1e-4,
            angle_count: 1e-4,
            angle_zero: 0.02,
            ..drawn()
        };
        // A ramp from 0 to 1 spends a hundredth of its time there.
        let reading: Vec<f64> = (0..=20_000).map(|k| f64::from(k) / 20_000.0).collect();
        let line = Line::new(200.0, vec![0.0; 2]);
        let shown = Shown {
            line: &line,
            reading: &reading,
            rate_hz: 100.0,
        };
        let limit = instruments.limit([&reading]);
        let samples = instruments.record(&shown, limit, &mut random());
        let limit = limit.unwrap();
        assert!((limit - 1.01).abs() < 2e-4, "{limit}");
        let at_limit = samples.angle.iter().filter(|&&a| a >= limit - 1e-9).count();
        let share = at_limit as f64 / samples.angle.len() as f64;
        assert!((share - 0.01).abs() < 0.001, "{share}");
        assert!(samples.angle.iter().all(|angle| *angle <= limit + 1e-9));
    }

    #[test]
    fn noise_counts_and_zeros_are_as_stated() {
        let instruments = Instruments {
            cut_off: false,
            ..drawn()
        };
        let reading = vec![0.7; 20_001];
        let line = Line::new(200.0, vec![40e3; 2]);
        let shown = Shown {
            line: &line,
            reading: &reading,
            rate_hz: 100.0,
        };
        let samples = instruments.record(&shown, None, &mut random());
        let of = |values: &[f64], about: f64| {
            let count = values.len() as f64;
            let mean = values.iter().sum::<f64>() / count - about;
            let square = values
                .iter()
                .map(|v| (v - about - mean).powi(2))
                .sum::<f64>();
            (mean, (square / count).sqrt())
        };
        let (zero, floor) = of(&samples.angle, 0.7);
        assert!((zero - instruments.angle_zero).abs() < 0.03 * floor);
        assert!((floor / instruments.angle_floor() - 1.0).abs() < 0.03);
        let (zero, _) = of(&samples.pressure, 40e3);
        assert!((zero - instruments.pressure_zero).abs() < 15.0, "{zero}");
        let counts = samples.angle[7] / instruments.angle_count;
        assert!((counts - counts.round()).abs() < 1e-6);
    }
}
