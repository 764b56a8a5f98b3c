//! The noise floor of the recordings: the smallest residual that a model can leave.
//!
//! A model is complete when its residual cannot be distinguished from noise. The floor is
//! the noise of the angle sensor: the largest of its white noise, its slow noise at rest
//! and its quantisation. The rig's own repeatability raises it
//! ([`NoiseFloor::with_repeats`]): the spread of residuals between repeats, each simulated
//! from its own initial state and history, since repeats with different initial states
//! differ without any noise. The simulation error from noise of the measured pressure is
//! kept separately.

use std::ops::Range;

use model_core::actuator::Model;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use crate::diagnose::work::policy::{Policy, Search};
use crate::estimate::checkpoint::fingerprint;
use crate::estimate::filter::noise_floor;
use crate::estimate::fit::Fit;
use crate::estimate::fitter::Fitter;
use crate::estimate::nuisance::{Nuisance, rest_at_start};
use crate::estimate::smooth::noise_of;
use crate::estimate::{Dataset, Session};
use crate::statistics::{
    agreed_noise, coloured_rms, mean, quantisation_step, rms, standard_deviation,
};
use softrig_formats::recording::{Meta, Recording};
use softrig_formats::removed::Channel;

/// The noise floor and its sources.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseFloor {
    /// RMS over all recordings (rad).
    pub rms: f64,
    /// White noise of the angle (rad): from differences of high order, or where these disagree
    /// ([`NoiseFloor::seen_by`]) what a filter does not foresee.
    pub white: f64,
    /// Whether differences of all high orders agree on the white noise. They do not where motion,
    /// late time stamps or coarse sampling count as noise.
    pub agreed: bool,
    /// Standard deviation of residuals between repeats (rad), once a fit is known and if
    /// there are any.
    pub repeats: Option<f64>,
    /// Standard deviation about a straight line (rad) during the rest before the motion,
    /// if that is long enough. Unlike differences it includes slow noise. A disturbed rest
    /// does not count.
    pub rest: Option<f64>,
    /// Quantisation step (rad); zero if none shows.
    pub quantisation_step: f64,
    /// RMS error (rad) of a simulated angle from noise of the measured pressure; zero
    /// until a model is known, see [`NoiseFloor::with_input`].
    pub input: f64,
    /// Groups of recordings that repeat the same run, by index.
    pub groups: Vec<Vec<usize>>,
}

impl NoiseFloor {
    /// RMS error (rad) that a right model leaves: the noise of the angle, and that of the pressure
    /// in the simulation.
    pub fn total(&self) -> f64 {
        libm::hypot(self.rms, self.input)
    }

    /// Estimates the floor of a set of recordings.
    pub fn of(recordings: &[Recording]) -> Self {
        let each: Vec<f64> = recordings
            .iter()
            .map(|recording| noise_of(recording, Channel::Angle))
            .collect();
        let agreed = recordings.iter().all(|recording| {
            let (time, angle) = recording.measured(Channel::Angle);
            agreed_noise(&time, &angle).is_some()
        });
        let white = rms(&each);
        let quantisation_step = recordings
            .iter()
            .map(|recording| quantisation_step(&recording.angle))
            .fold(0.0, f64::max);
        let groups = repeats(recordings);
        let rest = noise_at_rest(recordings);
        Self {
            rms: 0.0,
            white,
            agreed,
            repeats: None,
            rest,
            quantisation_step,
            input: 0.0,
            groups,
        }
        .with_white(white)
    }

    /// The floor with another white noise (rad): the largest of its sources.
    fn with_white(self, white: f64) -> Self {
        // Quantisation noise has the RMS step/√12.
        let steps = self.quantisation_step / 12f64.sqrt();
        Self {
            rms: white.max(steps).max(self.rest.unwrap_or(0.0)),
            white,
            ..self
        }
    }

    /// The floor with the noise that a filter of the fitted model sees, where differences disagree
    /// on it: it is the smaller one, since motion can only raise both.
    pub fn seen_by(self, fit: &Fit, data: &Dataset) -> Self {
        if self.agreed {
            return self;
        }
        let Some(seen) = noise_floor(&fit.model, data, &fit.nuisances, self.white) else {
            return self;
        };
        let white = self.white.min(seen);
        self.with_white(white)
    }

    /// The floor if a structure leaves this error (rad): the noise is not more.
    #[must_use]
    pub fn at_most(self, left: f64) -> Self {
        Self {
            rms: self.rms.min(left),
            white: self.white.min(left),
            ..self
        }
    }

    /// Whether an RMS error (rad) may be noise alone.
    pub fn covers(&self, error: f64) -> bool {
        error <= self.beside_input(Policy::STANDARD.at_noise)
    }

    /// Whether what a fit leaves cannot be told from noise: neither its size nor its colour.
    pub fn is_all_that_remains(&self, fit: &Fit) -> bool {
        let coloured = coloured_rms(&fit.residuals);
        coloured <= self.beside_input(Search::STANDARD.coloured_share) && self.covers(fit.rmse())
    }

    /// A share of the floor together with what noise of the input may do (rad).
    fn beside_input(&self, share: f64) -> f64 {
        libm::hypot(share * self.rms, Search::STANDARD.input_factor * self.input)
    }

    /// The largest source of the floor, in words.
    pub fn source(&self) -> &'static str {
        let is_it = |source: Option<f64>| source.is_some_and(|source| source >= self.rms);
        if is_it(self.repeats) {
            "spread between repeats"
        } else if is_it(self.rest) && self.white < self.rms {
            "noise at rest"
        } else if self.white < self.rms {
            "steps of the converter"
        } else if self.agreed {
            "noise of the angle sensor"
        } else {
            "what a filter of the model does not foresee"
        }
    }

    /// Raises the floor to the standard deviation of a fit's residuals (one series per recording)
    /// between repeats, which no model driven by the same pressure can explain. Repeats that differ
    /// by far more than the sensor's noise have different histories, which is not noise.
    pub fn with_repeats(self, residuals: &[Vec<f64>]) -> Self {
        /// Largest multiple of the sensor's noise that counts.
        const MOST: f64 = 2.0;
        let repeats = pure_error(residuals, &self.groups);
        let scatter = repeats.unwrap_or(0.0).min(MOST * self.rms);
        Self {
            rms: self.rms.max(scatter),
            repeats,
            ..self
        }
    }

    /// Adds the error from noise of the measured pressure: the difference between
    /// simulations by the recorded pressure and by one with the same white noise added again.
    ///
    /// Fits use the measured pressure without its fastest part
    /// ([`crate::estimate::denoise`]), so even a right model has this error. It is
    /// correlated, because the actuator filters it.
    ///
    /// The noise is drawn until the RMS is known to [`INPUT_ACCURACY`], always in the same
    /// way: the floor steers the whole search, and the answer must not depend on a draw.
    pub fn with_input(self, fitter: &Fitter<'_>, fit: &Fit) -> Self {
        let calm: Vec<Calm<'_>> = fitter
            .data
            .sessions()
            .iter()
            .zip(&fit.nuisances)
            .enumerate()
            .map(|(index, (session, nuisance))| {
                let ranges = fitter.data.fitted_ranges(index);
                let pressure = &session.recording().pressure;
                Calm {
                    session,
                    nuisance,
                    noise: noise_of(session.recording(), Channel::Pressure),
                    seed: fingerprint(pressure.iter().flat_map(|sample| sample.to_le_bytes())),
                    simulated: if ranges.is_empty() {
                        Vec::new()
                    } else {
                        session.simulate(&fit.model, nuisance)
                    },
                    ranges,
                }
            })
            .filter(|calm| !calm.ranges.is_empty() && calm.noise > 0.0)
            .collect();
        let samples: usize = calm.iter().map(Calm::samples).sum();
        let mut squares: Vec<f64> = Vec::new();
        while squares.len() < MOST_DRAWS && samples > 0 {
            let batch = squares.len()..squares.len() + BATCH;
            squares.par_extend(batch.into_par_iter().map(|draw| {
                let sum: f64 = calm.iter().map(|it| it.squares(&fit.model, draw)).sum();
                sum / fitter.data.samples().max(1) as f64
            }));
            let error = standard_deviation(&squares) / (squares.len() as f64).sqrt();
            // In a sum of squares with the floor, a much smaller term hardly counts.
            let known = mean(&squares).max(SMALL * self.rms * self.rms);
            let is_beyond = mean(&squares) - 3.0 * error > self.rms * self.rms;
            if is_beyond || error <= 2.0 * INPUT_ACCURACY * known {
                break;
            }
        }
        // Differences mistake a fast pressure for noise, so the allowance is at most the
        // floor itself.
        Self {
            input: mean(&squares).sqrt().min(self.rms),
            ..self
        }
    }
}

/// Relative accuracy of the RMS error from noise of the pressure.
const INPUT_ACCURACY: f64 = 0.01;

/// Below this share of the floor, in squares, an error need not be known better.
const SMALL: f64 = 0.1;

/// Draws of the noise that are made at once, and at most.
const BATCH: usize = 8;
const MOST_DRAWS: usize = 400;

/// A session with its simulation by the recorded pressure.
struct Calm<'a> {
    session: &'a Session,
    nuisance: &'a Nuisance,
    /// White noise of the pressure (Pa).
    noise: f64,
    /// What its draws are seeded by: the recorded pressure.
    seed: u64,
    ranges: Vec<Range<usize>>,
    simulated: Vec<f64>,
}

impl Calm<'_> {
    fn samples(&self) -> usize {
        self.ranges.iter().map(ExactSizeIterator::len).sum()
    }

    /// Sum of squares (rad²) over the fitted samples of the difference that a draw of the
    /// noise makes. A session has its own draws, whatever its place among the others: so fewer
    /// are needed of many.
    fn squares(&self, model: &Model<f64>, draw: usize) -> f64 {
        let mut random = Pcg64Mcg::seed_from_u64(self.seed.wrapping_add(draw as u64));
        let pressure = self
            .session
            .recording()
            .pressure
            .iter()
            .map(|pressure| {
                let drawn: f64 = StandardNormal.sample(&mut random);
                pressure + self.noise * drawn
            })
            .collect();
        let noisy = self.session.clone().with_pressure(pressure);
        let noisy = noisy.simulate(model, self.nuisance);
        let samples = self.ranges.iter().cloned().flatten();
        samples
            .map(|k| (self.simulated[k] - noisy[k]).powi(2))
            .sum()
    }
}

/// Groups recordings with the same pressure within its noise.
pub fn repeats(recordings: &[Recording]) -> Vec<Vec<usize>> {
    let runs: Vec<NoisyRun<'_>> = recordings.iter().map(NoisyRun::of).collect();
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (index, run) in runs.iter().enumerate() {
        let found = groups.iter_mut().find(|group| {
            let first = group.first().and_then(|&first| runs.get(first));
            first.is_some_and(|first| first.is_repeated_by(run))
        });
        match found {
            Some(group) => group.push(index),
            None => groups.push(vec![index]),
        }
    }
    groups.retain(|group| group.len() > 1);
    groups
}

/// A recording with its statistics, for comparison with every other one.
struct NoisyRun<'a> {
    recording: &'a Recording,
    interval: f64,
    noise: f64,
    level: f64,
}

impl<'a> NoisyRun<'a> {
    fn of(recording: &'a Recording) -> Self {
        Self {
            recording,
            interval: recording.interval(),
            noise: noise_of(recording, Channel::Pressure),
            level: rms(&recording.pressure),
        }
    }

    /// Whether another recording is a repeat of this run.
    fn is_repeated_by(&self, other: &Self) -> bool {
        let named = |meta: &Meta| meta.protocol.clone().zip(meta.setpoint_deg);
        let (a, b) = (self.recording, other.recording);
        if let (Some(a), Some(b)) = (named(&a.meta), named(&b.meta))
            && a != b
        {
            return false;
        }
        let count = a.len().min(b.len());
        if (a.len().max(b.len()) - count) * 20 > count
            || (self.interval / other.interval - 1.0).abs() > 0.01
        {
            return false;
        }
        // Free motion has no pressure to compare, and initial states differ.
        if self.level <= 0.0 {
            return false;
        }
        let most = 1.5 * libm::hypot(self.noise, other.noise) + 0.01 * self.level;
        let most = most * most * count as f64;
        // Different runs diverge early.
        let mut sum = 0.0;
        a.pressure.iter().zip(&b.pressure).all(|(a, b)| {
            sum += (a - b).powi(2);
            sum <= most
        })
    }
}

/// Standard deviation (rad) in the initial rests of recordings, about a straight line through each:
/// creep from the run before is not noise.
fn noise_at_rest(recordings: &[Recording]) -> Option<f64> {
    /// Fewest samples of a rest.
    const FEWEST: usize = 30;
    let mut sum = 0.0;
    let mut freedom = 0;
    for recording in recordings {
        let rest = rest_at_start(recording);
        if rest >= FEWEST {
            sum += squares_about_line(&recording.time[..rest], &recording.angle[..rest]);
            freedom += rest - 2;
        }
    }
    (freedom > 0).then(|| (sum / freedom as f64).sqrt())
}

/// Sum of squares about the least-squares line of `y` over `x`.
fn squares_about_line(x: &[f64], y: &[f64]) -> f64 {
    let (mean_x, mean_y) = (mean(x), mean(y));
    let pairs = || {
        x.iter()
            .map(|x| x - mean_x)
            .zip(y.iter().map(|y| y - mean_y))
    };
    let spread: f64 = pairs().map(|(x, _)| x * x).sum();
    let slope = pairs().map(|(x, y)| x * y).sum::<f64>() / spread.max(f64::MIN_POSITIVE);
    pairs().map(|(x, y)| (y - slope * x).powi(2)).sum()
}

/// Pure error: the standard deviation of residuals (rad) within groups of repeats.
fn pure_error(residuals: &[Vec<f64>], groups: &[Vec<usize>]) -> Option<f64> {
    let mut sum = 0.0;
    let mut freedom = 0usize;
    for group in groups {
        let runs: Vec<&[f64]> = group
            .iter()
            .filter_map(|&index| residuals.get(index).map(Vec::as_slice))
            .collect();
        let shortest = runs.iter().map(|run| run.len()).min().unwrap_or(0);
        for sample in 0..shortest {
            let mean = runs.iter().map(|run| run[sample]).sum::<f64>() / runs.len() as f64;
            sum += runs
                .iter()
                .map(|run| (run[sample] - mean).powi(2))
                .sum::<f64>();
        }
        freedom += shortest * runs.len().saturating_sub(1);
    }
    (freedom > 0).then(|| (sum / freedom as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(amplitude: f64, wander: f64, seed: u64) -> Recording {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
        let time: Vec<f64> = (0..700).map(|k| f64::from(k) * 0.01).collect();
        let shift = wander * noise();
        Recording {
            pressure: time
                .iter()
                .map(|t| if *t > 0.5 { amplitude } else { 0.0 } + 300.0 * noise())
                .collect(),
            angle: time
                .iter()
                .map(|t| shift + 1.0 - (-t).exp() + 0.01 * noise())
                .collect(),
            time,
            ..Recording::default()
        }
    }

    /// The residuals of a model that explains nothing: the angles themselves.
    fn angles(recordings: &[Recording]) -> Vec<Vec<f64>> {
        recordings
            .iter()
            .map(|recording| recording.angle.clone())
            .collect()
    }

    #[test]
    fn repeats_are_recognised_by_their_pressure_and_give_pure_error() {
        let recordings = [
            step(20e3, 0.0, 1),
            step(40e3, 0.0, 2),
            step(20e3, 0.0, 3),
            step(40e3, 0.0, 4),
        ];
        let floor = NoiseFloor::of(&recordings).with_repeats(&angles(&recordings));
        assert_eq!(floor.groups, [vec![0, 2], vec![1, 3]]);
        assert!((floor.repeats.unwrap() - 0.01).abs() < 5e-4);
        assert!((floor.white - 0.01).abs() < 5e-4);
        assert!(floor.quantisation_step == 0.0);
    }

    #[test]
    fn noise_that_is_slow_shows_at_rest() {
        let wandering = |amplitude: f64| {
            let mut recordings: Vec<_> = (0..4).map(|seed| step(20e3, 0.0, seed)).collect();
            for (k, recording) in recordings.iter_mut().enumerate() {
                let mut wander = 0.0;
                let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(77 + k as u64);
                for (time, angle) in recording.time.iter().zip(&mut recording.angle) {
                    let draw: f64 = StandardNormal.sample(&mut random);
                    wander = 0.9 * wander + amplitude * (1.0_f64 - 0.81).sqrt() * draw;
                    *angle += wander;
                    // The motion begins with the pressure.
                    *angle -= 1.0 - (-time.min(0.5)).exp();
                }
            }
            NoiseFloor::of(&recordings)
        };
        let calm = wandering(0.0);
        assert!((calm.rest.unwrap() / 0.01 - 1.0).abs() < 0.15, "{calm:?}");
        let uneasy = wandering(0.007);
        assert!(uneasy.white < 0.0112, "{uneasy:?}");
        assert!(
            (uneasy.rest.unwrap() / 0.0122 - 1.0).abs() < 0.15,
            "{uneasy:?}"
        );
    }

    #[test]
    fn what_does_not_repeat_raises_the_floor() {
        let recordings: Vec<_> = (0..6).map(|seed| step(20e3, 0.05, seed)).collect();
        let sensor = NoiseFloor::of(&recordings);
        assert!(sensor.rms < 0.011, "{}", sensor.rms);
        let floor = sensor.with_repeats(&angles(&recordings));
        assert!(floor.white < 0.011);
        assert!(floor.rms > 0.02, "{}", floor.rms);
    }
}
