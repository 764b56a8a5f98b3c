//! Subsamples of the data, for initial guesses and for ranking candidates.

use std::ops::Range;

use model_core::actuator::Model;

use super::dataset::{Dataset, Mark, Session};
use super::nuisance::Nuisance;
use crate::estimate::smooth::{half_window, motion};
use crate::sim::simulate::{Grain, InitialState, Stepping};
use crate::statistics::{noise, squares_about_mean};
use softrig_formats::recording::{Meta, Recording};

/// Cuts the fitted segments into short segments that each start from the measured motion
/// (multiple shooting), for initial guesses.
///
/// Over a whole recording a small frequency error puts simulation and measurement out of
/// phase, and the sum of squares has many local minima. Over half a swing it has one. A
/// fit to short segments is biased by the noise of their initial states and by hidden
/// states that have not built up, so it only gives initial guesses. The zeros are the
/// guesses of the sessions.
///
/// The segments last about half a swing of the `nominal` model, between 10 samples
/// and 1 s. Enough of them are taken, evenly spaced.
pub fn short_segments(data: &Dataset, nominal: &Model<f64>) -> Dataset {
    const FEWEST: f64 = 10.0;
    const LONGEST_S: f64 = 1.0;
    /// Enough samples for an initial guess.
    const ENOUGH: usize = 2_000;
    let mut short_segments = Vec::new();
    for segment in data.fitted() {
        let session = &data.sessions()[segment.session];
        let stiffness = nominal.fastest_rate(session.largest_angle()).stiffness;
        let half_swing = std::f64::consts::PI / stiffness.sqrt();
        let samples = (half_swing.min(LONGEST_S) / session.interval()).max(FEWEST);
        // At most a second of samples.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let length = samples as usize;
        let recording = &segment.recording;
        let half = half_window(recording);
        let mut begin = half;
        while begin + length < recording.len() {
            let at = motion(recording, begin - half, begin + half + 1, begin);
            if let Some(motion) = at {
                let known = Nuisance {
                    start: InitialState {
                        angle: motion.angle,
                        rate: motion.rate,
                    },
                    ..session.guess()
                };
                let clock = session.clock() + recording.time[begin] - session.recording().time[0];
                let first = segment.range.start + begin;
                let piece = cut(session, first..first + length, 1);
                short_segments.push((piece, clock, known, session));
            }
            begin += length;
        }
    }
    let samples: usize = short_segments.iter().map(|(piece, ..)| piece.len()).sum();
    let stride = samples.div_ceil(ENOUGH).max(1);
    let mut found = Dataset::default();
    for (piece, clock, known, of) in short_segments.into_iter().step_by(stride) {
        let mark = whole(&piece, true);
        let session = Session::new(piece, clock, Vec::new())
            .sampled(of.sampled_every())
            .standing(of.placement())
            .knowing(known);
        found.push(session, vec![mark]);
    }
    found.knowing(data.known_ranges())
}

/// A subsample of the sessions, to rank initial guesses and candidates before the best
/// are fitted to everything.
///
/// All sessions are thinned as far as the motion of `model` allows. If that is still more than
/// `enough` samples, sessions are taken at even distances in the list.
pub fn subsample(data: &Dataset, model: &Model<f64>, enough: usize) -> Dataset {
    let most = samples_of_fitted_sessions(data).div_ceil(enough).max(1);
    taken(data, enough, |session| most.min(coarsest(session, model)))
}

/// Samples that are enough to fit single effects: those of a dozen sessions, thinned.
pub const ENOUGH_TO_FIT: usize = 8_000;

/// Samples that are enough to rank many structures.
pub const ENOUGH_TO_RANK: usize = 3_000;

/// A part of the data on which very different models can be ranked: thinned as far as the
/// recorded motion allows, whatever a model makes of it, to `enough` samples.
pub fn reduced(data: &Dataset, enough: usize) -> Dataset {
    let most = samples_of_fitted_sessions(data).div_ceil(enough);
    if most <= 1 {
        return data.clone();
    }
    taken(data, enough, |session| redundant(session.recording(), most))
}

fn samples_of_fitted_sessions(data: &Dataset) -> usize {
    data.sessions()
        .iter()
        .enumerate()
        .filter(|(index, _)| !data.fitted_ranges(*index).is_empty())
        .map(|(_, session)| session.recording().len())
        .sum()
}

/// The session with the largest angle, and others at even distances in the list, each
/// thinned, up to `most` samples. Of a session that is too long, [`shown`] is taken.
fn taken(data: &Dataset, most: usize, thinning: impl Fn(&Session) -> usize) -> Dataset {
    /// Fewest samples of a further session.
    const FEWEST: usize = 100;
    let sessions = data.sessions();
    let with_fit: Vec<(usize, usize)> = (0..sessions.len())
        .filter(|&index| !data.fitted_ranges(index).is_empty())
        .map(|index| (index, thinning(&sessions[index])))
        .collect();
    let thinned: usize = with_fit
        .iter()
        .map(|&(index, thin)| sessions[index].recording().len() / thin)
        .sum();
    let stride = thinned.div_ceil(most).max(1);
    // What stiffens or stops shows only at large angles, maybe in a single session.
    let farthest = with_fit.iter().map(|&(index, _)| index).max_by(|&a, &b| {
        let angle = |index: usize| sessions[index].largest_angle();
        angle(a).total_cmp(&angle(b))
    });
    let mut order: Vec<(usize, (usize, usize))> = with_fit.into_iter().enumerate().collect();
    order.sort_by_key(|&(place, (index, _))| (Some(index) != farthest, place % stride, place));
    let mut parts = Vec::new();
    let mut room = most;
    for (_, (index, thin)) in order {
        let session = &sessions[index];
        if room < FEWEST.min(session.recording().len()) {
            break;
        }
        let fitted = data.fitted_ranges(index);
        for range in shown(session, &fitted, room.saturating_mul(thin)) {
            if let Some((part, marks)) = part(session, &fitted, range, thin) {
                room = room.saturating_sub(part.recording().len());
                parts.push((index, part, marks));
            }
        }
    }
    // Zeros of a fit go back to the sessions by their order.
    parts.sort_by_key(|(index, ..)| *index);
    let mut found = Dataset::default();
    for (_, part, marks) in parts {
        found.push(part, marks);
    }
    found.knowing(data.known_ranges())
}

/// The parts of a session that are taken if there is room for so many of its samples: its
/// beginning, with the history of what has one, and the surroundings of the largest fitted
/// angle, which what stiffens or stops shows in. The second begins anew.
fn shown(session: &Session, fitted: &[Range<usize>], room: usize) -> Vec<Range<usize>> {
    let angle = &session.recording().angle;
    if angle.len() <= room {
        return std::iter::once(0..angle.len()).collect();
    }
    let farthest = fitted
        .iter()
        .cloned()
        .flatten()
        .max_by(|&a, &b| angle[a].abs().total_cmp(&angle[b].abs()))
        .unwrap_or(0);
    if farthest < room {
        return std::iter::once(0..room).collect();
    }
    let half = room / 2;
    // The way there is as telling as what follows.
    let begin = farthest.saturating_sub(half / 2).max(half);
    let end = (begin + half).min(angle.len());
    vec![0..half, (end - half).max(half)..end]
}

/// A part of a session, thinned, with its fitted ranges; none where nothing of it is fitted.
fn part(
    session: &Session,
    fitted: &[Range<usize>],
    samples: Range<usize>,
    thin: usize,
) -> Option<(Session, Vec<Mark>)> {
    let place =
        |sample: usize| (sample.clamp(samples.start, samples.end) - samples.start).div_ceil(thin);
    let kept = |range: Range<usize>| place(range.start)..place(range.end);
    let marks: Vec<Mark> = fitted
        .iter()
        .cloned()
        .map(kept)
        .filter(|range| !range.is_empty())
        .map(|range| Mark {
            range,
            about: Recording::default(),
            fitted: true,
        })
        .collect();
    if marks.is_empty() {
        return None;
    }
    let silent = session.silent().iter().cloned().map(kept).collect();
    let recording = session.recording();
    let clock = session.clock() + recording.time[samples.start] - recording.time[0];
    let is_first = samples.start == 0;
    let part = Session::new(cut(session, samples, thin), clock, silent)
        .sampled(session.sampled_every())
        .standing(session.placement())
        .coarse();
    let (mut guess, mut prior) = (session.guess(), session.prior().thinned(thin));
    if !is_first {
        let anew = part.prior();
        guess.start = anew.mean.start;
        prior.mean.start = anew.mean.start;
        prior.deviation.start = anew.deviation.start;
    }
    Some((part.guessing(guess, &prior), marks))
}

/// The largest stride up to `most` at which straight lines through the samples that are left
/// meet those between.
fn redundant(recording: &Recording, most: usize) -> usize {
    /// Largest RMS error, as a share of the RMS of the signal about its mean.
    const SHARE: f64 = 0.01;
    let meets = |signal: &[f64], stride: usize| {
        let allowed = (SHARE * SHARE) * squares_about_mean(signal)
            + noise(&recording.time, signal).powi(2) * 1.5 * signal.len() as f64;
        let missed: f64 = signal
            .chunks(stride)
            .zip(signal.iter().skip(stride).step_by(stride))
            .flat_map(|(chunk, next)| {
                chunk.iter().enumerate().map(move |(k, value)| {
                    let share = k as f64 / stride as f64;
                    (chunk[0] + share * (next - chunk[0]) - value).powi(2)
                })
            })
            .sum();
        missed <= allowed
    };
    (2..=most)
        .take_while(|&stride| meets(&recording.angle, stride) && meets(&recording.pressure, stride))
        .last()
        .unwrap_or(1)
}

/// The largest stride that still shows the motion: one integration step spans it, as coarse as
/// those of a ranking, and the edges of the pressure are kept. What an effect makes faster (a
/// friction's sign, a loop that reverses) is a matter of the steps between two samples.
fn coarsest(session: &Session, model: &Model<f64>) -> usize {
    /// Longest interval (s) that keeps edges of the pressure.
    const EDGE_S: f64 = 0.05;
    /// Largest stride: enough for a recording at 10 kHz.
    const MOST: u16 = 500;
    /// Evaluations of one Runge–Kutta step.
    const ONE_STEP: usize = 4;
    (1..=MOST)
        .take_while(|&thin| {
            let interval = f64::from(thin) * session.interval();
            let stepping =
                Stepping::of_motion(model, interval, session.largest_angle(), Grain::Coarse);
            interval <= EDGE_S && stepping.evaluations() <= ONE_STEP
        })
        .last()
        .map_or(1, usize::from)
}

/// Every `stride`-th sample of a session, with the pressure denoised.
fn cut(session: &Session, samples: Range<usize>, stride: usize) -> Recording {
    let pick = |values: &[f64]| {
        let samples = samples.clone().step_by(stride);
        samples.map(|k| values[k]).collect()
    };
    let recording = session.recording();
    Recording {
        time: pick(&recording.time),
        pressure: pick(session.signal().values()),
        angle: pick(&recording.angle),
        // The rig stood as it did; what is known of the zeros is passed on beside it.
        meta: Meta {
            setup: recording.meta.setup.clone(),
            ..Meta::default()
        },
        ..Recording::default()
    }
}

fn whole(recording: &Recording, fitted: bool) -> Mark {
    Mark {
        range: 0..recording.len(),
        about: Recording::default(),
        fitted,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps that grow, 200 s at 100 Hz: the largest comes last.
    fn steps() -> Recording {
        let time: Vec<f64> = (0..20_000).map(|k| 0.01 * f64::from(k)).collect();
        let level = |t: f64| {
            if t % 20.0 < 10.0 {
                (t / 20.0).ceil()
            } else {
                0.0
            }
        };
        Recording {
            pressure: time.iter().map(|&t| 1e4 * level(t)).collect(),
            angle: time.iter().map(|&t| 0.1 * level(t)).collect(),
            time,
            ..Recording::default()
        }
    }

    #[test]
    fn the_largest_angle_of_a_long_session_is_shown() {
        let recording = steps();
        let largest = recording.angle.iter().copied().fold(0.0, f64::max);
        let data = Dataset::of(&[recording]);
        let session = &data.sessions()[0];
        let enough = 3_000;
        let part = taken(&data, enough, |_| 1);
        let samples: usize = part.sessions().iter().map(|it| it.recording().len()).sum();
        assert!(samples <= enough, "{samples}");
        let found = part.sessions().iter().map(|it| it.largest_angle());
        assert!((found.fold(0.0, f64::max) - largest).abs() < 1e-9);
        // The first part has the history, the second its own start and the rig's clock.
        let [first, second] = part.sessions() else {
            panic!("{} parts", part.sessions().len());
        };
        assert_eq!(first.guess(), session.guess());
        let begins = second.recording().time[0];
        assert!((second.clock() - session.clock() - begins).abs() < 1e-9);
        let at = session.recording().time.partition_point(|t| *t < begins);
        let there = session.recording().angle[at];
        assert!((second.guess().start.angle - there).abs() < 0.05);
    }

    #[test]
    fn the_session_with_the_largest_angle_is_among_those_taken() {
        let of_size = |size: f64| {
            let mut recording = steps();
            recording.angle.iter_mut().for_each(|angle| *angle *= size);
            recording
        };
        let sizes = [1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 1.0, 1.0];
        let data = Dataset::of(&sizes.map(of_size));
        let part = taken(&data, 5_000, |_| 10);
        assert!(part.sessions().len() < sizes.len());
        let largest = |data: &Dataset| {
            let angles = data.sessions().iter().map(|it| it.largest_angle());
            angles.fold(0.0, f64::max)
        };
        assert!((largest(&part) - largest(&data)).abs() < 1e-9);
        // Where all are taken, a fit's zeros go back to them by their order.
        let angles = |data: &Dataset| -> Vec<f64> {
            data.sessions()
                .iter()
                .map(|it| it.largest_angle())
                .collect()
        };
        assert_eq!(angles(&taken(&data, 20_000, |_| 10)), angles(&data));
    }

    #[test]
    fn a_session_that_fits_is_whole() {
        let data = Dataset::of(&[steps()]);
        let whole = taken(&data, 20_000, |_| 1);
        assert_eq!(whole.sessions().len(), 1);
        assert_eq!(whole.sessions()[0].recording().len(), 20_000);
        let thinned = taken(&data, 2_000, |_| 10);
        assert_eq!(thinned.sessions().len(), 1);
        assert_eq!(thinned.sessions()[0].recording().len(), 2_000);
    }
}
