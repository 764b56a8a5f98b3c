//! The four numbers that matter most.

use serde::Serialize;

use super::explained::{at_horizons, of_the_refit};
use super::rivals::likeliest_explains;
use super::sentences::{best_closed, left_over};
use super::words::probability;
use crate::shares::Explained;
use softrig::diagnose::Diagnosis;
use softrig::diagnose::decide::finding::Finding;
use softrig::diagnose::recordings::noise::NoiseFloor;
use softrig_formats::measurand::Measurand;
use softrig_formats::numbers::{percent, short};

/// A number with its label.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Key {
    /// Its name.
    pub label: String,
    /// The number with its unit.
    pub value: String,
    /// How to read it.
    pub note: String,
}

/// The share of the error beyond the noise that is gone.
const EXPLAINED: &str = "error explained";

/// The note where nothing is named.
const UNNAMED: &str = "by an unnamed repair";

/// The four key numbers: the error, the noise floor, and two that depend on the answer.
pub(super) fn keys(diagnosis: &Diagnosis) -> Vec<Key> {
    let held_out = &diagnosis.held_out;
    let noise = key(
        "noise floor",
        diagnosis.shown(held_out.floor),
        noise_note(
            &diagnosis.floor,
            held_out.floor,
            &diagnosis.data.measurand(),
        ),
    );
    let [third, fourth] = match &diagnosis.finding {
        Finding::Quiet {
            refitted: false, ..
        } => [
            key(
                "error over noise",
                format!(
                    "{:.2}",
                    held_out.nominal / held_out.floor.max(f64::MIN_POSITIVE)
                ),
                "1 is the best possible",
            ),
            key(
                "runs",
                diagnosis.nominal.residuals.len().to_string(),
                format!("fitted, with {} samples", diagnosis.nominal.samples()),
            ),
        ],
        Finding::Noisy | Finding::Quiet { refitted: true, .. } => [
            explained_key(
                Explained::of_whole_runs(held_out.nominal, held_out.refit, held_out.floor),
                "by parameters alone, over whole runs",
            ),
            key("effects needed", "0".into(), left_over(diagnosis)),
        ],
        Finding::Named { effects, .. } => [
            repair_key(diagnosis, left_over(diagnosis)),
            probability_key(
                effects.iter().map(|it| it.probability).reduce(f64::min),
                "among what was tried",
            ),
        ],
        undecided @ (Finding::Rivals { .. }
        | Finding::Shape { .. }
        | Finding::Trace { .. }
        | Finding::OutOfTime { .. }) => [
            if diagnosis.repaired.added.is_empty() {
                key(
                    EXPLAINED,
                    likeliest_explains(diagnosis).map_or_else(|| "–".into(), |it| it.to_string()),
                    "by the best explanation, over whole runs",
                )
            } else {
                repair_key(diagnosis, UNNAMED)
            },
            probability_key(
                undecided
                    .explanations()
                    .first()
                    .map(|best| best.probability),
                match undecided {
                    Finding::OutOfTime { .. } => "of the closest candidate tried",
                    Finding::Shape { .. } => "of the best formula, among what was tried",
                    Finding::Trace { .. } => {
                        "among what was tried, but its parameters are not determined"
                    }
                    _ => "of the best explanation: too low to name it",
                },
            ),
        ],
        Finding::Unexplained { .. } => [
            if diagnosis.repaired.added.is_empty() {
                key(
                    EXPLAINED,
                    percent(best_closed(diagnosis).unwrap_or(0.0)),
                    "over three horizons, by the best that was tried",
                )
            } else {
                repair_key(diagnosis, UNNAMED)
            },
            key(
                "missing force",
                format!("{} N", short(diagnosis.gap.rms)),
                format!(
                    "RMS; {} of the largest modelled force",
                    percent(diagnosis.gap.rms / diagnosis.gap.known.max(f64::MIN_POSITIVE))
                ),
            ),
        ],
    };
    vec![error_key(diagnosis), noise, third, fourth]
}

fn key(label: &str, value: String, note: impl Into<String>) -> Key {
    Key {
        label: label.into(),
        value,
        note: note.into(),
    }
}

/// The error on validation runs, before and after.
fn error_key(diagnosis: &Diagnosis) -> Key {
    let held_out = &diagnosis.held_out;
    let from_to =
        |from: f64, to: f64| format!("{} → {}", short(from.to_degrees()), diagnosis.shown(to));
    let added = !diagnosis.repaired.added.is_empty();
    let (value, note) = match &diagnosis.finding {
        Finding::Quiet {
            refitted: false, ..
        } => (
            diagnosis.shown(held_out.nominal),
            "RMS of the model as supplied".into(),
        ),
        Finding::Named { .. } => (
            from_to(held_out.refit, held_out.repaired_on_board),
            format!(
                "RMS, refitted → repaired; nominal {}",
                diagnosis.shown(held_out.nominal)
            ),
        ),
        finding if added && !finding.is_quiet() => (
            from_to(held_out.refit, held_out.repaired_on_board),
            format!(
                "RMS, refitted → unnamed repair; nominal {}",
                diagnosis.shown(held_out.nominal)
            ),
        ),
        _ => (
            from_to(held_out.nominal, held_out.refit),
            "RMS, nominal → refitted".into(),
        ),
    };
    key("error on validation runs", value, note)
}

fn explained_key(explained: Explained, note: &str) -> Key {
    key(EXPLAINED, explained.to_string(), note)
}

/// The share that the repaired model explains. The share over whole runs is also in the
/// table of tried structures.
fn repair_key(diagnosis: &Diagnosis, note: &str) -> Key {
    let held_out = &diagnosis.held_out;
    let whole = of_the_refit(diagnosis, held_out.repaired_on_board);
    match &diagnosis.closure {
        Some(closure) => explained_key(
            at_horizons(diagnosis, closure),
            &format!("over three horizons, {whole} over whole runs; {note}"),
        ),
        None => explained_key(whole, &format!("over whole runs; {note}")),
    }
}

fn probability_key(value: Option<f64>, note: &str) -> Key {
    key(
        "probability",
        value.map_or_else(|| "–".into(), probability),
        note,
    )
}

/// The sources of a noise floor of `shown` (rad).
fn noise_note(floor: &NoiseFloor, shown: f64, measurand: &Measurand) -> String {
    let source = floor.source();
    if 3.0 * floor.input > shown {
        let input = measurand.value(floor.input);
        format!("{source}, and {input} from pressure noise")
    } else {
        source.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_source_is_that_of_the_noise_floor() {
        let floor = NoiseFloor {
            rms: 0.02,
            white: 0.01,
            agreed: true,
            repeats: Some(0.015),
            rest: Some(0.02),
            quantisation_step: 0.001,
            input: 0.001,
            groups: Vec::new(),
        };
        assert_eq!(
            noise_note(&floor, 0.02, &Measurand::default()),
            "noise at rest"
        );
        let floor = NoiseFloor {
            repeats: Some(0.03),
            rms: 0.03,
            input: 0.02,
            ..floor
        };
        assert_eq!(
            noise_note(&floor, 0.036, &Measurand::default()),
            "spread between repeats, and 1.15° from pressure noise"
        );
    }
}
