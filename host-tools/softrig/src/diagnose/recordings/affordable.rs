//! The part of the recordings that the time is enough for.
//!
//! A budget in time leaves out parts of the search, which is of no use where it is too short
//! for the first fit: hours of samples, for a model with five parameters. A full search on some
//! of the samples says more than the beginning of a search on all of them, so recordings are
//! shortened then, from their end: what came before a sample is never cut away.

use std::borrow::Cow;
use std::time::Duration;

use model_core::actuator::{Model, ParameterId};
use softrig_formats::numbers::spelled;
use softrig_formats::recording::Recording;

use crate::estimate::Dataset;
use crate::estimate::fit::Effort;
use crate::estimate::fitter::Fitter;
use crate::estimate::usable::{Concern, Matter};
use softrig_formats::instant::Instant;

/// Simulations of all samples, with derivatives, that a diagnosis needs, in units of one of the
/// model as it is: some thirty effects with a few starts of a dozen steps and the validation of the
/// best, and a stiff one (dry friction) takes ten times as long as the model without it.
const SIMULATIONS: f64 = 5_000.0;

/// Samples on which the time of one is measured.
const PROBE: usize = 2_000;

/// Steps of the fit that measures it, each a simulation after the first.
const STEPS: usize = 2;

/// Samples that are always used: a hundred seconds as the board records.
const FEWEST: usize = 10_000;

/// The samples of `recordings` that a diagnosis can use within `time`.
pub fn affordable(
    model: &Model<f64>,
    free: &[ParameterId],
    recordings: &[Recording],
    time: Duration,
) -> usize {
    let all: usize = recordings.iter().map(Recording::len).sum();
    let longest = recordings.iter().max_by_key(|it| it.len());
    let Some(longest) = longest.filter(|_| all > FEWEST) else {
        return all;
    };
    let probe = [longest.slice(&(0..longest.len().min(PROBE)))];
    let data = Dataset::of(&probe);
    let clock = Instant::now();
    Fitter::new(model, &data).fit(model, free, Effort::Steps(STEPS));
    let simulations = (probe[0].len() * (STEPS + 1)) as f64;
    let per_sample = clock.elapsed().as_secs_f64() / simulations;
    let enough = time.as_secs_f64() / (SIMULATIONS * per_sample);
    // Doubled rather than measured to the sample: the next run with the same fits kept is to
    // use the same samples.
    let mut samples = FEWEST;
    while samples < all && 2.0 * samples as f64 <= enough {
        samples *= 2;
    }
    samples.min(all)
}

/// The recordings with at most `samples` samples, and what was left out, if anything. Long ones
/// are shortened to one length; where that would be less than half the [`FEWEST`], some are left
/// out.
pub fn shortened(
    recordings: &[Recording],
    samples: usize,
    time: Duration,
) -> (Cow<'_, [Recording]>, Option<Concern>) {
    let all: usize = recordings.iter().map(Recording::len).sum();
    if all <= samples {
        return (Cow::Borrowed(recordings), None);
    }
    // What the short ones do not need is for the long ones.
    let mut lengths: Vec<usize> = recordings.iter().map(Recording::len).collect();
    lengths.sort_unstable();
    let most = length_of_each(&lengths, samples).max(samples.min(FEWEST) / 2);
    let mut room = samples;
    let stride = all
        .div_ceil(samples)
        .min(recordings.len().div_ceil(2))
        .max(1);
    let is_tight = lengths.iter().map(|&it| it.min(most)).sum::<usize>() > samples;
    let mut kept = Vec::new();
    for recording in recordings.iter().step_by(if is_tight { stride } else { 1 }) {
        let length = recording.len().min(most).min(room);
        if length > 0 {
            let mut part = recording.slice(&(0..length));
            let end_s = part.time.last().copied().unwrap_or(0.0);
            part.meta.segment.retain(|it| it.from_s < end_s);
            kept.push(part);
            room -= length;
        }
    }
    let used: usize = kept.iter().map(Recording::len).sum();
    let which = match (kept.len(), recordings.len()) {
        (1, 1) => "those at its beginning".to_owned(),
        (some, all) if some == all => "those at the beginning of each recording".to_owned(),
        (some, all) => format!("those at the beginning of {some} of {all} recordings"),
    };
    let text = format!(
        "the time of {} is enough for {used} of the {all} samples: {which} are used",
        spelled(time),
    );
    let advice = "give more time for all of them";
    let concern = Concern::of(Matter::TooManySamples, None, text, advice);
    (Cow::Owned(kept), Some(concern))
}

/// The length to which the longest of the sorted `lengths` are cut so that all have `samples`.
fn length_of_each(lengths: &[usize], samples: usize) -> usize {
    let mut left = samples;
    for (place, &length) in lengths.iter().enumerate() {
        let share = left / (lengths.len() - place);
        if length > share {
            return share;
        }
        left -= length;
    }
    usize::MAX
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use softrig_formats::model_file::ModelFile;
    use softrig_formats::recording::SegmentMeta;

    use super::*;

    const TIME: Duration = Duration::from_secs(20);

    fn of_length(samples: usize) -> Recording {
        let time: Vec<f64> = (0..samples).map(|k| 0.01 * k as f64).collect();
        Recording {
            pressure: time.iter().map(|t| 1e4 * t.sin()).collect(),
            angle: time.iter().map(|t| 0.3 * t.sin()).collect(),
            time,
            ..Recording::default()
        }
    }

    fn lengths(recordings: &[Recording]) -> Vec<usize> {
        recordings.iter().map(Recording::len).collect()
    }

    #[test]
    fn what_is_affordable_is_used_whole() {
        let recordings = [of_length(3_000), of_length(7_000)];
        let (used, concern) = shortened(&recordings, 10_000, TIME);
        assert_eq!((lengths(&used), concern), (vec![3_000, 7_000], None));
    }

    #[test]
    fn long_recordings_are_shortened_and_short_ones_stay() {
        let recordings = [of_length(30_000), of_length(1_000), of_length(20_000)];
        let (used, concern) = shortened(&recordings, 13_000, TIME);
        assert_eq!(lengths(&used), [6_000, 1_000, 6_000]);
        assert_eq!(
            concern.unwrap().text,
            "the time of 20 s is enough for 13000 of the 51000 samples: those at the beginning of \
             each recording are used"
        );
        let (used, concern) = shortened(&recordings[..1], 10_000, TIME);
        assert_eq!(lengths(&used), [10_000]);
        assert!(concern.unwrap().text.contains("at its beginning"));
    }

    #[test]
    fn segments_beyond_what_is_used_are_forgotten() {
        let mut session = of_length(30_000);
        session.meta.segment = [0.0, 60.0, 120.0, 240.0]
            .map(|from_s| SegmentMeta {
                from_s,
                to_s: from_s + 50.0,
                ..SegmentMeta::default()
            })
            .to_vec();
        let (used, _) = shortened(std::slice::from_ref(&session), 10_000, TIME);
        let kept: Vec<f64> = used[0].meta.segment.iter().map(|it| it.from_s).collect();
        assert_eq!(kept, [0.0, 60.0]);
    }

    #[test]
    fn of_many_recordings_some_are_left_out_evenly() {
        let recordings = vec![of_length(850); 200];
        let (used, concern) = shortened(&recordings, 10_000, TIME);
        assert_eq!(lengths(&used), [vec![850; 11], vec![650]].concat());
        assert!(concern.unwrap().text.contains("of 12 of 200 recordings"));
        // A diagnosis needs two.
        let three = vec![of_length(9_000); 3];
        let (used, _) = shortened(&three, 10_000, TIME);
        assert!(used.len() >= 2, "{:?}", lengths(&used));
    }

    #[test]
    fn any_time_is_enough_for_the_fewest_and_enough_time_for_all() {
        let text = crate::synth::example::rig_models(1, None).unwrap().model;
        let model = ModelFile::parse(&text, Path::new("m.toml")).unwrap().model;
        let free = [ParameterId::Damping, ParameterId::Stiffness];
        let recordings = [of_length(12_000)];
        let samples = |time| affordable(&model, &free, &recordings, time);
        assert_eq!(samples(Duration::ZERO), FEWEST);
        assert_eq!(samples(Duration::from_secs(1_000_000)), 12_000);
        let few = [of_length(900)];
        assert_eq!(affordable(&model, &free, &few, Duration::ZERO), 900);
    }
}
