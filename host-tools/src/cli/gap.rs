//! `rig gap`: the error of the board's own prediction.
//!
//! The firmware simulates the uploaded model beside the actuator and logs the predicted
//! angle next to the measured one. This command needs no model and fits nothing: it
//! subtracts two columns of a recording, before and after an upload.

use std::ops::Range;
use std::path::PathBuf;

use clap::Parser;
use serde_json::{Value, json};

use super::input::InputArgs;
use super::output::{self, FileKind, Output};
use crate::plot::{Figure, Panel, Series, Style, write_svg};
use softrig::estimate::assemble::{Group, grouped};
use softrig::statistics::rms;
use softrig_formats::columns::Layout;
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::recording::{Recording, SegmentMeta, check_distinct, read_all};

/// Shows the gap between the angle that the board predicts and the angle that
/// it measures, before and after an upload.
///
/// The prediction is the column predicted_deg that `rig record` writes: the board
/// simulates its model from the measured pressure. Of a session, only the runs
/// that its metadata lists count.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  rig gap run.csv
  rig gap before/run.csv --after after/run.csv --plot gap.svg
  rig gap before/run.csv --after after/run.csv --json gap.json")]
pub struct Args {
    /// Recordings made with the present model, or before the upload
    #[arg(required = true, value_name = "REC.csv")]
    recordings: Vec<PathBuf>,
    /// Recordings made after the upload
    #[arg(long, num_args = 1.., value_name = "REC.csv")]
    after: Vec<PathBuf>,
    /// Draw the worst run, before and after, with its errors. Runs before and after are
    /// matched by name, else by set-point and repeat, else by their order
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Write the errors of every run and of all runs as JSON
    #[arg(long, value_name = "GAP.json")]
    json: Option<PathBuf>,
    #[command(flatten)]
    input: InputArgs,
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let read = args.recordings.iter().chain(&args.after);
    output::check(
        &[
            Output::of("--plot", FileKind::Picture, args.plot.as_ref()),
            Output::of("--json", FileKind::Json, args.json.as_ref()),
        ],
        read,
    )?;
    check_distinct(&args.recordings, &args.after)?;
    let layout = args.input.layout();
    let before = gaps(&args.recordings, &layout)?;
    let after = gaps(&args.after, &layout)?;
    let mut text = table(&before, &after);
    if let Some(path) = &args.plot {
        write_svg(path, &figure(&before, &after))?;
        text += &format!("\npicture: {}\n", path.display());
    }
    if let Some(path) = &args.json {
        let mut json = serde_json::to_string_pretty(&json(&before, &after))?;
        json.push('\n');
        write_atomically(path, json.as_bytes())?;
    }
    Ok(super::print(&text)?)
}

/// One run with the board's prediction, in degrees.
#[derive(Clone, Debug, PartialEq)]
struct Gap {
    name: String,
    /// Set-point and repeat, if it is a step.
    step: Option<String>,
    /// Time since the run's first sample (s).
    time: Vec<f64>,
    measured: Vec<f64>,
    predicted: Vec<f64>,
}

impl Gap {
    /// The runs of a recording: the segments of a session, or all of it.
    fn runs(recording: &Recording) -> Result<Vec<Self>, InputError> {
        let whole = Self::of(recording)?;
        let segments = &recording.meta.segment;
        if segments.is_empty() {
            return Ok(vec![whole]);
        }
        let runs: Vec<Self> = segments
            .iter()
            .map(|segment| whole.run(segment))
            .filter(|run| !run.finite_errors().is_empty())
            .collect();
        if runs.is_empty() {
            return Err(InputError::new(
                "has no prediction of the board in any of the segments that its metadata lists",
                "correct from_s and to_s there, or record again",
            )
            .in_file(&recording.path));
        }
        Ok(runs)
    }

    fn of(recording: &Recording) -> Result<Self, InputError> {
        let predicted = recording
            .column("predicted_deg")
            .filter(|column| column.iter().any(|value| value.is_finite()))
            .ok_or_else(|| {
                InputError::new(
                    "has no column predicted_deg with numbers in it",
                    "give recordings of `rig record`: the board logs its prediction in them",
                )
                .in_file(&recording.path)
            })?;
        Ok(Self {
            name: recording.name.clone(),
            step: step((recording.meta.setpoint_deg, None), recording.meta.repeat),
            time: recording.time.clone(),
            measured: recording.angle.iter().map(|a| a.to_degrees()).collect(),
            predicted,
        })
    }

    /// The samples of a segment.
    fn run(&self, segment: &SegmentMeta) -> Self {
        let within: Vec<usize> = (0..self.time.len())
            .filter(|&row| self.time[row] >= segment.from_s && self.time[row] < segment.to_s)
            .collect();
        let first = within.first().map_or(0.0, |&row| self.time[row]);
        let pick = |column: &[f64]| within.iter().map(|&row| column[row]).collect();
        Self {
            name: format!("{} {}", self.name, label(segment)),
            step: step((segment.setpoint_deg, segment.setpoint_kpa), segment.repeat),
            time: within.iter().map(|&row| self.time[row] - first).collect(),
            measured: pick(&self.measured),
            predicted: pick(&self.predicted),
        }
    }

    /// Predicted minus measured, where the board predicted.
    fn errors(&self) -> Vec<f64> {
        self.predicted
            .iter()
            .zip(&self.measured)
            .map(|(predicted, measured)| predicted - measured)
            .collect()
    }

    fn finite_errors(&self) -> Vec<f64> {
        let mut errors = self.errors();
        errors.retain(|error| error.is_finite());
        errors
    }

    fn rms(&self) -> f64 {
        rms(&self.finite_errors())
    }

    fn largest(&self) -> f64 {
        self.finite_errors()
            .iter()
            .fold(0.0, |largest, error| largest.max(error.abs()))
    }
}

/// The label of a segment within its session: its step, or its times.
fn label(segment: &SegmentMeta) -> String {
    step((segment.setpoint_deg, segment.setpoint_kpa), segment.repeat)
        .unwrap_or_else(|| format!("{:.1}–{:.1} s", segment.from_s, segment.to_s))
}

/// A step by its level (° or kPa) and its repeat; none without a level.
fn step((degrees, kilopascals): (Option<f64>, Option<f64>), repeat: Option<u32>) -> Option<String> {
    let level = match (degrees, kilopascals) {
        (Some(degrees), _) => format!("{degrees}°"),
        (None, Some(kilopascals)) => format!("{kilopascals} kPa"),
        (None, None) => return None,
    };
    Some(match repeat {
        Some(repeat) => format!("{level} {repeat}"),
        None => level,
    })
}

fn gaps(paths: &[PathBuf], layout: &Layout) -> Result<Vec<Gap>, InputError> {
    let recordings = read_all(paths, layout, super::warn)?;
    let mut gaps = Vec::new();
    for group in grouped(recordings.iter().map(|recording| (recording, true))) {
        let (used, note) = used_of(&group);
        if let Some(note) = note {
            super::warn(&note);
        }
        for recording in used {
            gaps.extend(Gap::runs(recording)?);
        }
    }
    Ok(gaps)
}

/// The recordings to use of a session given beside files cut from it: the session if it
/// lists its runs, otherwise the files. Also returns a note about what is left out.
fn used_of<'a>(group: &Group<'a>) -> (Vec<&'a Recording>, Option<String>) {
    let pieces: Vec<&Recording> = group.pieces.iter().map(|(piece, _)| *piece).collect();
    let Some((whole, _)) = group.whole else {
        return (pieces, None);
    };
    let files = match pieces.len() {
        0 => return (vec![whole], None),
        1 => "1 file".to_owned(),
        count => format!("{count} files"),
    };
    let path = whole.path.display();
    if whole.meta.segment.is_empty() {
        let note = format!("{path}: left out, {files} cut from it are used instead");
        (pieces, Some(note))
    } else {
        let note = format!("{path}: used once, {files} cut from it are left out");
        (vec![whole], Some(note))
    }
}

/// What the table says: for each side its runs and all of them together, in degrees. `after`
/// and the sentence are null without recordings after the upload.
fn json(before: &[Gap], after: &[Gap]) -> Value {
    let side = |gaps: &[Gap]| {
        let runs: Vec<Value> = gaps
            .iter()
            .map(
                |gap| json!({"name": gap.name, "rms_deg": gap.rms(), "largest_deg": gap.largest()}),
            )
            .collect();
        json!({"rms_deg": overall(gaps), "largest_deg": largest(gaps), "runs": runs})
    };
    let second = (!after.is_empty()).then_some(after);
    json!({
        "schema": 1,
        "before": side(before),
        "after": second.map(side),
        "sentence": second.map(|after| sentence(before, after)),
    })
}

/// RMS over all samples of all runs (°).
fn overall(gaps: &[Gap]) -> f64 {
    rms(&gaps.iter().flat_map(Gap::finite_errors).collect::<Vec<_>>())
}

/// The largest error of all runs (°).
fn largest(gaps: &[Gap]) -> f64 {
    gaps.iter().map(Gap::largest).fold(0.0, f64::max)
}

fn table(before: &[Gap], after: &[Gap]) -> String {
    let mut text = format!(
        "The board's own prediction less its flex sensor\n\n{:<28} {:>8} {:>12}\n",
        "run", "RMS (°)", "largest (°)"
    );
    let mut rows = |title: &str, gaps: &[Gap]| {
        if gaps.is_empty() {
            return;
        }
        if !after.is_empty() {
            text += &format!("{title}\n");
        }
        for gap in gaps {
            let name: String = gap.name.chars().take(26).collect();
            text += &format!("  {name:<26} {:>8.3} {:>12.3}\n", gap.rms(), gap.largest());
        }
        if gaps.len() > 1 {
            let (rms, largest) = (overall(gaps), largest(gaps));
            text += &format!("  {:<26} {rms:>8.3} {largest:>12.3}\n", "all");
        }
    };
    rows("before", before);
    rows("after", after);
    if !after.is_empty() {
        text += &format!("\n{}\n", sentence(before, after));
    }
    text
}

fn sentence(before: &[Gap], after: &[Gap]) -> String {
    let (before, after) = (overall(before), overall(after));
    let change = 100.0 * (1.0 - after / before);
    if change >= 1.0 {
        format!("The gap shrank from {before:.2}° to {after:.2}° RMS, by {change:.0} %.")
    } else if change > -1.0 {
        format!("The gap stayed at {after:.2}° RMS.")
    } else {
        format!(
            "The gap grew from {before:.2}° to {after:.2}° RMS: the upload made the prediction worse."
        )
    }
}

/// The worst of some runs, by its index among all.
fn worst(gaps: &[Gap], of: impl IntoIterator<Item = usize>) -> Option<usize> {
    of.into_iter()
        .max_by(|&a, &b| gaps[a].rms().total_cmp(&gaps[b].rms()))
}

/// Pairs of runs before and after, by their indices.
type Pairing<'a> = &'a dyn Fn() -> Vec<(usize, usize)>;

/// Pairs runs before and after with the same key; of several, the first that is free.
fn pairs(before: &[Gap], after: &[Gap], key: impl Fn(&Gap) -> Option<&str>) -> Vec<(usize, usize)> {
    let mut left: Vec<usize> = (0..after.len()).collect();
    let mut pairs = Vec::new();
    for (index, gap) in before.iter().enumerate() {
        let same = |&other: &usize| key(gap).is_some() && key(&after[other]) == key(gap);
        if let Some(place) = left.iter().position(same) {
            pairs.push((index, left.remove(place)));
        }
    }
    pairs
}

/// The runs to draw before and after, and how they were chosen: two different runs would
/// show nothing about the upload.
fn drawn<'a>(before: &'a [Gap], after: &'a [Gap]) -> (Option<&'a Gap>, Option<&'a Gap>, String) {
    let all_before = || worst(before, 0..before.len()).map(|index| &before[index]);
    if after.is_empty() {
        return (all_before(), None, String::new());
    }
    let by_name = || pairs(before, after, |gap| Some(&gap.name));
    let by_step = || pairs(before, after, |gap| gap.step.as_deref());
    let by_order = || {
        let stepless = |gaps: &[Gap]| gaps.iter().all(|gap| gap.step.is_none());
        // Steps without a counterpart are different runs.
        let alike = before.len() == after.len() && (stepless(before) || stepless(after));
        let count = if alike { before.len() } else { 0 };
        (0..count).map(|index| (index, index)).collect()
    };
    let ways: [(&str, Pairing<'_>); 3] = [
        ("name", &by_name),
        ("set-point and repeat", &by_step),
        ("order", &by_order),
    ];
    for (how, pairs) in ways {
        let pairs = pairs();
        let Some(first) = worst(before, pairs.iter().map(|(first, _)| *first)) else {
            continue;
        };
        let second = pairs.iter().find(|pair| pair.0 == first).map(|pair| pair.1);
        let rest = if before.len().max(after.len()) == 1 {
            String::new()
        } else if pairs.len() == before.len() {
            "The run with the largest gap before; ".to_owned()
        } else {
            format!(
                "The largest gap before among the {} runs that were made on both sides; ",
                pairs.len()
            )
        };
        let note = if rest.is_empty() {
            format!("The two runs go together by {how}.")
        } else {
            format!("{rest}runs go together by {how}.")
        };
        return (
            Some(&before[first]),
            second.map(|index| &after[index]),
            note,
        );
    }
    let note = "No run after the upload has the name or the set-point of one before: these are \
                different runs, the worst of each side.";
    let second = worst(after, 0..after.len()).map(|index| &after[index]);
    (all_before(), second, note.to_owned())
}

fn figure(before: &[Gap], after: &[Gap]) -> Figure {
    let (first, second, note) = drawn(before, after);
    let title = if after.is_empty() {
        "What the board predicts and what it measures".to_owned()
    } else {
        sentence(before, after)
    };
    let shown: Vec<(&Gap, &str, Style)> = [
        first.map(|gap| (gap, "before the upload", Style::BEFORE)),
        second.map(|gap| (gap, "after the upload", Style::AFTER)),
    ]
    .into_iter()
    .flatten()
    .collect();
    let source =
        "Predicted on the microcontroller, from the measured pressure, while the run was made.";
    let mut figure = Figure::new(title)
        .with_subtitle(format!("{source} {note}").trim_end())
        .with_columns(shown.len().max(1))
        .with_separate_x();
    let alone = after.is_empty();
    let angles = range_of(&shown.iter().map(|(gap, ..)| *gap).collect::<Vec<_>>());
    for (gap, when, style) in &shown {
        let heading = if alone {
            gap.name.clone()
        } else {
            format!("{} ({when})", gap.name)
        };
        figure = figure.with_panel(
            Panel::new("time (s)", "angle (°)")
                .with_title(heading)
                .with_weight(1.6)
                .with_y_range(angles.start, angles.end)
                .with_series(Series::new(
                    "measured",
                    &gap.time,
                    &gap.measured,
                    Style::MEASURED,
                ))
                .with_series(Series::new("predicted", &gap.time, &gap.predicted, *style)),
        );
    }
    let reach = shown
        .iter()
        .map(|(gap, ..)| gap.largest())
        .fold(0.1, f64::max);
    for (gap, _, style) in &shown {
        figure = figure.with_panel(
            Panel::new("time (s)", "predicted − measured (°)")
                .with_y_range(-1.1 * reach, 1.1 * reach)
                .with_level(0.0)
                .with_series(Series::new("", &gap.time, &gap.errors(), *style)),
        );
    }
    figure
}

/// The common range (°) of runs drawn side by side: on separate scales a small gap would
/// look as large as a big one.
fn range_of(gaps: &[&Gap]) -> Range<f64> {
    let finite = gaps
        .iter()
        .flat_map(|gap| gap.measured.iter().chain(&gap.predicted))
        .copied()
        .filter(|angle| angle.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), angle| {
        (low.min(angle), high.max(angle))
    });
    let room = (0.05 * (high - low)).max(0.1);
    low - room..high + room
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn recording(rows: &str) -> Recording {
        let text = format!("time_s,pressure_kpa,angle_deg,predicted_deg\n{rows}");
        Recording::parse(&text, Path::new("run.csv")).unwrap().0
    }

    #[test]
    fn the_gap_is_predicted_less_measured_where_both_exist() {
        let gap = Gap::of(&recording("0,0,1,4\n0.01,0,2,\n0.02,0,5,1\n")).unwrap();
        assert_eq!(gap.finite_errors().len(), 2);
        assert!((gap.rms() - 12.5_f64.sqrt()).abs() < 1e-12);
        assert!((gap.largest() - 4.0).abs() < 1e-12);
    }

    fn segment(from_s: f64, to_s: f64) -> SegmentMeta {
        SegmentMeta {
            from_s,
            to_s,
            ..SegmentMeta::default()
        }
    }

    /// Errors of 9, 1, 2, 3 and 9 degrees, a second apart.
    fn session() -> Recording {
        recording("0,0,1,10\n1,0,1,2\n2,0,1,3\n3,0,1,4\n4,0,1,10\n")
    }

    #[test]
    fn the_segments_of_a_session_are_its_runs_and_nothing_else_counts() {
        let mut session = session();
        session.meta.segment = vec![
            SegmentMeta {
                setpoint_deg: Some(60.0),
                repeat: Some(1),
                ..segment(1.0, 3.0)
            },
            SegmentMeta {
                setpoint_kpa: Some(42.5),
                repeat: Some(2),
                ..segment(3.0, 4.0)
            },
            // Beyond the end.
            segment(90.0, f64::NAN),
        ];
        let runs = Gap::runs(&session).unwrap();
        let names: Vec<&str> = runs.iter().map(|run| run.name.as_str()).collect();
        assert_eq!(names, ["run 60° 1", "run 42.5 kPa 2"]);
        assert_eq!(runs[0].finite_errors(), [1.0, 2.0]);
        assert_eq!(runs[0].time, [0.0, 1.0]);
        assert_eq!(runs[1].finite_errors(), [3.0]);
        assert!((overall(&runs) - (14.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        let text = table(&runs, &[]);
        assert!(text.contains("run 60° 1") && text.contains("all"), "{text}");
    }

    #[test]
    fn segments_without_samples_are_refused() {
        let mut session = session();
        session.meta.segment = vec![segment(7.0, 2.0)];
        let error = Gap::runs(&session).unwrap_err().to_string();
        assert!(error.contains("segments"), "{error}");
        assert_eq!(label(&segment(7.0, 2.0)), "7.0–2.0 s");
    }

    #[test]
    fn a_session_beside_its_pieces_is_used_once() {
        let named = |name: &str, part_of: Option<&str>| {
            let mut recording = session();
            recording.path = Path::new("before").join(name);
            recording.meta.part_of = part_of.map(str::to_owned);
            recording.meta.begins_s = part_of.map(|_| 1.0);
            recording
        };
        let kept = |with_segments: bool| {
            let mut all = [
                named("run_60_1.csv", Some("run.csv")),
                named("run.csv", None),
                named("other_60_1.csv", Some("other.csv")),
            ];
            if with_segments {
                all[1].meta.segment = vec![segment(1.0, 3.0)];
            }
            let (mut names, mut notes) = (Vec::new(), Vec::new());
            for group in grouped(all.iter().map(|recording| (recording, true))) {
                let (used, note) = used_of(&group);
                notes.extend(note);
                names.extend(used.iter().filter_map(|it| it.path.file_name()?.to_str()));
            }
            assert_eq!(notes.len(), 1, "{notes:?}");
            let names = names.into_iter();
            (names.map(str::to_owned).collect::<Vec<_>>(), notes.concat())
        };
        let (names, note) = kept(true);
        assert_eq!(names, ["run.csv", "other_60_1.csv"]);
        assert!(note.contains("used once, 1 file cut from it"), "{note}");
        let (names, note) = kept(false);
        assert_eq!(names, ["run_60_1.csv", "other_60_1.csv"]);
        assert!(note.contains("run.csv: left out"), "{note}");
    }

    #[test]
    fn a_recording_without_predictions_is_refused() {
        assert!(Gap::of(&recording("0,0,1,\n0.01,0,2,\n")).is_err());
        let plain = Recording::parse(
            "time_s,pressure_kpa,angle_deg\n0,0,1\n0.01,0,2\n",
            Path::new("run.csv"),
        );
        let error = Gap::of(&plain.unwrap().0).err().unwrap().to_string();
        assert!(error.contains("predicted_deg"), "{error}");
    }

    #[test]
    fn the_same_runs_are_drawn_before_and_after() {
        // Runs of one error each (°).
        let run = |name: &str, step: Option<&str>, error: f64| Gap {
            name: name.to_owned(),
            step: step.map(str::to_owned),
            time: vec![0.0],
            measured: vec![1.0],
            predicted: vec![1.0 + error],
        };
        let chosen = |before: &[Gap], after: &[Gap]| {
            let (first, second, note) = drawn(before, after);
            let name = |gap: Option<&Gap>| gap.map_or_else(String::new, |gap| gap.name.clone());
            (name(first), name(second), note)
        };
        let pair = |first: &str, second: &str| (first.to_owned(), second.to_owned());

        // By name, though another run is the worst on each side.
        let before = [
            run("a", None, 9.0),
            run("b", None, 2.0),
            run("c", None, 3.0),
        ];
        let after = [
            run("d", None, 8.0),
            run("c", None, 0.1),
            run("b", None, 1.0),
        ];
        let (first, second, note) = chosen(&before, &after);
        assert_eq!((first, second), pair("c", "c"));
        assert!(
            note.contains("2 runs") && note.contains("by name"),
            "{note}"
        );

        // One session each, in files of other names.
        let before = [
            run("monday 30° 1", Some("30° 1"), 1.0),
            run("monday 60° 1", Some("60° 1"), 4.0),
        ];
        let after = [
            run("tuesday 60° 1", Some("60° 1"), 0.2),
            run("tuesday 30° 1", Some("30° 1"), 0.5),
        ];
        let (first, second, note) = chosen(&before, &after);
        assert_eq!((first, second), pair("monday 60° 1", "tuesday 60° 1"));
        assert!(note.contains("by set-point and repeat"), "{note}");

        // Nothing but their order.
        let before = [run("a", None, 1.0), run("b", None, 2.0)];
        let after = [run("x", None, 0.5), run("y", None, 0.1)];
        let (first, second, note) = chosen(&before, &after);
        assert_eq!((first, second), pair("b", "y"));
        assert!(note.contains("by order"), "{note}");
        let (first, second, note) = chosen(&before[1..], &after[..1]);
        assert_eq!((first, second), pair("b", "x"));
        assert_eq!(note, "The two runs go together by order.");

        // Other runs: said to be.
        for (before, after) in [
            (&before[..], &after[..1]),
            (
                &[run("a", Some("30° 1"), 1.0), run("b", Some("40° 1"), 2.0)][..],
                &[run("x", Some("60° 1"), 0.5), run("y", Some("90° 1"), 0.1)][..],
            ),
        ] {
            let (first, second, note) = chosen(before, after);
            assert_eq!((first, second), pair("b", "x"));
            assert!(note.contains("different runs"), "{note}");
        }
        let (first, second, note) = chosen(&before, &[]);
        assert_eq!((first, second), pair("b", ""));
        assert!(note.is_empty(), "{note}");
    }

    #[test]
    fn a_worse_prediction_is_not_called_an_improvement() {
        let good = [Gap::of(&recording("0,0,1,1.1\n0.01,0,2,2.1\n")).unwrap()];
        let bad = [Gap::of(&recording("0,0,1,2\n0.01,0,2,3\n")).unwrap()];
        assert!(sentence(&bad, &good).contains("by 90 %"));
        assert!(sentence(&good, &bad).contains("grew"));
        assert!(sentence(&good, &good).contains("stayed"));
    }
}
