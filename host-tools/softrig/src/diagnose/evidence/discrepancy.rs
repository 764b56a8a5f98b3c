//! Evidence for a structure when every structure is incomplete.
//!
//! On a real rig the residual of a fit is not white: some model error always remains, and
//! it is correlated. If its samples counted as independent, any formula that follows it a
//! little would have "very strong evidence". So the residual is modelled as a discrepancy
//! (Kennedy and O'Hagan, J. R. Stat. Soc. B 63, 2001): an Ornstein–Uhlenbeck process of
//! unknown variance and correlation time, plus white noise. Its likelihood comes from a
//! scalar Kalman filter in steady state.

/// Grid of the ratio of the discrepancy's variance to that of the noise, beside none.
const RATIOS: [f64; 9] = [0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 1000.0];

/// Grid of the correlation time (samples).
const TIMES: [f64; 9] = [1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10_000.0];

/// −2 log L of residuals (rad), one series per segment, as the sum of an
/// Ornstein–Uhlenbeck process and white noise, at the maximum-likelihood ratio and
/// correlation time, with the noise profiled out.
pub fn deviance(residuals: &[Vec<f64>]) -> f64 {
    most_likely(residuals).map_or(f64::INFINITY, |(_, deviance)| deviance)
}

/// The log density of every sample, given those before it in its segment, under the most
/// likely process.
pub fn log_densities(residuals: &[Vec<f64>]) -> Vec<f64> {
    let Some((process, _)) = most_likely(residuals) else {
        return Vec::new();
    };
    let (errors, spreads): (Vec<f64>, Vec<f64>) = residuals
        .iter()
        .flat_map(|series| process.innovations(series))
        .unzip();
    let scaled = errors
        .iter()
        .zip(&spreads)
        .map(|(error, spread)| error * error / spread);
    let noise = (scaled.clone().sum::<f64>() / errors.len() as f64).max(f64::MIN_POSITIVE);
    scaled
        .zip(&spreads)
        .map(|(square, spread)| -0.5 * (libm::log(noise * spread) + square / noise))
        .collect()
}

/// The process with the least deviance, and that.
fn most_likely(residuals: &[Vec<f64>]) -> Option<(Process, f64)> {
    let count = residuals.iter().map(Vec::len).sum::<usize>();
    if count == 0 {
        return None;
    }
    let white = std::iter::once(Process {
        ratio: 0.0,
        time: 1.0,
    });
    let coloured = RATIOS
        .into_iter()
        .flat_map(|ratio| TIMES.map(|time| Process { ratio, time }));
    white
        .chain(coloured)
        .map(|process| (process, process.deviance(residuals, count as f64)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
}

/// An Ornstein–Uhlenbeck process beside white noise.
#[derive(Clone, Copy, Debug)]
struct Process {
    /// Ratio of its variance to the noise's.
    ratio: f64,
    /// Correlation time (samples).
    time: f64,
}

impl Process {
    /// What every sample of a series adds to those before it, and the variance of that in
    /// units of the noise.
    fn innovations(self, series: &[f64]) -> impl Iterator<Item = (f64, f64)> {
        let decay = libm::exp(-1.0 / self.time);
        let growth = self.ratio * (1.0 - decay * decay);
        let (mut level, mut variance) = (0.0, self.ratio);
        series.iter().map(move |residual| {
            let spread = variance + 1.0;
            let error = residual - level;
            let gain = variance / spread;
            level = decay * (level + gain * error);
            variance = decay * decay * variance * (1.0 - gain) + growth;
            (error, spread)
        })
    }

    /// −2 log L.
    fn deviance(self, residuals: &[Vec<f64>], count: f64) -> f64 {
        let mut squares = 0.0;
        let mut log_variance = 0.0;
        for series in residuals {
            for (error, spread) in self.innovations(series) {
                squares += error * error / spread;
                log_variance += libm::log(spread);
            }
        }
        count * libm::log(squares.max(f64::MIN_POSITIVE) / count) + log_variance
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// The density of a short series by its covariance matrix.
    #[test]
    fn the_filter_has_the_density_of_the_covariance() {
        use nalgebra::{DMatrix, DVector};
        let series = vec![0.3, -0.1, 0.4, 0.9, 0.2, -0.7];
        let (ratio, time) = (3.0, 10.0f64);
        let n = series.len();
        let covariance = DMatrix::from_fn(n, n, |i, j| {
            let apart = i.abs_diff(j) as f64;
            ratio * (-apart / time).exp() + if i == j { 1.0 } else { 0.0 }
        });
        let y = DVector::from_vec(series.clone());
        let squares = y.dot(&covariance.clone().cholesky().unwrap().solve(&y));
        let expected = n as f64 * (squares / n as f64).ln() + covariance.determinant().ln();
        let process = Process { ratio, time };
        let found = process.deviance(&[series], n as f64);
        assert!((found - expected).abs() < 1e-9, "{found}, not {expected}");
    }

    /// The densities of the samples make up that of the series.
    #[test]
    fn densities_add_up_to_the_deviance() {
        let series = vec![vec![0.3, -0.1, 0.4, 0.9, 0.2, -0.7], vec![0.1, 0.2, 0.3]];
        let total: f64 = log_densities(&series).iter().sum();
        // The deviance leaves out the constant of the profiled noise.
        let expected = deviance(&series) + 9.0;
        assert!((-2.0 * total - expected).abs() < 1e-9);
    }

    /// A sine fitted to a random walk gains much in squares and little here.
    #[test]
    fn a_formula_that_follows_a_wandering_force_gains_little() {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(5);
        let mut level = 0.0;
        let wandering: Vec<f64> = (0..2000)
            .map(|_| {
                let [a, b]: [f64; 2] = std::array::from_fn(|_| StandardNormal.sample(&mut random));
                level = 0.99 * level + 0.1 * a;
                level + 0.1 * b
            })
            .collect();
        let wave = |k: usize| (k as f64 * std::f64::consts::TAU / 1000.0).sin();
        let (mut up, mut down) = (0.0, 0.0);
        for (k, y) in wandering.iter().enumerate() {
            up += y * wave(k);
            down += wave(k) * wave(k);
        }
        let left: Vec<f64> = wandering
            .iter()
            .enumerate()
            .map(|(k, y)| y - up / down * wave(k))
            .collect();
        let plain = |series: &[f64]| {
            let n = series.len() as f64;
            n * (series.iter().map(|y| y * y).sum::<f64>() / n).ln()
        };
        let by_squares = plain(&wandering) - plain(&left);
        let gained = deviance(&[wandering]) - deviance(&[left]);
        assert!(gained < 10.0, "{gained}");
        assert!(by_squares > gained, "{by_squares}");
    }
}
