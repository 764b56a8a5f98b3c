//! Statistics of sampled signals: medians, autocorrelation and noise estimates.

use statrs::statistics::{Data, OrderStatistics};

/// The median; NaN for an empty slice. Reorders `values`.
pub fn median(values: &mut [f64]) -> f64 {
    Data::new(values).median()
}

/// Whether two values are the same to the last digit.
pub fn same(a: f64, b: f64) -> bool {
    // The two zeros are one.
    (a + 0.0).total_cmp(&(b + 0.0)).is_eq()
}

/// Root of the mean square; zero for an empty slice.
pub fn rms(values: &[f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

/// The mean; zero for an empty slice.
pub fn mean(values: &[f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    values.iter().sum::<f64>() / values.len() as f64
}

/// The largest value less the smallest.
pub fn swing(values: &[f64]) -> f64 {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    high - low
}

/// Whether a signal sampled at `time` moves: white noise alone spans eight standard deviations.
pub fn moves(time: &[f64], values: &[f64]) -> bool {
    swing(values) > 10.0 * noise(time, values)
}

/// The standard deviation about the mean; zero for fewer than two values.
pub fn standard_deviation(values: &[f64]) -> f64 {
    if values.len() < 2 {
        return 0.0;
    }
    (squares_about_mean(values) / (values.len() - 1) as f64).sqrt()
}

/// The sum of squares about the mean.
pub fn squares_about_mean(values: &[f64]) -> f64 {
    let middle = mean(values);
    values.iter().map(|value| (value - middle).powi(2)).sum()
}

/// Robust standard deviation of normal values about zero, from the median of their
/// absolute values (Huber, Robust Statistics, 1981, Section 5.1).
pub fn robust_deviation(values: &[f64]) -> f64 {
    /// Half of all normal values lie within so many standard deviations.
    const HALF_WITHIN: f64 = 0.674_489_750_196_081_7;
    let mut sizes: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    median(&mut sizes) / HALF_WITHIN
}

/// Sum of products of samples `lag` apart.
fn lagged(values: &[f64], lag: usize) -> f64 {
    values
        .iter()
        .zip(values.iter().skip(lag))
        .map(|(a, b)| a * b)
        .sum()
}

/// Integrated autocorrelation time (samples): 1 + 2 Σ ρ(k) over all `runs` together,
/// summed to the first lag at which the correlation has died away. At least 1.
///
/// A residual of 10 000 samples with a correlation time of one second holds as much
/// information as a few hundred independent samples; every test that counts samples has
/// to count those.
pub fn correlation_time(runs: &[Vec<f64>]) -> f64 {
    /// Longest lag (samples). A correlation beyond it is an offset, and its exact length
    /// changes no verdict.
    const LONGEST_LAG: usize = 1_000;
    let power: f64 = runs.iter().map(|run| lagged(run, 0)).sum();
    let longest = runs.iter().map(Vec::len).max().unwrap_or(0);
    if power <= 0.0 {
        return 1.0;
    }
    let mut time = 1.0;
    for lag in 1..LONGEST_LAG.min(longest / 2) {
        let correlation = runs.iter().map(|run| lagged(run, lag)).sum::<f64>() / power;
        // Below this the sum would only add the noise of the estimate.
        if correlation < 0.02 {
            break;
        }
        time += 2.0 * correlation;
    }
    time
}

/// Length (samples) of blocks whose sums are independent, for a series with this
/// correlation time: four times that, and at least 50.
pub fn independent_block(correlation_time: f64) -> usize {
    // A correlation time is at most some thousand samples.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let correlated = (4.0 * correlation_time) as usize;
    correlated.max(50)
}

/// RMS of the coloured part of a residual: the root of the mean autocovariance at lags 1
/// to 5, where white noise has none.
pub fn coloured_rms(runs: &[Vec<f64>]) -> f64 {
    const LAGS: usize = 5;
    let mut sum = 0.0;
    let mut count = 0usize;
    for run in runs {
        for lag in 1..=LAGS.min(run.len().saturating_sub(1)) {
            sum += lagged(run, lag);
            count += run.len() - lag;
        }
    }
    if count == 0 {
        return 0.0;
    }
    (sum / count as f64).max(0.0).sqrt()
}

/// The standard deviation of white noise on a smooth signal sampled at `time`, from what
/// polynomials through neighbours miss.
///
/// Of m + 1 successive samples that combination is taken which is zero for every polynomial below
/// degree m and keeps the variance of white noise (Gasser, Sroka and Jennen-Steinmetz, Biometrika
/// 73, 1986). With even sampling it is the m-th difference over the root of the binomial (2m over
/// m). A smooth signal can only raise the estimate of each order, so the smallest one is returned:
/// an upper bound of the noise, tight where the sampling is fast against the motion.
pub fn noise(time: &[f64], values: &[f64]) -> f64 {
    noise_by_order(time, values)
        .into_iter()
        .reduce(f64::min)
        .unwrap_or(0.0)
}

/// Orders of differences that estimate noise; the first sees every motion.
const NOISE_ORDERS: std::ops::RangeInclusive<usize> = 2..=8;

/// Fewest differences of an order that estimate noise.
const FEWEST_DIFFERENCES: usize = 8;

/// The estimates of [`noise`] of each order from the second on. They agree where there is white
/// noise and little else.
pub fn noise_by_order(time: &[f64], values: &[f64]) -> Vec<f64> {
    if is_even(time) {
        return noise_of_even(values);
    }
    NOISE_ORDERS
        .map(|order| {
            time.windows(order + 1)
                .zip(values.windows(order + 1))
                .map(|(time, values)| scaled_difference(time, values))
                .collect::<Vec<f64>>()
        })
        .take_while(|differences| differences.len() >= FEWEST_DIFFERENCES)
        .map(|differences| rms(&differences))
        .collect()
}

/// The standard deviation of a signal's noise, if differences of all high orders agree on it: then
/// it is white, and nearly nothing else shows in them.
pub fn agreed_noise(time: &[f64], values: &[f64]) -> Option<f64> {
    /// Estimates agree within this share.
    const AGREEMENT: f64 = 0.2;
    let orders = noise_by_order(time, values);
    // The lowest orders still see the motion.
    let fast = orders.get(2..)?;
    let low = fast.iter().copied().fold(f64::INFINITY, f64::min);
    let high = fast.iter().copied().fold(0.0, f64::max);
    (low > 0.0 && high <= (1.0 + AGREEMENT) * low).then_some(low)
}

/// Whether nearly all intervals are the usual one, up to the rounding of the times.
fn is_even(time: &[f64]) -> bool {
    const NEARLY_ALL: f64 = 0.95;
    const ROUNDING: f64 = 0.2;
    let mut steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let usual = median(&mut steps);
    let even = steps
        .iter()
        .filter(|step| (*step / usual - 1.0).abs() <= ROUNDING);
    steps.is_empty() || even.count() as f64 >= NEARLY_ALL * steps.len() as f64
}

/// The divided difference of samples over its standard deviation for noise of variance 1.
fn scaled_difference(time: &[f64], values: &[f64]) -> f64 {
    let span = time[time.len() - 1] - time[0];
    let (mut sum, mut squares) = (0.0, 0.0);
    for (own, value) in time.iter().zip(values) {
        let others = time
            .iter()
            .map(|other| own - other)
            .filter(|apart| apart.abs() > 0.0);
        let weight: f64 = others.map(|apart| span / apart).product();
        sum += weight * value;
        squares += weight * weight;
    }
    sum / squares.sqrt()
}

/// The same for even samples, by differencing again and again.
fn noise_of_even(values: &[f64]) -> Vec<f64> {
    let mut difference = values.to_vec();
    let mut gain = 1.0;
    let mut found = Vec::new();
    for order in 1..=*NOISE_ORDERS.end() {
        for k in 0..difference.len().saturating_sub(1) {
            difference[k] = difference[k + 1] - difference[k];
        }
        difference.pop();
        if difference.len() < FEWEST_DIFFERENCES {
            break;
        }
        let m = order as f64;
        gain *= (2.0 * m) * (2.0 * m - 1.0) / (m * m);
        if NOISE_ORDERS.contains(&order) {
            found.push(rms(&difference) / f64::sqrt(gain));
        }
    }
    found
}

/// The quantisation step of a signal: the smallest difference between its values, if they
/// lie on a grid. Zero if there is no grid.
pub fn quantisation_step(values: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let span = sorted.last().unwrap_or(&0.0) - sorted.first().unwrap_or(&0.0);
    let mut steps: Vec<f64> = sorted
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .filter(|step| *step > 1e-6 * span)
        .collect();
    // On a grid many samples share few levels.
    if steps.is_empty() || steps.len() * 2 > values.len() {
        return 0.0;
    }
    median(&mut steps)
}

/// Ranges of samples in which a signal saturates: it stays exactly at its largest or
/// smallest value although noise would move it.
pub fn clipped(time: &[f64], values: &[f64]) -> Vec<std::ops::Range<usize>> {
    /// Shortest range that is not chance.
    const SHORTEST: usize = 20;
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let same = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (high - low);
    let mut found = Vec::new();
    let mut start = 0;
    while start < values.len() {
        let end = (start..values.len())
            .find(|&k| !same(values[k], values[start]))
            .unwrap_or(values.len());
        let at_end = same(values[start], low) || same(values[start], high);
        if at_end && end - start >= SHORTEST {
            found.push(start..end);
        }
        start = end;
    }
    if found.is_empty() {
        return found;
    }
    // Where the noise is small against the quantisation step, a rest looks the same.
    let (time, moving): (Vec<f64>, Vec<f64>) = time
        .iter()
        .zip(values)
        .enumerate()
        .filter(|(k, _)| !found.iter().any(|range| range.contains(k)))
        .map(|(_, (time, value))| (*time, *value))
        .unzip();
    if noise(&time, &moving) > 0.4 * quantisation_step(values).max(1e-6 * (high - low)) {
        found
    } else {
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn white(count: usize, seed: u64) -> Vec<f64> {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        (0..count)
            .map(|_| StandardNormal.sample(&mut random))
            .collect()
    }

    /// The times of so many samples at 100 Hz.
    fn even(count: usize) -> Vec<f64> {
        (0..count).map(|k| k as f64 * 0.01).collect()
    }

    #[test]
    fn median_of_odd_even_and_nothing() {
        assert!((median(&mut [3.0, 1.0, 2.0]) - 2.0).abs() < 1e-15);
        assert!((median(&mut [4.0, 1.0, 2.0, 3.0]) - 2.5).abs() < 1e-15);
        assert!(median(&mut []).is_nan());
    }

    #[test]
    fn noise_on_a_smooth_signal_is_found_and_the_signal_ignored() {
        let noise = white(3_000, 1);
        let signal: Vec<f64> = noise
            .iter()
            .enumerate()
            .map(|(k, n)| 50.0 * (k as f64 * 0.03).sin() + 0.4 * n)
            .collect();
        let estimate = super::noise(&even(signal.len()), &signal);
        assert!((estimate - 0.4).abs() < 0.02, "{estimate}");
        let clean: Vec<f64> = (0..3_000)
            .map(|k| 50.0 * (f64::from(k) * 0.03).sin())
            .collect();
        assert!(super::noise(&even(clean.len()), &clean) < 1e-6);
    }

    #[test]
    fn correlation_time_of_white_and_of_filtered_noise() {
        let noise = white(50_000, 2);
        let time = correlation_time(std::slice::from_ref(&noise));
        assert!((time - 1.0).abs() < 0.1, "{time}");
        assert!(coloured_rms(std::slice::from_ref(&noise)) < 0.06);
        // A first-order filter with pole a has the correlation time (1+a)/(1−a).
        let mut filtered = vec![0.0; noise.len()];
        for k in 1..noise.len() {
            filtered[k] = 0.8 * filtered[k - 1] + noise[k];
        }
        let time = correlation_time(&[filtered]);
        assert!((time - 9.0).abs() < 0.9, "{time}");
    }

    #[test]
    fn a_sensor_at_its_end_is_seen_and_a_rest_is_not() {
        let noise = white(600, 5);
        let signal: Vec<f64> = noise
            .iter()
            .enumerate()
            .map(|(k, n)| (60.0 * (k as f64 * 0.01).sin() + 0.4 * n).min(55.0))
            .collect();
        let found = clipped(&even(signal.len()), &signal);
        assert!(!found.is_empty());
        assert!(
            found
                .iter()
                .all(|range| range.start > 80 && range.end < 240)
        );
        let rest: Vec<f64> = (0..600)
            .map(|k| f64::from((k - 300).max(0)) * 0.1)
            .collect();
        assert!(clipped(&even(rest.len()), &rest).is_empty());
    }

    /// What is missing or late says nothing of the noise.
    #[test]
    fn noise_does_not_depend_on_the_spacing_of_the_samples() {
        let draws = white(6_000, 11);
        let signal = |t: f64| 50.0 * (3.0 * t).sin();
        let with = |time: Vec<f64>| {
            let noisy = time.iter().zip(&draws).map(|(t, n)| signal(*t) + 0.4 * n);
            super::noise(&time, &noisy.collect::<Vec<f64>>())
        };
        let third_missing: Vec<f64> = even(6_000)
            .into_iter()
            .zip(white(6_000, 12))
            .filter(|(_, draw)| draw.abs() > 0.43)
            .map(|(t, _)| t)
            .collect();
        let irregular: Vec<f64> = even(6_000)
            .iter()
            .zip(white(6_000, 13))
            .map(|(t, draw)| t + 0.004 * draw.tanh())
            .collect();
        for time in [even(6_000), third_missing, irregular] {
            let estimate = with(time);
            assert!((estimate - 0.4).abs() < 0.02, "{estimate}");
        }
    }

    #[test]
    fn quantum_of_a_ten_bit_signal() {
        let step = 90.0 / 341.0;
        let signal: Vec<f64> = white(4_000, 3)
            .iter()
            .map(|n| (n * 3.0 / step).round() * step)
            .collect();
        assert!((quantisation_step(&signal) - step).abs() < 1e-9);
        assert!(quantisation_step(&white(4_000, 4)) == 0.0);
    }
}
