//! Smoothed estimate of the missing force, from the measured angle.
//!
//! The missing force Q of M θ̈ = g·p − C ω − K sign(θ)|θ|ⁿ − Q is modelled as a random
//! walk. Angle, rate and Q are estimated together from the measured angle: forwards by the
//! Kalman filter of the fits ([`mod@crate::estimate::filter`]), and back over its steps by the
//! Rauch–Tung–Striebel smoother (Rauch, Tung and Striebel, AIAA Journal 3, 1965). No signal is
//! differentiated, and every estimate has a standard deviation. The intensity of the process
//! noise is its maximum-likelihood estimate.

use model_core::actuator::Model;

use crate::estimate::filter::{self, Estimate, Innovation, Level, Pace, Step};
use crate::estimate::{Nuisance, Session};
use crate::sim::dual::Dual;

/// Estimated motion and missing force of one run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ForceSeries {
    /// Time of each sample (s).
    pub time: Vec<f64>,
    /// Bending angle θ (rad).
    pub angle: Vec<f64>,
    /// Angular rate ω (rad/s).
    pub rate: Vec<f64>,
    /// Missing force Q (N), positive where it acts against growing angles.
    pub force: Vec<f64>,
    /// Standard deviation of the force (N).
    pub deviation: Vec<f64>,
}

impl ForceSeries {
    /// A range of the samples.
    pub fn slice(&self, range: &std::ops::Range<usize>) -> Self {
        let cut = |values: &[f64]| values[range.clone()].to_vec();
        Self {
            time: cut(&self.time),
            angle: cut(&self.angle),
            rate: cut(&self.rate),
            force: cut(&self.force),
            deviation: cut(&self.deviation),
        }
    }
}

/// Settings of a smoother.
#[derive(Clone, Copy, Debug)]
pub struct Smoother<'a> {
    /// The model that lacks the force.
    pub model: &'a Model<f64>,
    /// Standard deviation of the measured angle (rad).
    pub noise: f64,
    /// Scale of the forces (N).
    pub force: f64,
    /// The recorded motion.
    pub pace: Pace,
}

/// Grid of the process-noise intensity, in units of the force scale per √s.
const INTENSITIES: [f64; 6] = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0];

impl Smoother<'_> {
    /// The maximum-likelihood process-noise intensity (N/√s) of sessions with their zeros and
    /// initial states.
    pub fn likeliest_intensity<'s>(
        &self,
        sessions: impl IntoIterator<Item = (&'s Session, &'s Nuisance)>,
    ) -> f64 {
        /// Enough samples to choose.
        const ENOUGH: usize = 4_000;
        let mut chosen = Vec::new();
        let mut samples = 0;
        for (session, nuisance) in sessions {
            if samples < ENOUGH {
                chosen.push((session, nuisance));
                samples += session.recording().len();
            }
        }
        INTENSITIES
            .iter()
            .map(|share| share * self.force)
            .map(|intensity| {
                let likelihood: f64 = chosen
                    .iter()
                    .map(|(session, nuisance)| self.likelihood(session, nuisance, intensity))
                    .sum();
                (intensity, likelihood)
            })
            .filter(|(_, likelihood)| likelihood.is_finite())
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map_or(0.1 * self.force, |(intensity, _)| intensity)
    }

    /// Estimates motion and missing force of one session, its zeros subtracted.
    pub fn smooth(&self, session: &Session, nuisance: &Nuisance, intensity: f64) -> ForceSeries {
        let mut steps: Vec<Step<2>> = Vec::with_capacity(session.recording().len());
        self.walk(session, nuisance, intensity, |step| steps.push(*step));
        // A stiff model may diverge: the estimate ends there.
        let known = |at: &Step<2>| at.corrected.0.iter().all(|value| value.is_finite());
        steps.truncate(steps.iter().take_while(|at| known(at)).count());
        let mut series = ForceSeries {
            time: session.recording().time.clone(),
            ..ForceSeries::default()
        };
        let mut estimates: Vec<Estimate> = Vec::with_capacity(steps.len());
        for (index, at) in steps.iter().enumerate().rev() {
            let (mut state, mut covariance) = at.corrected;
            if let (Some((next, next_covariance)), Some(after)) =
                (estimates.last(), steps.get(index + 1))
            {
                let (predicted, predicted_covariance) = after.predicted;
                if let Some(inverse) = predicted_covariance.try_inverse() {
                    let gain = covariance * after.transition.transpose() * inverse;
                    state += gain * (next - predicted);
                    covariance +=
                        gain * (next_covariance - predicted_covariance) * gain.transpose();
                }
            }
            estimates.push((state, covariance));
        }
        for (state, covariance) in estimates.into_iter().rev() {
            series.angle.push(state[0]);
            series.rate.push(state[1]);
            series.force.push(state[2]);
            let deviation = self.noise * covariance[(2, 2)].max(0.0).sqrt();
            series.deviation.push(deviation);
        }
        let unknown = |values: &mut Vec<f64>| values.resize(series.time.len(), f64::NAN);
        unknown(&mut series.angle);
        unknown(&mut series.rate);
        unknown(&mut series.force);
        unknown(&mut series.deviation);
        series
    }

    /// The log-likelihood of the angles of a session; infinitely small if the model diverges.
    fn likelihood(&self, session: &Session, nuisance: &Nuisance, intensity: f64) -> f64 {
        /// First samples, which are not counted.
        const SETTLING: usize = 20;
        let mut sample = 0;
        let mut likelihood = 0.0;
        let passed = self.walk(session, nuisance, intensity, |step| {
            if sample > SETTLING && step.is_measured {
                let Innovation { error, variance } = step.innovation;
                let error = error.value() / self.noise;
                likelihood -= 0.5 * (error * error / variance + libm::log(variance));
            }
            sample += 1;
        });
        passed.map_or(f64::NEG_INFINITY, |()| likelihood)
    }

    /// The steps of the filter over a session. None if the model diverges.
    fn walk(
        &self,
        session: &Session,
        nuisance: &Nuisance,
        intensity: f64,
        note: impl FnMut(&Step<2>),
    ) -> Option<()> {
        let level = Level {
            intensity: intensity / self.noise,
            noise: self.noise,
            pace: self.pace,
            outlier: None,
        };
        let dual: Model<Dual<2>> = self.model.map(Dual::constant);
        let zero = Dual::constant(nuisance.pressure_zero);
        filter::walk(&dual, session, nuisance, zero, &level, 0, note)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::Dataset;
    use crate::sim::simulate::Signal;
    use model_core::dynamics::Dynamics;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use softrig_formats::recording::Recording;

    /// A model that cannot be followed leaves a series of the recording's length.
    #[test]
    fn a_model_that_diverges_is_not_known_and_no_panic() {
        let dynamics = Dynamics {
            inertia: 1e-6,
            damping: 0.0,
            stiffness: 1e9,
            exponent: 3.0,
            input_gain: 1.0,
        };
        let model: Model<f64> = Model::new(dynamics, &[]).unwrap();
        let time: Vec<f64> = (0..200).map(|k| f64::from(k) * 0.1).collect();
        let recording = Recording {
            pressure: time.iter().map(|t| 1e9 * t.sin()).collect(),
            angle: time.iter().map(|t| t.sin()).collect(),
            time,
            ..Recording::default()
        };
        let data = Dataset::known(recording, Nuisance::AT_ZERO);
        let smoother = Smoother {
            model: &model,
            noise: 1e-3,
            force: 1e9,
            pace: Pace::of(&data),
        };
        let found = smoother.smooth(&data.sessions()[0], &Nuisance::AT_ZERO, 1e9);
        assert_eq!(found.slice(&(150..200)).force.len(), 50);
    }

    /// A force that nobody modelled is found within its own error bars.
    #[test]
    fn a_hidden_sinusoidal_force_is_recovered() {
        let dynamics = Dynamics {
            inertia: 0.3,
            damping: 0.8,
            stiffness: 2.0,
            exponent: 1.6,
            input_gain: 1e-4,
        };
        let model: Model<f64> = Model::new(dynamics, &[]).unwrap();
        let noise = 0.004;
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(4);
        let time: Vec<f64> = (0..1_500).map(|k| f64::from(k) * 0.01).collect();
        let hidden = |t: f64| 0.4 * (1.1 * t).sin();
        let known: Vec<f64> = time.iter().map(|t| 1.5e4 * (1.0 - (-t).exp())).collect();
        // The force goes in as the pressure that does the same.
        let pressure: Vec<f64> = time
            .iter()
            .zip(&known)
            .map(|(t, p)| p - hidden(*t) / dynamics.input_gain)
            .collect();
        let signal = Signal::new(time.clone(), pressure);
        let start = crate::sim::simulate::InitialState {
            angle: 0.0,
            rate: 0.0,
        };
        let angle = crate::sim::simulate::run(&model, &signal, start, 4)
            .reading
            .into_iter()
            .map(|angle| {
                let draw: f64 = StandardNormal.sample(&mut random);
                angle + noise * draw
            })
            .collect();
        let recording = Recording {
            time,
            pressure: known,
            angle,
            ..Recording::default()
        };
        let data = Dataset::known(recording, Nuisance::AT_ZERO);
        let smoother = Smoother {
            model: &model,
            noise,
            force: 1.5,
            pace: Pace::of(&data),
        };
        let session = data.sessions()[0].as_ref();
        let intensity = smoother.likeliest_intensity([(session, &Nuisance::AT_ZERO)]);
        let found = smoother.smooth(session, &Nuisance::AT_ZERO, intensity);
        // Nothing comes after the last sample: it is the filter's.
        let mut last = None;
        smoother.walk(session, &Nuisance::AT_ZERO, intensity, |step| {
            last = Some(*step);
        });
        let (state, covariance) = last.unwrap().corrected;
        let end = found.force.len() - 1;
        let deviation = noise * covariance[(2, 2)].sqrt();
        assert_eq!(
            [
                found.angle[end],
                found.rate[end],
                found.force[end],
                found.deviation[end]
            ]
            .map(f64::to_bits),
            [state[0], state[1], state[2], deviation].map(f64::to_bits)
        );
        let errors: Vec<f64> = found
            .time
            .iter()
            .zip(&found.force)
            .map(|(t, force)| force - hidden(*t))
            .collect();
        let inner = &errors[50..1_450];
        assert!(
            crate::statistics::rms(inner) < 0.06,
            "{}",
            crate::statistics::rms(inner)
        );
        let covered = inner
            .iter()
            .zip(&found.deviation[50..])
            .filter(|(error, deviation)| error.abs() < 2.0 * **deviation)
            .count();
        assert!(
            covered * 10 > inner.len() * 8,
            "{covered} of {}",
            inner.len()
        );
    }
}
