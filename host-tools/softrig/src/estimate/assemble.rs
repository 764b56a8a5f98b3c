//! Assembles files into sessions.
//!
//! A session is one file with its segments in its metadata. If it was cut into
//! files whose metadata say where they belong (`part_of`, `begins_s`), they are
//! joined again. If a session is given beside files that were cut from it, its
//! samples are used once. A file without metadata is a session of its own. Where
//! the motion cannot be followed across a gap, a new session begins on the same
//! clock.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::dataset::{Dataset, Mark, Session};
use crate::estimate::identify::rest::resting_angle;
use crate::estimate::impossible::cleaned;
use crate::estimate::usable::{Concern, Matter};
use crate::estimate::usable::{Usable, usable};
use softrig_formats::error::InputError;
use softrig_formats::left_out::LeftOut;
use softrig_formats::recording::{Column, Recording, stem};

/// Number of segments into which the only session is cut if nothing says where
/// its runs begin: enough to leave one out and still fit the rest.
const PARTS: usize = 4;

/// Fewest samples of a segment.
const FEWEST: usize = 20;

/// Board resets closer together than this (s) count as the same reset: the
/// computer's clock and the serial line are no more accurate.
const SAME_RESET_S: f64 = 5.0;

/// Data for a fit, with the concerns raised while assembling it.
#[derive(Clone, Debug, Default)]
pub struct Assembly {
    /// The sessions.
    pub data: Dataset,
    /// Concerns to report.
    pub concerns: Vec<Concern>,
    /// The angle at rest (rad) that was subtracted from all measured ones.
    pub subtracted: f64,
    /// What was left out of the files, those with [`Matter::LeftOut`] among the concerns too.
    pub left_out: Vec<LeftOut>,
}

/// Files of one session, each with whether it is fitted.
#[derive(Debug, Default)]
pub struct Group<'a> {
    /// The session itself.
    pub whole: Option<(&'a Recording, bool)>,
    /// Files that were cut from it.
    pub pieces: Vec<(&'a Recording, bool)>,
}

/// A stretch of time in a session, in seconds on its own axis.
type Span = Range<f64>;

/// Assembles sessions from fitted and held-out recordings, with the angle counted from its
/// rest.
///
/// # Errors
///
/// Refuses a recording of which nothing can be used.
pub fn assemble(fitted: &[Recording], held_out: &[Recording]) -> Result<Assembly, InputError> {
    Ok(as_read(fitted, held_out)?.from_rest(fitted))
}

/// Assembles sessions with the angle as the columns say.
///
/// # Errors
///
/// Refuses a recording of which nothing can be used.
pub fn as_read(fitted: &[Recording], held_out: &[Recording]) -> Result<Assembly, InputError> {
    let mut all = Assembly::default();
    let fitted = &all.cleaned(fitted)?[..];
    let held_out = &all.cleaned(held_out)?[..];
    // The order in which files are named decides nothing.
    let by_path = |recordings: &'_ [Recording]| {
        let mut order: Vec<usize> = (0..recordings.len()).collect();
        order.sort_by(|&a, &b| recordings[a].path.cmp(&recordings[b].path));
        order
    };
    let [first, then] = [by_path(fitted), by_path(held_out)];
    let files = || {
        let fitted = first.iter().map(|&index| (&fitted[index], true));
        let held_out = then.iter().map(|&index| (&held_out[index], false));
        fitted.chain(held_out)
    };
    let groups = grouped(files());
    let clocks = Clocks::of(files().map(|(recording, _)| recording));
    let alone = groups.len() == 1;
    for group in &groups {
        add(&mut all, group, &clocks, alone)?;
    }
    all.data = all.data.in_order();
    Ok(all)
}

impl Assembly {
    /// The recordings without what no motion can reach.
    fn cleaned(&mut self, recordings: &[Recording]) -> Result<Vec<Recording>, InputError> {
        recordings
            .iter()
            .map(|recording| {
                let clean = cleaned(recording)?;
                let found = &clean.left_out[recording.left_out.len()..];
                let concerns = found.iter().map(|it| Concern::left_out(recording, it));
                self.concerns.extend(concerns);
                self.left_out.extend(clean.left_out.iter().cloned());
                Ok(clean)
            })
            .collect()
    }

    /// Counts the angle from where it rests, if that is far from zero and no flag says where
    /// zero is.
    #[must_use]
    pub fn from_rest(mut self, fitted: &[Recording]) -> Self {
        let was_said = |recording: &Recording| recording.columns.angle_zero_deg.is_some();
        // A turned rig rests where its weight pulls it, and one with a load where that does.
        let mut sessions = self.data.sessions().iter();
        let hangs_elsewhere = sessions.any(|it| it.placement().moves_the_rest());
        if !hangs_elsewhere
            && !fitted.iter().any(was_said)
            && let Some(rest) = resting_angle(&self.data)
        {
            let zero_deg = rest.to_degrees().round();
            self.data = self.data.shifted(-zero_deg.to_radians());
            self.subtracted = zero_deg.to_radians();
            self.concerns.push(far_from_zero(zero_deg));
        }
        self
    }
}

/// The angle (°) at which the actuator rests was subtracted.
fn far_from_zero(zero: f64) -> Concern {
    Concern::of(
        Matter::FarFromZero,
        None,
        format!(
            "without pressure the angle rests at {zero}°, far from zero, where the model's spring pulls it: {zero}° are subtracted"
        ),
        &format!(
            "add --angle-zero={zero} to every command, or angle_zero_deg = {zero} to [recording] in the model file, so that all of them do"
        ),
    )
}

/// Groups files by session, from their metadata.
pub fn grouped<'a>(files: impl Iterator<Item = (&'a Recording, bool)>) -> Vec<Group<'a>> {
    let mut groups: Vec<(PathBuf, Group<'a>)> = Vec::new();
    for (recording, fit) in files {
        let place = session_path(recording);
        let is_piece = recording.meta.part_of.is_some() && recording.meta.begins_s.is_some();
        let known = groups
            .iter_mut()
            // The same name in a recording without a path is another one.
            .find(|(path, group)| *path == place && (is_piece || group.whole.is_none()));
        let group = if let Some((_, group)) = known {
            group
        } else {
            groups.push((place, Group::default()));
            let last = groups.len() - 1;
            &mut groups[last].1
        };
        if is_piece {
            group.pieces.push((recording, fit));
        } else {
            group.whole = Some((recording, fit));
        }
    }
    groups.into_iter().map(|(_, group)| group).collect()
}

/// The path of the session's own file, whether or not it is given.
fn session_path(recording: &Recording) -> PathBuf {
    // Metadata may have been written by hand: a name, whatever path stands there.
    let whole = recording
        .meta
        .part_of
        .as_deref()
        .and_then(|name| Path::new(name).file_name());
    let path = match whole {
        Some(name) => recording.path.with_file_name(name),
        None if recording.path.as_os_str().is_empty() => PathBuf::from(&recording.name),
        None => recording.path.clone(),
    };
    // It may have been converted since, into a file with another ending.
    let stem = stem(&path);
    let path = path.canonicalize().unwrap_or_else(|_| {
        let folder = path.parent().and_then(|it| it.canonicalize().ok());
        folder.map_or(path.clone(), |folder| folder.join(&stem))
    });
    path.with_file_name(stem)
}

/// Times of the board's resets, as far as they are known.
struct Clocks {
    /// Time of each reset (s since 1970), and the board's clock (s) at the first
    /// recording after it.
    resets: Vec<(f64, f64)>,
}

impl Clocks {
    fn of<'a>(recordings: impl Iterator<Item = &'a Recording>) -> Self {
        let mut resets: Vec<(f64, f64)> = Vec::new();
        for recording in recordings {
            let Some((reset, uptime)) = reset_of(recording) else {
                continue;
            };
            match resets
                .iter_mut()
                .find(|(known, _)| (known - reset).abs() < SAME_RESET_S)
            {
                Some((_, first)) => *first = first.min(uptime),
                None => resets.push((reset, uptime)),
            }
        }
        Self { resets }
    }

    /// Time on the rig's clock (s) at time 0 of a session: zero for the first
    /// session after a reset.
    fn start_of(&self, recording: &Recording) -> f64 {
        let Some((reset, uptime)) = reset_of(recording) else {
            return 0.0;
        };
        self.resets
            .iter()
            .find(|(known, _)| (known - reset).abs() < SAME_RESET_S)
            .map_or(0.0, |(_, first)| uptime - first)
    }
}

fn reset_of(recording: &Recording) -> Option<(f64, f64)> {
    let uptime = recording.meta.uptime_s?;
    Some((recording.meta.started_unix_s()? - uptime, uptime))
}

fn add(
    all: &mut Assembly,
    group: &Group<'_>,
    clocks: &Clocks,
    alone: bool,
) -> Result<(), InputError> {
    if let Some((whole, fit)) = group.whole {
        let marks = marks_of(all, whole, fit, &group.pieces);
        let clock = clocks.start_of(whole) + first_time(whole);
        return add_session(all, whole, clock, marks, fit, alone);
    }
    let mut pieces = group.pieces.clone();
    pieces.sort_by(|a, b| begins(a.0).total_cmp(&begins(b.0)));
    let alone = alone && pieces.len() == 1;
    for chain in chains(&pieces) {
        let (whole, marks) = join(&chain);
        let clock = clocks.start_of(chain[0].0) + begins(chain[0].0);
        add_session(all, &whole, clock, marks, chain[0].1, alone)?;
    }
    Ok(())
}

/// The segments of a whole session. Files that were cut from it and are given
/// beside it say which segments are fitted, and where they are if the session's
/// metadata do not.
fn marks_of(
    all: &mut Assembly,
    whole: &Recording,
    fit: bool,
    pieces: &[(&Recording, bool)],
) -> Vec<(Span, About)> {
    let first = first_time(whole);
    let mut marks = spans_of(whole, fit);
    if pieces.is_empty() {
        return marks;
    }
    all.concerns.push(used_once(whole, pieces.len()));
    if marks.is_empty() {
        marks = pieces.iter().map(|piece| span_of(piece, first)).collect();
    }
    for (piece, piece_fit) in pieces {
        let (span, _) = span_of(&(piece, *piece_fit), first);
        for (mark, about) in &mut marks {
            if overlap(mark, &span) > 0.5 * (mark.end - mark.start) {
                about.fitted = *piece_fit;
            }
        }
    }
    marks
}

fn used_once(whole: &Recording, pieces: usize) -> Concern {
    let pieces = if pieces == 1 {
        "1 of the files is a piece of it and is".to_owned()
    } else {
        format!("{pieces} of the files are pieces of it and are")
    };
    Concern {
        matter: Matter::SegmentFiles,
        recording: Some(whole.name.clone()),
        text: format!("{pieces} used once, with it"),
        advice: "name the whole session alone".into(),
    }
}

/// The name of a segment, and whether it is fitted.
#[derive(Clone, Debug)]
struct About {
    name: String,
    source: Recording,
    fitted: bool,
}

fn first_time(recording: &Recording) -> f64 {
    recording.time.first().copied().unwrap_or(0.0)
}

/// Time (s) of a piece's first sample on its session's time axis.
fn begins(piece: &Recording) -> f64 {
    piece.meta.begins_s.unwrap_or(0.0) + first_time(piece)
}

/// The span of a piece in its session, whose first sample is at `first` (s).
fn span_of(piece: &(&Recording, bool), first: f64) -> (Span, About) {
    let (recording, fitted) = *piece;
    let begin = begins(recording) - first;
    (
        begin..begin + recording.duration(),
        About {
            name: recording.name.clone(),
            source: header(recording),
            fitted,
        },
    )
}

/// A recording without its samples.
fn header(recording: &Recording) -> Recording {
    Recording {
        name: recording.name.clone(),
        path: recording.path.clone(),
        meta: recording.meta.clone(),
        columns: recording.columns,
        measurand: recording.measurand.clone(),
        ..Recording::default()
    }
}

/// The segments that a session's metadata names.
fn spans_of(whole: &Recording, fitted: bool) -> Vec<(Span, About)> {
    let first = first_time(whole);
    whole
        .meta
        .segment
        .iter()
        .enumerate()
        .map(|(number, segment)| {
            let mut source = header(whole);
            source.meta.setpoint_deg = segment.setpoint_deg;
            source.meta.repeat = segment.repeat;
            source.meta.segment.clear();
            let level = match (segment.setpoint_deg, segment.setpoint_kpa) {
                (Some(degrees), _) => format!("_{degrees}"),
                (None, Some(pressure)) => format!("_{pressure}kpa"),
                (None, None) => String::new(),
            };
            let count = segment.repeat.map_or(number + 1, |repeat| repeat as usize);
            (
                segment.from_s - first..segment.to_s - first,
                About {
                    name: format!("{}{level}_{count}", whole.name),
                    source,
                    fitted,
                },
            )
        })
        .collect()
}

fn overlap(a: &Span, b: &Span) -> f64 {
    (a.end.min(b.end) - a.start.max(b.start)).max(0.0)
}

/// Pieces that follow each other without a gap, in order.
fn chains<'a>(pieces: &[(&'a Recording, bool)]) -> Vec<Vec<(&'a Recording, bool)>> {
    /// Most sample intervals between the last sample of a piece and the first of
    /// the next.
    const INTERVALS: f64 = 3.0;
    let mut chains: Vec<Vec<(&Recording, bool)>> = Vec::new();
    for &piece in pieces {
        let follows = chains
            .last()
            .and_then(|chain| chain.last())
            .is_some_and(|(before, _)| {
                let end = begins(before) + before.duration();
                begins(piece.0) - end <= INTERVALS * before.interval().max(1e-3)
            });
        match chains.last_mut() {
            Some(chain) if follows => chain.push(piece),
            _ => chains.push(vec![piece]),
        }
    }
    chains
}

/// Joins pieces that follow each other into one recording. Where two overlap, the
/// samples of the first are kept.
fn join(chain: &[(&Recording, bool)]) -> (Recording, Vec<(Span, About)>) {
    let first = chain[0].0;
    let origin = begins(first);
    let mut whole = Recording {
        name: first.meta.part_of.as_deref().map_or_else(
            || first.name.clone(),
            |name| name.trim_end_matches(".csv").to_owned(),
        ),
        ..header(first)
    };
    if chain.len() == 1 {
        whole.name.clone_from(&first.name);
        whole.lines.clone_from(&first.lines);
        whole.stamps.clone_from(&first.stamps);
    }
    // Columns that all pieces have.
    whole.extra = first
        .extra
        .iter()
        .filter(|column| {
            chain
                .iter()
                .all(|(piece, _)| piece.extra.iter().any(|other| other.name == column.name))
        })
        .map(|column| Column {
            name: column.name.clone(),
            fields: Vec::new(),
        })
        .collect();
    let mut marks = Vec::new();
    for piece in chain {
        let recording = piece.0;
        let shift = begins(recording) - origin - first_time(recording);
        for k in 0..recording.len() {
            let time = recording.time[k] + shift;
            if whole.time.last().is_some_and(|last| time <= *last) {
                continue;
            }
            if recording.is_break(k) {
                whole.breaks.push(whole.time.len());
            }
            whole.time.push(time);
            whole.pressure.push(recording.pressure[k]);
            whole.angle.push(recording.angle[k]);
            for column in &mut whole.extra {
                let field = recording
                    .extra
                    .iter()
                    .find(|other| other.name == column.name)
                    .map_or_else(String::new, |other| other.fields[k].clone());
                column.fields.push(field);
            }
        }
        marks.push(span_of(piece, origin));
    }
    (whole, marks)
}

/// Adds a session, cut where the motion cannot be followed.
fn add_session(
    all: &mut Assembly,
    whole: &Recording,
    clock: f64,
    marks: Vec<(Span, About)>,
    fitted: bool,
    alone: bool,
) -> Result<(), InputError> {
    let Usable {
        blocks,
        unfitted,
        concerns,
    } = usable(whole)?;
    all.concerns.extend(concerns);
    let begin = first_time(whole);
    let marks = if marks.is_empty() {
        unnamed(whole, fitted, alone && blocks.len() == 1)
    } else {
        ranges(whole, marks)
    };
    for (number, block) in blocks.iter().enumerate() {
        let inside = |range: &Range<usize>| {
            let from = range.start.max(block.start);
            let to = range.end.min(block.end);
            (from < to).then(|| from - block.start..to - block.start)
        };
        let own: Vec<Mark> = marks
            .iter()
            .filter_map(|mark| {
                let range = inside(&mark.range).filter(|range| range.len() >= FEWEST)?;
                let mut mark = mark.clone();
                if blocks.len() > 1 && range.len() < mark.range.len() {
                    mark.about.name = format!("{} ({})", mark.about.name, number + 1);
                }
                mark.range = range;
                Some(mark)
            })
            .collect();
        if own.is_empty() {
            continue;
        }
        let part = whole.slice(block);
        let later = part.time[0] - begin;
        let silent = unfitted.iter().filter_map(inside).collect();
        all.data
            .push(Session::new(part, clock + later, silent), own);
    }
    Ok(())
}

/// Segments of a recording without metadata: all of it, or equal parts if it is
/// the only one.
fn unnamed(whole: &Recording, fitted: bool, alone: bool) -> Vec<Mark> {
    let count = whole.len();
    if !alone || count < PARTS * FEWEST {
        return vec![Mark {
            range: 0..count,
            about: header(whole),
            fitted,
        }];
    }
    (0..PARTS)
        .map(|part| Mark {
            range: part * count / PARTS..(part + 1) * count / PARTS,
            about: Recording {
                name: format!("{} (part {} of {PARTS})", whole.name, part + 1),
                ..header(whole)
            },
            fitted,
        })
        .collect()
}

/// Converts spans of time to ranges of samples that do not overlap.
fn ranges(whole: &Recording, mut marks: Vec<(Span, About)>) -> Vec<Mark> {
    marks.sort_by(|a, b| a.0.start.total_cmp(&b.0.start));
    let begin = first_time(whole);
    let at = |seconds: f64| {
        // Times in metadata are rounded to the millisecond.
        whole
            .time
            .partition_point(|time| *time - begin < seconds - 5e-4)
    };
    let mut ends = 0;
    let starts: Vec<usize> = marks.iter().map(|(span, _)| at(span.start)).collect();
    let mut found = Vec::new();
    for (number, (span, about)) in marks.into_iter().enumerate() {
        let next = starts.get(number + 1).copied().unwrap_or(whole.len());
        let start = starts[number].max(ends);
        let end = at(span.end + 1e-3).min(next).max(start);
        ends = end;
        if end - start >= FEWEST {
            found.push(Mark {
                range: start..end,
                about: Recording {
                    name: about.name,
                    ..about.source
                },
                fitted: about.fitted,
            });
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use softrig_formats::recording::{Meta, SegmentMeta};

    const INTERVAL_S: f64 = 0.01;
    const PIECE_S: f64 = 3.0;

    /// This many seconds of a swinging actuator, from this time of its session,
    /// on a time axis that begins at zero.
    fn swinging(name: &str, from_s: f64, seconds: f64) -> Recording {
        // A small positive number.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let count = (seconds / INTERVAL_S).round() as u32;
        let time: Vec<f64> = (0..count).map(|k| f64::from(k) * INTERVAL_S).collect();
        let swing = |t: &f64| 1.0 - (1.7 * (from_s + t)).cos();
        Recording {
            name: name.trim_end_matches(".csv").into(),
            path: PathBuf::from("data").join(name),
            pressure: time.iter().map(|t| 20e3 * swing(t)).collect(),
            angle: time.iter().map(|t| 0.4 * swing(&(t - 0.2))).collect(),
            time,
            ..Recording::default()
        }
    }

    /// A session of four runs.
    fn session() -> Recording {
        let segment = |number: u32| SegmentMeta {
            from_s: PIECE_S * f64::from(number),
            to_s: PIECE_S * f64::from(number + 1),
            setpoint_deg: Some(60.0),
            repeat: Some(number + 1),
            ..SegmentMeta::default()
        };
        Recording {
            meta: Meta {
                segment: (0..4).map(segment).collect(),
                ..Meta::default()
            },
            ..swinging("run.csv", 0.0, 4.0 * PIECE_S)
        }
    }

    /// The run of this number, from 0, in a file of its own.
    fn piece(number: u32) -> Recording {
        let begins_s = PIECE_S * f64::from(number);
        Recording {
            meta: Meta {
                part_of: Some("run.csv".into()),
                begins_s: Some(begins_s),
                ..Meta::default()
            },
            ..swinging(&format!("run_60_{}.csv", number + 1), begins_s, PIECE_S)
        }
    }

    fn since(mut recording: Recording, started: &str, uptime_s: f64) -> Recording {
        recording.meta.started = Some(started.into());
        recording.meta.uptime_s = Some(uptime_s);
        recording
    }

    fn data(fitted: &[Recording], held_out: &[Recording]) -> Dataset {
        let assembled = assemble(fitted, held_out).unwrap();
        assert_eq!(assembled.concerns, []);
        assembled.data
    }

    #[test]
    fn a_session_that_was_converted_is_still_the_whole_of_its_pieces() {
        let mut whole = session();
        whole.path = PathBuf::from("data/run.parquet");
        let piece = piece(0);
        let files = [(&whole, true), (&piece, true)];
        for files in [files, [files[1], files[0]]] {
            let groups = grouped(files.into_iter());
            assert_eq!(groups.len(), 1);
            assert!(groups[0].whole.is_some() && groups[0].pieces.len() == 1);
        }
    }

    /// Session, range and name of each segment.
    fn segments(data: &Dataset) -> Vec<(usize, Range<usize>, &str)> {
        let of = data.segments().iter();
        of.map(|it| (it.session, it.range.clone(), it.recording.name.as_str()))
            .collect()
    }

    fn clocks(data: &Dataset) -> Vec<f64> {
        data.sessions().iter().map(|it| it.clock()).collect()
    }

    fn assert_clocks(data: &Dataset, expected: &[f64]) {
        let found = clocks(data);
        let near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-6;
        assert!(
            found.len() == expected.len() && found.iter().zip(expected).all(near),
            "{found:?}, not {expected:?}"
        );
    }

    #[test]
    fn a_session_is_cut_where_its_metadata_says() {
        let data = data(&[session()], &[]);
        assert_eq!(data.sessions().len(), 1);
        assert_eq!(
            segments(&data),
            [
                (0, 0..300, "run_60_1"),
                (0, 300..600, "run_60_2"),
                (0, 600..900, "run_60_3"),
                (0, 900..1200, "run_60_4"),
            ]
        );
        assert_eq!(data.indices(false), [0; 0]);
    }

    #[test]
    fn a_session_beside_its_pieces_is_used_once_and_says_so() {
        let bare = Recording {
            meta: Meta::default(),
            ..session()
        };
        for (whole, runs) in [(session(), 4), (bare, 2)] {
            let all = assemble(&[piece(2), whole, piece(0)], &[]).unwrap();
            assert_eq!(all.data.sessions().len(), 1);
            assert_eq!(all.data.sessions()[0].recording().len(), 1200);
            assert_eq!(segments(&all.data).len(), runs);
            assert_eq!(all.data.samples(), 300 * runs);
            let said: Vec<(Matter, &str)> = all
                .concerns
                .iter()
                .map(|it| (it.matter, it.text.as_str()))
                .collect();
            let text = "2 of the files are pieces of it and are used once, with it";
            assert_eq!(said, [(Matter::SegmentFiles, text)]);
        }
    }

    #[test]
    fn pieces_alone_are_joined_and_are_its_segments() {
        let later = |number| since(piece(number), "2026-03-01T10:00:00Z", 7.0);
        // Another session was recorded before.
        let before = since(swinging("b.csv", 0.0, 4.0), "2026-03-01T09:59:55Z", 2.0);
        let data = data(&[later(3), before, later(1), later(2)], &[]);
        assert_eq!(
            segments(&data),
            [
                (0, 0..400, "b"),
                (1, 0..300, "run_60_2"),
                (1, 300..600, "run_60_3"),
                (1, 600..900, "run_60_4"),
            ],
            "by the order of their paths"
        );
        assert_clocks(&data, &[0.0, 5.0 + PIECE_S]);
        let joined = data.sessions()[1].recording();
        assert_eq!(joined.name, "run");
        let whole = session();
        for (k, (time, angle)) in joined.time.iter().zip(&joined.angle).enumerate() {
            assert!((time - INTERVAL_S * k as f64).abs() < 1e-9);
            assert!((angle - whole.angle[300 + k]).abs() < 1e-9);
        }
    }

    #[test]
    fn a_held_out_piece_of_a_given_session_is_a_held_out_segment_of_it() {
        // The same on a time axis that does not begin at zero.
        let mut later = session();
        for time in &mut later.time {
            *time += 100.0;
        }
        for segment in &mut later.meta.segment {
            segment.from_s += 100.0;
            segment.to_s += 100.0;
        }
        let mut later_piece = piece(2);
        later_piece.meta.begins_s = Some(100.0 + 2.0 * PIECE_S);
        for (whole, piece) in [(session(), piece(2)), (later, later_piece)] {
            let data = assemble(&[whole], &[piece]).unwrap().data;
            assert_eq!(data.sessions().len(), 1);
            assert_eq!(data.indices(true), [0, 1, 3]);
            assert_eq!(data.indices(false), [2]);
            assert_eq!(segments(&data)[2], (0, 600..900, "run_60_3"));
        }
    }

    #[test]
    fn a_held_out_piece_among_pieces_is_simulated_through() {
        let data = data(&[piece(0), piece(2)], &[piece(1)]);
        assert_eq!(data.sessions().len(), 1);
        assert_eq!(data.indices(true), [0, 2]);
        assert_eq!(data.indices(false), [1]);
    }

    #[test]
    fn files_without_metadata_are_sessions_of_their_own() {
        let files = [swinging("a.csv", 0.0, 4.0), swinging("b.csv", 1.0, 5.0)];
        let data = data(&files, &[swinging("c.csv", 2.0, 4.0)]);
        assert_eq!(
            segments(&data),
            [(0, 0..400, "a"), (1, 0..500, "b"), (2, 0..400, "c")]
        );
        assert_eq!(data.indices(false), [2]);
        assert_clocks(&data, &[0.0; 3]);
    }

    #[test]
    fn a_single_file_without_metadata_becomes_four_parts_of_one_session() {
        let data = data(&[swinging("a.csv", 0.0, 8.0)], &[]);
        assert_eq!(data.sessions().len(), 1);
        assert_eq!(
            segments(&data),
            [
                (0, 0..200, "a (part 1 of 4)"),
                (0, 200..400, "a (part 2 of 4)"),
                (0, 400..600, "a (part 3 of 4)"),
                (0, 600..800, "a (part 4 of 4)"),
            ]
        );
    }

    #[test]
    fn a_missing_piece_makes_two_sessions_that_run_by_one_clock() {
        let data = data(&[piece(0), piece(1), piece(3)], &[]);
        assert_eq!(
            segments(&data),
            [
                (0, 0..300, "run_60_1"),
                (0, 300..600, "run_60_2"),
                (1, 0..300, "run_60_4"),
            ]
        );
        // What was recorded before, and what is missing.
        assert_clocks(&data, &[0.0, 3.0 * PIECE_S]);
    }

    #[test]
    fn sessions_since_the_same_reset_share_a_clock_and_others_do_not() {
        let at = |name, started, uptime_s| since(swinging(name, 0.0, 4.0), started, uptime_s);
        let data = data(
            &[
                at("a.csv", "2026-03-01T10:01:10Z", 70.0),
                // The same reset, by a clock that is two seconds off.
                at("b.csv", "2026-03-01T10:00:12Z", 10.0),
                at("c.csv", "2026-03-01T10:05:00Z", 3.0),
                swinging("d.csv", 0.0, 4.0),
            ],
            &[],
        );
        assert_clocks(&data, &[60.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn a_clock_is_that_of_the_first_sample() {
        let mut later = swinging("a.csv", 0.0, 4.0);
        for time in &mut later.time {
            *time += 100.0;
        }
        let zero = "2026-03-01T10:00:00Z";
        let files = [
            since(later, zero, 7.0),
            since(swinging("b.csv", 0.0, 4.0), zero, 7.0),
        ];
        assert_clocks(&data(&files, &[]), &[100.0, 0.0]);
    }
}
