//! Where the gap lives: the missing force, and what it goes with.
//!
//! The equation of motion is solved for the force that is missing at every
//! instant, Q = g·p − C ω − K sign(θ)|θ|ⁿ − M α, with angle, rate and
//! acceleration from parabolas through a moving window of the measured angle.
//! Then the share of its variance is asked that each feature of the motion
//! explains, by the scatter of its mean over bins of that feature. It is a
//! picture for people, not the basis of the verdict: that comes from
//! simulating candidates.

use crate::recording::Recording;
use crate::smooth::{Motion, half_window, motion};
use crate::statistics::{mean, noise_by_differences};
use model_core::actuator::Model;
use model_core::input::Held;

/// Bins of a feature, each with as many samples.
const BINS: usize = 16;

/// A feature of the motion and the share of the missing force that goes with
/// it.
#[derive(Clone, Debug, PartialEq)]
pub struct Feature {
    /// Name, as in the catalogue's signatures.
    pub name: &'static str,
    /// Share of the variance of the missing force, 0 to 1.
    pub share: f64,
    /// One sentence about it.
    pub text: String,
}

/// One sample of the motion with the force that is missing there.
struct Sample {
    force: f64,
    features: [f64; 6],
}

const NAMES: [&str; 6] = [
    "angle",
    "angular velocity",
    "sign of angular velocity",
    "pressure",
    "time since the last command edge",
    "time in the run",
];

/// Ranks the features by what they explain of the force that `model` lacks.
pub fn localise(model: &Model<f64>, recordings: &[Recording]) -> Vec<Feature> {
    let samples: Vec<Sample> = recordings
        .iter()
        .flat_map(|recording| missing_force(model, recording))
        .collect();
    let forces: Vec<f64> = samples.iter().map(|sample| sample.force).collect();
    let average = mean(&forces);
    let total: f64 = forces.iter().map(|force| (force - average).powi(2)).sum();
    if samples.len() < 4 * BINS || total <= 0.0 {
        return Vec::new();
    }
    let features: Vec<Feature> = NAMES
        .iter()
        .enumerate()
        .map(|(column, &name)| {
            let share = explained(&samples, column, average) / total;
            Feature {
                name,
                share,
                text: format!(
                    "{:.0} % of the force that the model lacks goes with the {name}.",
                    100.0 * share
                ),
            }
        })
        .collect();
    let share_of = |name: &str| {
        features
            .iter()
            .find(|feature| feature.name == name)
            .map_or(0.0, |feature| feature.share)
    };
    // The rate knows its own sign and so always explains more; where the sign
    // alone explains nearly as much, it is the better description.
    let sign_suffices = share_of(NAMES[2]) >= 0.9 * share_of(NAMES[1]);
    let order = |feature: &Feature| {
        if sign_suffices && feature.name == NAMES[1] {
            feature.share.min(share_of(NAMES[2])) * 0.999
        } else {
            feature.share
        }
    };
    let mut ranked: Vec<(f64, Feature)> = features
        .iter()
        .map(|feature| (order(feature), feature.clone()))
        .collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    ranked.into_iter().map(|(_, feature)| feature).collect()
}

/// Scatter of the bin means of the force over bins of a feature.
fn explained(samples: &[Sample], column: usize, average: f64) -> f64 {
    let mut order: Vec<usize> = (0..samples.len()).collect();
    order.sort_by(|&a, &b| samples[a].features[column].total_cmp(&samples[b].features[column]));
    let width = samples.len().div_ceil(BINS);
    let mut sum = 0.0;
    let mut start = 0;
    while start < order.len() {
        let mut end = (start + width).min(order.len());
        // Equal values belong to one bin: a sign has only two.
        while end < order.len()
            && samples[order[end]].features[column] <= samples[order[end - 1]].features[column]
        {
            end += 1;
        }
        let bin: Vec<f64> = order[start..end]
            .iter()
            .map(|&k| samples[k].force)
            .collect();
        sum += bin.len() as f64 * (mean(&bin) - average).powi(2);
        start = end;
    }
    sum
}

/// The missing force over one recording.
fn missing_force(model: &Model<f64>, recording: &Recording) -> Vec<Sample> {
    let half = half_window(recording);
    if recording.len() < 2 * half + 1 {
        return Vec::new();
    }
    let edges = edges(recording);
    let inertia = model.dynamics().inertia;
    (half..recording.len() - half)
        .filter_map(|k| {
            let Motion {
                angle,
                rate,
                acceleration,
            } = motion(recording, k - half, k + half + 1, k)?;
            let pressure = recording.pressure[k];
            let state = model.moving(angle, rate, pressure);
            let simulated = model.derivative(&state, &Held(pressure), 0.0).acceleration;
            let since = edges
                .iter()
                .rev()
                .find(|&&edge| edge <= k)
                .map_or(0.0, |&edge| recording.time[k] - recording.time[edge]);
            Some(Sample {
                force: inertia * (simulated - acceleration),
                features: [
                    angle,
                    rate,
                    rate.signum(),
                    pressure,
                    since,
                    recording.time[k] - recording.time[0],
                ],
            })
        })
        .collect()
}

/// Samples at which the pressure starts to change quickly.
fn edges(recording: &Recording) -> Vec<usize> {
    let pressure = &recording.pressure;
    let low = pressure.iter().copied().fold(f64::INFINITY, f64::min);
    let high = pressure.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let jump = (0.1 * (high - low)).max(6.0 * noise_by_differences(pressure));
    let mut edges = vec![0];
    for k in 5..pressure.len() {
        let moved = (pressure[k] - pressure[k - 5]).abs() > jump;
        if moved && edges.last().is_none_or(|&last| k > last + 10) {
            edges.push(k - 5);
        }
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{Signal, Start, run};
    use model_core::actuator::Dynamics;
    use model_core::catalogue::Kind;

    /// A run with a hidden effect, seen through the base model: the force has
    /// to be found where the effect puts it.
    fn where_is(kind: Kind, values: &[f64], expected: &str) {
        let dynamics = Dynamics {
            inertia: 0.3,
            damping: 0.8,
            stiffness: 2.0,
            exponent: 1.6,
            input_gain: 1e-4,
        };
        let time: Vec<f64> = (0..2_000).map(|k| f64::from(k) * 0.01).collect();
        let pressure: Vec<f64> = time
            .iter()
            .map(|t| 1.5e4 * (1.0 + (0.9 * t).sin() + 0.5 * (2.3 * t).sin()))
            .collect();
        let truth: Model<f64> = Model::new(dynamics, &[kind.build(values).unwrap()]).unwrap();
        let signal = Signal::new(time.clone(), pressure.clone());
        let angle = run(
            &truth,
            &signal,
            Start {
                angle: 0.0,
                rate: 0.0,
            },
            4,
        )
        .reading;
        let recording = Recording {
            time,
            pressure,
            angle,
            ..Recording::default()
        };
        let base: Model<f64> = Model::new(dynamics, &[]).unwrap();
        let features = localise(&base, &[recording]);
        assert_eq!(features[0].name, expected, "{features:?}");
        assert!(features[0].share > 0.8);
    }

    #[test]
    fn forces_are_found_where_they_are() {
        where_is(Kind::CubicStiffness, &[0.5], "angle");
        where_is(Kind::QuadraticDamping, &[0.5], "angular velocity");
        where_is(
            Kind::CoulombFriction,
            &[0.3, 0.001],
            "sign of angular velocity",
        );
    }
}
