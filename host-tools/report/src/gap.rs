//! The picture of a gap: what a board predicts beside what it measures, before and after an upload.

use std::ops::Range;

use softrig::board_gap::{BoardGap, PredictedRun};

use crate::plot::{Figure, Panel, Series, Style};

/// The worst of some runs, by its index among all.
fn worst(gaps: &[PredictedRun], of: impl IntoIterator<Item = usize>) -> Option<usize> {
    of.into_iter()
        .max_by(|&a, &b| gaps[a].rms_deg().total_cmp(&gaps[b].rms_deg()))
}

/// Pairs of runs before and after, by their indices.
type Pairing<'a> = &'a dyn Fn() -> Vec<(usize, usize)>;

/// Pairs runs before and after with the same key; of several, the first that is free.
fn pairs(
    before: &[PredictedRun],
    after: &[PredictedRun],
    key: impl Fn(&PredictedRun) -> Option<&str>,
) -> Vec<(usize, usize)> {
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
fn drawn<'a>(
    before: &'a [PredictedRun],
    after: &'a [PredictedRun],
) -> (Option<&'a PredictedRun>, Option<&'a PredictedRun>, String) {
    let all_before = || worst(before, 0..before.len()).map(|index| &before[index]);
    if after.is_empty() {
        return (all_before(), None, String::new());
    }
    let by_name = || pairs(before, after, |gap| Some(&gap.name));
    let by_step = || pairs(before, after, |gap| gap.step.as_deref());
    let by_order = || {
        let stepless = |gaps: &[PredictedRun]| gaps.iter().all(|gap| gap.step.is_none());
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
            format!("The two runs are paired by {how}.")
        } else {
            format!("{rest}runs are paired by {how}.")
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

/// The worst run before an upload, and its counterpart after it: angles, and errors below them.
pub fn gap_figure(before: &[PredictedRun], after: &[PredictedRun], gap: &BoardGap) -> Figure {
    let (first, second, note) = drawn(before, after);
    let title = gap
        .sentence
        .clone()
        .unwrap_or_else(|| "What the board predicts and what it measures".to_owned());
    let shown: Vec<(&PredictedRun, &str, Style)> = [
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
                    &gap.time_s,
                    &gap.measured_deg,
                    Style::MEASURED,
                ))
                .with_series(Series::new(
                    "predicted",
                    &gap.time_s,
                    &gap.predicted_deg,
                    *style,
                )),
        );
    }
    let reach = shown
        .iter()
        .map(|(gap, ..)| gap.largest_deg())
        .fold(0.1, f64::max);
    for (gap, _, style) in &shown {
        figure = figure.with_panel(
            Panel::new("time (s)", "predicted − measured (°)")
                .with_y_range(-1.1 * reach, 1.1 * reach)
                .with_level(0.0)
                .with_series(Series::new("", &gap.time_s, &gap.errors(), *style)),
        );
    }
    figure
}

/// The common range (°) of runs drawn side by side: on separate scales a small gap would
/// look as large as a big one.
fn range_of(gaps: &[&PredictedRun]) -> Range<f64> {
    let finite = gaps
        .iter()
        .flat_map(|gap| gap.measured_deg.iter().chain(&gap.predicted_deg))
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

    #[test]
    fn the_same_runs_are_drawn_before_and_after() {
        // Runs of one error each (°).
        let run = |name: &str, step: Option<&str>, error: f64| PredictedRun {
            name: name.to_owned(),
            step: step.map(str::to_owned),
            time_s: vec![0.0],
            measured_deg: vec![1.0],
            predicted_deg: vec![1.0 + error],
            setpoint_deg: vec![f64::NAN],
        };
        let chosen = |before: &[PredictedRun], after: &[PredictedRun]| {
            let (first, second, note) = drawn(before, after);
            let name =
                |gap: Option<&PredictedRun>| gap.map_or_else(String::new, |gap| gap.name.clone());
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
        assert_eq!(note, "The two runs are paired by order.");

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
}
