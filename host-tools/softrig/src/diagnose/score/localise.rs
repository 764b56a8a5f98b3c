//! Localises the model error: which feature of the motion the missing force goes with.
//!
//! [`crate::diagnose::score::smoother`] estimates the missing force at every instant. Here its dependence
//! on features is measured: angle, rate and its sign, pressure and its rate, the time
//! since the last edge of the command, the time in the run, the largest angle so far, and
//! the run itself. The measure is the share of the force's variance that its means over
//! bins of a feature explain, beyond the share for pure noise. It illustrates the verdict
//! and does not decide it: candidates are simulated for that.

use std::ops::Range;
use std::sync::Arc;

use model_core::actuator::Model;

use crate::diagnose::score::smoother::{ForceSeries, Smoother};
use crate::estimate::filter::Pace;
use crate::estimate::smooth::noise_of;
use crate::estimate::{Dataset, Nuisance};
use crate::statistics::{mean, noise, rms};
use softrig_formats::measurand::Measurand;
use softrig_formats::numbers::{percent, short};
use softrig_formats::recording::Recording;
use softrig_formats::removed::Channel;

/// Bins of a feature, each with as many samples.
const BINS: usize = 16;

/// Bins of a map along each axis.
const MAP_BINS: usize = 12;

/// Samples of a feature that are drawn as dots.
const DOTS: usize = 300;

/// A feature of the motion, with the share of the missing force that it explains.
#[derive(Clone, Debug, PartialEq)]
pub struct Feature {
    /// Name, as in the catalogue's signatures.
    pub name: &'static str,
    /// Unit of the feature in [`Feature::curve`].
    pub unit: &'static str,
    /// Share of the variance of the missing force, 0 to 1.
    pub share: f64,
    /// A sentence about it.
    pub text: String,
    /// The missing force as a function of the feature.
    pub curve: Vec<CurvePoint>,
    /// Some samples: the feature and the missing force (N).
    pub dots: Vec<(f64, f64)>,
}

/// The missing force in one bin of a feature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePoint {
    /// Mean of the feature, in its unit.
    pub at: f64,
    /// Mean of the force (N).
    pub force: f64,
    /// Standard deviation of the force in the bin (N).
    pub standard_deviation: f64,
    /// Samples in the bin.
    pub samples: usize,
}

/// The missing force over two features, shown where nothing is named.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ForceMap {
    /// The features and the edges of their bins; the first lies across.
    pub axes: [MapAxis; 2],
    /// Mean force (N) in each bin, one row per bin of the first feature; none for bins
    /// with too few samples.
    pub force: Vec<Vec<Option<f64>>>,
}

/// One axis of a [`ForceMap`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapAxis {
    /// Name of the feature.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Edges of the bins, in that unit.
    pub edges: Vec<f64>,
}

/// The missing force and its features.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gap {
    /// Features, strongest first.
    pub features: Vec<Feature>,
    /// The caption of the pictures.
    pub sentences: Vec<String>,
    /// Motion and missing force of each recording.
    pub runs: Vec<ForceSeries>,
    /// Maps of the missing force over angle and rate, and over the time since the last
    /// edge of the command and the time in the run.
    pub maps: [ForceMap; 2],
    /// RMS of the missing force (N).
    pub rms: f64,
    /// The largest force of the model in these runs (N).
    pub known: f64,
    /// What the output is.
    pub measurand: Measurand,
}

/// One sample of the motion with the missing force.
struct Sample {
    force: f64,
    features: [f64; NAMES.len()],
}

/// The feature on which the runs are folded.
pub const SINCE_LAST_EDGE: &str = "time since the last command edge";

/// Name and unit of each feature.
const NAMES: [(&str, &str); 9] = [
    ("angle", "°"),
    ("angular velocity", "°/s"),
    ("sign of angular velocity", ""),
    ("pressure", "kPa"),
    ("rate of the pressure", "kPa/s"),
    (SINCE_LAST_EDGE, "s"),
    ("time in the run", "s"),
    ("largest angle so far", "°"),
    ("run", "number"),
];
const ANGLE: usize = 0;
const RATE: usize = 1;
const SIGN: usize = 2;
const SINCE_EDGE: usize = 5;
const IN_RUN: usize = 6;

/// Estimates the missing force of a fitted model and its features; `noise` is the
/// standard deviation of the measured angle (rad). Sessions are smoothed whole, with the
/// zeros in `nuisances` subtracted; features are taken from their fitted segments.
pub fn localise(model: &Model<f64>, data: &Dataset, nuisances: &[Nuisance], noise: f64) -> Gap {
    let with_zeros = || data.sessions().iter().map(Arc::as_ref).zip(nuisances);
    let known = known_force(model, with_zeros().map(|(it, zeros)| it.corrected(zeros)));
    let smoother = Smoother {
        model,
        noise: noise.max(1e-6),
        force: known,
        pace: Pace::of(data),
    };
    let intensity = smoother.likeliest_intensity(with_zeros());
    let mut runs: Vec<ForceSeries> = Vec::new();
    let count = data.fitted().map(|it| it.range.len()).sum();
    let mut all: Vec<Sample> = Vec::with_capacity(count);
    for (index, (session, nuisance)) in with_zeros().enumerate() {
        let ranges = data.fitted_ranges(index);
        if ranges.is_empty() {
            continue;
        }
        let series = smoother.smooth(session, nuisance, intensity);
        let recording = session.corrected(nuisance);
        for range in ranges {
            all.extend(samples(runs.len(), &recording, &series, &range));
            runs.push(series.slice(&range));
        }
    }
    let samples = all;
    // In a run without an edge the time since the last edge is that since its start.
    let over = if has_edges(&samples) {
        SINCE_EDGE
    } else {
        ANGLE
    };
    let forces: Vec<f64> = samples.iter().map(|sample| sample.force).collect();
    let features = features(&samples, &forces);
    let measurand = data.measurand();
    let sentences = sentences(&features, rms(&forces), known, &measurand);
    Gap {
        sentences,
        maps: [map(&samples, [ANGLE, RATE]), map(&samples, [over, IN_RUN])],
        rms: rms(&forces),
        known,
        features,
        runs,
        measurand,
    }
}

/// The largest force of spring or drive in the recordings (N).
fn known_force(model: &Model<f64>, recordings: impl Iterator<Item = Recording>) -> f64 {
    let d = model.dynamics();
    let size = |largest: f64, value: &f64| largest.max(value.abs());
    let [angle, pressure] = recordings.fold([0.0; 2], |[angle, pressure], recording| {
        [
            recording.angle.iter().fold(angle, size),
            recording.pressure.iter().fold(pressure, size),
        ]
    });
    let spring = d.stiffness * libm::pow(angle, d.exponent);
    spring.max(d.input_gain.abs() * pressure).max(1e-9)
}

/// Whether the pressure has an edge other than at the start of a run.
fn has_edges(samples: &[Sample]) -> bool {
    #[allow(clippy::float_cmp)] // The same difference of the same clock.
    samples
        .iter()
        .any(|sample| sample.features[SINCE_EDGE] != sample.features[IN_RUN])
}

/// Ranks the features by the share that they explain.
fn features(samples: &[Sample], forces: &[f64]) -> Vec<Feature> {
    let average = mean(forces);
    let total: f64 = forces.iter().map(|force| (force - average).powi(2)).sum();
    if samples.len() < 4 * BINS || total <= 0.0 {
        return Vec::new();
    }
    let mut features: Vec<(f64, Feature)> = NAMES
        .iter()
        .enumerate()
        .filter(|&(column, _)| column != SINCE_EDGE || has_edges(samples))
        .map(|(column, &(name, unit))| {
            let curve = curve(samples, column);
            let between: f64 = curve
                .iter()
                .map(|bin| bin.samples as f64 * (bin.force - average).powi(2))
                .sum();
            let share = between / total;
            let feature = Feature {
                name,
                unit,
                share,
                text: format!(
                    "{} of the force that the model lacks goes with the {name}.",
                    percent(share)
                ),
                curve,
                dots: samples
                    .iter()
                    .step_by(samples.len().div_ceil(DOTS))
                    .map(|sample| (sample.features[column], sample.force))
                    .collect(),
            };
            (share, feature)
        })
        .collect();
    // The rate includes its sign and so always explains more. Where the sign alone
    // explains nearly as much, it is the better description.
    let (sign, rate) = (features[SIGN].0, features[RATE].0);
    if sign >= 0.9 * rate {
        features[RATE].0 = rate.min(sign) * 0.999;
    }
    features.sort_by(|a, b| b.0.total_cmp(&a.0));
    features.into_iter().map(|(_, feature)| feature).collect()
}

/// The force over bins of a feature.
fn curve(samples: &[Sample], column: usize) -> Vec<CurvePoint> {
    /// Share of the range within which values are equal: how a rate rounds differs from one
    /// processor to another.
    const EQUAL: f64 = 1e-9;
    let at = |k: usize| samples[k].features[column];
    let mut order: Vec<usize> = (0..samples.len()).collect();
    order.sort_by(|&a, &b| at(a).total_cmp(&at(b)));
    let width = samples.len().div_ceil(BINS);
    let ends = order.first().zip(order.last());
    let equal = ends.map_or(0.0, |(&first, &last)| EQUAL * (at(last) - at(first)));
    let mut curve = Vec::new();
    let mut start = 0;
    while start < order.len() {
        let mut end = (start + width).min(order.len());
        // Equal values share a bin: a sign has only two.
        while end < order.len() && at(order[end]) <= at(order[end - 1]) + equal {
            end += 1;
        }
        let bin = &order[start..end];
        let forces: Vec<f64> = bin.iter().map(|&k| samples[k].force).collect();
        let places: Vec<f64> = bin.iter().map(|&k| at(k)).collect();
        let average = mean(&forces);
        let standard_deviation: Vec<f64> = forces.iter().map(|force| force - average).collect();
        curve.push(CurvePoint {
            at: mean(&places),
            force: average,
            standard_deviation: rms(&standard_deviation),
            samples: bin.len(),
        });
        start = end;
    }
    curve
}

/// Two or three sentences about the missing force.
fn sentences(features: &[Feature], missing: f64, known: f64, measurand: &Measurand) -> Vec<String> {
    /// Least share of a second feature that is mentioned.
    const WORTH_SAYING: f64 = 0.3;
    let Some(first) = features.first() else {
        return Vec::new();
    };
    let name = |feature: &Feature| measurand.named(feature.name, feature.unit).0;
    let mut sentences = vec![format!(
        "The model lacks a force of {} N RMS, {} of its largest force.",
        short(missing),
        percent(missing / known)
    )];
    if first.share < WORTH_SAYING {
        sentences.push(format!(
            "It depends on no single variable: the {} explains {} of it, all others less.",
            name(first),
            percent(first.share)
        ));
        return sentences;
    }
    sentences.push(format!(
        "{} of it goes with the {}: {}.",
        percent(first.share),
        name(first),
        shape(first, measurand)
    ));
    if let Some(second) = features
        .get(1)
        .filter(|second| second.share > WORTH_SAYING && !related(first.name, second.name))
    {
        sentences.push(format!(
            "The {} explains {} as well, so these runs do not quite separate the two.",
            name(second),
            percent(second.share)
        ));
    }
    sentences
}

/// Whether two features are equivalent.
fn related(a: &str, b: &str) -> bool {
    a.contains("velocity") && b.contains("velocity")
}

/// The shape of a curve in words.
fn shape(feature: &Feature, measurand: &Measurand) -> String {
    let curve = &feature.curve;
    let (Some(first), Some(last)) = (curve.first(), curve.last()) else {
        return String::new();
    };
    let (_, unit) = measurand.named(feature.name, feature.unit);
    let with_unit = |value: f64| {
        if unit == "°" {
            format!("{}°", short(value))
        } else {
            format!("{} {unit}", short(value))
        }
    };
    if feature.name == NAMES[SIGN].0 {
        return format!(
            "{} N while the {} falls, {} N while it grows",
            short(first.force),
            measurand.name(),
            short(last.force)
        );
    }
    let extreme = |sign: f64| {
        curve
            .iter()
            .max_by(|a, b| (sign * a.force).total_cmp(&(sign * b.force)))
            .unwrap_or(first)
    };
    let (high, low) = (extreme(1.0), extreme(-1.0));
    let range = high.force - low.force;
    let ends = (last.force - first.force).abs();
    if ends > 0.8 * range {
        let verb = if last.force > first.force {
            "grows"
        } else {
            "falls"
        };
        format!(
            "it {verb} from {} N at {} to {} N at {}",
            short(first.force),
            with_unit(first.at),
            short(last.force),
            with_unit(last.at)
        )
    } else {
        format!(
            "it is largest at {} ({} N) and smallest at {} ({} N)",
            with_unit(high.at),
            short(high.force),
            with_unit(low.at),
            short(low.force)
        )
    }
}

/// The samples of one run of a session, without the session's first samples, where the
/// estimate settles. Clock and largest angle are those of the session.
fn samples(
    number: usize,
    recording: &Recording,
    series: &ForceSeries,
    run: &Range<usize>,
) -> Vec<Sample> {
    const FINDING_ITS_WAY: usize = 10;
    let edges = edges(recording);
    let noise = noise_of(recording, Channel::Angle);
    let mut largest: f64 = 0.0;
    let mut edge = 0;
    (0..run.end.min(recording.len()))
        .filter_map(|k| {
            while edges.get(edge + 1).is_some_and(|&next| next <= k) {
                edge += 1;
            }
            let since = recording.time[k] - recording.time[edges[edge]];
            let angle = *series.angle.get(k)?;
            let rate = *series.rate.get(k)?;
            largest = largest.max(angle.abs());
            // At rest the sign of the rate is noise.
            let moves = rate.abs() > 2.0 * noise;
            let sample = Sample {
                force: *series.force.get(k)?,
                features: [
                    angle.to_degrees(),
                    rate.to_degrees(),
                    if moves { rate.signum() } else { 0.0 },
                    recording.pressure[k] / 1000.0,
                    pressure_rate(recording, k) / 1000.0,
                    since,
                    recording.time[k] - recording.time[0],
                    largest.to_degrees(),
                    (number + 1) as f64,
                ],
            };
            (k >= FINDING_ITS_WAY && run.contains(&k) && sample.force.is_finite()).then_some(sample)
        })
        .collect()
}

/// Rate of the pressure (Pa/s) about a sample, over a tenth of a second.
fn pressure_rate(recording: &Recording, k: usize) -> f64 {
    const HALF: usize = 5;
    let (from, to) = (k.saturating_sub(HALF), (k + HALF).min(recording.len() - 1));
    let span = recording.time[to] - recording.time[from];
    if span > 0.0 {
        (recording.pressure[to] - recording.pressure[from]) / span
    } else {
        0.0
    }
}

/// The missing force over two features.
fn map(samples: &[Sample], columns: [usize; 2]) -> ForceMap {
    /// Fewest samples of a bin.
    const FEWEST: usize = 3;
    let ranges = columns.map(|column| usual_range(samples, column));
    if ranges.iter().any(|(low, high)| low >= high) {
        return ForceMap::default();
    }
    let bin = |value: f64, (low, high): (f64, f64)| {
        let share = ((value - low) / (high - low)).clamp(0.0, 1.0);
        // Values beyond the range go into the outermost bins.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let bin = (share * MAP_BINS as f64) as usize;
        bin.min(MAP_BINS - 1)
    };
    let mut sum = [[(0.0, 0usize); MAP_BINS]; MAP_BINS];
    for sample in samples {
        let [across, up] = [0, 1].map(|k| bin(sample.features[columns[k]], ranges[k]));
        let cell = &mut sum[across][up];
        cell.0 += sample.force;
        cell.1 += 1;
    }
    let axis = |k: usize| {
        let (low, high) = ranges[k];
        let (name, unit) = NAMES[columns[k]];
        MapAxis {
            name,
            unit,
            edges: (0..=MAP_BINS)
                .map(|k| low + (high - low) * k as f64 / MAP_BINS as f64)
                .collect(),
        }
    };
    ForceMap {
        axes: [axis(0), axis(1)],
        force: sum
            .iter()
            .map(|row| {
                row.iter()
                    .map(|&(force, samples)| (samples >= FEWEST).then(|| force / samples as f64))
                    .collect()
            })
            .collect(),
    }
}

/// The range of a feature from its 1st to its 99th percentile: one spike of the rate
/// would squeeze everything else into one bin.
fn usual_range(samples: &[Sample], column: usize) -> (f64, f64) {
    let mut values: Vec<f64> = samples
        .iter()
        .map(|sample| sample.features[column])
        .filter(|value| value.is_finite())
        .collect();
    values.sort_by(f64::total_cmp);
    let aside = values.len() / 100;
    match (values.get(aside), values.iter().rev().nth(aside)) {
        (Some(&low), Some(&high)) => (low, high),
        _ => (0.0, 0.0),
    }
}

/// Samples at which the pressure starts to change quickly.
pub(super) fn edges(recording: &Recording) -> Vec<usize> {
    let pressure = &recording.pressure;
    let low = pressure.iter().copied().fold(f64::INFINITY, f64::min);
    let high = pressure.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let jump = (0.1 * (high - low)).max(6.0 * noise(&recording.time, pressure));
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
    use crate::sim::simulate::{InitialState, Signal, run};
    use model_core::catalogue::Kind;
    use model_core::dynamics::Dynamics;

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
            InitialState {
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
        let data = Dataset::known(recording, Nuisance::AT_ZERO);
        let gap = localise(&base, &data, &[Nuisance::AT_ZERO], 1e-4);
        let features = gap.features;
        assert_eq!(features[0].name, expected, "{features:?}");
        assert!(features[0].share > 0.8, "{features:?}");
        assert!(gap.sentences.len() >= 2);
    }

    /// A pressure has few rates, each of them many times, in whichever way it rounds.
    #[test]
    fn equal_values_share_a_bin_however_they_round() {
        let bins = |rounding: f64| -> Vec<(usize, f64)> {
            let samples: Vec<Sample> = (0..400_u32)
                .map(|k| {
                    let rate = f64::from(k % 7) * (1.0 + rounding * f64::from(k % 3));
                    let mut features = [0.0; NAMES.len()];
                    features[RATE] = rate;
                    let force = f64::from(k % 5);
                    Sample { force, features }
                })
                .collect();
            let bins = curve(&samples, RATE);
            bins.iter()
                .map(|bin| (bin.samples, bin.at.round()))
                .collect()
        };
        assert_eq!(bins(0.0).len(), 7);
        assert_eq!(bins(1e-15), bins(0.0));
    }

    #[test]
    fn a_map_has_its_forces_in_the_right_bins() {
        let samples: Vec<Sample> = (0..4_000)
            .map(|k| {
                let (angle, rate) = (f64::from(k % 40), f64::from(k / 40));
                let mut features = [0.0; NAMES.len()];
                features[ANGLE] = angle;
                features[RATE] = rate;
                let force = if angle > 20.0 && rate > 50.0 {
                    1.0
                } else {
                    -0.5
                };
                Sample { force, features }
            })
            .collect();
        let found = map(&samples, [ANGLE, RATE]);
        assert_eq!(found.axes[0].name, "angle");
        assert_eq!(found.axes[1].edges.len(), MAP_BINS + 1);
        let last = MAP_BINS - 1;
        assert_eq!(found.force[last][last], Some(1.0));
        assert_eq!(found.force[0][last], Some(-0.5));
        assert_eq!(found.force[last][0], Some(-0.5));
        assert_eq!(map(&[], [ANGLE, RATE]), ForceMap::default());
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
