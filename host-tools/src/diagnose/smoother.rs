//! Smoothed estimate of the missing force, from the measured angle.
//!
//! The missing force Q of M θ̈ = g·p − C ω − K sign(θ)|θ|ⁿ − Q is modelled as a random
//! walk. Angle, rate and Q are estimated together from the measured angle: by an extended
//! Kalman filter forwards, and the Rauch–Tung–Striebel smoother backwards (Rauch, Tung and
//! Striebel, AIAA Journal 3, 1965). No signal is differentiated, and every estimate has a
//! standard deviation. The intensity of the process noise is its maximum-likelihood
//! estimate.

use model_core::actuator::{Model, State};
use nalgebra::{Matrix3, RowVector3, Vector3};

use crate::io::recording::Recording;
use crate::sim::dual::Dual;
use crate::sim::simulate::{Grain, Signal, Stepping, advance};

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

/// Angle, rate and missing force.
type Vector = Vector3<f64>;

/// One step of the filter pass.
struct FilterStep {
    /// State before and after the measurement.
    predicted: (Vector, Matrix3<f64>),
    corrected: (Vector, Matrix3<f64>),
    /// Transition matrix from the sample before.
    transition: Matrix3<f64>,
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
}

/// Grid of the process-noise intensity, in units of the force scale per √s.
const INTENSITIES: [f64; 6] = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0];

impl Smoother<'_> {
    /// The maximum-likelihood process-noise intensity (N/√s) of `recordings`.
    pub fn likeliest_intensity(&self, recordings: &[Recording]) -> f64 {
        /// Enough samples to choose.
        const ENOUGH: usize = 4_000;
        let mut chosen: Vec<&Recording> = Vec::new();
        let mut samples = 0;
        for recording in recordings {
            if samples < ENOUGH {
                chosen.push(recording);
                samples += recording.len();
            }
        }
        INTENSITIES
            .iter()
            .map(|share| share * self.force)
            .map(|intensity| {
                let likelihood: f64 = chosen
                    .iter()
                    .map(|recording| self.filter_pass(recording, intensity).1)
                    .sum();
                (intensity, likelihood)
            })
            .filter(|(_, likelihood)| likelihood.is_finite())
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map_or(0.1 * self.force, |(intensity, _)| intensity)
    }

    /// Estimates motion and missing force of one recording.
    pub fn smooth(&self, recording: &Recording, intensity: f64) -> ForceSeries {
        let (mut steps, _) = self.filter_pass(recording, intensity);
        // A stiff model may diverge: the estimate ends there.
        let known = |at: &FilterStep| at.corrected.0.iter().all(|value| value.is_finite());
        steps.truncate(steps.iter().take_while(|at| known(at)).count());
        let mut series = ForceSeries {
            time: recording.time.clone(),
            ..ForceSeries::default()
        };
        let mut estimates: Vec<(Vector, f64)> = Vec::with_capacity(steps.len());
        let mut later: Option<(Vector, Matrix3<f64>)> = None;
        for (index, at) in steps.iter().enumerate().rev() {
            let (mut state, mut covariance) = at.corrected;
            if let (Some((next, next_covariance)), Some(after)) = (later, steps.get(index + 1)) {
                let (predicted, predicted_covariance) = after.predicted;
                if let Some(inverse) = predicted_covariance.try_inverse() {
                    let gain = covariance * after.transition.transpose() * inverse;
                    state += gain * (next - predicted);
                    covariance +=
                        gain * (next_covariance - predicted_covariance) * gain.transpose();
                }
            }
            later = Some((state, covariance));
            estimates.push((state, covariance[(2, 2)].max(0.0).sqrt()));
        }
        for (state, deviation) in estimates.into_iter().rev() {
            series.angle.push(state[0]);
            series.rate.push(state[1]);
            series.force.push(state[2]);
            series.deviation.push(deviation);
        }
        let unknown = |values: &mut Vec<f64>| values.resize(recording.len(), f64::NAN);
        unknown(&mut series.angle);
        unknown(&mut series.rate);
        unknown(&mut series.force);
        unknown(&mut series.deviation);
        series
    }

    /// The filter pass, with the log-likelihood of the angles.
    fn filter_pass(&self, recording: &Recording, intensity: f64) -> (Vec<FilterStep>, f64) {
        /// First samples, whose likelihood is not counted.
        const SETTLING: usize = 20;
        let inertia = self.model.dynamics().inertia;
        let signal = Signal::pressure(recording);
        let largest_angle = recording
            .angle
            .iter()
            .fold(0.0, |largest_angle: f64, angle| {
                angle.abs().max(largest_angle)
            });
        let stepping = Stepping::of(self.model, recording.interval(), largest_angle, Grain::Fine);
        let dual: Model<Dual<2>> = self.model.map(Dual::constant);
        let variance = self.noise.powi(2).max(1e-12);
        let observed = RowVector3::new(1.0, 0.0, 0.0);

        let first_angle = recording.angle.first().copied().unwrap_or(0.0);
        let pressure = recording.pressure.first().copied().unwrap_or(0.0);
        let mut whole: State<Dual<2>> = dual.moving(
            Dual::constant(self.model.angle_behind(first_angle)),
            Dual::constant(0.0),
            Dual::constant(pressure),
        );
        let mut state = Vector::new(whole.angle.value(), 0.0, 0.0);
        let mut covariance = Matrix3::from_diagonal(&Vector::new(
            variance,
            (0.3 * (largest_angle + 0.1)).powi(2),
            self.force.powi(2),
        ));
        let mut transition = Matrix3::identity();
        let mut steps = Vec::with_capacity(recording.len());
        let mut likelihood = 0.0;
        for sample in 0..recording.len() {
            if sample > 0 {
                let interval = recording.time[sample] - recording.time[sample - 1];
                whole.angle = Dual::variable(state[0], 0, 1.0);
                whole.rate = Dual::variable(state[1], 1, 1.0);
                let zero = Dual::constant(0.0);
                advance(&dual, &signal, sample, zero, stepping, &mut whole);
                let (angle, rate) = (whole.angle, whole.rate);
                let (by_angle, by_rate) = (angle.partials(), rate.partials());
                // The force acts beside the model's own for the whole interval.
                let push = -interval / inertia;
                transition = Matrix3::new(
                    by_angle[0],
                    by_angle[1],
                    0.5 * push * interval,
                    by_rate[0],
                    by_rate[1],
                    push,
                    0.0,
                    0.0,
                    1.0,
                );
                state = Vector::new(
                    angle.value() + 0.5 * push * interval * state[2],
                    rate.value() + push * state[2],
                    state[2],
                );
                covariance = transition * covariance * transition.transpose();
                covariance[(2, 2)] += intensity * intensity * interval;
                // The error of a linear step.
                covariance[(1, 1)] += (1e-3 * intensity / inertia * interval).powi(2);
            }
            let predicted = (state, covariance);
            let sensor = self.sensor_error(&whole, state[0]);
            let innovation = recording.angle[sample] - state[0] - sensor;
            let spread = (observed * covariance * observed.transpose())[0] + variance;
            let gain = covariance * observed.transpose() / spread;
            state += gain * innovation;
            covariance = (Matrix3::identity() - gain * observed) * covariance;
            covariance = 0.5 * (covariance + covariance.transpose());
            if sample > SETTLING {
                likelihood -= 0.5 * (innovation * innovation / spread + spread.ln());
            }
            steps.push(FilterStep {
                predicted,
                corrected: (state, covariance),
                transition,
            });
            if !state.iter().all(|value| value.is_finite()) {
                return (steps, f64::NEG_INFINITY);
            }
        }
        (steps, likelihood)
    }

    /// The error of the modelled sensor (rad).
    fn sensor_error(&self, whole: &State<Dual<2>>, angle: f64) -> f64 {
        let state = State {
            time: whole.time.value(),
            angle,
            rate: whole.rate.value(),
            hidden: whole.hidden.map(|slot| slot.map(|value| value.value())),
        };
        self.model.reading(&state) - angle
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::dynamics::Dynamics;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

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
        let smoother = Smoother {
            model: &model,
            noise: 1e-3,
            force: 1e9,
        };
        let found = smoother.smooth(&recording, 1e9);
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
        let smoother = Smoother {
            model: &model,
            noise,
            force: 1.5,
        };
        let intensity = smoother.likeliest_intensity(std::slice::from_ref(&recording));
        let found = smoother.smooth(&recording, intensity);
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
