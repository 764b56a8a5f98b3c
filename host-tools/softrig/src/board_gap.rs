//! The error of the board's own prediction.
//!
//! The firmware simulates the uploaded model beside the actuator and logs the predicted angle
//! next to the measured one. The gap needs no model and fits nothing: it subtracts two columns of
//! a recording, before and after an upload.

use std::ops::Range;

use schemars::JsonSchema;
use serde::Serialize;
use softrig_formats::error::InputError;
use softrig_formats::recording::{Meta, Recording, SegmentMeta};
use wire::protocol::{ControlMode, Segment};

use crate::estimate::assemble::{Group, grouped};
use crate::prediction::Prediction;
use crate::statistics::rms;

/// One run with the board's prediction.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictedRun {
    /// Name of the recording, and of its segment if it has several.
    pub name: String,
    /// Set-point and repeat, if it is a step.
    pub step: Option<String>,
    /// Time since the run's first sample (s).
    pub time_s: Vec<f64>,
    /// Measured angle (°).
    pub measured_deg: Vec<f64>,
    /// Predicted angle (°); NaN where the board predicted none.
    pub predicted_deg: Vec<f64>,
    /// Set-point of a closed loop (°); NaN where there was none.
    pub setpoint_deg: Vec<f64>,
}

impl PredictedRun {
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
        let predicted = Prediction::of_board().angles(recording)?;
        Ok(Self {
            name: recording.name.clone(),
            step: step((recording.meta.setpoint_deg, None), recording.meta.repeat),
            time_s: recording.time.clone(),
            measured_deg: recording.angle.iter().map(|a| a.to_degrees()).collect(),
            predicted_deg: predicted.iter().map(|a| a.to_degrees()).collect(),
            setpoint_deg: recording
                .column("setpoint_deg")
                .filter(|_| !is_open_loop(&recording.meta))
                .unwrap_or_else(|| vec![f64::NAN; recording.len()]),
        })
    }

    /// The samples of a segment.
    fn run(&self, segment: &SegmentMeta) -> Self {
        let within: Vec<usize> = (0..self.time_s.len())
            .filter(|&row| self.time_s[row] >= segment.from_s && self.time_s[row] < segment.to_s)
            .collect();
        let first = within.first().map_or(0.0, |&row| self.time_s[row]);
        let pick = |column: &[f64]| within.iter().map(|&row| column[row]).collect();
        Self {
            name: format!("{} {}", self.name, label(segment)),
            step: step((segment.setpoint_deg, segment.setpoint_kpa), segment.repeat),
            time_s: within.iter().map(|&row| self.time_s[row] - first).collect(),
            measured_deg: pick(&self.measured_deg),
            predicted_deg: pick(&self.predicted_deg),
            setpoint_deg: pick(&self.setpoint_deg),
        }
    }

    /// Predicted minus measured (°); NaN where the board predicted none.
    pub fn errors(&self) -> Vec<f64> {
        self.predicted_deg
            .iter()
            .zip(&self.measured_deg)
            .map(|(predicted, measured)| predicted - measured)
            .collect()
    }

    fn finite_errors(&self) -> Vec<f64> {
        let mut errors = self.errors();
        errors.retain(|error| error.is_finite());
        errors
    }

    /// The stretches in which a set-point was held.
    fn held(&self) -> Vec<Range<usize>> {
        const HELD_S: f64 = 1.0;
        let mut rows = 0..0;
        self.setpoint_deg
            .chunk_by(|one, next| one.to_bits() == next.to_bits())
            .map(|stretch| {
                rows = rows.end..rows.end + stretch.len();
                rows.clone()
            })
            .filter(|rows| {
                let lasts = self.time_s[rows.end - 1] - self.time_s[rows.start];
                self.setpoint_deg[rows.start].is_finite() && lasts >= HELD_S
            })
            .collect()
    }

    /// Measured angle less set-point (°): of set-points that were held, in the second half of their
    /// time, since no pump is there at once. Where none was held, as along a ramp, of all.
    fn tracking_errors(&self) -> Vec<f64> {
        let held = self.held();
        let rows: Vec<usize> = if held.is_empty() {
            (0..self.setpoint_deg.len()).collect()
        } else {
            let late = |rows: Range<usize>| rows.clone().skip(rows.len() / 2);
            held.into_iter().flat_map(late).collect()
        };
        let errors = rows
            .into_iter()
            .map(|row| self.measured_deg[row] - self.setpoint_deg[row]);
        errors.filter(|error| error.is_finite()).collect()
    }

    /// How far the angle went beyond each set-point that was held, in percent of the way to it.
    /// Ways shorter than 5° are left out.
    fn overshoots_percent(&self) -> Vec<f64> {
        const LEAST_WAY_DEG: f64 = 5.0;
        let overshoot = |rows: Range<usize>| {
            let goal = self.setpoint_deg[rows.start];
            let way = goal - self.measured_deg[rows.start];
            (way.abs() >= LEAST_WAY_DEG).then(|| {
                let beyond = self.measured_deg[rows].iter().map(|it| (it - goal) / way);
                100.0 * beyond.fold(0.0, f64::max)
            })
        };
        self.held().into_iter().filter_map(overshoot).collect()
    }

    /// RMS error where the board predicted (°).
    pub fn rms_deg(&self) -> f64 {
        rms(&self.finite_errors())
    }

    /// The largest error where the board predicted (°).
    pub fn largest_deg(&self) -> f64 {
        self.finite_errors()
            .iter()
            .fold(0.0, |largest, error| largest.max(error.abs()))
    }
}

/// Whether a protocol was played and no part of it in closed loop: then nothing followed the
/// set-points, and a step may end before the pump has come to it.
fn is_open_loop(meta: &Meta) -> bool {
    let mut segments = meta.segments.iter();
    let closed = Some(ControlMode::AngleClosedLoop);
    let is_closed =
        |it: &String| Segment::parse(it.as_bytes()).is_some_and(|it| it.mode() == closed);
    !meta.segments.is_empty() && !segments.any(is_closed)
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

/// The runs of recordings with the board's prediction in them, and notes about recordings that
/// are left out. Of a session, only the runs that its metadata lists count.
///
/// # Errors
///
/// Names a recording without predictions.
pub fn predicted_runs(
    recordings: &[Recording],
) -> Result<(Vec<PredictedRun>, Vec<String>), InputError> {
    let (mut runs, mut notes) = (Vec::new(), Vec::new());
    for group in grouped(recordings.iter().map(|recording| (recording, true))) {
        let (used, note) = used_of(&group);
        notes.extend(note);
        for recording in used {
            runs.extend(PredictedRun::runs(recording)?);
        }
    }
    Ok((runs, notes))
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

/// The errors of a run, in degrees.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct RunError {
    /// Name of the run.
    pub name: String,
    /// RMS error (°).
    pub rms_deg: f64,
    /// Largest error (°).
    pub largest_deg: f64,
}

/// The errors of some runs, in degrees.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct GapOf {
    /// RMS over all samples of all runs (°).
    pub rms_deg: f64,
    /// The largest of all (°).
    pub largest_deg: f64,
    /// How the angle followed its set-points; none without any in degrees.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub tracking: Option<Tracking>,
    /// Each run.
    pub runs: Vec<RunError>,
}

/// How a rig followed set-points in degrees, in closed loop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Tracking {
    /// RMS of measured angle less set-point (°): of set-points that were held, in the second half of
    /// their time; where none was held, of all.
    pub rms_deg: f64,
    /// The farthest that the angle went beyond a set-point, in percent of the way to it; none where no
    /// set-point was held.
    pub overshoot_percent: Option<f64>,
}

impl Tracking {
    fn of(runs: &[PredictedRun]) -> Option<Self> {
        let errors: Vec<f64> = runs
            .iter()
            .flat_map(PredictedRun::tracking_errors)
            .collect();
        (!errors.is_empty()).then(|| Self {
            rms_deg: rms(&errors),
            overshoot_percent: runs
                .iter()
                .flat_map(PredictedRun::overshoots_percent)
                .reduce(f64::max),
        })
    }

    /// In words: the error, and the overshoot.
    fn words(self) -> String {
        let error = format!("{:.2}° RMS", self.rms_deg);
        match self.overshoot_percent {
            Some(percent) => format!("{error} (largest overshoot {percent:.0} %)"),
            None => error,
        }
    }
}

impl GapOf {
    /// Of runs.
    pub fn runs(runs: &[PredictedRun]) -> Self {
        let all: Vec<f64> = runs.iter().flat_map(PredictedRun::finite_errors).collect();
        let each = runs.iter().map(|run| RunError {
            name: run.name.clone(),
            rms_deg: run.rms_deg(),
            largest_deg: run.largest_deg(),
        });
        Self {
            rms_deg: rms(&all),
            largest_deg: runs
                .iter()
                .map(PredictedRun::largest_deg)
                .fold(0.0, f64::max),
            tracking: Tracking::of(runs),
            runs: each.collect(),
        }
    }
}

/// The gap before and after an upload, as `softrig gap --json` writes it.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct BoardGap {
    /// Version of the layout.
    pub schema: u32,
    /// The gap before the upload, or of the present model.
    pub before: GapOf,
    /// The gap after it; none without recordings.
    pub after: Option<GapOf>,
    /// What the upload changed; none without recordings after it.
    pub sentence: Option<String>,
    /// How the rig follows its set-points, before and after; none without set-points in degrees.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub tracking: Option<String>,
}

impl BoardGap {
    /// Of runs before and after an upload; `after` may be empty.
    pub fn of(before: &[PredictedRun], after: &[PredictedRun]) -> Self {
        let before = GapOf::runs(before);
        let after = (!after.is_empty()).then(|| GapOf::runs(after));
        let tracking = match (before.tracking, after.as_ref().map(|it| it.tracking)) {
            (Some(now), None) => Some(format!("The rig misses its set-points by {}.", now.words())),
            (Some(before), Some(Some(after))) => Some(format!(
                "The rig misses its set-points by {}; before the upload by {}.",
                after.words(),
                before.words()
            )),
            _ => None,
        };
        Self {
            schema: 1,
            tracking,
            sentence: after
                .as_ref()
                .map(|after| sentence(before.rms_deg, after.rms_deg)),
            before,
            after,
        }
    }
}

fn sentence(before: f64, after: f64) -> String {
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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn recording(rows: &str) -> Recording {
        let text = format!("time_s,pressure_kpa,angle_deg,predicted_deg\n{rows}");
        Recording::parse(&text, Path::new("run.csv")).unwrap().0
    }

    #[test]
    fn the_gap_is_predicted_less_measured_where_both_exist() {
        let gap = PredictedRun::of(&recording("0,0,1,4\n0.01,0,2,\n0.02,0,5,1\n")).unwrap();
        assert_eq!(gap.finite_errors().len(), 2);
        assert!((gap.rms_deg() - 12.5_f64.sqrt()).abs() < 1e-12);
        assert!((gap.largest_deg() - 4.0).abs() < 1e-12);
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
        let runs = PredictedRun::runs(&session).unwrap();
        let names: Vec<&str> = runs.iter().map(|run| run.name.as_str()).collect();
        assert_eq!(names, ["run 60° 1", "run 42.5 kPa 2"]);
        // They have been radians.
        for (error, expected) in runs[0].finite_errors().into_iter().zip([1.0, 2.0]) {
            assert!((error - expected).abs() < 1e-12, "{error}");
        }
        assert_eq!(runs[0].finite_errors().len(), 2);
        assert_eq!(runs[0].time_s, [0.0, 1.0]);
        assert_eq!(runs[1].finite_errors(), [3.0]);
        let gap = BoardGap::of(&runs, &[]);
        assert!((gap.before.rms_deg - (14.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert_eq!((gap.after, gap.sentence), (None, None));
    }

    #[test]
    fn segments_without_samples_are_refused() {
        let mut session = session();
        session.meta.segment = vec![segment(7.0, 2.0)];
        let error = PredictedRun::runs(&session).unwrap_err().to_string();
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
        assert!(PredictedRun::of(&recording("0,0,1,\n0.01,0,2,\n")).is_err());
        let plain = Recording::parse(
            "time_s,pressure_kpa,angle_deg\n0,0,1\n0.01,0,2\n",
            Path::new("run.csv"),
        );
        let error = PredictedRun::of(&plain.unwrap().0)
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains("predicted_deg"), "{error}");
    }

    #[test]
    fn tracking_is_the_error_at_held_set_points_and_the_overshoot_on_the_way() {
        let parsed = |rows: &[(f64, f64)]| {
            let mut text = "time_s,pressure_kpa,angle_deg,predicted_deg,setpoint_deg\n".to_owned();
            for (row, (setpoint, angle)) in rows.iter().enumerate() {
                let setpoint = Some(setpoint).filter(|it| it.is_finite());
                let setpoint = setpoint.map_or_else(String::new, ToString::to_string);
                text += &format!("{:.2},0,{angle},1,{setpoint}\n", row as f64 * 0.01);
            }
            let (run, _) = Recording::parse(&text, Path::new("run.csv")).unwrap();
            [PredictedRun::of(&run).unwrap()]
        };
        // From 4° through a set-point on its way to 20°, with an overshoot of 4°, held 1° above.
        let held = (0..=200).map(|row| (20.0, if row < 100 { 24.0 } else { 21.0 }));
        let before = [(f64::NAN, 4.0), (12.0, 4.0), (20.0, 4.0)];
        let run = parsed(&before.into_iter().chain(held).collect::<Vec<_>>());
        let tracking = GapOf::runs(&run).tracking.unwrap();
        assert!(
            (tracking.rms_deg - 1.0).abs() < 1e-9,
            "{}",
            tracking.rms_deg
        );
        let overshoot = tracking.overshoot_percent.unwrap();
        assert!((overshoot - 25.0).abs() < 1e-9, "{overshoot}");
        let said = BoardGap::of(&run, &run).tracking.unwrap();
        assert!(
            said.contains("by 1.00° RMS (largest overshoot 25 %); before"),
            "{said}"
        );

        let ramp: Vec<(f64, f64)> = (0..300)
            .map(|row| (f64::from(row), f64::from(row) - 2.0))
            .collect();
        let tracking = GapOf::runs(&parsed(&ramp)).tracking.unwrap();
        assert!(
            (tracking.rms_deg - 2.0).abs() < 1e-9,
            "{}",
            tracking.rms_deg
        );
        assert_eq!(tracking.overshoot_percent, None);

        let text =
            "time_s,pressure_kpa,angle_deg,predicted_deg,setpoint_deg\n0,0,1,1,20\n0.01,0,2,2,20\n";
        let (mut recording, _) = Recording::parse(text, Path::new("run.csv")).unwrap();
        for (segment, is_followed) in [
            ("step deg 20.00 5000", true),
            ("step open 20.00 5000", false),
        ] {
            recording.meta.segments = vec![segment.into()];
            let run = [PredictedRun::of(&recording).unwrap()];
            assert_eq!(
                GapOf::runs(&run).tracking.is_some(),
                is_followed,
                "{segment}"
            );
        }
    }

    #[test]
    fn a_worse_prediction_is_not_called_an_improvement() {
        let good = [PredictedRun::of(&recording("0,0,1,1.1\n0.01,0,2,2.1\n")).unwrap()];
        let bad = [PredictedRun::of(&recording("0,0,1,2\n0.01,0,2,3\n")).unwrap()];
        let said = |before, after| BoardGap::of(before, after).sentence.unwrap_or_default();
        assert!(said(&bad, &good).contains("by 90 %"));
        assert!(said(&good, &bad).contains("grew"));
        assert!(said(&good, &good).contains("stayed"));
    }
}
