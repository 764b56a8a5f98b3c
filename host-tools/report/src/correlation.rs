//! Residual analysis: is the residual white, and is it correlated with the input?
//!
//! A residual that is correlated with itself contains something that a model could predict. One
//! that is correlated with earlier inputs shows missing dynamics (Ljung, System Identification,
//! 2nd edition, §16.6).

use softrig::statistics::mean;

/// A level of confidence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Share of normal values beyond it.
    beyond: f64,
    /// Half width of the interval that holds the others, in standard deviations.
    deviations: f64,
}

impl Level {
    /// 95 %.
    pub const P95: Self = Self {
        beyond: 0.05,
        deviations: 1.96,
    };
    /// 99 %.
    pub const P99: Self = Self {
        beyond: 0.01,
        deviations: 2.576,
    };
}

/// Number of lags outside the band by chance, in standard deviations: 99 of 100 white
/// residuals have fewer.
const BY_CHANCE: f64 = 2.33;

/// Multiple of the band beyond which the largest cross-correlation is no chance: three
/// standard deviations, since the lags of a slow input are not independent.
const BEYOND_CHANCE: f64 = 1.5;

/// Largest number of lags on one side, about: no picture is wider.
pub const MOST_LAGS: usize = 500;

/// Least number of lags on one side, if a run is long enough.
const FEWEST_LAGS: usize = 25;

/// Largest lag, as a share of the longest run: beyond it few pairs are left.
const REACH: f64 = 0.25;

/// One run with the residual of a model.
#[derive(Clone, Copy, Debug)]
pub struct RunResiduals<'a> {
    /// Time of each sample (s), increasing.
    pub time: &'a [f64],
    /// Simulated minus measured.
    pub residual: &'a [f64],
    /// The measured input.
    pub input: &'a [f64],
    /// For each sample, whether the residual is not usable.
    pub silent: &'a [bool],
}

/// Correlation over the lag.
#[derive(Clone, Debug, PartialEq)]
pub struct Correlation {
    /// Lags (s), increasing.
    pub lag: Vec<f64>,
    /// Correlation at each, −1 to 1.
    pub value: Vec<f64>,
    /// The 95 % bound of the absolute value without any correlation.
    pub band: f64,
}

impl Correlation {
    /// The bound of the absolute value without any correlation, at a level.
    pub fn bound(&self, level: Level) -> f64 {
        self.band * (level.deviations / Level::P95.deviations)
    }

    /// Share of the lags above zero at which the correlation is beyond the bound.
    pub fn share_outside(&self, level: Level) -> f64 {
        let bound = self.bound(level);
        let outside = self.later().filter(|(_, value)| value.abs() > bound);
        outside.count() as f64 / self.lags().max(1) as f64
    }

    /// Whether chance alone puts as many lags beyond the bound. The lags of white noise are
    /// independent.
    pub fn is_white(&self, level: Level) -> bool {
        let Level { beyond, .. } = level;
        let chance =
            beyond + BY_CHANCE * (beyond * (1.0 - beyond) / self.lags().max(1) as f64).sqrt();
        self.share_outside(level) <= chance
    }

    /// Whether the largest correlation is more than chance gives signals as slow as these.
    pub fn is_beyond_chance(&self) -> bool {
        let peak = self.peak().map_or(0.0, |(_, peak)| peak.abs());
        peak > BEYOND_CHANCE * self.band
    }

    /// Lag (s) and size of the largest correlation at lags above zero.
    pub fn peak(&self) -> Option<(f64, f64)> {
        self.later().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
    }

    /// The first lag (s) above zero at which the correlation is within the band; none if
    /// there is none.
    pub fn memory(&self) -> Option<f64> {
        self.later()
            .find(|(_, value)| value.abs() <= self.band)
            .map(|(lag, _)| lag)
    }

    /// Lags above zero with their values. The residual is correlated with itself at zero
    /// by definition, and with later inputs only under a controller.
    fn later(&self) -> impl Iterator<Item = (f64, f64)> {
        let both = self.lag.iter().copied().zip(self.value.iter().copied());
        both.filter(|(lag, _)| *lag > 0.0)
    }

    /// Number of lags above zero.
    pub fn lags(&self) -> usize {
        self.later().count()
    }
}

/// Correlations of a residual.
///
/// Of the residual ε and the input u they are
///
/// ```text
/// ρ_ε(τ)  = Σ ε(t) ε(t−τ) / Σ ε²(t)
/// ρ_εu(τ) = Σ ε(t) u(t−τ) / √(Σ ε²(t) · Σ u²(t))
/// ```
///
/// over all runs together, with the mean of the input subtracted. The mean of the residual stays:
/// an offset is no noise.
///
/// For N samples of white noise, 95 % of the autocorrelations lie within ±1.96/√N. The standard
/// deviation of the cross-correlation is √(P/N) with P = Σ ρ_ε(k) ρ_u(k), since slow inputs and slow
/// residuals correlate by chance.
#[derive(Clone, Debug, PartialEq)]
pub struct Correlations {
    /// Autocorrelation of the residual, from lag zero.
    pub own: Correlation,
    /// Cross-correlation of input and residual, lags of both signs; none where the
    /// input never changes.
    pub with_input: Option<Correlation>,
    /// Samples that were used.
    pub samples: usize,
}

impl Correlations {
    /// Correlates over lags up to `longest` (s); none if there are no samples, or the
    /// residual is zero.
    pub fn of(runs: &[RunResiduals<'_>], longest: f64) -> Option<Self> {
        let duration = |run: &RunResiduals<'_>| Some(run.time.last()? - run.time.first()?);
        let longest_run = runs.iter().filter_map(duration).fold(0.0, f64::max);
        let longest = longest.min(REACH * longest_run);
        let step = step(runs, longest)?;
        let mut grids: Vec<Grid> = runs.iter().filter_map(|run| Grid::of(run, step)).collect();
        let samples: usize = grids.iter().map(|grid| grid.samples).sum();
        let most = grids.iter().map(|grid| grid.residual.len()).max()?;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let [wanted, reach] = [longest / step, REACH * most as f64].map(|count| count as usize);
        let lags = wanted.max(FEWEST_LAGS).min(reach);
        remove_mean(&mut grids);
        let residual = |grid: &Grid| grid.residual.clone();
        let input = |grid: &Grid| grid.input.clone();
        let residuals: Vec<Vec<f64>> = grids.iter().map(residual).collect();
        let inputs: Vec<Vec<f64>> = grids.iter().map(input).collect();
        let own = normalised(&residuals, &residuals, lags)?;
        let seconds = |lag: usize| lag as f64 * step;
        let with_input = normalised(&inputs, &inputs, lags).and_then(|input| {
            let after = normalised(&residuals, &inputs, lags)?;
            let before = normalised(&inputs, &residuals, lags)?;
            let later = (1..=lags).rev();
            Some(Correlation {
                lag: later
                    .clone()
                    .map(|lag| -seconds(lag))
                    .chain((0..=lags).map(seconds))
                    .collect(),
                value: later.map(|lag| before[lag]).chain(after).collect(),
                band: Level::P95.deviations * (spread(&own, &input) / samples as f64).sqrt(),
            })
        });
        Some(Self {
            own: Correlation {
                lag: (0..=lags).map(seconds).collect(),
                value: own,
                band: Level::P95.deviations / (samples as f64).sqrt(),
            },
            with_input,
            samples,
        })
    }
}

/// The common step (s) of the lags: that of the slowest run, so that nothing is
/// interpolated, or the multiple of it that [`MOST_LAGS`] requires.
fn step(runs: &[RunResiduals<'_>], longest: f64) -> Option<f64> {
    let usual = |run: &RunResiduals<'_>| {
        let mut steps: Vec<f64> = run.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
        softrig::statistics::median(&mut steps)
    };
    let slowest = runs
        .iter()
        .map(usual)
        .filter(|step| step.is_finite() && *step > 0.0)
        .reduce(f64::max)?;
    let every = (longest / (MOST_LAGS as f64 * slowest)).round().max(1.0);
    Some(every * slowest)
}

/// A run on a regular clock. Missing samples are zero, which adds nothing to a sum.
struct Grid {
    residual: Vec<f64>,
    input: Vec<f64>,
    present: Vec<bool>,
    samples: usize,
}

impl Grid {
    /// Puts each sample at the nearest tick; of several, the first. Means or interpolated
    /// values would be correlated even if the samples are not.
    fn of(run: &RunResiduals<'_>, step: f64) -> Option<Self> {
        let (first, last) = (run.time.first()?, run.time.last()?);
        // Times increase, and a recording with a gap of years is refused before.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let tick = |time: f64| ((time - first) / step).round().max(0.0) as usize;
        let ticks = tick(*last) + 1;
        let mut grid = Self {
            residual: vec![0.0; ticks],
            input: vec![0.0; ticks],
            present: vec![false; ticks],
            samples: 0,
        };
        let values = run.residual.iter().zip(run.input).zip(run.silent);
        for (time, ((&residual, &input), &silent)) in run.time.iter().zip(values) {
            let tick = tick(*time);
            if silent || grid.present[tick] || !residual.is_finite() || !input.is_finite() {
                continue;
            }
            grid.residual[tick] = residual;
            grid.input[tick] = input;
            grid.present[tick] = true;
            grid.samples += 1;
        }
        (grid.samples > 0).then_some(grid)
    }
}

/// Subtracts the mean of all runs together from the input: differences between runs are
/// part of it.
fn remove_mean(grids: &mut [Grid]) {
    let present = |grid: &Grid| -> Vec<f64> {
        let pairs = grid.input.iter().zip(&grid.present);
        pairs.filter(|(_, is)| **is).map(|(u, _)| *u).collect()
    };
    let middle = mean(&grids.iter().flat_map(present).collect::<Vec<f64>>());
    for grid in grids {
        for (input, is) in grid.input.iter_mut().zip(&grid.present) {
            if *is {
                *input -= middle;
            }
        }
    }
}

/// Σ a(t) b(t−τ) over the roots of the powers of both, for each lag from zero; none where
/// one of them is nothing.
fn normalised(a: &[Vec<f64>], b: &[Vec<f64>], lags: usize) -> Option<Vec<f64>> {
    let power = |all: &[Vec<f64>]| -> f64 { all.iter().flatten().map(|v| v * v).sum() };
    let scale = (power(a) * power(b)).sqrt();
    if !scale.is_normal() {
        return None;
    }
    let at = |lag: usize| -> f64 {
        a.iter()
            .zip(b)
            .map(|(a, b)| -> f64 { a.iter().skip(lag).zip(b).map(|(a, b)| a * b).sum() })
            .sum()
    };
    Some((0..=lags).map(|lag| at(lag) / scale).collect())
}

/// P = Σ ρ_ε(k) ρ_u(k) over both signs of k, with Bartlett weights, since far lags are
/// estimated poorly. At least that of white noise.
fn spread(residual: &[f64], input: &[f64]) -> f64 {
    let count = residual.len().min(input.len());
    let both = residual.iter().zip(input).enumerate().skip(1);
    let sum: f64 = both
        .map(|(lag, (a, b))| (1.0 - lag as f64 / count as f64) * a * b)
        .sum();
    (1.0 + 2.0 * sum).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    const STEP: f64 = 0.01;

    fn white(count: usize, seed: u64) -> Vec<f64> {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        (0..count)
            .map(|_| StandardNormal.sample(&mut random))
            .collect()
    }

    fn clock(count: usize) -> Vec<f64> {
        (0..count).map(|k| k as f64 * STEP).collect()
    }

    fn correlate(residual: &[f64], input: &[f64], longest: f64) -> Correlations {
        let time = clock(residual.len());
        let silent = vec![false; residual.len()];
        let run = RunResiduals {
            time: &time,
            residual,
            input,
            silent: &silent,
        };
        Correlations::of(&[run], longest).unwrap()
    }

    #[test]
    fn white_noise_lies_within_the_bands_at_95_percent_of_the_lags() {
        let (mut own, mut crossed) = (Vec::new(), Vec::new());
        for seed in 0..20 {
            // A slow input: the second band has to know that.
            let mut input = white(4_000, 100 + seed);
            for k in 1..input.len() {
                input[k] += 0.95 * input[k - 1];
            }
            let found = correlate(&white(4_000, seed), &input, 1.0);
            assert!((found.own.value[0] - 1.0).abs() < 1e-12);
            own.push(found.own.share_outside(Level::P95));
            crossed.push(found.with_input.unwrap().share_outside(Level::P95));
        }
        assert!((mean(&own) - 0.05).abs() < 0.015, "{}", mean(&own));
        assert!((mean(&crossed) - 0.05).abs() < 0.04, "{}", mean(&crossed));
    }

    #[test]
    fn slow_noise_and_a_slow_input_that_have_nothing_in_common_stay_in_the_band() {
        let slow = |seed| {
            let mut values = white(4_000, seed);
            for k in 1..values.len() {
                values[k] += 0.9 * values[k - 1];
            }
            values
        };
        let outside: Vec<f64> = (0..40)
            .map(|seed| {
                let found = correlate(&slow(seed), &slow(1_000 + seed), 1.0);
                found.with_input.unwrap().share_outside(Level::P95)
            })
            .collect();
        assert!((mean(&outside) - 0.05).abs() < 0.04, "{}", mean(&outside));
    }

    #[test]
    fn the_autocorrelation_of_a_sine_is_a_cosine() {
        let rate = std::f64::consts::TAU / 0.4;
        let sine: Vec<f64> = clock(40_000).iter().map(|t| (rate * t).sin()).collect();
        let found = correlate(&sine, &white(40_000, 1), 1.0).own;
        assert_eq!(found.lag.len(), 101);
        for (lag, value) in found.lag.iter().zip(&found.value) {
            assert!((value - (rate * lag).cos()).abs() < 0.01, "{lag} {value}");
        }
    }

    #[test]
    fn a_delayed_copy_peaks_at_its_delay() {
        let input = white(3_000, 7);
        let mut late = vec![0.0; 30];
        late.extend(&input[..2_970]);
        let found = correlate(&late, &input, 1.0).with_input.unwrap();
        let (lag, value) = found.peak().unwrap();
        assert!((lag - 0.3).abs() < 1e-9 && value > 0.9, "{lag} {value}");
        // The other way round it is the input that follows: at a lag below zero.
        let found = correlate(&input, &late, 1.0).with_input.unwrap();
        let (place, _) = found
            .value
            .iter()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(b.1))
            .unwrap();
        assert!((found.lag[place] + 0.3).abs() < 1e-9);
        assert!(found.share_outside(Level::P95) < 0.2);
    }

    #[test]
    fn gaps_slow_runs_and_silent_samples_are_no_correlation() {
        let residual = white(2_000, 3);
        let input = white(2_000, 4);
        let mut time = clock(2_000);
        for late in &mut time[1_000..] {
            *late += 3.0;
        }
        let mut silent = vec![false; 2_000];
        silent[200..300].fill(true);
        let run = RunResiduals {
            time: &time,
            residual: &residual,
            input: &input,
            silent: &silent,
        };
        let slow_time: Vec<f64> = (0..500).map(|k| f64::from(k) * 4.0 * STEP).collect();
        let slow = RunResiduals {
            time: &slow_time,
            residual: &residual[..500],
            input: &input[..500],
            silent: &silent[..500],
        };
        let found = Correlations::of(&[run], 1.0).unwrap();
        assert_eq!((found.samples, found.own.lags()), (1_900, 100));
        assert!(found.own.share_outside(Level::P95) < 0.12);
        let found = Correlations::of(&[run, slow], 1.0).unwrap();
        assert!((found.own.lag[1] - 4.0 * STEP).abs() < 1e-9);
        assert!(found.own.share_outside(Level::P95) < 0.2);
    }

    #[test]
    fn nothing_is_said_of_nothing() {
        let nothing = Correlations::of(&[], 1.0);
        assert_eq!(nothing, None);
        let found = correlate(&white(300, 1), &[2.0; 300], 1.0);
        assert_eq!(found.with_input, None);
        assert_eq!(found.own.lags(), 74);
        let time = clock(300);
        let flat = RunResiduals {
            time: &time,
            residual: &[0.0; 300],
            input: &[1.0; 300],
            silent: &[false; 300],
        };
        assert_eq!(Correlations::of(&[flat], 1.0), None);
    }
}
