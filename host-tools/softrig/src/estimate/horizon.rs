//! Prediction errors over blocks of a given length.
//!
//! A model that drifts out of phase over a whole run may be right from one swing to the
//! next, and a model that follows every swing may miss a creep. So the error is measured
//! at several horizons. Each segment is cut into blocks of that length. In each block the
//! simulation restarts with the best-fitting angle and rate, while hidden states continue
//! from the block before. Each block costs two degrees of freedom.

use std::ops::Range;

use model_core::actuator::{Model, State};
use nalgebra::{Matrix2, Vector2};

use super::dataset::{Dataset, Session};
use super::nuisance::Nuisance;
use crate::sim::dual::Dual;
use crate::sim::fixed_power::{Fixed, FixedPower};
use crate::sim::simulate::{advance, is_lost, state_at};

/// Fewest samples of a block, from which an angle and a rate are estimated.
const FEWEST: usize = 8;

/// A sum of squared errors with its degrees of freedom.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Squares {
    /// Sum of squares (rad²).
    pub sum: f64,
    /// Samples less estimated states.
    pub freedom: f64,
}

impl Squares {
    /// From residuals (rad) for which no state was estimated.
    pub fn of(residual: &[f64]) -> Self {
        Self {
            sum: residual.iter().map(|r| r * r).sum(),
            freedom: residual.len() as f64,
        }
    }

    /// The sum of both.
    pub fn with(self, other: Self) -> Self {
        Self {
            sum: self.sum + other.sum,
            freedom: self.freedom + other.freedom,
        }
    }

    /// Mean square (rad²); zero without degrees of freedom.
    pub fn mean(self) -> f64 {
        if self.freedom > 0.0 {
            self.sum / self.freedom
        } else {
            0.0
        }
    }
}

/// Squared errors over blocks of `horizon` seconds, one entry per fitted segment, or per
/// held-out segment.
pub fn block_errors(
    model: &Model<f64>,
    data: &Dataset,
    nuisances: &[Nuisance],
    horizon: f64,
    fitted: bool,
) -> Vec<Squares> {
    let dual: Model<Dual<2>> = model.map(Dual::constant);
    data.sessions()
        .iter()
        .enumerate()
        .flat_map(|(index, session)| {
            let ranges = data.ranges(index, fitted);
            if ranges.is_empty() {
                return Vec::new();
            }
            // Hidden states also run through samples that are not counted.
            let blocks = blocks(session, &ranges, horizon);
            let errors = over_blocks(&dual, session, &nuisances[index], &blocks);
            ranges
                .iter()
                .map(|range| {
                    blocks
                        .iter()
                        .zip(&errors)
                        .filter(|(block, _)| range.start <= block.start && block.end <= range.end)
                        .fold(Squares::default(), |sum, (_, squares)| sum.with(*squares))
                })
                .collect()
        })
        .collect()
}

/// Blocks of a session, none of which reaches over the end of one of `ranges`.
fn blocks(session: &Session, ranges: &[Range<usize>], horizon: f64) -> Vec<Range<usize>> {
    let samples = session.recording().len();
    // At most as many as there are.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let length =
        (horizon / session.interval()).clamp(FEWEST as f64, samples.max(FEWEST) as f64) as usize;
    let mut cuts: Vec<usize> = ranges
        .iter()
        .flat_map(|range| [range.start, range.end])
        .collect();
    cuts.extend([0, samples]);
    cuts.sort_unstable();
    cuts.dedup();
    cuts.windows(2)
        .flat_map(|pair| {
            let (from, to) = (pair[0], pair[1]);
            let count = ((to - from) / length).max(1);
            (0..count).map(move |k| {
                let at = |k: usize| from + (to - from) * k / count;
                at(k)..at(k + 1)
            })
        })
        .collect()
}

/// Squared errors of each block, from its best-fitting initial angle and rate.
fn over_blocks(
    model: &Model<Dual<2>>,
    session: &Session,
    nuisance: &Nuisance,
    blocks: &[Range<usize>],
) -> Vec<Squares> {
    /// Gauss–Newton steps of a block that begins far from where the last one ended.
    const STEPS: usize = 3;
    /// Convergence: the last step moves the initial state by less than so many times the
    /// residual's RMS.
    const NEAR: f64 = 3.0;
    let signal = session.signal();
    let zero = Dual::constant(nuisance.pressure_zero);
    let plain: Model<f64> = model.map(|value| value.value());
    let stepping = session.stepping(&plain);
    let prepared = FixedPower::of(model);
    let model = &session.placed(model);
    let model = &model.with_power(Fixed::new(prepared.as_ref()));
    let mut begin = state_at(model, signal, &session.origin(nuisance));
    let silent = session.silence();
    let measured = &session.recording().angle;
    let mut found = Vec::with_capacity(blocks.len());
    for block in blocks {
        let mut squares = Squares::default();
        for step in 0..STEPS {
            let mut state = seeded(&begin);
            let mut normal = Matrix2::<f64>::zeros();
            let mut slope = Vector2::zeros();
            let mut sum = 0.0;
            let mut count = 0;
            let mut lost = false;
            for sample in block.clone() {
                // The first sample of a block is that of its start.
                if sample > block.start {
                    advance(model, signal, sample, zero, stepping, &mut state);
                }
                lost = is_lost(state.angle);
                if lost {
                    break;
                }
                if silent[sample] {
                    continue;
                }
                let reading = model.reading(&state);
                let error = reading.value() + nuisance.angle_zero - measured[sample];
                let partials = Vector2::from(reading.partials());
                normal += partials * partials.transpose();
                slope += partials * error;
                sum += error * error;
                count += 1;
            }
            if lost {
                squares = Squares {
                    sum: f64::INFINITY,
                    freedom: 1.0,
                };
                break;
            }
            for k in 0..2 {
                normal[(k, k)] += 1e-9 * normal[(k, k)] + f64::MIN_POSITIVE;
            }
            let correction = normal
                .cholesky()
                .map_or_else(Vector2::zeros, |factor| -factor.solve(&slope));
            let left = (sum + slope.dot(&correction)).max(0.0);
            squares = Squares {
                sum: left,
                freedom: f64::from(u32::try_from(count).unwrap_or(0)) - 2.0,
            };
            let moved = (normal * correction).dot(&correction);
            if moved <= NEAR * NEAR * left || step + 1 == STEPS {
                begin = corrected(&state, correction);
                break;
            }
            begin.angle += Dual::constant(correction[0]);
            begin.rate += Dual::constant(correction[1]);
        }
        if squares.sum.is_finite() && block.end < measured.len() && !block.is_empty() {
            let mut state = begin;
            advance(model, signal, block.end, zero, stepping, &mut state);
            begin = state;
        }
        if squares.freedom < 1.0 {
            squares = Squares::default();
        }
        found.push(squares);
    }
    found
}

/// A state with angle and rate as variables of the dual numbers.
fn seeded(state: &State<Dual<2>>) -> State<Dual<2>> {
    let mut state = *state;
    state.angle = Dual::variable(state.angle.value(), 0, 1.0);
    state.rate = Dual::variable(state.rate.value(), 1, 1.0);
    for hidden in state.hidden.iter_mut().flatten() {
        *hidden = Dual::constant(hidden.value());
    }
    state
}

/// A state after a correction of its variables, to first order.
fn corrected(state: &State<Dual<2>>, correction: Vector2<f64>) -> State<Dual<2>> {
    let moved = |value: Dual<2>| {
        let [by_angle, by_rate] = value.partials();
        Dual::constant(value.value() + by_angle * correction[0] + by_rate * correction[1])
    };
    let mut state = *state;
    state.angle = moved(state.angle);
    state.rate = moved(state.rate);
    for hidden in state.hidden.iter_mut().flatten() {
        *hidden = moved(*hidden);
    }
    state
}

#[cfg(test)]
mod tests {
    use model_core::catalogue::Kind;
    use model_core::dynamics::Dynamics;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::estimate::fitter::Fitter;
    use crate::sim::simulate::{InitialState as From, Signal, run};
    use softrig_formats::recording::Recording;

    const NOISE: f64 = 0.004;

    fn model(stiffness: f64, effects: &[model_core::catalogue::Effect<f64>]) -> Model<f64> {
        let dynamics = Dynamics {
            inertia: 1.0,
            damping: 0.05,
            stiffness,
            exponent: 1.0,
            input_gain: 1e-4,
        };
        Model::new(dynamics, effects).unwrap()
    }

    /// A free swing with noise.
    fn swing(truth: &Model<f64>) -> Dataset {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(3);
        let time: Vec<f64> = (0..3_000).map(|k| f64::from(k) * 0.01).collect();
        let pressure = vec![0.0; time.len()];
        let signal = Signal::new(time.clone(), pressure.clone());
        let from = From {
            angle: 0.6,
            rate: 0.0,
        };
        let angle = run(truth, &signal, from, 4)
            .reading
            .into_iter()
            .map(|angle| {
                let draw: f64 = StandardNormal.sample(&mut random);
                angle + NOISE * draw
            })
            .collect();
        Dataset::of(&[Recording {
            time,
            pressure,
            angle,
            ..Recording::default()
        }])
    }

    fn error(model: &Model<f64>, data: &Dataset, horizon: f64) -> f64 {
        let nuisances = Fitter::new(model, data).compare(model).nuisances;
        let squares = block_errors(model, data, &nuisances, horizon, true);
        squares[0].mean().sqrt()
    }

    /// The right model leaves the noise at every horizon, degrees of freedom paid for.
    #[test]
    fn the_truth_leaves_the_noise_at_every_horizon() {
        let effect = Kind::MaxwellBranch.build(&[4.0, 0.8, 0.0]).unwrap();
        let truth = model(30.0, &[effect]);
        let data = swing(&truth);
        for horizon in [0.15, 0.6, 3.0, 100.0] {
            let error = error(&truth, &data, horizon);
            assert!((error / NOISE - 1.0).abs() < 0.06, "{horizon} s: {error}");
        }
    }

    /// A wrong frequency is invisible within a part of a swing and grows with the horizon.
    #[test]
    fn a_wrong_frequency_shows_at_long_horizons() {
        let data = swing(&model(30.0, &[]));
        let off = model(30.6, &[]);
        let errors = [0.15, 1.5, 12.0].map(|horizon| error(&off, &data, horizon));
        assert!(errors[0] < 1.2 * NOISE, "{errors:?}");
        assert!(errors[0] < errors[1] && errors[1] < errors[2], "{errors:?}");
        assert!(errors[2] > 5.0 * NOISE, "{errors:?}");
    }

    /// No block reaches into a segment that is not counted.
    #[test]
    fn blocks_end_where_segments_end() {
        let data = swing(&model(30.0, &[]));
        let session = &data.sessions()[0];
        let ranges = [100..450, 450..460, 1_000..2_000];
        let found = blocks(session, &ranges, 0.5);
        assert_eq!(found.first().map(|block| block.start), Some(0));
        assert_eq!(found.last().map(|block| block.end), Some(3_000));
        for pair in found.windows(2) {
            assert_eq!(pair[0].end, pair[1].start);
        }
        for edge in ranges.iter().flat_map(|range| [range.start, range.end]) {
            assert!(found.iter().any(|block| block.start == edge), "{edge}");
        }
    }
}
