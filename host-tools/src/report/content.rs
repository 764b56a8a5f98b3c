//! The content of a diagnosis: sentences and rounded numbers.
//!
//! Terminal and page must agree. So every sentence and every row that both show is made
//! here, and neither computes its own.

use model_core::actuator::ParameterId;
use model_core::catalogue::Kind;
use model_core::effects::Place;
use serde::Serialize;

use super::shares::Explained;
use crate::diagnose::budget::{Ended, Part};
use crate::diagnose::noise::NoiseFloor;
use crate::diagnose::policy::Policy;
use crate::diagnose::selection::{self, FittedStructure};
use crate::diagnose::verdict::{Answer, Closure, Strength};
use crate::diagnose::{Diagnosis, Request};
use crate::estimate::Segment;
use crate::estimate::fit::Fit;
use crate::family::Family;
use crate::io::model_file::{parameter_name, parameter_unit, to_file_units};
use crate::io::terminal::quoted;
use crate::numbers::{degrees, evidence, fit, percent, short, with_ends};
use crate::statistics::squares_about_mean;

/// Number of structures of one size that are listed; further ones are only counted.
const TRIED_LISTED: usize = 6;

/// Title of rivals that explain too little.
pub const CLOSEST: &str = "Closest, but not good enough";

/// The share of the error beyond the noise that is gone.
const EXPLAINED: &str = "error explained";

/// The note where nothing is named.
const UNNAMED: &str = "by a repair without a name";

/// Evidence (Δχ²) from which a run is expected to separate two rivals.
const VERY_STRONG: f64 = 20.0;

/// The content of a diagnosis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Content {
    /// The answer.
    pub answer: Answer,
    /// The verdict in one sentence.
    pub sentence: String,
    /// Two or three sentences: the evidence, and what to do.
    pub lede: String,
    /// Sentences about a search that ended early: the cause, and what was not tried.
    pub ended: Option<String>,
    /// The numbers that matter most.
    pub keys: Vec<Key>,
    /// Notices about the recordings.
    pub notices: Vec<Notice>,
    /// Errors on fitted runs and on validation runs.
    pub errors: Vec<ErrorRow>,
    /// Whether effects were added to the model.
    pub repaired: bool,
    /// Whether the written model differs from the supplied one.
    pub upload: bool,
    /// How much of the gap the added effects close, as a sentence.
    pub closed: Option<String>,
    /// The added effects.
    pub effects: Vec<Effect>,
    /// The parameters that the model had before.
    pub base: Vec<ParameterRow>,
    /// The sensors' zeros, as a sentence.
    pub zeros: String,
    /// Sentences about parameters that the recordings do not determine.
    pub undetermined: Vec<String>,
    /// Sentences about the missing force.
    pub gap: Vec<String>,
    /// Rival explanations, best first.
    pub rivals: Vec<Rival>,
    /// The letters of the curves, where several explanations remain.
    pub lettered: Option<String>,
    /// Structures that were fitted, by their number of effects.
    pub tried: Vec<TriedGroup>,
    /// Effects that were not tried, by the reason.
    pub untried: Vec<Untried>,
    /// Runs that would separate the rivals, best first.
    pub next: Vec<NextRun>,
    /// Whether the first of them is expected to.
    pub next_suffices: bool,
    /// Sentences about what these recordings leave open.
    pub open: Vec<String>,
}

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

/// An effect that was added.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Effect {
    /// Name in files.
    pub kind: &'static str,
    /// Name in sentences.
    pub title: &'static str,
    /// Its equation.
    pub equation: String,
    /// Its description.
    pub text: &'static str,
    /// Where it acts.
    pub place: &'static str,
    /// Probability among the tried explanations; none for an effect that repairs the model
    /// and is not named.
    pub probability: Option<String>,
    /// Its parameters.
    pub parameters: Vec<ParameterRow>,
}

impl Effect {
    /// How certain its name is.
    pub fn standing(&self) -> String {
        self.probability.as_ref().map_or_else(
            || "lowers the error, not named".into(),
            |probability| format!("probability {probability}"),
        )
    }
}

/// A parameter with its interval, in the unit of files.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterRow {
    /// Name in files.
    pub name: String,
    /// Symbol in the equation.
    pub symbol: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// The value as supplied; none for an added effect.
    pub nominal: Option<String>,
    /// The value now.
    pub value: String,
    /// Whether it was fitted.
    pub free: bool,
    /// The ends of the 95 % interval, if there is one.
    pub interval: Option<[String; 2]>,
}

impl ParameterRow {
    /// The interval, or why there is none.
    pub fn certainty(&self) -> String {
        match &self.interval {
            Some([low, high]) => format!("95 %: {low} … {high}"),
            None if self.free => "not determined by these runs".to_owned(),
            None => "held".to_owned(),
        }
    }
}

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

/// A run that would separate two rivals.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NextRun {
    /// Name of the protocol.
    pub protocol: String,
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

impl Content {
    /// Puts a diagnosis into words.
    pub fn of(request: &Request<'_>, diagnosis: &Diagnosis) -> Self {
        let repaired = !diagnosis.repaired.added.is_empty();
        Self {
            answer: diagnosis.answer,
            sentence: sentence(diagnosis),
            lede: lede(diagnosis),
            ended: diagnosis.ended.as_ref().map(Ended::sentence),
            keys: keys(diagnosis),
            notices: notices(diagnosis),
            errors: errors(diagnosis),
            repaired,
            upload: diagnosis.is_better(),
            closed: diagnosis
                .closure
                .map(|closure| explained(diagnosis, &closure)),
            effects: effects(diagnosis),
            base: base(request, diagnosis),
            zeros: diagnosis.zeros().to_string(),
            undetermined: diagnosis.identifiability[0].text.clone(),
            gap: diagnosis.gap.sentences.clone(),
            tried: tried(diagnosis),
            untried: untried(diagnosis),
            next: next(request, diagnosis),
            next_suffices: next_suffices(diagnosis),
            open: open(diagnosis),
            rivals: rivals(diagnosis),
            lettered: lettered(diagnosis),
        }
    }

    /// Whether something is missing, named or not.
    pub fn something_is_missing(&self) -> bool {
        !matches!(self.answer, Answer::NoDiscrepancy | Answer::ParametersOnly)
    }

    /// The title of the section of rivals.
    pub fn rivals_title(&self) -> &'static str {
        if self.answer == Answer::Unexplained {
            CLOSEST
        } else {
            "Rivals"
        }
    }
}

/// The verdict in one sentence.
pub fn sentence(diagnosis: &Diagnosis) -> String {
    if let (Answer::CannotTell, Some(of)) = (diagnosis.answer, diagnosis.shape) {
        return format!(
            "The model lacks {}: a force of the {} that no formula follows, and a table does.",
            in_words(&diagnosis.families),
            of.name()
        );
    }
    match diagnosis.answer {
        Answer::NoDiscrepancy | Answer::ParametersOnly if diagnosis.immaterial => format!(
            "Nothing that matters is missing: {} remain unexplained, less than {}.",
            degrees(diagnosis.beyond_noise()),
            degrees(diagnosis.tolerance)
        ),
        Answer::NoDiscrepancy => {
            "Nothing is missing: the model agrees with the recordings within their noise.".into()
        }
        Answer::ParametersOnly => {
            "No effect is missing: the structure is right, only the parameters were off.".into()
        }
        Answer::EffectFound if diagnosis.strength == Some(Strength::Part) => format!(
            "The model lacks {}, which explains part of the error.",
            titles(&diagnosis.named)
        ),
        Answer::EffectFound => format!("The model lacks {}.", titles(&diagnosis.named)),
        Answer::CannotTell if diagnosis.is_open() => {
            let best = match diagnosis.alternatives.first() {
                Some(best) => titles_of_names(&best.kinds),
                None => titles(&diagnosis.repaired.added),
            };
            if best.is_empty() {
                "Something is missing, and the time was up before it was found.".into()
            } else {
                let best = with_capital(&best);
                format!("Something is missing. {best} came closest until the time was up.")
            }
        }
        Answer::CannotTell if diagnosis.alternatives.len() == 1 => format!(
            "{} looks like {}, but these recordings do not determine it.",
            if diagnosis.strength == Some(Strength::Part) {
                "Part of what is missing"
            } else {
                "What is missing"
            },
            titles_of_names(&diagnosis.alternatives[0].kinds)
        ),
        Answer::CannotTell => {
            let rivals: Vec<String> = diagnosis
                .alternatives
                .iter()
                .map(|rival| {
                    let kinds: Vec<&str> = rival.kinds.iter().map(|kind| title(kind)).collect();
                    kinds.join(" with ")
                })
                .collect();
            if diagnosis.families.is_empty() {
                format!(
                    "Something is missing, but these recordings cannot tell apart {}.",
                    listed(&rivals)
                )
            } else {
                format!(
                    "{}; these recordings cannot tell apart {}.",
                    lacks(diagnosis),
                    listed(&rivals)
                )
            }
        }
        Answer::Unexplained => {
            "Something is missing, and it is none of the effects that are known.".into()
        }
    }
}

/// What the model lacks, as a clause: a family, and whether it explains all.
fn lacks(diagnosis: &Diagnosis) -> String {
    let families = in_words(&diagnosis.families);
    if diagnosis.strength == Some(Strength::Part) {
        format!("The model lacks {families}, which explains part of the error")
    } else {
        format!("The model lacks {families}")
    }
}

/// Families in a sentence: "a kind of dry friction and a kind of creep".
fn in_words(families: &[Family]) -> String {
    let kinds: Vec<String> = families
        .iter()
        .map(|family| format!("a kind of {family}"))
        .collect();
    kinds.join(" and ")
}

/// The share of the error beyond the noise that the repaired model explains at each
/// horizon, and what remains.
fn explained(diagnosis: &Diagnosis, closure: &Closure) -> String {
    let remaining = diagnosis.remaining();
    let goes_with = remaining
        .goes_with
        .map_or_else(String::new, |feature| format!(" and go with the {feature}"));
    let share = |share: f64| percent(share.max(0.0));
    let (what, alone) = named_alone(diagnosis).map_or_else(
        || ("it", String::new()),
        |alone| {
            let named = titles(&diagnosis.named);
            (
                "the repaired model",
                format!("; {named} alone {}", share(alone)),
            )
        },
    );
    format!(
        "On validation runs {what} explains {} of the error beyond the noise ({} over \
         a quarter of a swing, {} over two and a half, {} over whole runs{alone}); {} remain, {} \
         times the noise{goes_with}: {}.",
        at_horizons(diagnosis, closure).in_words(),
        share(closure.short),
        share(closure.medium),
        share(closure.full),
        degrees(remaining.rmse_deg.to_radians()),
        short(remaining.times_noise),
        left_over(diagnosis)
    )
}

/// The closure of the named effects alone, if the repaired model has more.
fn named_alone(diagnosis: &Diagnosis) -> Option<f64> {
    let named = &diagnosis.named;
    if named.is_empty() || named.len() == diagnosis.repaired.added.len() {
        return None;
    }
    let is_it = |tried: &&FittedStructure| {
        tried.kinds.len() == named.len() && tried.kinds.iter().all(|kind| named.contains(kind))
    };
    let (_, closed) = diagnosis.tried.iter().find(is_it)?.held_out?;
    Some(closed)
}

/// The share that the repaired model explains over the three horizons together.
fn at_horizons(diagnosis: &Diagnosis, closure: &Closure) -> Explained {
    let held_out = &diagnosis.held_out;
    let share = closure.overall.max(0.0);
    Explained::known(share, held_out.repaired_on_board, held_out.floor)
}

/// The share of the refit's error that an error (rad) on held-out runs explains.
fn of_the_refit(diagnosis: &Diagnosis, error: f64) -> Explained {
    let held_out = &diagnosis.held_out;
    Explained::of_whole_runs(held_out.refit, error, held_out.floor)
}

/// The lede: the evidence for the verdict, and what to do.
fn lede(diagnosis: &Diagnosis) -> String {
    let held_out = &diagnosis.held_out;
    let [nominal, refit, repaired, floor] = [
        held_out.nominal,
        held_out.refit,
        held_out.repaired_on_board,
        held_out.floor,
    ]
    .map(degrees);
    match diagnosis.answer {
        Answer::NoDiscrepancy | Answer::ParametersOnly if diagnosis.immaterial => format!(
            "On validation runs, the model as supplied leaves {nominal} and the refitted one \
             {refit}, where noise alone leaves {floor}. No effect that was tried explains the \
             rest, and it is below {}, what may remain (--tolerance).",
            degrees(diagnosis.tolerance)
        ),
        Answer::NoDiscrepancy => format!(
            "On validation runs, simulation and measurement differ by {nominal}, where \
             noise alone leaves {floor}. There is nothing to repair: keep the model as it is."
        ),
        Answer::ParametersOnly => format!(
            "With the parameters refitted, the error on validation runs falls from \
             {nominal} to {refit}, where noise alone leaves {floor}. Use the refitted model; no \
             physics has to be added."
        ),
        Answer::EffectFound => format!(
            "On validation runs, refitting alone leaves {refit}. With {} it is \
             {repaired}, where noise alone leaves {floor}: {}.",
            if diagnosis.repaired.added.len() == 1 {
                "the effect added"
            } else {
                "the effects added"
            },
            left_over(diagnosis)
        ),
        Answer::CannotTell if diagnosis.is_open() => format!(
            "Refitting the parameters leaves {refit} on validation runs, where noise \
             alone leaves {floor}. {}",
            if diagnosis.repaired.added.is_empty() {
                "Nothing that was tried until then predicts better.".into()
            } else {
                format!(
                    "With {} it is {repaired}, which is no name: what was not tried may do better.",
                    titles(&diagnosis.repaired.added)
                )
            }
        ),
        Answer::CannotTell if diagnosis.shape.is_some() => format!(
            "Refitting the parameters leaves {refit} on validation runs, where noise \
             alone leaves {floor}. With the effect and a table beside it, it is {repaired}: what is \
             missing depends on the right variable, by a formula that is not known."
        ),
        Answer::CannotTell if diagnosis.alternatives.len() == 1 => format!(
            "Refitting the parameters leaves {refit} on validation runs, where noise \
             alone leaves {floor}. With {} it is {repaired}. But a parameter of it is at the end of \
             its range or may be zero, or these runs do not show what sets it apart: take it for a \
             hint.",
            titles(&diagnosis.repaired.added)
        ),
        Answer::CannotTell => format!(
            "Refitting the parameters leaves {refit} on validation runs, where noise \
             alone leaves {floor}. Several explanations close that gap, and these recordings \
             speak for none of them clearly. {}",
            what_separates(diagnosis)
        ),
        Answer::Unexplained => format!(
            "Refitting the parameters leaves {refit} on validation runs, where noise \
             alone leaves {floor}. {}Instead of a name, this page shows the missing force \
             itself: how large it is, and when.",
            why_no_name(diagnosis)
        ),
    }
}

/// The remaining error of the repaired model, as a clause.
fn left_over(diagnosis: &Diagnosis) -> &'static str {
    if diagnosis.immaterial {
        "what is left is below the tolerance"
    } else if diagnosis.adequacy.adequate {
        "what is left is noise"
    } else if diagnosis.held_out.at_noise() {
        "what is left is hardly more than noise"
    } else {
        "what is left is still more than noise"
    }
}

/// The structure that closed most of the held-out gap, its error (rad) there,
/// and the share that it closed.
fn closed_most(diagnosis: &Diagnosis) -> Option<(&FittedStructure, f64, f64)> {
    diagnosis
        .tried
        .iter()
        .filter(|tried| !tried.kinds.is_empty())
        .filter_map(|tried| tried.held_out.map(|(error, closed)| (tried, error, closed)))
        .max_by(|a, b| a.2.total_cmp(&b.2))
}

/// The largest share of the held-out gap that anything closed.
fn best_closed(diagnosis: &Diagnosis) -> Option<f64> {
    closed_most(diagnosis).map(|(_, _, closed)| closed)
}

/// Why the structure that closed most of the gap is not named, as sentences.
fn why_no_name(diagnosis: &Diagnosis) -> String {
    let Some((_, _, closed)) = closed_most(diagnosis) else {
        return String::new();
    };
    if closed < 0.005 {
        return "Nothing that was tried explains any of that. ".into();
    }
    format!(
        "The best of all that was tried explains {} of what is beyond the noise, over three \
         horizons together. {} ",
        percent(closed),
        shortfall(closed)
    )
}

/// Why a structure that closed this share of the gap is not named.
fn shortfall(closed: f64) -> String {
    let needed = Policy::STANDARD.part;
    if closed >= needed {
        "That share would do for a name, but the rest of the evidence does not: what it gains \
         over simpler explanations could be chance, or is too little on validation runs."
            .into()
    } else {
        format!(
            "That is not enough: a name needs at least {}.",
            percent(needed)
        )
    }
}

/// The rivals, or the closest structures.
fn rivals(diagnosis: &Diagnosis) -> Vec<Rival> {
    let explained = diagnosis.answer != Answer::Unexplained;
    diagnosis
        .alternatives
        .iter()
        .map(|rival| Rival {
            name: rival.kinds.join(" + "),
            title: titles_of_names(&rival.kinds),
            probability: explained.then(|| probability(rival.probability)),
            closed: fitted_as(diagnosis, &rival.kinds)
                .and_then(|tried| tried.held_out)
                .map(|(_, closed)| percent(closed)),
            delta_bic: evidence(rival.delta_bic),
        })
        .collect()
}

/// "A is dead time, B is pneumatic lag", and where to look.
fn lettered(diagnosis: &Diagnosis) -> Option<String> {
    if diagnosis.answer != Answer::CannotTell || diagnosis.rivals.len() < 2 {
        return None;
    }
    let letters: Vec<String> = ('A'..)
        .zip(&diagnosis.rivals)
        .map(|(letter, rival)| format!("{letter} is {}", titles(&rival.added)))
        .collect();
    Some(format!(
        "{}. A run that tells them apart is one on which their curves part.",
        letters.join(", ")
    ))
}

/// The share that the best rival explains over whole runs.
fn likeliest_explains(diagnosis: &Diagnosis) -> Option<Explained> {
    let best = diagnosis.alternatives.first()?;
    let (error, _) = fitted_as(diagnosis, &best.kinds)?.held_out?;
    Some(of_the_refit(diagnosis, error))
}

/// The structure that adds these effects, as it was fitted.
fn fitted_as<'a>(diagnosis: &'a Diagnosis, names: &[String]) -> Option<&'a FittedStructure> {
    let mut all = diagnosis.tried.iter();
    all.find(|tried| are_the_same(&tried.kinds, names))
}

/// Whether effects are those with these names, in any order.
fn are_the_same(kinds: &[Kind], names: &[String]) -> bool {
    let has = |kind: &Kind| names.iter().any(|name| name == kind.name());
    kinds.len() == names.len() && kinds.iter().all(has)
}

/// A sentence about the run that would separate the rivals.
fn what_separates(diagnosis: &Diagnosis) -> &'static str {
    if diagnosis
        .ended
        .as_ref()
        .is_some_and(|ended| ended.lacks(Part::Experiment))
    {
        "With more time, a run that would separate them is looked for."
    } else if !next_suffices(diagnosis) {
        "No run that the board can make is expected to separate them: a different measurement \
         is needed."
    } else if diagnosis.alternatives.len() > selection::RIVALS_PLANNED {
        "The run proposed below would separate the likeliest of them."
    } else {
        "The run proposed below would separate them."
    }
}

/// Whether the proposed run can be expected to separate the rivals.
fn next_suffices(diagnosis: &Diagnosis) -> bool {
    let mut all = diagnosis.proposals.iter();
    all.any(|(proposal, _)| proposal.evidence >= VERY_STRONG)
}

fn key(label: &str, value: String, note: impl Into<String>) -> Key {
    Key {
        label: label.into(),
        value,
        note: note.into(),
    }
}

/// The four key numbers: the error, the noise floor, and two that depend on the answer.
fn keys(diagnosis: &Diagnosis) -> Vec<Key> {
    let held_out = &diagnosis.held_out;
    let noise = key(
        "noise floor",
        degrees(held_out.floor),
        noise_note(&diagnosis.floor, held_out.floor),
    );
    let [third, fourth] = match diagnosis.answer {
        Answer::NoDiscrepancy => [
            key(
                "error over noise",
                format!(
                    "{:.2}",
                    held_out.nominal / held_out.floor.max(f64::MIN_POSITIVE)
                ),
                "1 is as good as it gets",
            ),
            key(
                "runs",
                diagnosis.nominal.residuals.len().to_string(),
                format!("fitted, with {} samples", diagnosis.nominal.samples()),
            ),
        ],
        Answer::ParametersOnly => [
            explained_key(
                Explained::of_whole_runs(held_out.nominal, held_out.refit, held_out.floor),
                "by parameters alone, over whole runs",
            ),
            key("effects needed", "0".into(), left_over(diagnosis)),
        ],
        Answer::EffectFound => [
            repair_key(diagnosis, left_over(diagnosis)),
            probability_key(
                diagnosis.probability.iter().copied().reduce(f64::min),
                "among what was tried",
            ),
        ],
        Answer::CannotTell => [
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
                diagnosis.alternatives.first().map(|best| best.probability),
                if diagnosis.is_open() {
                    "of what came closest, among what was tried"
                } else if diagnosis.alternatives.len() == 1 {
                    "among what was tried, but its parameters are not determined"
                } else {
                    "of the best explanation: too little for a name"
                },
            ),
        ],
        Answer::Unexplained => [
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
                    "RMS; {} of the largest that the model knows",
                    percent(diagnosis.gap.rms / diagnosis.gap.known.max(f64::MIN_POSITIVE))
                ),
            ),
        ],
    };
    vec![error_key(diagnosis), noise, third, fourth]
}

/// The error on validation runs, before and after.
fn error_key(diagnosis: &Diagnosis) -> Key {
    let held_out = &diagnosis.held_out;
    let from_to = |from: f64, to: f64| format!("{} → {}", short(from.to_degrees()), degrees(to));
    let (value, note) = match diagnosis.answer {
        Answer::NoDiscrepancy => (
            degrees(held_out.nominal),
            "RMS of the model as supplied".into(),
        ),
        Answer::EffectFound => (
            from_to(held_out.refit, held_out.repaired_on_board),
            format!(
                "RMS, refitted → repaired; nominal {}",
                degrees(held_out.nominal)
            ),
        ),
        Answer::CannotTell | Answer::Unexplained if !diagnosis.repaired.added.is_empty() => (
            from_to(held_out.refit, held_out.repaired_on_board),
            format!(
                "RMS, refitted → repaired without a name; nominal {}",
                degrees(held_out.nominal)
            ),
        ),
        Answer::ParametersOnly | Answer::CannotTell | Answer::Unexplained => (
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
fn noise_note(floor: &NoiseFloor, shown: f64) -> String {
    let source = noise_source(floor);
    if 3.0 * floor.input > shown {
        let input = degrees(floor.input);
        format!("{source}, and the {input} that noise of the pressure leaves")
    } else {
        source.to_owned()
    }
}

/// The largest source of the noise floor.
fn noise_source(floor: &NoiseFloor) -> &'static str {
    let is_it = |source: Option<f64>| source.is_some_and(|source| source >= floor.rms);
    if is_it(floor.repeats) {
        "spread between repeats"
    } else if is_it(floor.rest) && floor.white < floor.rms {
        "noise at rest"
    } else if floor.white >= floor.rms {
        "noise of the angle sensor"
    } else {
        "steps of the converter"
    }
}

/// Notices about the recordings.
fn notices(diagnosis: &Diagnosis) -> Vec<Notice> {
    let floor = &diagnosis.floor;
    let spread = floor.repeats.filter(|spread| *spread > 2.0 * floor.white);
    let repeats = spread.map(|spread| Notice {
        about: None,
        text: format!(
            "the repeats differ by {} among themselves, more than the sensor's noise of {}",
            degrees(spread),
            degrees(floor.white)
        ),
        advice: "motion that the rig itself does not repeat counts as noise here".into(),
    });
    let concerns = diagnosis.concerns.iter().map(|concern| Notice {
        about: concern.recording.clone(),
        text: concern.text.clone(),
        advice: concern.advice.clone(),
    });
    repeats.into_iter().chain(concerns).collect()
}

/// Nominal, refit and repaired on fitted and on held-out runs.
fn errors(diagnosis: &Diagnosis) -> Vec<ErrorRow> {
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
    vec![
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
    ]
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

/// Number of effects that the model had before.
fn effects_before(diagnosis: &Diagnosis) -> usize {
    let all = diagnosis.repaired.fit.model.effects().count();
    all - diagnosis.repaired.added.len()
}

/// Equation and parameters of each named effect.
fn effects(diagnosis: &Diagnosis) -> Vec<Effect> {
    let fit = &diagnosis.repaired.fit;
    let first = effects_before(diagnosis);
    diagnosis
        .repaired
        .added
        .iter()
        .enumerate()
        .map(|(offset, kind)| {
            let info = kind.info();
            Effect {
                kind: info.name,
                title: info.title,
                equation: match fit.model.table().filter(|_| *kind == Kind::Table) {
                    Some(table) => format!("Q = piecewise linear in {}", table.of().symbol()),
                    None => info.equation.to_owned(),
                },
                text: info.text,
                place: match info.place {
                    Place::Input => "between the pressure sensor and the chamber",
                    Place::Force => "in the balance of forces",
                    Place::Sensor => "between the angle and what its sensor shows",
                },
                probability: diagnosis
                    .named
                    .iter()
                    .position(|named| named == kind)
                    .map(|place| {
                        probability(diagnosis.probability.get(place).copied().unwrap_or(0.0))
                    }),
                parameters: (0..kind.parameters().len())
                    .map(|parameter| ParameterId::Effect {
                        slot: first + offset,
                        parameter,
                    })
                    // Unused nodes of a table are not shown.
                    .filter(|&id| fit.model.value(id).is_some())
                    .map(|id| parameter_row(fit, id, None))
                    .collect(),
            }
        })
        .collect()
}

/// The parameters that the model had before: its five, and those of its
/// effects that were free.
fn base(request: &Request<'_>, diagnosis: &Diagnosis) -> Vec<ParameterRow> {
    let fit = &diagnosis.repaired.fit;
    let first = effects_before(diagnosis);
    let own = [
        ParameterId::Inertia,
        ParameterId::Damping,
        ParameterId::Stiffness,
        ParameterId::Exponent,
        ParameterId::InputGain,
    ];
    let of_effects = fit
        .free
        .iter()
        .copied()
        .filter(|id| matches!(id, ParameterId::Effect { slot, .. } if *slot < first));
    own.into_iter()
        .chain(of_effects)
        .map(|id| parameter_row(fit, id, request.file.model.value(id)))
        .collect()
}

fn parameter_row(fit: &Fit, id: ParameterId, nominal: Option<f64>) -> ParameterRow {
    let in_file = |value: f64| to_file_units(&fit.model, id, value);
    let name = parameter_name(&fit.model, id);
    let position = fit.free.iter().position(|&free| free == id);
    let ends = position
        .and_then(|index| fit.interval95(index))
        .filter(|(low, high)| (high - low).is_finite())
        .map(|(low, high)| [in_file(low), in_file(high)]);
    let value = fit.model.value(id).map(in_file);
    let (value, interval) = match (value, ends) {
        (Some(value), Some(ends)) => {
            let (value, ends) = with_ends(value, ends);
            (value, Some(ends))
        }
        (Some(value), None) => (short(value), None),
        (None, _) => (String::new(), None),
    };
    ParameterRow {
        name: name.rsplit('.').next().unwrap_or(&name).to_owned(),
        symbol: symbol(fit, id),
        unit: parameter_unit(&fit.model, id),
        nominal: nominal.map(|value| short(in_file(value))),
        value,
        free: position.is_some(),
        interval,
    }
}

/// The symbol of a parameter in its equation.
fn symbol(fit: &Fit, id: ParameterId) -> &'static str {
    match id {
        ParameterId::Inertia => "M",
        ParameterId::Damping => "C",
        ParameterId::Stiffness => "K",
        ParameterId::Exponent => "n",
        ParameterId::InputGain => "g",
        ParameterId::Effect { slot, parameter } => fit
            .model
            .effects()
            .nth(slot)
            .and_then(|effect| effect.parameters().get(parameter))
            .map_or("", |row| row.symbol),
    }
}

/// The structures that were fitted, by their number of effects.
fn tried(diagnosis: &Diagnosis) -> Vec<TriedGroup> {
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
    let names: Vec<&str> = tried.kinds.iter().map(|kind| kind.name()).collect();
    let (fitted, held_out) = errors_of(tried, diagnosis);
    TriedRow {
        title: if tried.kinds.is_empty() {
            "the refitted model".into()
        } else {
            titles(&tried.kinds)
        },
        name: names.join(" + "),
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
    } else if !added.is_empty() && are_the_same(&tried.kinds, &selection::names(added)) {
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
    let alternatives = &diagnosis.alternatives;
    let listed = alternatives
        .iter()
        .any(|rival| are_the_same(&tried.kinds, &rival.kinds));
    let added = selection::names(&diagnosis.repaired.added);
    let named = selection::names(&diagnosis.named);
    match diagnosis.answer {
        Answer::CannotTell if listed => Standing::Rival,
        Answer::EffectFound if are_the_same(&tried.kinds, &named) => Standing::Named,
        _ if !added.is_empty() && are_the_same(&tried.kinds, &added) => Standing::Repair,
        Answer::Unexplained if listed => Standing::Closest,
        _ if is_to_be_separated(tried, diagnosis) => Standing::Rival,
        _ if shares_the_named(tried, diagnosis) => Standing::Rival,
        _ => Standing::Rejected,
    }
}

/// Effects that were not tried, by the reason.
fn untried(diagnosis: &Diagnosis) -> Vec<Untried> {
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

/// The runs that would separate the rivals.
fn next(request: &Request<'_>, diagnosis: &Diagnosis) -> Vec<NextRun> {
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
        .map(|(proposal, [a, b])| NextRun {
            protocol: proposal.protocol.name.clone(),
            title: proposal.protocol.title.clone(),
            seconds: format!("{:.0}", f64::from(proposal.protocol.total_ms()) / 1000.0),
            separates: [a.join(" + "), b.join(" + ")],
            evidence: evidence(proposal.evidence),
            command: format!(
                "rig plan --model {}{effects} --between {},{} {} -o next.toml",
                quoted(&request.file.path.to_string_lossy()),
                a.join("+"),
                b.join("+"),
                files.join(" ")
            ),
        })
        .collect()
}

/// Sentences about what these recordings leave open.
fn open(diagnosis: &Diagnosis) -> Vec<String> {
    let mut open: Vec<String> = diagnosis.identifiability[0]
        .text
        .iter()
        .map(|text| format!("{}.", with_capital(text)))
        .collect();
    match diagnosis.answer {
        Answer::NoDiscrepancy | Answer::ParametersOnly => open.push(format!(
            "An effect that moves the angle by less than the noise of {} does not show in these \
             runs; nor does one that they do not excite, such as creep in short runs.",
            degrees(diagnosis.held_out.floor)
        )),
        Answer::EffectFound => {
            open.extend(look_alikes(diagnosis));
            if !diagnosis.adequacy.exact_form {
                open.push(format!(
                    "Whether the formula holds to the letter, or only the kind of effect: {}.",
                    left_over(diagnosis)
                ));
            }
        }
        Answer::CannotTell if diagnosis.is_open() => {
            open.push("What is missing: the search was ended before everything was tried.".into());
        }
        Answer::CannotTell => open.push(
            "Which of the explanations is the right one. Upload none of them yet: a wrong one \
             predicts these runs as well, and others not."
                .into(),
        ),
        Answer::Unexplained => open.push(
            "What the missing force is. Where the picture repeats from run to run it is physics \
             that no known formula describes; where it does not, look at the rig first."
                .into(),
        ),
    }
    open.push(
        "The gain of the angle sensor cannot be told from stiffness, damping and input gain, nor \
         the scale of the inertia from anything: neither is fitted."
            .into(),
    );
    open
}

/// The standing of a look-alike of a named effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Alike {
    /// It is rejected.
    ToldApart,
    /// It is not rejected.
    NotSeparated,
    /// It generalises the named effect, and leaves no less.
    MoreGeneral,
    /// It had no final fit in place of the named one.
    NotTried,
}

impl Alike {
    const ALL: [Self; 4] = [
        Self::ToldApart,
        Self::NotSeparated,
        Self::MoreGeneral,
        Self::NotTried,
    ];

    /// The text about all of them.
    fn text(self) -> &'static str {
        match self {
            Self::ToldApart => "These recordings tell what is named from its look-alikes",
            Self::NotSeparated => "Look-alikes that these recordings do not separate from it",
            Self::MoreGeneral => {
                "More general effects, of which it is a special case and which bring nothing beyond it"
            }
            Self::NotTried => "Look-alikes that were not fitted to the end in its place",
        }
    }
}

/// Sentences about the look-alikes of the named effects.
fn look_alikes(diagnosis: &Diagnosis) -> Vec<String> {
    let added = &diagnosis.repaired.added;
    let size = judged_size(diagnosis);
    let fates: Vec<(&str, Alike)> = added
        .iter()
        .flat_map(|&named| {
            let others = named.info().look_alikes.iter();
            let others = others.filter_map(|name| Kind::from_name(name));
            others
                .filter(|other| !added.contains(other))
                .map(move |other| {
                    (
                        other.info().title,
                        fate(named, other, size, &diagnosis.tried),
                    )
                })
        })
        .collect();
    Alike::ALL
        .iter()
        .filter_map(|&wanted| {
            let mut titles: Vec<&str> = fates
                .iter()
                .filter(|(_, fate)| *fate == wanted)
                .map(|(title, _)| *title)
                .collect();
            titles.sort_unstable();
            titles.dedup();
            let text = wanted.text();
            (!titles.is_empty()).then(|| format!("{text}: {}.", listed(&titles)))
        })
        .collect()
}

/// The standing of `other`, a look-alike of `named`, among structures of `size` effects:
/// that of the best structure that has it instead.
fn fate(named: Kind, other: Kind, size: usize, tried: &[FittedStructure]) -> Alike {
    let best = tried
        .iter()
        .filter(|tried| tried.kinds.len() == size)
        .filter(|tried| tried.kinds.contains(&other) && !tried.kinds.contains(&named))
        .max_by(|a, b| a.probability.total_cmp(&b.probability));
    match best {
        None => Alike::NotTried,
        Some(best) if !best.rejected => Alike::NotSeparated,
        // Its probability was given to the special case.
        Some(_) if other.special_case() == Some(named) => Alike::MoreGeneral,
        Some(_) => Alike::ToldApart,
    }
}

/// The size of the structures among which the answer was chosen: the number of named
/// effects, or more if these are common to several structures.
fn judged_size(diagnosis: &Diagnosis) -> usize {
    let rival = diagnosis.alternatives.first();
    rival.map_or(diagnosis.repaired.added.len(), |rival| rival.kinds.len())
}

/// Whether a structure is one of several that are not rejected and have the
/// named effects in common.
fn shares_the_named(tried: &FittedStructure, diagnosis: &Diagnosis) -> bool {
    let (named, size) = (diagnosis.repaired.added.len(), judged_size(diagnosis));
    diagnosis.answer == Answer::EffectFound
        && size > named
        && tried.kinds.len() == size
        && !tried.rejected
}

/// Whether a run is proposed that separates a structure from another.
fn is_to_be_separated(tried: &FittedStructure, diagnosis: &Diagnosis) -> bool {
    let mut pairs = diagnosis.proposals.iter().flat_map(|(_, pair)| pair);
    pairs.any(|names| are_the_same(&tried.kinds, names))
}

/// The name of an effect in sentences.
fn title(name: &str) -> &str {
    Kind::from_name(name).map_or(name, |kind| kind.info().title)
}

fn titles(kinds: &[Kind]) -> String {
    let titles: Vec<&str> = kinds.iter().map(|kind| kind.info().title).collect();
    listed(&titles)
}

fn titles_of_names(names: &[String]) -> String {
    let titles: Vec<&str> = names.iter().map(|name| title(name)).collect();
    listed(&titles)
}

/// "a, b and c".
fn listed(items: &[impl AsRef<str>]) -> String {
    let items: Vec<&str> = items.iter().map(AsRef::as_ref).collect();
    match items.as_slice() {
        [] => String::new(),
        [only] => (*only).to_owned(),
        [head @ .., last] => format!("{} and {last}", head.join(", ")),
    }
}

fn with_capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| {
        first.to_uppercase().chain(letters).collect()
    })
}

fn probability(value: f64) -> String {
    if value > 0.995 {
        "> 0.99".into()
    } else if value < 0.005 {
        "< 0.01".into()
    } else {
        format!("{value:.2}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_numbers_for_people() {
        assert_eq!(listed(&["a"]), "a");
        assert_eq!(listed(&["a", "b", "c"]), "a, b and c");
        assert_eq!(probability(0.999), "> 0.99");
    }

    #[test]
    fn what_a_name_needs_depends_on_what_is_left() {
        assert!(shortfall(0.2).contains("25 %"));
        assert!(shortfall(0.5).contains("chance"));
    }

    #[test]
    fn look_alikes_are_told_apart_only_where_they_were_rejected() {
        use Kind::{BoucWenHysteresis, CoulombFriction, InputBacklash};
        let tried = |kinds: &[Kind], probability| FittedStructure {
            kinds: kinds.to_vec(),
            rmse: 0.01,
            held_out: None,
            delta_bic: 0.0,
            probability,
            rejected: probability < 0.05,
            at_bound: Vec::new(),
        };
        let all = [
            tried(&[CoulombFriction], 0.9),
            tried(&[InputBacklash], 0.01),
            tried(&[BoucWenHysteresis], 0.0),
            tried(&[CoulombFriction, InputBacklash], 0.5),
            tried(&[InputBacklash, BoucWenHysteresis], 0.3),
        ];
        let fate = |other, size| fate(CoulombFriction, other, size, &all);
        assert_eq!(fate(InputBacklash, 1), Alike::ToldApart);
        assert_eq!(fate(BoucWenHysteresis, 1), Alike::MoreGeneral);
        assert_eq!(fate(Kind::Gravity, 1), Alike::NotTried);
        assert_eq!(fate(InputBacklash, 2), Alike::NotSeparated);
    }

    #[test]
    fn the_largest_source_is_that_of_the_noise_floor() {
        let floor = NoiseFloor {
            rms: 0.02,
            white: 0.01,
            repeats: Some(0.015),
            rest: Some(0.02),
            quantisation_step: 0.001,
            input: 0.001,
            groups: Vec::new(),
        };
        assert_eq!(noise_note(&floor, 0.02), "noise at rest");
        let floor = NoiseFloor {
            repeats: Some(0.03),
            rms: 0.03,
            input: 0.02,
            ..floor
        };
        assert_eq!(
            noise_note(&floor, 0.036),
            "spread between repeats, and the 1.15° that noise of the pressure leaves"
        );
    }
}
