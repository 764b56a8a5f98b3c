//! What reaches the file: a flex sensor and a pressure sensor behind a ten-bit
//! converter.

use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};
use softrig_formats::recording::Recording;

use super::world::{Line, SAMPLES_HZ};

/// Angle of one count (rad): 0.26°.
pub const ANGLE_COUNT: f64 = 0.26 * std::f64::consts::PI / 180.0;
/// Pressure of one count (Pa): 80 psi over the sensor's 819 counts.
pub const PRESSURE_COUNT: f64 = 674.0;

/// The sensors of a case.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sensors {
    /// RMS of the angle's white noise (rad).
    pub angle_noise: f64,
    /// RMS of the white noise of one conversion of the pressure (Pa).
    pub pressure_noise: f64,
    /// Conversions of the pressure that are averaged.
    pub averaged: u32,
}

impl Sensors {
    /// RMS of everything that the angle's sensor adds (rad): noise and counts.
    pub fn angle_floor(&self) -> f64 {
        self.angle_noise.hypot(ANGLE_COUNT / 12f64.sqrt())
    }

    /// A recording of a run: `reading` is what a perfect sensor would show.
    pub fn record(&self, line: &Line, reading: &[f64], random: &mut Pcg64Mcg) -> Recording {
        let time: Vec<f64> = (0..reading.len())
            .map(|k| k as f64 / f64::from(SAMPLES_HZ))
            .collect();
        let mut noisy = |value: f64, noise: f64, count: f64| {
            let normal: f64 = StandardNormal.sample(random);
            ((value + noise * normal) / count).round() * count
        };
        let angle = reading
            .iter()
            .map(|&reading| noisy(reading, self.angle_noise, ANGLE_COUNT))
            .collect();
        let pressure = time
            .iter()
            .map(|&time| {
                let sum: f64 = (0..self.averaged)
                    .map(|_| noisy(line.at(time), self.pressure_noise, PRESSURE_COUNT))
                    .sum();
                sum / f64::from(self.averaged)
            })
            .collect();
        Recording {
            time,
            pressure,
            angle,
            ..Recording::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn noise_and_counts_are_as_stated() {
        let sensors = Sensors {
            angle_noise: 0.4f64.to_radians(),
            pressure_noise: 600.0,
            averaged: 9,
        };
        let line = Line::new(1.0, vec![50e3; 400]);
        let reading = vec![1.0; 20_000];
        let recording = sensors.record(&line, &reading, &mut Pcg64Mcg::seed_from_u64(3));
        let spread = |values: &[f64], about: f64| {
            let squares: f64 = values.iter().map(|v| (v - about) * (v - about)).sum();
            (squares / values.len() as f64).sqrt()
        };
        let floor = spread(&recording.angle, 1.0);
        assert!((floor / sensors.angle_floor() - 1.0).abs() < 0.03);
        let expected = 600f64.hypot(PRESSURE_COUNT / 12f64.sqrt()) / 3.0;
        assert!((spread(&recording.pressure, 50e3) / expected - 1.0).abs() < 0.03);
        let counts = recording.angle[7] / ANGLE_COUNT;
        assert!((counts - counts.round()).abs() < 1e-9);
    }
}
