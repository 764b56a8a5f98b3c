//! Quality of the recordings.
//!
//! A diagnosis of damaged recordings names a wrong cause with great confidence. So they
//! are examined first. Problems that can be handled are handled and reported; otherwise
//! the recording is refused, with what to record instead.
//!
//! | problem | handling |
//! |---|---|
//! | too short to leave a part out | refused |
//! | no motion in any recording, or hardly any samples | refused |
//! | no motion in one of them | reported |
//! | units mixed up, columns exchanged | refused, with the flags that mend it ([`crate::estimate::unit_errors`]) |
//! | sensor at the end of its range, gaps, jitter, a reset | unusable samples are left out and reported ([`crate::estimate::usable`]) |
//! | moved by hand at first | used from the release on ([`crate::estimate::let_go`]) |
//! | another actuator among the recordings | left out, and named |
//! | no repeats, short runs | reported |

use model_core::actuator::ParameterId;
use model_core::effects::Unit;

use super::candidates::Candidate;
use super::noise::NoiseFloor;
use crate::estimate::Dataset;
use crate::estimate::fit::Effort;
use crate::estimate::fitter::Fitter;
use crate::statistics::{median, moves, swing};
use softrig_formats::error::InputError;
use softrig_formats::model_file::{ModelFile, parameter_name};
use softrig_formats::recording::Recording;

pub use crate::estimate::usable::{Concern, Matter};

/// Examines the usable runs before anything is fitted.
///
/// # Errors
///
/// Refuses recordings with problems that cannot be handled.
pub fn examine(recordings: &[Recording], floor: &NoiseFloor) -> Result<Vec<Concern>, InputError> {
    /// Length (s) below which runs show no slow effects.
    const SHORT_S: f64 = 3.0;
    refuse_without_motion(recordings)?;
    let mut concerns = Vec::new();
    for recording in recordings {
        if !moves(&recording.time, &recording.angle) {
            concerns.push(Concern::of(
                Matter::NoMotion,
                Some(recording),
                format!("the angle does not move: {}", angles(recording)),
                "keep it if so little pressure moves nothing; otherwise check the angle sensor",
            ));
        }
        if !moves(&recording.time, &recording.pressure)
            && swing(&recording.pressure) > 0.0
            && recordings.len() > 1
        {
            concerns.push(Concern::of(
                Matter::ConstantPressure,
                Some(recording),
                "the pressure never changes: this run says nothing about the input path".into(),
                "keep it if it is a free swing; otherwise check the pressure sensor",
            ));
        }
    }
    if floor.groups.is_empty() && recordings.len() > 1 {
        concerns.push(Concern::of(
            Matter::NoRepeats,
            None,
            "no run was repeated, so the repeatability of the rig is not known; the noise is estimated from neighbouring samples".into(),
            "record each run twice or more",
        ));
    }
    let longest = recordings
        .iter()
        .map(Recording::duration)
        .fold(0.0, f64::max);
    if longest < SHORT_S {
        concerns.push(Concern::of(
            Matter::ShortRuns,
            None,
            format!(
                "the longest run lasts {longest:.1} s: creep, drift and leaks do not show in it"
            ),
            "hold a step for ten seconds or more, and record its release",
        ));
    }
    Ok(concerns)
}

/// The range of a recording's angle (°), in words.
fn angles(recording: &Recording) -> String {
    let angles = || recording.angle.iter().copied();
    format!(
        "{} samples between {:.2}° and {:.2}°",
        recording.len(),
        angles().fold(f64::INFINITY, f64::min).to_degrees(),
        angles().fold(f64::NEG_INFINITY, f64::max).to_degrees()
    )
}

/// Refuses recordings without any motion, with which every model agrees. A run without
/// motion among others shows that its pressure was too small, and is kept.
pub fn refuse_without_motion(recordings: &[Recording]) -> Result<(), InputError> {
    match recordings.first() {
        Some(first) if !recordings.iter().any(|it| moves(&it.time, &it.angle)) => {
            Err(InputError::new(
                format!("holds no motion: {}", angles(first)),
                "leave it out, and record a step, a staircase or a swing",
            )
            .in_file(&first.path))
        }
        _ => Ok(()),
    }
}

/// An outlying recording, which seems to be of another actuator.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlier {
    /// Its index.
    pub index: usize,
    /// The concern, if it is left out.
    pub concern: Concern,
    /// The concern, if there is no time to repeat the diagnosis without it.
    pub kept: Concern,
}

/// Looks for one recording that a structure cannot fit together with the others, although
/// the others agree without it and the structure fits it alone with other base parameters:
/// another actuator, or another sensor.
pub fn outlying_recording(
    file: &ModelFile,
    fitter: &Fitter<'_>,
    candidate: &Candidate,
    floor: &NoiseFloor,
) -> Option<Outlier> {
    /// Fewest recordings that have a majority.
    const FEWEST: usize = 4;
    /// Least ratio of its error to that of the others.
    const STANDS_OUT: f64 = 2.5;
    /// Least relative difference of parameters for another actuator.
    const DIFFERS: f64 = 0.08;
    let places: Vec<usize> = (0..candidate.fit.residuals.len()).collect();
    if places.len() < FEWEST {
        return None;
    }
    let each = crate::estimate::fit::rms_each(&candidate.fit);
    let index = (0..each.len()).max_by(|&a, &b| each[a].total_cmp(&each[b]))?;
    let mut others_each: Vec<f64> = each.clone();
    others_each.remove(index);
    if each[index] < STANDS_OUT * median(&mut others_each).max(floor.rms) / 1.5 {
        return None;
    }
    let segment = fitter.data.fitted().nth(index)?;
    let own_session = fitter.data.fitted_ranges(segment.session).len() == 1;
    if !own_session {
        // Nobody changes the actuator within a session.
        return None;
    }
    let others = fitter.data.without(&[index]);
    let nominal = fitter.nominal;
    let without =
        Fitter::new(nominal, &others).fit(&candidate.fit.model, &candidate.fit.free, Effort::Full);
    let only = fitter.data.only(&[index]);
    let alone = Fitter::new(nominal, &only);
    let predicted = alone.compare(&without.model).rmse();
    if !floor.covers(without.rmse()) || predicted < STANDS_OUT * without.rmse() {
        return None;
    }
    let own = alone.fit(&without.model, &file.free, Effort::Full);
    if !floor.covers(own.rmse()) {
        return None;
    }
    let (id, ratio) = file
        .free
        .iter()
        .filter_map(|&id| {
            let (others, own) = (without.model.value(id)?, own.model.value(id)?);
            (others.abs() > 0.0).then(|| (id, own / others))
        })
        .max_by(|a, b| {
            libm::log(a.1.abs())
                .abs()
                .total_cmp(&libm::log(b.1.abs()).abs())
        })?;
    if (ratio - 1.0).abs() < DIFFERS {
        return None;
    }
    let recording = &segment.recording;
    let why = format!(
        "the others agree among themselves to {:.2}° and miss it by {:.2}°; alone it asks for {:.2} times their {}",
        without.rmse().to_degrees(),
        predicted.to_degrees(),
        ratio,
        parameter_name(&candidate.fit.model, id)
    );
    let concern = |what: &str| {
        Concern::of(
            Matter::OtherActuator,
            Some(recording),
            format!("behaves like another actuator and {what}: {why}"),
            "check which actuator and which calibration it was recorded with",
        )
    };
    Some(Outlier {
        index,
        concern: concern("is left out"),
        kept: concern("is used all the same"),
    })
}

/// Concerns about time constants of named effects that are too long for the runs.
pub fn slow_effects(candidate: &Candidate, data: &Dataset) -> Vec<Concern> {
    /// Longest time constant that a run shows, as a share of its length.
    const SHARE: f64 = 0.7;
    let longest = data
        .sessions()
        .iter()
        .map(|session| session.recording().duration())
        .fold(0.0, f64::max);
    let model = &candidate.fit.model;
    let first = model.effects().count() - candidate.added.len();
    let mut concerns = Vec::new();
    for (offset, kind) in candidate.added.iter().enumerate() {
        for (parameter, row) in kind.parameters().iter().enumerate() {
            let id = ParameterId::Effect {
                slot: first + offset,
                parameter,
            };
            let Some(value) = model.value(id) else {
                continue;
            };
            if row.unit == Unit::Second && value > SHARE * longest {
                concerns.push(Concern {
                    matter: Matter::TimeConstant,
                    recording: None,
                    text: format!(
                        "{} of {} is {value:.0} s, longer than these runs of up to {longest:.0} s can show",
                        row.key,
                        kind.name()
                    ),
                    advice: format!("hold a step for {:.0} s and record its release", 3.0 * value),
                });
            }
        }
    }
    concerns
}

#[cfg(test)]
pub(crate) mod tests {
    use std::path::Path;

    use rand::{RngExt, SeedableRng};

    use super::*;
    use crate::estimate::Dataset;
    use crate::estimate::assemble::assemble;
    use crate::synth::example::{Hidden, make};

    /// A model and its recordings, of which nothing is missing.
    pub fn example(seed: u64) -> (ModelFile, Vec<Recording>) {
        let example = make(Hidden::Nothing, 0.4, seed).unwrap();
        let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
        let recordings = example
            .recordings
            .into_iter()
            .map(|(name, recording, _)| Recording { name, ..recording })
            .collect();
        (file, recordings)
    }

    fn concerns(recordings: &[Recording]) -> Vec<(Matter, Option<String>)> {
        let assembled = assemble(recordings, &[]).unwrap();
        let runs = assembled.data.recordings(true);
        let found = examine(&runs, &NoiseFloor::of(&runs)).unwrap();
        assembled
            .concerns
            .into_iter()
            .chain(found)
            .map(|concern| (concern.matter, concern.recording))
            .collect()
    }

    /// Keeps the samples whose number passes.
    fn keep(recording: &Recording, mut passes: impl FnMut(usize) -> bool) -> Recording {
        let kept: Vec<usize> = (0..recording.len()).filter(|&k| passes(k)).collect();
        let pick = |values: &[f64]| kept.iter().map(|&k| values[k]).collect();
        Recording {
            time: pick(&recording.time),
            pressure: pick(&recording.pressure),
            angle: pick(&recording.angle),
            ..recording.clone()
        }
    }

    #[test]
    fn good_recordings_raise_no_concern() {
        let (_, recordings) = example(21);
        assert_eq!(concerns(&recordings), []);
    }

    #[test]
    fn saturated_sensors_are_said() {
        let (file, mut recordings) = example(23);
        recordings.truncate(6);
        let high = recordings[4].angle.iter().copied().fold(0.0, f64::max);
        for angle in &mut recordings[4].angle {
            *angle = angle.min(0.8 * high);
        }
        let name = Some(recordings[4].name.clone());
        assert!(concerns(&recordings).contains(&(Matter::SaturatedAngle, name)));
        // What was cut off does not enter the fit.
        let data = Dataset::of(&recordings);
        let fitter = Fitter::new(&file.model, &data);
        let fit = fitter.fit(&file.model, &file.free, Effort::Full);
        assert!(
            fit.rmse() < 0.45f64.to_radians(),
            "{}",
            fit.rmse().to_degrees()
        );

        let highest = recordings[5].pressure.iter().copied().fold(0.0, f64::max);
        for pressure in &mut recordings[5].pressure {
            *pressure = pressure.min(0.7 * highest);
        }
        let name = Some(recordings[5].name.clone());
        assert!(concerns(&recordings).contains(&(Matter::SaturatedPressure, name)));
    }

    #[test]
    fn lost_samples_and_jitter_are_handled() {
        let (file, mut recordings) = example(24);
        recordings.truncate(4);
        recordings[0] = keep(&recordings[0], |k| k % 17 != 3 && !(200..230).contains(&k));
        for (k, time) in recordings[1].time.iter_mut().enumerate() {
            *time += 0.002 * f64::from(u8::try_from(k * 7 % 3).unwrap());
        }
        let found = concerns(&recordings);
        assert!(found.contains(&(Matter::DroppedSamples, Some(recordings[0].name.clone()))));
        assert!(found.iter().any(|(matter, _)| *matter == Matter::Jitter));
        let data = Dataset::of(&recordings);
        let fitter = Fitter::new(&file.model, &data);
        let fit = fitter.fit(&file.model, &file.free, Effort::Full);
        assert!(
            fit.rmse() < 0.6f64.to_radians(),
            "{}",
            fit.rmse().to_degrees()
        );
        // Were it bursts of a few samples, nothing could be followed.
        recordings[2] = keep(&recordings[2], |k| k % 100 < 15);
        let refused = assemble(&recordings, &[]).unwrap_err();
        assert!(refused.to_string().contains("gaps in time"), "{refused}");
    }

    #[test]
    fn another_actuator_among_good_recordings_is_named() {
        let (file, mut recordings) = example(25);
        let (_, others) = example(26);
        let index = 4;
        recordings[index] = Recording {
            name: "stranger".into(),
            ..others[index].clone()
        };
        let data = Dataset::of(&recordings);
        let fitter = Fitter::new(&file.model, &data);
        let refit = Candidate::of(0, fitter.fit(&file.model, &file.free, Effort::Full));
        let floor = NoiseFloor::of(&recordings);
        let odd = outlying_recording(&file, &fitter, &refit, &floor).unwrap();
        assert_eq!(
            (odd.index, odd.concern.recording.as_deref()),
            (index, Some("stranger"))
        );
        // Among its own kind nothing is odd.
        let (file, recordings) = example(25);
        let data = Dataset::of(&recordings);
        let fitter = Fitter::new(&file.model, &data);
        let fit = fitter.fit(&file.model, &file.free, Effort::Full);
        let refit = Candidate::of(0, fit);
        assert_eq!(outlying_recording(&file, &fitter, &refit, &floor), None);
    }

    #[test]
    fn a_run_that_does_not_move_is_kept_among_others_and_refused_alone() {
        let (_, recordings) = example(29);
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(3);
        let still = Recording {
            angle: recordings[0]
                .angle
                .iter()
                .map(|_| random.random_range(-0.005..0.005))
                .collect(),
            ..recordings[0].clone()
        };
        let found = concerns(&[still.clone(), recordings[1].clone()]);
        assert!(found.contains(&(Matter::NoMotion, Some(still.name.clone()))));
        let alone = [still.clone(), still];
        let refusal = examine(&alone, &NoiseFloor::of(&alone)).unwrap_err();
        assert!(refusal.to_string().contains("holds no motion"), "{refusal}");
    }

    #[test]
    fn runs_without_repeats_short_ones_and_constant_pressure_are_said() {
        let (_, recordings) = example(27);
        let single = [recordings[0].clone(), recordings[3].clone()];
        assert_eq!(concerns(&single), [(Matter::NoRepeats, None)]);
        let short = keep(&recordings[3], |k| k < 200);
        let found = concerns(&[short.clone(), short]);
        assert!(found.contains(&(Matter::ShortRuns, None)));
        let still = Recording {
            pressure: (0..recordings[0].len())
                .map(|k| 100.0 * (k % 2) as f64)
                .collect(),
            ..recordings[0].clone()
        };
        let name = Some(still.name.clone());
        assert!(
            concerns(&[still, recordings[1].clone()]).contains(&(Matter::ConstantPressure, name))
        );
    }
}
