//! The runs within a recording: as segments in its metadata, or as files.
//!
//! A run is a rest, a step and its release, or any other part of a protocol between two
//! rests. The set-point in the telemetry gives the start of a run, so that lost lines and
//! delays of the link do not shift it.

use std::path::{Path, PathBuf};

use wire::protocol::{ControlMode, Segment};
use wire::state::State;
use wire::telemetry::{PERIOD_MS, Setpoint};

use super::meta::About;
use super::sheet::{header, line};
use super::shelf::Shelf;
use super::{Counts, LoggedSample, meta_path, seconds};
use softrig_formats::error::InputError;
use softrig_formats::protocol_file::ProtocolFile;
use softrig_formats::recording::SegmentMeta;

/// Rest in front of each run (ms), so that a run shows its zero.
const REST_MS: i64 = 500;
/// After a release of this length (ms) the actuator counts as at rest: the rest in
/// front of the next run, and as long again to come to it.
const RELEASE_MS: i64 = 2 * REST_MS;
/// How far the set-point that a step came to may be from its level (hundredths of
/// a degree or kPa): the board's rounding.
const LEVEL_TOLERANCE: i32 = 2;

/// One step of a protocol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The control mode.
    pub mode: ControlMode,
    /// The level (° or kPa).
    pub level: f64,
    /// Which step to this level it is, from 1.
    pub repeat: u32,
}

impl Step {
    /// Its level if that is an angle (°).
    fn degrees(&self) -> Option<f64> {
        (self.mode != ControlMode::Pressure).then_some(self.level)
    }

    /// Its level if that is a pressure (kPa).
    fn kilopascals(&self) -> Option<f64> {
        (self.mode == ControlMode::Pressure).then_some(self.level)
    }
}

/// A part of a protocol from one time at rest to the next.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// The step, where it is one step with its release.
    pub step: Option<Step>,
    /// The times in it during which something is tracked without a break: the
    /// set-point where it is one step, none where the set-point moves.
    tracked: Vec<Option<Setpoint>>,
}

/// The parts of a protocol, in order. Each begins at rest: at the start of the
/// protocol or after a release that is long enough.
pub fn parts(protocol: &ProtocolFile) -> Vec<Part> {
    let mut parts: Vec<Part> = Vec::new();
    let mut released_ms = RELEASE_MS;
    let mut is_tracking = false;
    for played in protocol.played() {
        let tracks = played.segment.mode().is_some();
        match (played.segment, parts.last_mut()) {
            (Segment::Release { duration_ms }, _) => released_ms += i64::from(duration_ms),
            (segment, _) if tracks && released_ms >= RELEASE_MS => {
                let step = first_step(segment, &parts);
                let tracked = vec![constant(segment)];
                parts.push(Part { step, tracked });
                released_ms = 0;
            }
            // More than a step and its release.
            (segment, Some(part)) => {
                part.step = None;
                released_ms = 0;
                match part.tracked.last_mut() {
                    Some(tracked) if is_tracking && tracks => *tracked = None,
                    _ if tracks => part.tracked.push(constant(segment)),
                    _ => {}
                }
            }
            // A hold before the first part does not disturb the rest.
            (_, None) => {}
        }
        is_tracking = tracks;
    }
    parts
}

/// The set-point of a step; none for what moves.
fn constant(segment: Segment) -> Option<Setpoint> {
    match segment {
        Segment::Step {
            mode: ControlMode::Pressure,
            level,
            ..
        } => Some(Setpoint::Pressure(level)),
        Segment::Step { level, .. } => Some(Setpoint::Angle(level)),
        _ => None,
    }
}

fn first_step(segment: Segment, before: &[Part]) -> Option<Step> {
    let Segment::Step { mode, level, .. } = segment else {
        return None;
    };
    let level = f64::from(level.0) / 100.0;
    let same = |step: &Step| step.mode == mode && (step.level - level).abs() < 1e-9;
    let repeats = before.iter().filter_map(|part| part.step).filter(same);
    Some(Step {
        mode,
        level,
        repeat: u32::try_from(repeats.count()).map_or(u32::MAX, |count| count.saturating_add(1)),
    })
}

/// The steps of a protocol in which every step is followed by a release that is
/// long enough to come to rest; none of another protocol.
pub fn steps(protocol: &ProtocolFile) -> Option<Vec<Step>> {
    let parts = parts(protocol);
    let steps: Option<Vec<Step>> = parts.iter().map(|part| part.step).collect();
    steps.filter(|steps| !steps.is_empty())
}

/// The file of a run: `R_60_1.csv` beside `R.csv`.
pub fn run_path(whole: &Path, step: &Step) -> PathBuf {
    let stem = whole
        .file_stem()
        .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    let unit = match step.mode {
        ControlMode::Pressure => "kpa",
        ControlMode::AngleOpenLoop | ControlMode::AngleClosedLoop => "",
    };
    whole.with_file_name(format!("{stem}_{}{unit}_{}.csv", step.level, step.repeat))
}

/// Rows of a recording that belong to a part of its protocol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Run<'r> {
    /// The step, if the part is one.
    pub(super) step: Option<Step>,
    /// Its rows; at least one.
    pub(super) rows: &'r [LoggedSample],
    /// Time of the first row after it (ms); where there is none, the time at which
    /// one would be.
    end_ms: i64,
}

impl Run<'_> {
    /// The form in the metadata of the recording.
    pub(super) fn segment(&self, clock_factor: Option<f64>) -> Option<SegmentMeta> {
        let seconds = |ms: i64| seconds(ms, clock_factor);
        Some(SegmentMeta {
            from_s: seconds(self.rows.first()?.time_ms),
            to_s: seconds(self.end_ms),
            setpoint_deg: self.step.and_then(|step| step.degrees()),
            setpoint_kpa: self.step.and_then(|step| step.kilopascals()),
            repeat: self.step.map(|step| step.repeat),
        })
    }
}

/// The parts of a protocol that were played to their end, in order. They do not
/// overlap. `complete` says that all of the protocol was played.
pub(super) fn split<'r>(rows: &'r [LoggedSample], parts: &[Part], complete: bool) -> Vec<Run<'r>> {
    let onsets = onsets(rows);
    let begins = |onset: usize| {
        let rest = rows[onset].time_ms - REST_MS;
        rows.partition_point(|row| row.time_ms < rest)
    };
    let after = match rows
        .iter()
        .rposition(|row| row.sample.state == State::Running)
    {
        Some(last) => last + 1,
        None => return Vec::new(),
    };
    let numbers = place(rows, &onsets, parts);
    // What breaks a part off: the next part, or an onset that is not in the
    // protocol.
    let starts: Vec<(usize, Option<usize>)> = (onsets.iter().zip(numbers))
        .filter(|(_, place)| *place != Place::Within)
        .map(|(&onset, place)| (onset, place.number()))
        .collect();
    let mut runs = Vec::new();
    for (index, &(onset, number)) in starts.iter().enumerate() {
        let Some(part) = number.and_then(|number| parts.get(number)) else {
            continue;
        };
        let end = match starts.get(index + 1) {
            Some(&(next, _)) => begins(next).max(onset),
            None if complete && number == Some(parts.len() - 1) => after,
            None => continue,
        };
        let previous = index.checked_sub(1).map_or(0, |before| starts[before].0);
        let run = &rows[begins(onset).max(previous)..end];
        let Some(last) = run.last() else { continue };
        let end_ms = rows
            .get(end)
            .map_or(last.time_ms + i64::from(PERIOD_MS), |row| row.time_ms);
        runs.push(Run {
            step: part.step,
            rows: run,
            end_ms,
        });
    }
    runs
}

/// Whether a protocol tracks something at this row.
fn tracks(row: &LoggedSample) -> bool {
    row.sample.state == State::Running && row.sample.setpoint != Setpoint::None
}

/// The rows at which a set-point begins. It follows a limited rate, so its level
/// is not yet the step's there; that it is there at all marks the beginning.
fn onsets(rows: &[LoggedSample]) -> Vec<usize> {
    (0..rows.len())
        .filter(|&row| tracks(&rows[row]) && (row == 0 || !tracks(&rows[row - 1])))
        .collect()
}

/// The place of an onset of the set-point in the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// The beginning of the part with this index.
    Begins(usize),
    /// Within a part, after a hold.
    Within,
    /// The onset is not in the protocol.
    Nowhere,
}

impl Place {
    fn number(self) -> Option<usize> {
        match self {
            Self::Begins(number) => Some(number),
            _ => None,
        }
    }
}

/// Finds the place of each onset in the protocol.
///
/// Times do not tell: a release lasts until the plunger is back. Where the number
/// of onsets is right, their order does; where lines were lost or the protocol was
/// cut off, the order and the level that the set-point came to.
fn place(rows: &[LoggedSample], onsets: &[usize], parts: &[Part]) -> Vec<Place> {
    let expected: Vec<(Place, Option<Setpoint>)> = (0..)
        .zip(parts)
        .flat_map(|(number, part)| {
            let place = move |index| match index {
                0 => Place::Begins(number),
                _ => Place::Within,
            };
            (0..)
                .zip(&part.tracked)
                .map(move |(index, &setpoint)| (place(index), setpoint))
        })
        .collect();
    if onsets.len() == expected.len() {
        return expected.into_iter().map(|(place, _)| place).collect();
    }
    let mut rest = &expected[..];
    let mut placed = Vec::with_capacity(onsets.len());
    for &onset in onsets {
        let came_to = rows[onset..]
            .iter()
            .take_while(|row| tracks(row))
            .last()
            .map(|row| row.sample.setpoint);
        let fits = |setpoint: Option<Setpoint>| match (setpoint, came_to) {
            (Some(Setpoint::Angle(asked)), Some(Setpoint::Angle(was)))
            | (Some(Setpoint::Pressure(asked)), Some(Setpoint::Pressure(was))) => {
                (asked.0.saturating_sub(was.0)).saturating_abs() <= LEVEL_TOLERANCE
            }
            (asked, _) => asked.is_none(),
        };
        match rest.iter().position(|&(_, setpoint)| fits(setpoint)) {
            Some(skipped) => {
                placed.push(rest[skipped].0);
                rest = &rest[skipped + 1..];
            }
            None => placed.push(Place::Nowhere),
        }
    }
    placed
}

/// Writes a run and what is known about it; its time starts at zero.
pub(super) fn write_run(
    shelf: &dyn Shelf,
    path: &Path,
    step: &Step,
    rows: &[LoggedSample],
    whole: &About,
) -> Result<(), InputError> {
    let Some(first) = rows.first() else {
        return Ok(());
    };
    let last = rows.last().unwrap_or(first);
    let mut text = header();
    for row in rows {
        let from_start = LoggedSample {
            time_ms: row.time_ms - first.time_ms,
            ..*row
        };
        text += &line(&from_start, whole.clock_factor);
    }
    let begins_s = seconds(first.time_ms, whole.clock_factor);
    let ends_s = seconds(last.time_ms, whole.clock_factor);
    let gap: Vec<_> = whole
        .gap
        .iter()
        .filter(|gap| gap.from_s >= begins_s && gap.to_s <= ends_s)
        .map(|gap| super::Gap {
            from_s: gap.from_s - begins_s,
            to_s: gap.to_s - begins_s,
            ..*gap
        })
        .collect();
    let steps_in = last.sample.sequence.wrapping_sub(first.sample.sequence);
    let about = About {
        setpoint_deg: step.degrees(),
        setpoint_kpa: step.kilopascals(),
        repeat: Some(step.repeat),
        complete: true,
        counts: Some(Counts {
            samples: rows.len() as u64,
            dropped_lines: (u64::from(steps_in) + 1).saturating_sub(rows.len() as u64),
            ..whole.counts.unwrap_or_default()
        }),
        part_of: whole_name(path, step),
        begins_s: Some(begins_s),
        runs: Vec::new(),
        segment: Vec::new(),
        gap,
        ..whole.clone()
    };
    shelf
        .begin(
            (path, text.as_bytes()),
            (&meta_path(path), about.to_text().as_bytes()),
        )
        .map(drop)
}

/// The name of the whole recording: that of the run without its ending.
fn whole_name(path: &Path, step: &Step) -> Option<String> {
    let ending = run_path(Path::new(".csv"), step);
    let name = path.file_name()?.to_string_lossy().into_owned();
    let ending = ending.file_name()?.to_string_lossy().into_owned();
    let ending = ending.strip_prefix(".csv").unwrap_or(&ending);
    Some(format!("{}.csv", name.strip_suffix(ending)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::decimal::Hundredths;
    use wire::protocol::Named;
    use wire::telemetry::Telemetry;

    #[test]
    fn protocols_of_steps_are_told_from_others() {
        let paper = steps(&ProtocolFile::named(Named::Paper)).unwrap();
        assert_eq!(paper.len(), 14);
        assert_eq!((paper[6].level, paper[6].repeat), (60.0, 7));
        assert_eq!((paper[7].level, paper[7].repeat), (90.0, 1));
        let four = steps(&ProtocolFile::named(Named::Steps)).unwrap();
        assert_eq!((four[4].level, four[4].repeat), (10.0, 2));
        for named in [
            Named::Staircase,
            Named::Triangles,
            Named::Sines,
            Named::HoldStill,
        ] {
            assert_eq!(steps(&ProtocolFile::named(named)), None, "{named:?}");
        }
    }

    fn row(time_ms: i64, setpoint: Setpoint, state: State) -> LoggedSample {
        LoggedSample {
            time_ms,
            sample: Telemetry {
                sequence: u16::try_from(time_ms / 10).unwrap(),
                time_ms: 0,
                pressure_kpa: Some(Hundredths(0)),
                angle_deg: Some(Hundredths(0)),
                predicted_deg: None,
                setpoint,
                volume_ul: 0,
                state,
                fault: 0,
                mismatch: false,
            },
        }
    }

    /// Two steps of a second and a half with a second between them.
    fn two_steps() -> Vec<LoggedSample> {
        (0..700)
            .map(|k| {
                let time = k * 10;
                let running = (1_000..6_000).contains(&time);
                let on = running && (time - 1_000) % 2_500 < 1_500;
                row(
                    time,
                    if on {
                        Setpoint::Angle(Hundredths(6_000))
                    } else {
                        Setpoint::None
                    },
                    if running {
                        State::Running
                    } else {
                        State::Ready
                    },
                )
            })
            .collect()
    }

    fn sixty(repeat: u32) -> Step {
        Step {
            mode: ControlMode::AngleOpenLoop,
            level: 60.0,
            repeat,
        }
    }

    /// The protocol of [`two_steps`].
    fn two_parts() -> [Part; 2] {
        [1, 2].map(|repeat| Part {
            step: Some(sixty(repeat)),
            tracked: vec![Some(Setpoint::Angle(Hundredths(6_000)))],
        })
    }

    fn times(run: &Run) -> (i64, i64) {
        (run.rows[0].time_ms, run.rows[run.rows.len() - 1].time_ms)
    }

    #[test]
    fn runs_start_with_a_rest_and_do_not_overlap() {
        let rows = two_steps();
        let runs = split(&rows, &two_parts(), true);
        assert_eq!(runs.len(), 2);
        assert_eq!(times(&runs[0]), (500, 2_990));
        assert_eq!(times(&runs[1]), (3_000, 5_990));
        let segments: Vec<_> = runs.iter().filter_map(|run| run.segment(None)).collect();
        let expected = [(0.5, 3.0, 1), (3.0, 6.0, 2)].map(|(from_s, to_s, repeat)| SegmentMeta {
            from_s,
            to_s,
            setpoint_deg: Some(60.0),
            setpoint_kpa: None,
            repeat: Some(repeat),
        });
        assert_eq!(segments, expected);
    }

    #[test]
    fn a_run_that_was_cut_off_is_left_out() {
        let rows = two_steps();
        let cut = |end: usize| split(&rows[..end], &two_parts(), false).len();
        assert_eq!(cut(450), 1);
        assert_eq!(cut(150), 0);
        assert_eq!(cut(0), 0);
    }

    #[test]
    fn a_recording_that_ends_with_the_protocol_keeps_its_last_sample() {
        let rows = two_steps();
        let runs = split(&rows[..600], &two_parts(), true);
        assert_eq!(runs[1].segment(None).map(|segment| segment.to_s), Some(6.0));
        assert_eq!(times(&runs[1]).1, 5_990);
    }

    #[test]
    fn lost_lines_never_panic_and_do_not_give_a_run_the_level_of_another() {
        let mut all = two_steps();
        for row in all.iter_mut().filter(|row| row.time_ms >= 3_400) {
            if row.sample.setpoint != Setpoint::None {
                row.sample.setpoint = Setpoint::Angle(Hundredths(9_000));
            }
        }
        let mut parts = two_parts();
        parts[1].tracked = vec![Some(Setpoint::Angle(Hundredths(9_000)))];
        let step = parts[1].step.insert(sixty(1));
        step.level = 90.0;
        let levels = |from: i64, to: i64| -> Vec<f64> {
            let kept = all.iter().filter(|row| !(from..to).contains(&row.time_ms));
            let kept: Vec<LoggedSample> = kept.copied().collect();
            let runs = split(&kept, &parts, true);
            runs.iter()
                .filter_map(|run| run.step)
                .map(|step| step.level)
                .collect()
        };
        assert_eq!(levels(0, 0), [60.0, 90.0]);
        // The beginning of the first step, and all of it with its release.
        assert_eq!(levels(900, 1_300), [60.0, 90.0]);
        assert_eq!(levels(0, 2_600), [90.0]);
        assert_eq!(levels(0, 10_000), [0.0; 0]);
        for from in (0..7_000).step_by(70) {
            for to in (from..7_000).step_by(130) {
                levels(from, to);
            }
        }
    }

    #[test]
    fn parts_begin_at_rest() {
        let deg = |level| Hundredths(level * 100);
        let step = |level| Segment::Step {
            mode: ControlMode::Pressure,
            level: deg(level),
            duration_ms: 2_000,
        };
        let ramp = Segment::Ramp {
            mode: ControlMode::Pressure,
            level: deg(9),
            duration_ms: 1_000,
        };
        let release = |duration_ms| Segment::Release { duration_ms };
        let hold = Segment::Hold { duration_ms: 500 };
        // The level and repeat of each part, and how often something begins to be
        // tracked in it.
        let found = |segments: &[Segment]| -> Vec<(Option<(f64, u32)>, usize)> {
            let protocol = ProtocolFile::new("p".into(), String::new(), segments.to_vec());
            let level = |part: &Part| part.step.map(|step| (step.level, step.repeat));
            parts(&protocol)
                .iter()
                .map(|part| (level(part), part.tracked.len()))
                .collect()
        };
        assert_eq!(
            found(&[
                step(20),
                release(1_000),
                ramp,
                release(1_000),
                step(20),
                release(1)
            ]),
            [(Some((20.0, 1)), 1), (None, 1), (Some((20.0, 2)), 1)]
        );
        // After a hold or a short release nothing is at rest.
        assert_eq!(
            found(&[hold, step(20), hold, step(20), ramp, release(999), ramp]),
            [(None, 3)]
        );
        assert_eq!(found(&[release(5_000), hold]), []);
    }

    #[test]
    fn runs_are_named_after_their_level() {
        let path = Path::new("out").join("R.csv");
        let named = run_path(&path, &sixty(1));
        assert_eq!(named, Path::new("out").join("R_60_1.csv"));
        assert_eq!(whole_name(&named, &sixty(1)).unwrap(), "R.csv");
        let step = Step {
            mode: ControlMode::Pressure,
            level: 42.5,
            repeat: 2,
        };
        assert_eq!(
            run_path(&path, &step),
            Path::new("out").join("R_42.5kpa_2.csv")
        );
    }
}
