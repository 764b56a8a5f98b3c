//! One file for each step of a protocol of steps.
//!
//! `rig diagnose` and `rig compare` want runs: a rest, a step, its release.
//! They are cut where the telemetry's own set-point says that a step begins, so
//! that lost lines and the delays of the link do not shift them.

use std::path::{Path, PathBuf};

use wire::protocol::{Segment, Track};
use wire::state::State;
use wire::telemetry::Setpoint;

use super::meta::About;
use super::sheet::{COLUMNS, line};
use super::{Row, meta_path};
use crate::error::{InputError, write_atomically};
use crate::protocol_file::ProtocolFile;

/// Rest in front of each step (ms), so that a run shows its zero.
const REST_MS: i64 = 500;

/// One step of a protocol of steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// What is tracked.
    pub track: Track,
    /// The level (° or kPa).
    pub level: f64,
    /// Which step to this level it is, from 1.
    pub repeat: u32,
}

/// The steps of a protocol in which every step is followed by a release that is
/// long enough to come to rest; none of another protocol.
pub fn steps(protocol: &ProtocolFile) -> Option<Vec<Step>> {
    let played = protocol.played();
    let mut steps: Vec<Step> = Vec::new();
    for pair in played.chunks(2) {
        let [step, release] = pair else { return None };
        let (Segment::Step { track, level, .. }, Segment::Release { duration_ms }) =
            (step.segment, release.segment)
        else {
            return None;
        };
        if i64::from(duration_ms) < 2 * REST_MS {
            return None;
        }
        let level = f64::from(level.0) / 100.0;
        let same = |step: &&Step| step.track == track && (step.level - level).abs() < 1e-9;
        let before = steps.iter().filter(same).count();
        steps.push(Step {
            track,
            level,
            repeat: u32::try_from(before).unwrap_or(u32::MAX) + 1,
        });
    }
    (!steps.is_empty()).then_some(steps)
}

/// The file of a run: `R_60_1.csv` beside `R.csv`.
pub fn run_path(whole: &Path, step: &Step) -> PathBuf {
    let stem = whole
        .file_stem()
        .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    let unit = match step.track {
        Track::Pressure => "kpa",
        Track::AngleOpenLoop | Track::AngleClosedLoop => "",
    };
    whole.with_file_name(format!("{stem}_{}{unit}_{}.csv", step.level, step.repeat))
}

/// The rows of each step that was played to its end, in order.
pub(super) fn split<'r>(rows: &'r [Row], steps: &[Step], complete: bool) -> Vec<&'r [Row]> {
    let tracks =
        |row: &Row| row.sample.state == State::Running && row.sample.setpoint != Setpoint::None;
    // The set-point follows a limited rate, so its level is not yet the step's
    // at the first row; that it is there at all marks the beginning.
    let onsets: Vec<usize> = (0..rows.len())
        .filter(|&row| tracks(&rows[row]) && (row == 0 || !tracks(&rows[row - 1])))
        .collect();
    let begins = |onset: usize| {
        let rest = rows[onset].time_ms - REST_MS;
        rows.partition_point(|row| row.time_ms < rest)
    };
    let mut runs = Vec::new();
    for (number, &onset) in onsets.iter().enumerate().take(steps.len()) {
        let end = match onsets.get(number + 1) {
            Some(&next) => begins(next),
            None if complete && number + 1 == steps.len() => rows[onset..]
                .iter()
                .position(|row| row.sample.state != State::Running)
                .map_or(rows.len(), |length| onset + length),
            None => break,
        };
        runs.push(&rows[begins(onset)..end]);
    }
    runs
}

/// Writes a run and what is known about it; its time starts at zero.
pub(super) fn write_run(
    path: &Path,
    step: &Step,
    rows: &[Row],
    whole: &About,
) -> Result<(), InputError> {
    let Some(first) = rows.first() else {
        return Ok(());
    };
    let last = rows.last().unwrap_or(first);
    let mut text = format!("{COLUMNS}\n");
    for row in rows {
        text += &line(&Row {
            time_ms: row.time_ms - first.time_ms,
            ..*row
        });
    }
    let begins_s = first.time_ms as f64 / 1000.0;
    let ends_s = last.time_ms as f64 / 1000.0;
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
    let is_pressure = step.track == Track::Pressure;
    let steps_in = last.sample.sequence.wrapping_sub(first.sample.sequence);
    let about = About {
        setpoint_deg: (!is_pressure).then_some(step.level),
        setpoint_kpa: is_pressure.then_some(step.level),
        repeat: Some(step.repeat),
        complete: true,
        samples: rows.len() as u64,
        dropped_lines: (u64::from(steps_in) + 1).saturating_sub(rows.len() as u64),
        part_of: whole_name(path, step),
        begins_s: Some(begins_s),
        runs: Vec::new(),
        gap,
        ..whole.clone()
    };
    write_atomically(&meta_path(path), about.to_text().as_bytes())?;
    write_atomically(path, text.as_bytes())
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

    fn row(time_ms: i64, setpoint: Setpoint, state: State) -> Row {
        Row {
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
    fn two_steps() -> Vec<Row> {
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
            track: Track::AngleOpenLoop,
            level: 60.0,
            repeat,
        }
    }

    #[test]
    fn runs_start_with_a_rest_and_do_not_overlap() {
        let rows = two_steps();
        let runs = split(&rows, &[sixty(1), sixty(2)], true);
        let times = |run: &[Row]| (run[0].time_ms, run[run.len() - 1].time_ms);
        assert_eq!(times(runs[0]), (500, 2_990));
        assert_eq!(times(runs[1]), (3_000, 5_990));
    }

    #[test]
    fn a_run_that_was_cut_off_is_left_out() {
        let rows = two_steps();
        assert_eq!(split(&rows[..450], &[sixty(1), sixty(2)], false).len(), 1);
        assert!(split(&rows[..150], &[sixty(1), sixty(2)], false).is_empty());
    }

    #[test]
    fn runs_are_named_after_their_level() {
        let path = Path::new("out").join("R.csv");
        let named = run_path(&path, &sixty(1));
        assert_eq!(named, Path::new("out").join("R_60_1.csv"));
        assert_eq!(whole_name(&named, &sixty(1)).unwrap(), "R.csv");
        let step = Step {
            track: Track::Pressure,
            level: 42.5,
            repeat: 2,
        };
        assert_eq!(
            run_path(&path, &step),
            Path::new("out").join("R_42.5kpa_2.csv")
        );
    }
}
