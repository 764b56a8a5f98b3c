//! How sure is it that one structure predicts better than another?
//!
//! The samples of a recording are not independent, in two ways. A disturbance lasts, so
//! neighbouring samples say the same; and a sensor's own curve, or a formula that is
//! nearly right, is off by the same amount whenever the actuator is in the same state,
//! however often it was recorded. So samples are weighted twice in every draw of a Bayesian
//! bootstrap (Rubin, Ann. Stat. 9, 1981): by a random weight of their block of time, and by
//! one of their state: the angle, and whether it rises, falls or rests. This is the
//! pigeonhole bootstrap of Owen (Ann. Appl. Stat. 1, 2007). A gain counts as far as it
//! survives the draws.

use rand::SeedableRng;
use rand_distr::{Distribution, Exp1};
use rand_pcg::Pcg64Mcg;

use crate::statistics::{correlation_time, independent_block, standard_deviation};
use softrig_formats::recording::Recording;

/// Number of draws: a share of 5 % is known to 0.7 %.
const DRAWS: usize = 1000;

/// Bands of the angle, with as many samples each.
const BANDS: usize = 6;

/// Time over which the direction of motion is taken (s).
const DIRECTION_S: f64 = 0.1;

/// Rates below this share of their standard deviation are rest.
const RESTS: f64 = 0.3;

/// Random weights of the samples of held-out segments.
#[derive(Clone, Debug)]
pub struct Draws {
    /// The block of time and the state of each sample.
    places: Vec<(usize, usize)>,
    /// Number of blocks.
    blocks: usize,
    /// Draws the weights of the blocks. They are drawn again whenever they are asked for: over a
    /// thousand recordings they would need more memory than the recordings.
    random: Pcg64Mcg,
    /// Weights of every state, draw by draw.
    states: Vec<Vec<f64>>,
}

impl Draws {
    /// Draws weights for segments; `residuals` (rad), one series for each, are those of
    /// the best structure and give the length of the blocks.
    pub fn of(segments: &[Recording], residuals: &[Vec<f64>], seed: u64) -> Self {
        let length = independent_block(correlation_time(residuals));
        let states = states(segments);
        let mut first = 0;
        let blocks = segments.iter().flat_map(|segment| {
            let samples = segment.len();
            let count = (samples / length).max(1);
            let before = first;
            first += count;
            (0..samples).map(move |at| before + at * count / samples)
        });
        let places: Vec<(usize, usize)> = blocks.zip(states).collect();
        let random = Pcg64Mcg::seed_from_u64(seed);
        let mut after_blocks = random.clone();
        for _ in 0..DRAWS {
            weights(&mut after_blocks, first);
        }
        Self {
            blocks: first,
            random,
            states: (0..DRAWS)
                .map(|_| weights(&mut after_blocks, 3 * BANDS))
                .collect(),
            places,
        }
    }

    /// In every draw: the weighted sum of one value for each sample, and the weighted root mean
    /// square of residuals (rad).
    pub fn sums_and_errors(&self, values: &[f64], residuals: &[Vec<f64>]) -> (Vec<f64>, Vec<f64>) {
        let squares: Vec<f64> = residuals.iter().flatten().map(|r| r * r).collect();
        let tables = [values, &squares, &vec![1.0; squares.len()]].map(|it| self.table(it));
        let mut random = self.random.clone();
        self.states
            .iter()
            .map(|states| {
                let blocks = weights(&mut random, self.blocks);
                let [sum, squares, count] =
                    [0, 1, 2].map(|table| weighted(&tables[table], &blocks, states));
                (sum, (squares / count).max(0.0).sqrt())
            })
            .unzip()
    }

    /// The sum of one value for each sample, by block and state.
    fn table(&self, values: &[f64]) -> Vec<[f64; 3 * BANDS]> {
        let mut table = vec![[0.0; 3 * BANDS]; self.blocks];
        for (&(block, state), value) in self.places.iter().zip(values) {
            table[block][state] += value;
        }
        table
    }
}

/// Weights whose mean is one.
fn weights(random: &mut Pcg64Mcg, count: usize) -> Vec<f64> {
    let drawn: Vec<f64> = (0..count).map(|_| Exp1.sample(random)).collect();
    let mean = drawn.iter().sum::<f64>() / count as f64;
    drawn.into_iter().map(|weight| weight / mean).collect()
}

/// The sum over a table, with a weight for each block and each state.
fn weighted(table: &[[f64; 3 * BANDS]], blocks: &[f64], states: &[f64]) -> f64 {
    let of_block = |row: &[f64; 3 * BANDS]| -> f64 {
        row.iter()
            .zip(states)
            .map(|(sum, weight)| sum * weight)
            .sum()
    };
    table
        .iter()
        .zip(blocks)
        .map(|(row, weight)| weight * of_block(row))
        .sum()
}

/// The state at each sample, over all segments: the band of the angle, and whether it
/// rests, rises or falls.
fn states(segments: &[Recording]) -> Vec<usize> {
    let mut sorted: Vec<f64> = segments.iter().flat_map(|it| &it.angle).copied().collect();
    sorted.sort_by(f64::total_cmp);
    let limits: Vec<f64> = (1..BANDS)
        .filter_map(|band| sorted.get(sorted.len() * band / BANDS).copied())
        .collect();
    segments
        .iter()
        .flat_map(|segment| {
            let rates = rates(segment);
            let still = RESTS * standard_deviation(&rates);
            let limits = &limits;
            segment
                .angle
                .iter()
                .zip(rates)
                .map(|(angle, rate)| {
                    let band = limits.partition_point(|limit| limit <= angle);
                    let direction = if rate > still {
                        1
                    } else if rate < -still {
                        2
                    } else {
                        0
                    };
                    3 * band + direction
                })
                .collect::<Vec<_>>()
        })
        .collect()
}

/// The mean rate (rad per sample) around each sample.
fn rates(segment: &Recording) -> Vec<f64> {
    // At most the length of a recording.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let half = (DIRECTION_S / segment.interval() / 2.0).round().max(1.0) as usize;
    let last = segment.len().saturating_sub(1);
    (0..segment.len())
        .map(|at| {
            let (from, to) = (at.saturating_sub(half), (at + half).min(last));
            let over = to.saturating_sub(from).max(1) as f64;
            (segment.angle[to] - segment.angle[from]) / over
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::mean;
    use rand_distr::StandardNormal;

    /// Slow swings over the same range.
    fn swings(runs: usize) -> Vec<Recording> {
        let time: Vec<f64> = (0..1000).map(|k| 0.01 * f64::from(k)).collect();
        let angle: Vec<f64> = time.iter().map(|t| (1.3 * t).sin()).collect();
        (0..runs)
            .map(|_| Recording {
                pressure: vec![0.0; time.len()],
                time: time.clone(),
                angle: angle.clone(),
                ..Recording::default()
            })
            .collect()
    }

    fn noise(runs: usize) -> Vec<Vec<f64>> {
        let mut random = Pcg64Mcg::seed_from_u64(7);
        let mut one = || StandardNormal.sample(&mut random);
        (0..runs)
            .map(|_| (0..1000).map(|_| one()).collect())
            .collect()
    }

    /// The weighted sums of these values.
    fn sums(segments: &[Recording], residuals: &[Vec<f64>], seed: u64, values: &[f64]) -> Vec<f64> {
        let draws = Draws::of(segments, residuals, seed);
        draws.sums_and_errors(values, residuals).0
    }

    /// The standard deviation of a sum over the draws, as a share of its mean.
    fn spread(runs: usize, value: impl Fn(f64) -> f64) -> f64 {
        let segments = swings(runs);
        let values: Vec<f64> = segments
            .iter()
            .flat_map(|segment| segment.angle.iter().map(|angle| value(*angle)))
            .collect();
        let sums = sums(&segments, &noise(runs), 1, &values);
        standard_deviation(&sums) / mean(&sums)
    }

    /// Weights are one on average, so a draw is a sum of the same size.
    #[test]
    fn draws_have_the_sum_as_their_mean() {
        let segments = swings(4);
        let (sums, errors) =
            Draws::of(&segments, &noise(4), 1).sums_and_errors(&vec![0.5; 4000], &noise(4));
        assert!((mean(&sums) / 2000.0 - 1.0).abs() < 0.03, "{}", mean(&sums));
        assert!((mean(&errors) - 1.0).abs() < 0.03, "{}", mean(&errors));
    }

    /// What a formula gains in one state of the actuator is as doubtful after forty runs as
    /// after four: it may be the sensor's own curve.
    #[test]
    fn a_gain_that_returns_in_every_run_counts_once() {
        let in_one_band = |angle: f64| f64::from(u8::from(angle > 0.9));
        let [few, many] = [4, 40].map(|runs| spread(runs, in_one_band));
        assert!(many > 0.8 * few, "{few} and {many}");
        assert!(many > 2.0 * spread(40, |_| 1.0), "{many}");
    }

    /// The same seed draws the same weights.
    #[test]
    fn draws_repeat() {
        let segments = swings(2);
        let sums = |seed| sums(&segments, &noise(2), seed, &vec![1.0; 2000]);
        assert_eq!(sums(3), sums(3));
        assert_ne!(sums(3), sums(4));
    }
}
