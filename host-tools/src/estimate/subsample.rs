//! Subsamples of the data, for initial guesses and for ranking candidates.

use std::ops::Range;

use model_core::actuator::Model;

use super::dataset::{Dataset, Mark, Session};
use super::nuisance::Nuisance;
use crate::estimate::smooth::{half_window, motion};
use crate::io::recording::Recording;
use crate::sim::simulate::{InitialState, substeps};
use crate::statistics::{noise_by_differences, squares_about_mean};

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
                short_segments.push((piece, clock, known, session.sampled_every()));
            }
            begin += length;
        }
    }
    let samples: usize = short_segments.iter().map(|(piece, ..)| piece.len()).sum();
    let stride = samples.div_ceil(ENOUGH).max(1);
    let mut found = Dataset::default();
    for (piece, clock, known, every) in short_segments.into_iter().step_by(stride) {
        let mark = whole(&piece, true);
        let session = Session::new(piece, clock, Vec::new())
            .sampled(every)
            .knowing(known);
        found.push(session, vec![mark]);
    }
    found.knowing(data.known_ranges())
}

/// A subsample of the sessions, to rank initial guesses and candidates before the best
/// are fitted to everything.
///
/// All sessions are thinned as far as the motion of `model` allows. If that is still too
/// much, sessions are taken at even distances in the list.
pub fn subsample(data: &Dataset, model: &Model<f64>) -> Dataset {
    /// Enough samples to rank.
    const ENOUGH: usize = 3_000;
    let enough = samples_of_fitted_sessions(data).div_ceil(ENOUGH).max(1);
    taken(data, ENOUGH, |session| enough.min(coarsest(session, model)))
}

/// A part of the data on which very different models can be ranked: thinned as far as the
/// recorded motion allows, whatever a model makes of it.
pub fn reduced(data: &Dataset) -> Dataset {
    /// Enough samples to tell models apart.
    const ENOUGH: usize = 5_000;
    let enough = samples_of_fitted_sessions(data).div_ceil(ENOUGH);
    if enough <= 1 {
        return data.clone();
    }
    taken(data, ENOUGH, |session| {
        redundant(session.recording(), enough)
    })
}

fn samples_of_fitted_sessions(data: &Dataset) -> usize {
    data.sessions()
        .iter()
        .enumerate()
        .filter(|(index, _)| !data.fitted_ranges(*index).is_empty())
        .map(|(_, session)| session.recording().len())
        .sum()
}

/// Sessions at even distances in the list, each thinned, up to `most` samples. A session that
/// is too long is cut at its end, so that its history is kept.
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
    let mut order: Vec<(usize, (usize, usize))> = with_fit.into_iter().enumerate().collect();
    order.sort_by_key(|(place, _)| (place % stride, *place));
    let mut found = Dataset::default();
    let mut room = most;
    for (_, (index, thin)) in order {
        let session = &sessions[index];
        let length = session.recording().len();
        if room < FEWEST.min(length) {
            break;
        }
        let end = length.min(room * thin);
        let thinned = cut(session, 0..end, thin);
        let kept = |range: Range<usize>| {
            range.start.min(end).div_ceil(thin)..range.end.min(end).div_ceil(thin)
        };
        let silent = session.silent().iter().cloned().map(kept).collect();
        let marks: Vec<Mark> = data
            .fitted_ranges(index)
            .into_iter()
            .map(kept)
            .filter(|range| !range.is_empty())
            .map(|range| Mark {
                range,
                about: Recording::default(),
                fitted: true,
            })
            .collect();
        if marks.is_empty() {
            continue;
        }
        room = room.saturating_sub(thinned.len());
        let mut part = Session::new(thinned, session.clock(), silent)
            .sampled(session.sampled_every())
            .coarse();
        part = part.guessing(session.guess(), &session.prior().thinned(thin));
        found.push(part, marks);
    }
    found.knowing(data.known_ranges())
}

/// The largest stride up to `most` at which straight lines through the samples that are left
/// meet those between.
fn redundant(recording: &Recording, most: usize) -> usize {
    /// Largest RMS error, as a share of the RMS of the signal about its mean.
    const SHARE: f64 = 0.01;
    let meets = |signal: &[f64], stride: usize| {
        let allowed = (SHARE * SHARE) * squares_about_mean(signal)
            + noise_by_differences(signal).powi(2) * 1.5 * signal.len() as f64;
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

/// The largest stride that still shows the motion: one integration step spans it, and
/// the edges of the pressure are kept.
fn coarsest(session: &Session, model: &Model<f64>) -> usize {
    /// Longest interval (s) that keeps edges of the pressure.
    const EDGE_S: f64 = 0.05;
    /// Largest stride: enough for a recording at 10 kHz.
    const MOST: u16 = 500;
    (1..=MOST)
        .take_while(|&thin| {
            let interval = f64::from(thin) * session.interval();
            interval <= EDGE_S && substeps(model, interval, session.largest_angle()) == 1
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
