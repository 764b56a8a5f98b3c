//! Was the base turned as the metadata say?
//!
//! A person forgets to turn the rig, or to write it down. Everything that is concluded from the
//! weight of the actuator is then wrong. So where a session is said to be turned, a weight is
//! fitted to all sessions as they are said to have stood, and once more with a group of them
//! taken otherwise: the turned ones as if they had stayed or had been turned the other way, those
//! of which nothing is said as if they had been turned like the others. What leaves less than half
//! is reported; nothing is changed.

use std::ops::Range;

use model_core::catalogue::Kind;
use rayon::prelude::*;

use crate::diagnose::fit::candidates::Candidate;
use crate::diagnose::fit::structures;
use crate::diagnose::work::budget::SearchPart;
use crate::diagnose::work::executor::{Executor, NoFit};
use crate::diagnose::work::job::Job;
use crate::estimate::checkpoint::Checkpoint;
use crate::estimate::fit::Effort;
use crate::estimate::fitter::Fitter;
use crate::estimate::usable::{Concern, Matter};
use crate::estimate::{Dataset, Session};
use softrig_formats::model_file::ModelFile;

/// A setup contradicts the stated one if it leaves at most this share of its error: a weight that
/// pulls the wrong way leaves more than no weight.
const CONTRADICTS: f64 = 0.5;

/// The sessions that contradict their setup, where one of them is said to be turned. What is
/// no more than `noise` (rad) contradicts nothing; what a model may be off without it mattering
/// does, since another effect would be named for it.
pub fn contradictions(
    file: &ModelFile,
    data: &Dataset,
    refit: &Candidate,
    noise: f64,
    job: &Job,
) -> Vec<Concern> {
    let said: Vec<f64> = data
        .sessions()
        .iter()
        .map(|it| it.placement().turned_rad)
        .collect();
    let Some(&turned) = said.iter().find(|&&turned| turned != 0.0) else {
        return Vec::new();
    };
    if !job.may_begin(SearchPart::Setups) {
        return Vec::new();
    }
    // None of these fits is asked for again.
    let checkpoint = Checkpoint::default();
    let executor = Executor::new(job, &checkpoint);
    let left = |data: &Dataset| {
        let left = with_weight(file, data, refit, executor);
        executor.reached(SearchPart::Setups, left)
    };
    let Some(as_said) = left(data).filter(|&left| left > noise) else {
        return Vec::new();
    };
    let groups = groups(data);
    let readings = groups.iter().flat_map(|group| {
        let readings = match group.said {
            Some(tilt) => [0.0, -tilt.to_radians()],
            None => [turned, -turned],
        };
        readings.map(|reading| (group, reading))
    });
    let readings: Vec<(&Group, f64)> = readings.collect();
    let best = readings
        .par_iter()
        .filter_map(|(group, reading)| {
            let taken = data.turned_as(|index, session| {
                if group.sessions.contains(&index) {
                    *reading
                } else {
                    session.placement().turned_rad
                }
            });
            let left = left(&taken)?;
            (left < CONTRADICTS * as_said).then_some((left, group, *reading))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(left, group, reading)| group.concern(data, reading, [as_said, left]))
        .into_iter()
        .collect()
}

/// What a weight leaves of the recordings (rad), or no weight if that leaves less. A refit over
/// sessions that stood differently is a poor start, so that the nominal model is another.
///
/// # Errors
///
/// [`NoFit`] where no model can be fitted, or the time is up.
fn with_weight(
    file: &ModelFile,
    data: &Dataset,
    refit: &Candidate,
    executor: Executor<'_>,
) -> Result<f64, NoFit> {
    let fitter = Fitter::new(&file.model, data);
    let without = executor.fit(&fitter, &refit.fit.model, &file.free, Effort::Full)?;
    let mut left = vec![without.rmse()];
    let mut effects = file.model.effects();
    if !effects.any(|effect| effect.kind() == Kind::Gravity) {
        let nominal = Candidate::of(0, fitter.compare(&file.model));
        for base in [refit, &nominal] {
            match structures::fit(file, data, base, &[Kind::Gravity], executor) {
                Ok(weight) => left.push(weight.fit.rmse()),
                Err(NoFit::Diverged) => {}
                Err(NoFit::NotReached) => return Err(NoFit::NotReached),
            }
        }
    }
    let finite = left.into_iter().filter(|left| left.is_finite());
    finite.reduce(f64::min).ok_or(NoFit::Diverged)
}

/// Sessions with the same stated tilt.
struct Group {
    /// The tilt that is said (°); none where nothing is said.
    said: Option<f64>,
    /// Their indices.
    sessions: Range<usize>,
}

/// Sittings, which are consecutive sessions with the same stated tilt, and each session of a
/// sitting on its own.
fn groups(data: &Dataset) -> Vec<Group> {
    let tilt = |session: &Session| session.recording().meta.setup.as_ref()?.tilt_deg;
    let said: Vec<Option<f64>> = data.sessions().iter().map(|it| tilt(it)).collect();
    let mut groups = Vec::new();
    let mut begin = 0;
    for sitting in said.chunk_by(|a, b| a == b) {
        let members = begin..begin + sitting.len();
        begin = members.end;
        // Where the base is said not to have been turned, nothing else is supposed.
        if sitting[0] == Some(0.0) {
            continue;
        }
        let of = |sessions: Range<usize>| Group {
            said: sitting[0],
            sessions,
        };
        groups.push(of(members.clone()));
        if members.len() > 1 {
            groups.extend(members.map(|index| of(index..index + 1)));
        }
    }
    groups
}

impl Group {
    /// What is to be said where it behaves as if the base was turned by `reading` (rad).
    fn concern(&self, data: &Dataset, reading: f64, [as_said, left]: [f64; 2]) -> Concern {
        let first = data.sessions().get(self.sessions.start);
        let first = first.map(|session| session.recording());
        let others = match self.sessions.len() - 1 {
            0 => String::new(),
            1 => "and another recording: ".to_owned(),
            more => format!("and {more} other recordings: "),
        };
        let errors = format!(
            "a weight then leaves {:.2}° instead of {:.2}°",
            left.to_degrees(),
            as_said.to_degrees()
        );
        let taken = if reading == 0.0 {
            "was not turned".to_owned()
        } else {
            format!("was turned by {}°", reading.to_degrees().round())
        };
        let (said, advice) = match self.said {
            Some(tilt) => (
                format!("the stated turn of the base is {tilt}°"),
                "correct tilt_deg in the metadata, positive in the direction in which it bends; if it \
                 is right, no weight acts on the actuator",
            ),
            None => (
                "no turn of the base is stated".to_owned(),
                "if it was, write tilt_deg below [setup] in the metadata",
            ),
        };
        let text = format!("{others}{said}, and the actuator behaves as if it {taken}: {errors}");
        Concern::of(Matter::Turned, first, text, advice)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use model_core::actuator::Model;
    use softrig_formats::recording::Recording;
    use softrig_formats::setup::Setup;

    use super::*;
    use crate::diagnose::fit::identifiability;
    use crate::estimate::Nuisance;
    use crate::synth::example::{Hidden, make};

    /// What is said of steps at several levels, of an actuator with a weight on a base that is
    /// turned by `turned` and said to be turned by `said` (°), sitting by sitting.
    fn said(turned: &[f64], said: &[Option<f64>]) -> Vec<String> {
        let example = make(Hidden::Effect(Kind::Gravity), 0.05, 6).unwrap();
        let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
        let truth = ModelFile::parse(&example.truth, Path::new("truth.toml")).unwrap();
        // A third as heavy as the spring is stiff at a radian.
        let dynamics = *truth.model.dynamics();
        let gravity = Kind::Gravity.build(&[0.3 * dynamics.stiffness, 0.0, 0.0, 1.0]);
        let truth = Model::new(dynamics, &[gravity.unwrap()]).unwrap();
        let levels = example
            .recordings
            .iter()
            .filter(|(name, ..)| name.starts_with("step"))
            .step_by(2);
        let runs: Vec<&Recording> = levels.map(|(_, recording, _)| recording).collect();
        let sittings = turned.iter().zip(said);
        let recordings: Vec<Recording> = sittings
            .enumerate()
            .flat_map(|(number, (turned, &said))| {
                let truth = &truth;
                runs.iter().map(move |&run| {
                    let mut recording = run.clone();
                    recording.name = format!("{}_{number}", run.name);
                    recording.meta.setup = Some(Setup {
                        tilt_deg: said,
                        ..Setup::default()
                    });
                    let of = Dataset::of(std::slice::from_ref(&recording));
                    let stood = of.turned_as(|_, _| turned.to_radians());
                    recording.angle = stood.sessions()[0].simulate(truth, &Nuisance::AT_ZERO);
                    recording
                })
            })
            .collect();
        let data = Dataset::of(&recordings);
        let fitter = Fitter::new(&file.model, &data);
        let refitted = identifiability::refit(&file, &fitter).unwrap();
        contradictions(
            &refitted.file,
            &data,
            &refitted.refit,
            1e-4,
            &Job::default(),
        )
        .iter()
        .map(ToString::to_string)
        .collect()
    }

    #[test]
    fn who_forgets_to_turn_the_base_is_told() {
        let found = said(&[90.0, 0.0, 0.0], &[Some(90.0), None, Some(90.0)]);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(
            found[0].contains("_2: and 4 other recordings: the stated turn of the base is 90°"),
            "{found:?}"
        );
        assert!(found[0].contains("as if it was not turned"), "{found:?}");
    }

    #[test]
    fn who_forgets_to_write_it_down_is_told() {
        let found = said(&[0.0, 90.0, 90.0], &[Some(0.0), None, Some(90.0)]);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].contains("_1: and"), "{found:?}");
        assert!(found[0].contains("as if it was turned by 90°"), "{found:?}");
    }

    #[test]
    fn who_turns_the_base_the_other_way_is_told() {
        let found = said(&[0.0, -90.0], &[None, Some(90.0)]);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(
            found[0].contains("stated turn of the base is 90°"),
            "{found:?}"
        );
        assert!(
            found[0].contains("as if it was turned by -90°"),
            "{found:?}"
        );
    }

    #[test]
    fn what_stands_as_it_is_said_contradicts_nothing() {
        let none: [String; 0] = [];
        assert_eq!(said(&[0.0, 90.0], &[None, Some(90.0)]), none);
        assert_eq!(said(&[0.0, 0.0], &[None, None]), none);
    }
}
