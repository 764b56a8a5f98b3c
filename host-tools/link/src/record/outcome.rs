//! How a recording ended, in words.

use anyhow::Context;

use super::{Gap, Part, Recorder, black_box_path};
use crate::Counters;

/// How a recording ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// As expected.
    Complete,
    /// It was enough before.
    Interrupted,
}

/// A recording that was made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordingOutcome {
    /// What is in it, line by line.
    pub text: String,
    /// Whether a protocol was played.
    pub has_moved: bool,
}

impl RecordingOutcome {
    /// Completes the files.
    pub(super) fn of(
        mut recorder: Recorder,
        counters: &Counters,
        outcome: anyhow::Result<End>,
        parts: &[Part],
        cut: bool,
    ) -> anyhow::Result<Self> {
        recorder.counts.count(counters);
        recorder.about.complete = matches!(outcome, Ok(End::Complete));
        let has_moved = !recorder.about.segments.is_empty();
        let text = text(&recorder);
        let kept = kept(&recorder);
        let finished = recorder.finish(parts, cut);
        // The cause comes first; that the recording could not be completed follows from it.
        let outcome = outcome.map_err(|error| error.context(kept.clone()))?;
        let runs = finished.context(kept.clone())?;
        if outcome == End::Interrupted {
            anyhow::bail!("interrupted; the pump was told to stop, {kept}");
        }
        let runs_said = match (runs.first(), runs.last()) {
            (Some(first), Some(last)) => format!(
                "{} runs: {} … {}\n",
                runs.len(),
                first.display(),
                last.display()
            ),
            _ => String::new(),
        };
        Ok(Self {
            text: text + &runs_said,
            has_moved,
        })
    }
}

/// What is kept of a recording that did not come to its end.
fn kept(recorder: &Recorder) -> String {
    let mut kept = format!(
        "{} samples are kept in {}",
        recorder.counts.samples,
        recorder.path.display()
    );
    if recorder.about.black_box.is_some() {
        kept += &format!(
            ", the second before the fault, as the board saw it, in {}",
            black_box_path(&recorder.path).display()
        );
    }
    if let Some(restarts) = told_restarts(&recorder.about.gap) {
        kept += &format!("; {restarts}");
    }
    kept
}

/// What is in a recording.
fn text(recorder: &Recorder) -> String {
    let counts = recorder.counts;
    let gaps = recorder.about.gap.len() as u64;
    let mut text = format!("{}: {} samples", recorder.path.display(), counts.samples);
    for (count, what) in [
        (counts.dropped_lines, "lines were lost on the way"),
        (gaps, "gaps"),
        (
            counts.rows_without_reading,
            "rows without a reading are in the .faulty.csv beside it",
        ),
    ] {
        if count > 0 {
            text += &format!(", {count} {what}");
        }
    }
    text.push('\n');
    if let Some(from_s) = recorder.about.mismatch_from_s {
        text += &format!(
            "from {from_s:.1} s on the angle disagrees with the board's prediction (column mismatch): a flex sensor that came off, or a model that is wrong\n"
        );
    }
    text += &recorder
        .about
        .lost_steps
        .map_or_else(String::new, told_lost);
    if recorder.about.black_box.is_some() {
        text += &format!(
            "the second before the fault, as the board saw it: {}\n",
            black_box_path(&recorder.path).display()
        );
    }
    if let Some(restarts) = told_restarts(&recorder.about.gap) {
        text += &format!("{restarts}\n");
    }
    text
}

/// Where the board started anew within the recording, if it did.
fn told_restarts(gaps: &[Gap]) -> Option<String> {
    let restarts: Vec<String> = gaps
        .iter()
        .filter(|gap| gap.restarted)
        .map(|gap| format!("{:.1} s", gap.from_s))
        .collect();
    (!restarts.is_empty()).then(|| {
        format!(
            "the board restarted after {}: look at its supply and the cable; its times after that are by this computer's clock",
            restarts.join(", ")
        )
    })
}

/// Microsteps within which a home is found: what `softrig commission` bears.
const HOME_STEPS: u32 = 17;

/// What lost steps mean for the recording.
fn told_lost(steps: i32) -> String {
    let most = steps.unsigned_abs();
    if most <= HOME_STEPS {
        return format!("no steps lost: the plunger came home within {most} microsteps\n");
    }
    let way = if steps > 0 {
        "less far in"
    } else {
        "farther in"
    };
    format!(
        "{most} microsteps were lost: at the end the plunger stood {way} than pump_ul says; check the driver's current and 12 V, the coupling, and whether the plunger rubs\n"
    )
}
