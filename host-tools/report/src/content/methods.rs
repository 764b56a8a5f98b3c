//! A paragraph for the methods section of a paper: what was done, with which numbers.

use softrig::diagnose::decide::finding::Finding;
use softrig::diagnose::{Diagnosis, Request};

use super::errors::ErrorRow;
use super::tried::TriedGroup;
use super::words::probability;
use softrig_formats::numbers::counted;

/// The paragraph, to be copied.
pub(super) fn methods(
    request: &Request<'_>,
    diagnosis: &Diagnosis,
    sentence: &str,
    (errors, tried): (&[ErrorRow], &[TriedGroup]),
) -> String {
    let runs = diagnosis.nominal.residuals.len();
    let held_out = &diagnosis.held_out;
    let mut text = format!(
        "{} with {} samples in {} were analysed with softrig {} (random seed {}). The model M θ̈ + C θ̇ + K sign(θ) |θ|ⁿ = g p was fitted by \
         output error, with the initial state of each run and the zeros of both sensors as unknowns",
        counted(runs, "run"),
        diagnosis.nominal.samples(),
        counted(diagnosis.data.sessions().len(), "recording"),
        env!("CARGO_PKG_VERSION"),
        request.seed
    );
    text += &match held_out.runs.len() {
        _ if held_out.in_turn => "; each run was also predicted by a fit without it. ".to_owned(),
        0 => ". ".to_owned(),
        count => format!(
            "; {} stayed unfitted, for validation. ",
            counted(count, "further run")
        ),
    };
    let structures: usize = tried
        .iter()
        .map(|group| group.rows.len() + group.more)
        .sum();
    if structures > 0 {
        text += &format!(
            "{} with effects added were fitted, and compared by their errors on fitted and held-out runs and by their evidence. ",
            counted(structures, "structure")
        );
    }
    text += "The verdict";
    if let Finding::Named { effects, .. } = &diagnosis.finding
        && let Some(least) = effects.iter().map(|it| it.probability).reduce(f64::min)
    {
        text += &format!(", with probability {}", probability(least));
    }
    text += &format!(": “{sentence}”");
    let measurand = diagnosis.data.measurand();
    let unit = measurand.unit();
    text += &format!(" RMS errors of the {}", measurand.name());
    for (place, row) in errors.iter().enumerate() {
        let separator = if place == 0 { ": " } else { "; " };
        text += &format!(
            "{separator}{} ({}) {}{unit} as supplied, {}{unit} refitted, {}{unit} with what was added, noise {}{unit}",
            row.name, row.runs, row.nominal, row.refit, row.repaired, row.floor
        );
    }
    text + "."
}
