//! What a model leaves of recordings: prediction errors over several horizons, and their
//! distribution.
//!
//! Whether a residual is white and free of the input is a matter of correlations; this is about its
//! size over a time ahead, and about tails that a normal error does not have.

use schemars::JsonSchema;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Normal};

use crate::estimate::Dataset;
use crate::estimate::fit::Fit;
use crate::estimate::horizon::{Squares, block_errors};
use crate::statistics::{mean, squares_about_mean};

/// Fewest samples ahead: from fewer, an angle and a rate cannot be told.
const FEWEST_AHEAD: f64 = 8.0;

/// Horizons, evenly spaced on a logarithmic scale.
const HORIZONS: u32 = 12;

/// Bars of the histogram.
const BARS: usize = 40;

/// Most points of the quantile plot.
const MOST_QUANTILES: usize = 200;

/// The error of predictions over a time ahead.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Ahead {
    /// Samples ahead.
    pub samples: usize,
    /// The same in seconds.
    pub seconds: f64,
    /// RMS error (°), with the start of each stretch of that length as the measured angle puts it.
    pub rmse_deg: f64,
}

/// RMS prediction errors over stretches of increasing length: from a few samples to whole runs. Each
/// stretch begins with the best-fitting angle and rate, and costs two degrees of freedom.
pub fn errors_ahead(fit: &Fit, data: &Dataset) -> Vec<Ahead> {
    let sessions = data.sessions().iter();
    let interval = sessions.map(|it| it.interval()).fold(0.0, f64::max);
    let longest = data
        .fitted()
        .map(|segment| segment.recording.duration())
        .fold(0.0, f64::max);
    let least = FEWEST_AHEAD * interval;
    if interval <= 0.0 || longest <= least {
        return Vec::new();
    }
    (0..HORIZONS)
        .map(|step| {
            let share = f64::from(step) / f64::from(HORIZONS - 1);
            let seconds = least * libm::pow(longest / least, share);
            let errors = block_errors(&fit.model, data, &fit.nuisances, seconds, true);
            let all = errors.into_iter().fold(Squares::default(), Squares::with);
            // At most the samples of a run.
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let samples = (seconds / interval).round() as usize;
            Ahead {
                samples,
                seconds,
                rmse_deg: all.mean().sqrt().to_degrees(),
            }
        })
        .collect()
}

/// How the errors of a model are distributed.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Distribution {
    /// Mean (°).
    pub mean_deg: f64,
    /// Standard deviation (°).
    pub deviation_deg: f64,
    /// Third standardised moment; zero for a symmetric distribution.
    pub skewness: f64,
    /// Fourth standardised moment less 3; zero for normal errors, above it for heavy tails.
    pub excess_kurtosis: f64,
    /// Middle of each bar of the histogram (°).
    pub centre_deg: Vec<f64>,
    /// Share of the samples in it, per degree.
    pub density: Vec<f64>,
    /// Quantiles of the standard normal distribution.
    pub normal: Vec<f64>,
    /// The same quantiles of the errors (°).
    pub quantile_deg: Vec<f64>,
}

impl Distribution {
    /// Of errors (rad); none of fewer than ten, or if all are the same.
    pub fn of(errors: &[f64]) -> Option<Self> {
        const FEWEST: usize = 10;
        let mut sorted: Vec<f64> = errors.iter().map(|it| it.to_degrees()).collect();
        sorted.retain(|it| it.is_finite());
        sorted.sort_unstable_by(f64::total_cmp);
        let count = sorted.len();
        if count < FEWEST {
            return None;
        }
        let middle = mean(&sorted);
        let deviation = (squares_about_mean(&sorted) / count as f64).sqrt();
        let (least, largest) = (sorted[0], sorted[count - 1]);
        if deviation <= 0.0 || least >= largest {
            return None;
        }
        let moment = |power: i32| {
            let sum: f64 = sorted
                .iter()
                .map(|it| ((it - middle) / deviation).powi(power))
                .sum();
            sum / count as f64
        };
        let width = (largest - least) / BARS as f64;
        let mut counts = vec![0.0; BARS];
        for error in &sorted {
            // The largest belongs to the last bar.
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let bar = ((error - least) / width) as usize;
            counts[bar.min(BARS - 1)] += 1.0;
        }
        let normal = Normal::standard();
        let points = count.min(MOST_QUANTILES);
        let shares = (0..points).map(|k| (k as f64 + 0.5) / points as f64);
        // Of the samples the one whose rank is that share.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let quantile = |share: f64| sorted[((share * count as f64) as usize).min(count - 1)];
        Some(Self {
            mean_deg: middle,
            deviation_deg: deviation,
            skewness: moment(3),
            excess_kurtosis: moment(4) - 3.0,
            centre_deg: (0..BARS)
                .map(|bar| least + (bar as f64 + 0.5) * width)
                .collect(),
            density: counts
                .into_iter()
                .map(|it: f64| it / (count as f64 * width))
                .collect(),
            normal: shares.clone().map(|it| normal.inverse_cdf(it)).collect(),
            quantile_deg: shares.map(quantile).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution as _, StandardNormal};

    use super::*;

    #[test]
    fn normal_errors_are_normal_and_heavy_tails_are_not() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(5);
        let errors: Vec<f64> = (0..20_000)
            .map(|_| {
                let error: f64 = StandardNormal.sample(&mut rng);
                (0.3 * error + 0.1).to_radians()
            })
            .collect();
        let found = Distribution::of(&errors).unwrap();
        assert!((found.mean_deg - 0.1).abs() < 0.01);
        assert!((found.deviation_deg - 0.3).abs() < 0.01);
        assert!(found.skewness.abs() < 0.1 && found.excess_kurtosis.abs() < 0.2);
        let inside = found.normal.iter().zip(&found.quantile_deg);
        for (normal, quantile) in inside.filter(|(normal, _)| normal.abs() < 2.0) {
            assert!((quantile - (0.1 + 0.3 * normal)).abs() < 0.03, "{normal}");
        }
        let width = found.centre_deg[1] - found.centre_deg[0];
        let whole: f64 = found.density.iter().map(|it| it * width).sum();
        assert!((whole - 1.0).abs() < 1e-9);
        let heavy: Vec<f64> = errors.iter().map(|it| it.powi(3)).collect();
        assert!(Distribution::of(&heavy).unwrap().excess_kurtosis > 5.0);
        assert_eq!(Distribution::of(&[0.1; 20]), None);
    }
}
