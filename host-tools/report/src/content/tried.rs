//! The structures that were fitted, with their standing, and the effects that were not tried.

use model_core::catalogue::Kind;
use serde::Serialize;

use super::explained::of_the_refit;
use super::words::{probability, titles};
use softrig::diagnose::Diagnosis;
use softrig::diagnose::decide::finding::{Finding, are_the_same};
use softrig::diagnose::search::selection::FittedStructure;
use softrig_formats::family::names;
use softrig_formats::numbers::{evidence, short};

/// Number of structures of one size that are listed; further ones are only counted.
const TRIED_LISTED: usize = 6;

/// Structures with the same number of added effects.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TriedGroup {
    /// "One effect added".
    pub title: String,
    /// The best of them.
    pub rows: Vec<TriedRow>,
    /// Number of further structures.
    pub more: usize,
}

/// A structure that was fitted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TriedRow {
    /// Its effects, as in sentences.
    pub title: String,
    /// Its effects, as in files.
    pub name: String,
    /// RMS error on fitted runs (°).
    pub fitted: String,
    /// RMS error on held-out runs (°).
    pub held_out: String,
    /// Share of the refit's error beyond the noise that it explains over whole runs.
    pub explained: String,
    /// Evidence against it.
    pub delta_bic: String,
    /// Its probability among the structures of its size.
    pub probability: String,
    /// Its standing.
    pub standing: Standing,
    /// Parameters at a bound of their search range.
    pub at_bound: Vec<String>,
}

/// The standing of a structure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Standing {
    /// It is named.
    Named,
    /// It repairs the model, with more effects than are named.
    Repair,
    /// It is not rejected.
    Rival,
    /// It is among the closest, and explains too little.
    Closest,
    /// It was rejected.
    Rejected,
}

/// Effects that were not tried, with the reason.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Untried {
    /// Names in files.
    pub kinds: Vec<&'static str>,
    /// The reason, as a clause.
    pub reason: &'static str,
}

/// The structures that were fitted, by their number of effects.
pub(super) fn tried(diagnosis: &Diagnosis) -> Vec<TriedGroup> {
    let sizes = diagnosis.tried.iter().map(|tried| tried.kinds.len()).max();
    (0..=sizes.unwrap_or(0))
        .filter_map(|size| {
            let all: Vec<&FittedStructure> = diagnosis
                .tried
                .iter()
                .filter(|tried| tried.kinds.len() == size)
                .collect();
            let rows: Vec<TriedRow> = all
                .iter()
                .take(TRIED_LISTED)
                .map(|tried| tried_row(tried, diagnosis))
                .collect();
            let title = match size {
                0 => "Nothing added".to_owned(),
                1 => "One effect added".to_owned(),
                2 => "Two effects added".to_owned(),
                _ => "Three effects added".to_owned(),
            };
            (!rows.is_empty()).then(|| TriedGroup {
                title,
                more: all.len() - rows.len(),
                rows,
            })
        })
        .collect()
}

fn tried_row(tried: &FittedStructure, diagnosis: &Diagnosis) -> TriedRow {
    let (fitted, held_out) = errors_of(tried, diagnosis);
    TriedRow {
        title: if tried.kinds.is_empty() {
            "the refitted model".into()
        } else {
            titles(&tried.kinds)
        },
        name: names(&tried.kinds).join(" + "),
        fitted: short(fitted.to_degrees()),
        // Not found for those far behind.
        held_out: held_out.map_or_else(|| "–".into(), |error| short(error.to_degrees())),
        explained: held_out.map_or_else(
            || "–".into(),
            |error| of_the_refit(diagnosis, error).to_string(),
        ),
        // The refit has no rival of its size.
        delta_bic: if tried.kinds.is_empty() {
            "–".into()
        } else {
            evidence(tried.delta_bic)
        },
        probability: if tried.kinds.is_empty() {
            "–".into()
        } else {
            probability(tried.probability)
        },
        standing: standing(tried, diagnosis),
        at_bound: tried.at_bound.clone(),
    }
}

/// Errors (rad) on fitted and on held-out runs. Refit and repaired model have those of the
/// headline: the search may have fitted them at another horizon, or in other folds.
fn errors_of(tried: &FittedStructure, diagnosis: &Diagnosis) -> (f64, Option<f64>) {
    let added = &diagnosis.repaired.added;
    let held_out = &diagnosis.held_out;
    if tried.kinds.is_empty() {
        (diagnosis.refit.rmse(), Some(held_out.refit))
    } else if !added.is_empty() && are_the_same(&tried.kinds, added) {
        (
            diagnosis.repaired.fit.rmse(),
            Some(held_out.repaired_on_board),
        )
    } else {
        let error = tried.held_out.map(|(error, _)| error);
        (tried.rmse, error)
    }
}

/// How the diagnosis judged a structure.
fn standing(tried: &FittedStructure, diagnosis: &Diagnosis) -> Standing {
    let finding = &diagnosis.finding;
    let is_it = |kinds: &[Kind]| are_the_same(&tried.kinds, kinds);
    let listed = || finding.explanations().iter().any(|it| is_it(&it.kinds));
    let added = &diagnosis.repaired.added;
    match finding {
        Finding::Named { .. } if is_it(&finding.named()) => Standing::Named,
        Finding::Rivals { .. }
        | Finding::Shape { .. }
        | Finding::Trace { .. }
        | Finding::OutOfTime { .. }
            if listed() =>
        {
            Standing::Rival
        }
        _ if !added.is_empty() && is_it(added) => Standing::Repair,
        Finding::Unexplained { .. } if listed() => Standing::Closest,
        _ if is_to_be_separated(tried, diagnosis) => Standing::Rival,
        Finding::Named { .. } if shares_the_named(tried, diagnosis) => Standing::Rival,
        _ => Standing::Rejected,
    }
}

/// Whether a structure is one of several that are not rejected and have the
/// named effects in common.
fn shares_the_named(tried: &FittedStructure, diagnosis: &Diagnosis) -> bool {
    let (named, size) = (diagnosis.repaired.added.len(), judged_size(diagnosis));
    size > named && tried.kinds.len() == size && !tried.rejected
}

/// Whether a run is proposed that separates a structure from another.
fn is_to_be_separated(tried: &FittedStructure, diagnosis: &Diagnosis) -> bool {
    let mut pairs = diagnosis.proposals.iter().flat_map(|(_, pair)| pair);
    pairs.any(|kinds| are_the_same(&tried.kinds, kinds))
}

/// The size of the structures among which the answer was chosen: the number of named
/// effects, or more if these are common to several structures.
pub(super) fn judged_size(diagnosis: &Diagnosis) -> usize {
    let rival = diagnosis.finding.explanations().first();
    rival.map_or(diagnosis.repaired.added.len(), |rival| rival.kinds.len())
}

/// Effects that were not tried, by the reason.
pub(super) fn untried(diagnosis: &Diagnosis) -> Vec<Untried> {
    let mut groups: Vec<Untried> = Vec::new();
    for untried in &diagnosis.untried {
        let name = untried.kind.name();
        match groups
            .iter_mut()
            .find(|group| group.reason == untried.reason)
        {
            Some(group) => group.kinds.push(name),
            None => groups.push(Untried {
                kinds: vec![name],
                reason: untried.reason,
            }),
        }
    }
    groups
}
