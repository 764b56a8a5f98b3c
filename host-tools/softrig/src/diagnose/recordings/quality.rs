//! Quality of the recordings.
//!
//! A diagnosis of damaged recordings names a wrong cause with great confidence. So they
//! are examined first. Problems that can be handled are handled and reported; otherwise
//! the recording is refused, with what to record instead.

use crate::diagnose::recordings::noise::NoiseFloor;
use crate::statistics::{moves, swing};
use softrig_formats::error::InputError;
use softrig_formats::recording::Recording;

pub use crate::estimate::usable::{Concern, Matter};

/// Examines the usable runs before anything is fitted.
///
/// | problem | handling |
/// |---|---|
/// | too short to leave a part out | refused |
/// | no motion in any recording, or hardly any samples | refused |
/// | no motion in one of them | reported |
/// | units mixed up, columns exchanged | refused, with the flags that mend it ([`crate::estimate::unit_errors`]) |
/// | sensor at the end of its range, gaps, jitter, a reset | unusable samples are left out and reported ([`crate::estimate::usable`]) |
/// | moved by hand at first | used from the release on ([`crate::estimate::let_go`]) |
/// | another actuator among the recordings | left out, and named |
/// | no repeats, short runs | reported |
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
                format!(
                    "the {} does not move: {}",
                    recording.measurand.name(),
                    angles(recording)
                ),
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
    let unit = recording.measurand.unit();
    format!(
        "{} samples between {:.2}{unit} and {:.2}{unit}",
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

#[cfg(test)]
pub(crate) mod tests {
    use softrig_formats::model_file::ModelFile;

    use crate::estimate::fit::Effort;
    use crate::estimate::fitter::Fitter;
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
