//! Subsamples of the data, for initial guesses and for ranking candidates.

use std::ops::Range;

use model_core::actuator::Model;

use super::dataset::{Dataset, Mark, Session};
use super::nuisance::Nuisance;
use crate::estimate::smooth::{half_window, motion};
use crate::io::recording::Recording;
use crate::sim::simulate::{InitialState, substeps};

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
                short_segments.push((cut(session, first..first + length, 1), clock, known));
            }
            begin += length;
        }
    }
    let samples: usize = short_segments.iter().map(|(piece, ..)| piece.len()).sum();
    let stride = samples.div_ceil(ENOUGH).max(1);
    let mut found = Dataset::default();
    for (piece, clock, known) in short_segments.into_iter().step_by(stride) {
        let mark = whole(&piece, true);
        let session = Session::new(piece, clock, Vec::new()).knowing(known);
        found.push(session, vec![mark]);
    }
    found
}

/// A subsample of the sessions, to rank initial guesses and candidates before the best
/// are fitted to everything.
///
/// All sessions are thinned as far as the motion of `model` allows. If that is still too
/// much, sessions are taken at even distances in the list. A session that is too long is
/// cut at its end, so that its history is kept.
pub fn subsample(data: &Dataset, model: &Model<f64>) -> Dataset {
    /// Enough samples to rank.
    const ENOUGH: usize = 3_000;
    /// Fewest samples of a further session.
    const FEWEST: usize = 100;
    let sessions = data.sessions();
    let with_fit: Vec<usize> = (0..sessions.len())
        .filter(|&index| !data.fitted_ranges(index).is_empty())
        .collect();
    let all: usize = with_fit
        .iter()
        .map(|&index| sessions[index].recording().len())
        .sum();
    let enough = all.div_ceil(ENOUGH).max(1);
    let thinning = |session: &Session| enough.min(coarsest(session, model));
    let thinned: usize = with_fit
        .iter()
        .map(|&index| sessions[index].recording().len() / thinning(&sessions[index]))
        .sum();
    let stride = thinned.div_ceil(ENOUGH).max(1);
    let mut order: Vec<(usize, usize)> = with_fit.iter().copied().enumerate().collect();
    order.sort_by_key(|(place, _)| (place % stride, *place));
    let mut found = Dataset::default();
    let mut room = ENOUGH;
    for (_, index) in order {
        let session = &sessions[index];
        let length = session.recording().len();
        if room < FEWEST.min(length) {
            break;
        }
        let thin = thinning(session);
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
        let mut part = Session::new(thinned, session.clock(), silent).coarse();
        part = part.guessing(session.guess(), &session.prior().thinned(thin));
        found.push(part, marks);
    }
    found
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
