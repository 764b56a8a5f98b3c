//! Errors on fitted and on validation runs, and notices about the recordings.

use serde::Serialize;

use softrig::diagnose::Diagnosis;
use softrig::diagnose::evidence::free_run::{TestRun, rms_of};
use softrig::estimate::Segment;
use softrig::estimate::start_from::StartFrom;
use softrig::statistics::squares_about_mean;
use softrig_formats::numbers::{fit, short};

/// RMS errors in degrees.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ErrorRow {
    /// Which runs.
    pub name: &'static str,
    /// How many.
    pub runs: usize,
    /// The model as supplied.
    pub nominal: String,
    /// The same structure, refitted.
    pub refit: String,
    /// With the named effects.
    pub repaired: String,
    /// The noise floor.
    pub floor: String,
    /// Fit (normalised RMS) of the three models.
    pub fits: [String; 3],
}

/// A problem of the recordings.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Notice {
    /// The recording; none if it is about all of them.
    pub about: Option<String>,
    /// The finding.
    pub text: String,
    /// The advice.
    pub advice: String,
}

/// Nominal, refit and repaired on fitted and on held-out runs.
pub(super) fn errors(diagnosis: &Diagnosis) -> Vec<ErrorRow> {
    let held_out = &diagnosis.held_out;
    let row = |name, runs, values: [f64; 4], spread: f64| {
        let fits = [values[0], values[1], values[2]].map(|error| fit(error, spread));
        let [nominal, refit, repaired, floor] = values.map(|value| short(value.to_degrees()));
        ErrorRow {
            name,
            runs,
            nominal,
            refit,
            repaired,
            floor,
            fits,
        }
    };
    let spread_fitted = spread(diagnosis.data.fitted());
    let spread_held_out = if held_out.in_turn {
        spread_fitted
    } else {
        spread(diagnosis.data.held_out())
    };
    let fitted = diagnosis.nominal.residuals.len();
    let (name, runs) = if held_out.in_turn {
        ("left out in turn", fitted)
    } else {
        ("validation", held_out.runs.len())
    };
    let mut rows = vec![
        row(
            "fitted",
            fitted,
            [
                diagnosis.nominal.rmse(),
                diagnosis.refit.rmse(),
                diagnosis.repaired.fit.rmse(),
                diagnosis.floor.rms,
            ],
            spread_fitted,
        ),
        row(
            name,
            runs,
            [
                held_out.nominal,
                held_out.refit,
                held_out.repaired_on_board,
                held_out.floor,
            ],
            spread_held_out,
        ),
    ];
    let test = &diagnosis.test;
    if !test.is_empty() {
        let of = |error: fn(&TestRun) -> f64| rms_of(test, error);
        rows.push(row(
            "test",
            test.len(),
            [
                of(|run| run.nominal),
                of(|run| run.refit),
                of(|run| run.repaired),
                diagnosis.floor.rms,
            ],
            of(|run| run.spread),
        ));
    }
    rows
}

/// How the test recordings were started, as a sentence; none without any.
pub(super) fn tested(diagnosis: &Diagnosis) -> Option<String> {
    let starts = diagnosis.test.iter().map(|run| {
        let from = match run.start {
            StartFrom::Rest => "rest at zero".to_owned(),
            StartFrom::Samples(1) => "its first sample".to_owned(),
            StartFrom::Samples(count) => format!("its first {count} samples"),
            StartFrom::Period => "its own input, played once before".to_owned(),
        };
        format!("{} from {from}", run.name)
    });
    let starts: Vec<String> = starts.collect();
    (!starts.is_empty()).then(|| {
        format!(
            "Test runs did not affect the selection. Their zeros are those of the fitted runs; \
             their starting points: {}.",
            starts.join(", ")
        )
    })
}

/// RMS deviation (rad) of the measured angles from the mean of their own run.
fn spread<'a>(segments: impl Iterator<Item = &'a Segment>) -> f64 {
    let (mut squares, mut samples) = (0.0, 0_usize);
    for segment in segments {
        let angle = &segment.recording.angle;
        squares += squares_about_mean(angle);
        samples += angle.len();
    }
    (squares / samples.max(1) as f64).sqrt()
}

/// Notices about the recordings.
pub(super) fn notices(diagnosis: &Diagnosis) -> Vec<Notice> {
    let floor = &diagnosis.floor;
    let spread = floor.repeats.filter(|spread| *spread > 2.0 * floor.white);
    let repeats = spread.map(|spread| Notice {
        about: None,
        text: format!(
            "the repeats differ by {} among themselves, more than the sensor's noise of {}",
            diagnosis.shown(spread),
            diagnosis.shown(floor.white)
        ),
        advice: "motion that the rig itself does not repeat counts as noise here".into(),
    });
    let concerns = diagnosis.concerns.iter().map(|concern| Notice {
        about: concern.recording.clone(),
        text: concern.text.clone(),
        advice: concern.advice.clone(),
    });
    concerns.chain(repeats).collect()
}
