//! Rival explanations, and the run that would separate them.

use model_core::catalogue::Kind;
use model_core::effects::Change;
use serde::Serialize;

use super::explained::of_the_refit;
use super::words::{probability, titles};
use crate::shares::Explained;
use softrig::diagnose::decide::finding::{Finding, are_the_same};
use softrig::diagnose::search::selection::FittedStructure;
use softrig::diagnose::{Diagnosis, Request};
use softrig_formats::family::{Family, names};
use softrig_formats::numbers::{evidence, percent};
use softrig_formats::terminal::quoted;

/// Title of rivals that explain too little.
pub const CLOSEST: &str = "Closest, but not good enough";

/// A rival explanation, or if nothing explains enough, one of the closest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rival {
    /// Its effects, as in files, joined by " + ".
    pub name: String,
    /// Its effects, as in sentences.
    pub title: String,
    /// Its probability, relative to the others; none where all of them explain too little.
    pub probability: Option<String>,
    /// Share of the error beyond the noise that it explains on held-out runs, over three
    /// horizons together, if measured.
    pub closed: Option<String>,
    /// Twice the logarithm of how much less likely the held-out runs are than under the best.
    pub delta_bic: String,
}

/// A run that would separate two rivals.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NextRun {
    /// Name of the protocol.
    pub protocol: String,
    /// What is to be changed at the rig before, as a sentence begins; empty if nothing is.
    pub before: String,
    /// The option of `softrig record` that says so; empty if nothing is changed.
    pub setup: String,
    /// Its title.
    pub title: String,
    /// How long it lasts (s).
    pub seconds: String,
    /// The two effects that it separates, by the names of files.
    pub separates: [String; 2],
    /// Its expected evidence.
    pub evidence: String,
    /// The command that writes it as a protocol file.
    pub command: String,
}

/// The rivals, or the closest structures.
pub(super) fn rivals(diagnosis: &Diagnosis) -> Vec<Rival> {
    let explained = !matches!(diagnosis.finding, Finding::Unexplained { .. });
    diagnosis
        .finding
        .explanations()
        .iter()
        .map(|rival| Rival {
            name: names(&rival.kinds).join(" + "),
            title: titles(&rival.kinds),
            probability: explained.then(|| probability(rival.probability)),
            closed: fitted_as(diagnosis, &rival.kinds)
                .and_then(|tried| tried.held_out)
                .map(|(_, closed)| percent(closed)),
            delta_bic: evidence(rival.delta_bic),
        })
        .collect()
}

/// The structure that adds these effects, as it was fitted.
fn fitted_as<'a>(diagnosis: &'a Diagnosis, kinds: &[Kind]) -> Option<&'a FittedStructure> {
    let mut all = diagnosis.tried.iter();
    all.find(|tried| are_the_same(&tried.kinds, kinds))
}

/// The share that the best rival explains over whole runs.
pub(super) fn likeliest_explains(diagnosis: &Diagnosis) -> Option<Explained> {
    let best = diagnosis.finding.explanations().first()?;
    let (error, _) = fitted_as(diagnosis, &best.kinds)?.held_out?;
    Some(of_the_refit(diagnosis, error))
}

/// "A is dead time, B is pneumatic lag", and where to look.
pub(super) fn lettered(diagnosis: &Diagnosis) -> Option<String> {
    if diagnosis.rivals.len() < 2 {
        return None;
    }
    let letters: Vec<String> = ('A'..)
        .zip(&diagnosis.rivals)
        .map(|(letter, rival)| format!("{letter} is {}", titles(&rival.added)))
        .collect();
    Some(format!(
        "{}. Runs on which their curves diverge tell them apart.",
        letters.join(", ")
    ))
}

/// The runs that would separate the rivals.
pub(super) fn next(request: &Request<'_>, diagnosis: &Diagnosis) -> Vec<NextRun> {
    let files: Vec<String> = request
        .recordings
        .iter()
        .enumerate()
        .filter(|(index, _)| Some(*index) != diagnosis.left_out)
        .map(|(_, recording)| quoted(&recording.path.to_string_lossy()))
        .collect();
    let effects = request.own.map_or_else(String::new, |own| {
        format!(" --effects {}", quoted(&own.path.to_string_lossy()))
    });
    diagnosis
        .proposals
        .iter()
        .map(|(proposal, pair)| {
            let [a, b] = pair.each_ref().map(|kinds| names(kinds));
            NextRun {
                protocol: proposal.protocol.name.clone(),
                before: proposal.protocol.setup.instruction(),
                setup: proposal.protocol.setup.option(),
                title: proposal.protocol.title.clone(),
                seconds: format!("{:.0}", f64::from(proposal.protocol.total_ms()) / 1000.0),
                separates: [a.join(" + "), b.join(" + ")],
                evidence: evidence(proposal.evidence),
                command: format!(
                    "softrig plan --model {}{effects} --between {},{} {} -o next.toml",
                    quoted(&request.file.path.to_string_lossy()),
                    a.join("+"),
                    b.join("+"),
                    files.join(" ")
                ),
            }
        })
        .collect()
}

/// What a changed rig would tell that no plan can offer yet.
pub(super) fn changes(diagnosis: &Diagnosis) -> Vec<String> {
    [turning(diagnosis), measuring_the_tube(diagnosis)]
        .into_iter()
        .flatten()
        .collect()
}

/// What a turned base would tell: a static curve that these runs leave open may be a weight,
/// also where no formula of one is among the rivals.
fn turning(diagnosis: &Diagnosis) -> Option<String> {
    let is_open = diagnosis
        .finding
        .families()
        .contains(&Family::StiffnessShape);
    let mut sessions = diagnosis.data.sessions().iter();
    let is_turned = sessions.any(|it| it.placement().turned_rad != 0.0);
    let mut proposals = diagnosis.proposals.iter();
    let is_proposed = proposals.any(|(proposal, _)| proposal.protocol.setup.tilt_deg.is_some());
    (is_open && !is_turned && !is_proposed).then(|| {
        "Whether it is a weight: turn the base by 90° without re-zeroing the angle, record the \
         same runs with --setup tilt_deg=90, and diagnose both. Only a weight changes."
            .into()
    })
}

/// What a longer tube would tell, of which the length has to be known first.
fn measuring_the_tube(diagnosis: &Diagnosis) -> Option<String> {
    let explanations = diagnosis.finding.explanations().iter();
    let has_air = |kinds: &[Kind]| {
        kinds
            .iter()
            .any(|kind| kind.info().told_by.contains(&Change::LongerTube))
    };
    let (with, without): (Vec<_>, Vec<_>) = explanations.partition(|it| has_air(&it.kinds));
    let is_open = !with.is_empty() && !without.is_empty();
    (is_open && diagnosis.data.tube_mm().is_none()).then(|| {
        "Whether it is the air in the tube: write the tube's length (tube_mm) below [setup] in the \
         metadata of these recordings, record again with a tube several times as long and --setup \
         tube_mm=…, and diagnose both. Only what the air does changes."
            .into()
    })
}

/// Whether the run that is offered first can be expected to separate the rivals.
pub(super) fn next_suffices(diagnosis: &Diagnosis) -> bool {
    let first = diagnosis.proposals.first();
    first.is_some_and(|(proposal, _)| proposal.decides)
}
