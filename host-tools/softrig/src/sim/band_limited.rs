//! A band-limited signal between its samples.
//!
//! A signal without anything beyond half the sampling rate is known between its samples (Whittaker
//! 1915, Shannon 1949): x(t) = Σ x_k sinc(t/T − k). Its slope and curvature at the samples are sums
//! over the neighbours, here within a Kaiser window; a quintic with both joins the samples. A cubic
//! with slopes from two neighbours is off by a hundredth of the amplitude at an eighth of the sampling
//! rate, this by a hundred-thousandth.

use std::f64::consts::PI;

/// Neighbours to either side that count.
const HALF: usize = 24;

/// Shape of the Kaiser window: what it leaks is 80 dB down.
const BETA: f64 = 8.0;

/// Largest deviation of an interval from the mean of all, as its share: beyond, samples are not even.
const EVEN: f64 = 1e-3;

/// Slope (1/s) and curvature (1/s²) of a band-limited signal at its samples; none if these are not
/// evenly spaced, or too few.
pub fn derivatives(time: &[f64], value: &[f64]) -> Option<[Vec<f64>; 2]> {
    let count = value.len();
    if count <= 2 * HALF {
        return None;
    }
    let interval = (time[count - 1] - time[0]) / (count - 1) as f64;
    let is_even = |pair: &[f64]| (pair[1] - pair[0] - interval).abs() <= EVEN * interval;
    if !time.windows(2).all(is_even) {
        return None;
    }
    let weights: Vec<[f64; 2]> = (0..=HALF).map(weights).collect();
    // Beyond an end the signal is its own mirror image about the sample there.
    let at = |place: isize| {
        let last = count - 1;
        match usize::try_from(place) {
            Ok(place) if place <= last => value[place],
            Ok(place) => 2.0 * value[last] - value[2 * last - place],
            Err(_) => 2.0 * value[0] - value[place.unsigned_abs()],
        }
    };
    let each = (0..count).map(|sample| {
        let (mut slope, mut curvature) = (0.0, weights[0][1] * value[sample]);
        for (away, [odd, even]) in weights.iter().enumerate().skip(1) {
            let [before, after] = [sample.wrapping_sub(away), sample + away];
            let [before, after] = [before, after].map(|place| at(place.cast_signed()));
            slope += odd * (after - before);
            curvature += even * (after + before);
        }
        (slope / interval, curvature / (interval * interval))
    });
    let (slope, curvature) = each.unzip();
    Some([slope, curvature])
}

/// What a neighbour so many samples away adds to the slope, and to the curvature, of a unit
/// interval: derivatives of the windowed sinc at whole numbers.
fn weights(away: usize) -> [f64; 2] {
    let k = away as f64;
    let step = 1e-4;
    let window_slope = (kaiser(k + step) - kaiser(k - step)) / (2.0 * step);
    if away == 0 {
        let bend = (kaiser(step) - 2.0 * kaiser(0.0) + kaiser(-step)) / (step * step);
        return [0.0, bend - PI * PI / 3.0];
    }
    let sign = if away.is_multiple_of(2) { 1.0 } else { -1.0 };
    // sinc′(k) = (−1)^k/k and sinc″(k) = −2(−1)^k/k².
    let odd = sign / k;
    [
        -odd * kaiser(k),
        -2.0 * sign / (k * k) * kaiser(k) + 2.0 * odd * window_slope,
    ]
}

/// The Kaiser window.
fn kaiser(at: f64) -> f64 {
    let share = at / (HALF as f64 + 1.0);
    bessel(BETA * (1.0 - share * share).max(0.0).sqrt()) / bessel(BETA)
}

/// The modified Bessel function I₀, by its series.
fn bessel(x: f64) -> f64 {
    let quarter = x * x / 4.0;
    let terms = (1..40).scan(1.0, |term, k| {
        *term *= quarter / f64::from(k * k);
        Some(*term)
    });
    1.0 + terms.sum::<f64>()
}

/// Value and slope of the quintic between two samples `width` (s) apart, each given by value, slope
/// and curvature, at the share `u` of the way.
pub fn quintic([from, to]: [[f64; 3]; 2], width: f64, u: f64) -> [f64; 2] {
    let scaled = |[value, slope, bend]: [f64; 3]| [value, slope * width, bend * width * width];
    let ([f0, m0, c0], [f1, m1, c1]) = (scaled(from), scaled(to));
    let rise = f1 - f0 - m0 - 0.5 * c0;
    let turn = m1 - m0 - c0;
    let bend = c1 - c0;
    let a = 10.0 * rise - 4.0 * turn + 0.5 * bend;
    let b = 7.0 * turn - 15.0 * rise - bend;
    let c = 6.0 * rise - 3.0 * turn + 0.5 * bend;
    let value = f0 + u * (m0 + u * (0.5 * c0 + u * (a + u * (b + u * c))));
    let slope = m0 + u * (c0 + u * (3.0 * a + u * (4.0 * b + 5.0 * u * c)));
    [value, slope / width]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::simulate::Signal;

    /// A sine at a third of the sampling rate, where a cubic misses by a tenth.
    #[test]
    fn a_band_limited_signal_is_known_between_its_samples() {
        let course = |t: f64| libm::sin(2.0 * PI * 0.33 * t) + 0.5 * libm::cos(2.0 * PI * 0.12 * t);
        let time: Vec<f64> = (0..400).map(f64::from).collect();
        let value: Vec<f64> = time.iter().map(|t| course(*t)).collect();
        let cubic = Signal::new(time, value);
        let worst = |signal: &Signal| {
            let each = (0..1_000).map(|k| {
                let t = 100.0 + 0.2 * f64::from(k);
                let (found, _) = signal.since_start(t, 0);
                (found - course(t)).abs()
            });
            each.fold(0.0, f64::max)
        };
        let before = worst(&cubic);
        let after = worst(&cubic.band_limited());
        assert!(before > 0.05, "{before}");
        assert!(after < 3e-3, "{after}");
    }

    /// Nothing is claimed of samples that are not even.
    #[test]
    fn uneven_samples_stay_as_they_are() {
        let mut time: Vec<f64> = (0..100).map(f64::from).collect();
        time[50] += 0.1;
        assert_eq!(derivatives(&time, &vec![1.0; 100]), None);
    }

    #[test]
    fn the_quintic_keeps_both_ends() {
        let ends = [[1.0, 0.5, -0.2], [2.0, -0.3, 0.4]];
        for (u, [value, slope, _]) in [(0.0, ends[0]), (1.0, ends[1])] {
            let found = quintic(ends, 0.3, u);
            assert!((found[0] - value).abs() < 1e-12 && (found[1] - slope).abs() < 1e-12);
        }
    }
}
