//! The noise of a sensor at rest.

use super::{Limit, Measurement};

/// Samples a second.
pub const RATE_HZ: f64 = 100.0;

/// Length of a piece of the spectrum: 2.56 s, so lines are 0.39 Hz apart.
const PIECE: usize = 256;

/// A line of the spectrum that is this many times the median one stands out. Of white noise in
/// eight pieces, the highest of 128 lines is about 4 times the median.
const HIGHEST_LINE: f64 = 25.0;

/// Neighbouring samples of white noise have no correlation; a hundred of them scatter by 0.1.
const CORRELATED: f64 = 0.5;

/// The noise of one sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Noise {
    /// Standard deviation about a straight line.
    pub deviation: f64,
    /// Slope of that line, a minute.
    pub drift: f64,
    /// Correlation of neighbours.
    pub correlation: f64,
    /// The highest line of the spectrum: frequency (Hz) and height over the median.
    pub line: Option<(f64, f64)>,
    /// Different values.
    pub levels: usize,
}

impl Noise {
    /// Of a sensor's values, 100 a second.
    pub fn of(values: &[f64]) -> Self {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let middle = (count - 1.0) / 2.0;
        let (mut slope, mut squares) = (0.0, 0.0);
        for (index, value) in values.iter().enumerate() {
            slope += (index as f64 - middle) * (value - mean);
            squares += (index as f64 - middle).powi(2);
        }
        let slope = if squares > 0.0 { slope / squares } else { 0.0 };
        let level: Vec<f64> = (0..values.len())
            .zip(values)
            .map(|(index, value)| value - mean - slope * (index as f64 - middle))
            .collect();
        let power = level.iter().map(|it| it * it).sum::<f64>();
        let neighbours: f64 = level.windows(2).map(|pair| pair[0] * pair[1]).sum();
        let mut different = values.to_vec();
        different.sort_by(f64::total_cmp);
        different.dedup();
        let spectrum = spectrum(&level);
        let mut heights: Vec<f64> = spectrum.iter().map(|&(_, height)| height).collect();
        heights.sort_by(f64::total_cmp);
        let median = heights.get(heights.len() / 2).copied().unwrap_or(0.0);
        let line = spectrum
            .into_iter()
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .filter(|_| median > 0.0)
            .map(|(hertz, height)| (hertz, height / median));
        Self {
            deviation: (power / (count - 1.0)).sqrt(),
            drift: slope * RATE_HZ * 60.0,
            correlation: if power > 0.0 { neighbours / power } else { 0.0 },
            line,
            levels: different.len(),
        }
    }

    /// What it is held to: at most this deviation, and this drift a minute.
    pub fn measure(
        &self,
        sensor: &str,
        unit: &'static str,
        per_minute: &'static str,
        deviation: f64,
        drift: f64,
    ) -> Vec<Measurement> {
        let mut measured = vec![
            Measurement::new(
                format!("noise of the {sensor}, rms"),
                self.deviation,
                unit,
                Limit::AtMost(deviation),
            ),
            Measurement::new(
                format!("drift of the {sensor}"),
                self.drift,
                per_minute,
                Limit::Within(-drift, drift),
            ),
            Measurement::new(
                format!("{sensor}: different readings"),
                self.levels as f64,
                "",
                Limit::None,
            ),
        ];
        // What repeats a few values has the spectrum of its rounding.
        if self.levels > 8 {
            measured.push(Measurement::new(
                format!("{sensor}: correlation of neighbouring samples"),
                self.correlation,
                "1",
                Limit::Within(-CORRELATED, CORRELATED),
            ));
            if let Some((hertz, height)) = self.line {
                measured.push(Measurement::new(
                    format!("{sensor}: highest line of the spectrum, at {}", at(hertz)),
                    height,
                    "times the median",
                    Limit::AtMost(HIGHEST_LINE),
                ));
            }
        }
        measured
    }
}

/// A frequency, and where it may come from: at 100 samples a second, mains of 60 Hz shows at 40.
fn at(hertz: f64) -> String {
    let near = |other: f64| (hertz - other).abs() < 0.6;
    let mains = if near(50.0) {
        " (mains of 50 Hz?)"
    } else if near(40.0) {
        " (mains of 60 Hz?)"
    } else {
        ""
    };
    format!("{hertz:.1} Hz{mains}")
}

/// The spectrum: frequency (Hz) and mean power of the lines, by the periodograms of pieces under a
/// Hann window that overlap by half.
pub fn spectrum(values: &[f64]) -> Vec<(f64, f64)> {
    use std::f64::consts::TAU;
    let size = PIECE as f64;
    let window: Vec<f64> = (0..PIECE)
        .map(|index| 0.5 - 0.5 * (TAU * index as f64 / size).cos())
        .collect();
    let mut lines = vec![0.0; PIECE / 2 + 1];
    let mut pieces = 0.0;
    for piece in values.windows(PIECE).step_by(PIECE / 2) {
        let mean = piece.iter().sum::<f64>() / size;
        for (line, sum) in lines.iter_mut().enumerate() {
            let (mut real, mut imaginary) = (0.0, 0.0);
            for (index, (value, weight)) in piece.iter().zip(&window).enumerate() {
                let phase = TAU * ((line * index) % PIECE) as f64 / size;
                real += (value - mean) * weight * phase.cos();
                imaginary += (value - mean) * weight * phase.sin();
            }
            *sum += real * real + imaginary * imaginary;
        }
        pieces += 1.0;
    }
    if pieces == 0.0 {
        return Vec::new();
    }
    lines
        .iter()
        .enumerate()
        // The window spreads the mean over the first two.
        .skip(2)
        .map(|(line, sum)| (line as f64 * RATE_HZ / size, sum / pieces))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums of twelve uniform numbers are nearly normal.
    fn white(count: usize, deviation: f64) -> Vec<f64> {
        let mut random = 7_u32;
        let mut uniform = move || {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(random >> 8) / f64::from(1 << 24)
        };
        let mut normal = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        (0..count).map(|_| deviation * normal()).collect()
    }

    fn failures(values: &[f64]) -> Vec<String> {
        let measured = Noise::of(values).measure("pressure", "kPa", "kPa/min", 0.3, 1.0);
        let failed = measured.into_iter().filter(|it| !it.passed);
        failed.map(|it| it.name).collect()
    }

    #[test]
    fn white_noise_passes_whatever_its_zero() {
        let values: Vec<f64> = white(3_000, 0.1).iter().map(|it| it + 5.0).collect();
        assert_eq!(failures(&values), [""; 0]);
        let noise = Noise::of(&values);
        assert!((noise.deviation - 0.1).abs() < 0.01, "{noise:?}");
        assert!(noise.correlation.abs() < 0.06, "{noise:?}");
    }

    #[test]
    fn hum_is_found_and_its_mains_named() {
        for (hertz, says) in [(40.0, "60 Hz"), (48.0, "48.0 Hz")] {
            let values: Vec<f64> = white(3_000, 0.05)
                .iter()
                .enumerate()
                .map(|(index, it)| {
                    let phase = std::f64::consts::TAU * hertz * index as f64 / RATE_HZ;
                    it + 0.1 * phase.sin()
                })
                .collect();
            let failed = failures(&values).join();
            assert!(
                failed.contains("highest line") && failed.contains(says),
                "{failed}"
            );
        }
    }

    trait Join {
        fn join(&self) -> String;
    }

    impl Join for Vec<String> {
        fn join(&self) -> String {
            <[String]>::join(self, "; ")
        }
    }

    #[test]
    fn drift_and_loud_noise_are_found() {
        let drifting: Vec<f64> = white(2_000, 0.05)
            .iter()
            .enumerate()
            .map(|(index, it)| it - 0.005 * index as f64)
            .collect();
        assert_eq!(failures(&drifting), ["drift of the pressure"]);
        assert_eq!(failures(&white(2_000, 0.5)), ["noise of the pressure, rms"]);
    }

    #[test]
    fn a_sensor_that_repeats_itself_has_no_spectrum() {
        let noise = Noise::of(&[3.0; 1_000]);
        assert_eq!((noise.deviation, noise.levels, noise.line), (0.0, 1, None));
        assert!(noise.drift.abs() < f64::EPSILON);
    }
}
