//! The third phase: open the answers and count.
//!
//! What the rates count:
//!
//! - **named, strict**: the verdict is `effect_found` and names exactly the
//!   truth.
//! - **named, lenient**: or the verdict is `cannot_tell` and its answer set is
//!   the truth and at most one other single effect, which the catalogue lists
//!   as a look-alike of the truth.
//! - **in the answer set**: the truth is what is named, or one of the
//!   alternatives; beside a name only alternatives with a probability of 5 % or
//!   more count. `unexplained` has no answer set.
//! - **a name**: the verdict is `effect_found`. On data that hide nothing, or
//!   only parameters, every name is false. On an effect that the catalogue does not
//!   hold, a name that explains the error is false; one that says itself that it
//!   explains a part is not.

use std::collections::BTreeSet;
use std::path::Path;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use softrig::estimate::Dataset;
use softrig::estimate::fit::Fitter;
use softrig_formats::model_file::ModelFile;
use statrs::distribution::{ContinuousCDF, Normal};

use super::cases::{Answer, Hidden};
use super::experiments::Set;
use super::kinds::look_alike;
use super::truth::{Base, Formula};
use super::verdicts::Outcome;

/// Alternatives beside a name count from this probability on.
const PROBABLE: f64 = 0.05;

/// A set of kinds, in alphabetical order.
pub type Kinds = Vec<String>;

/// What of a verdict is scored.
#[derive(Clone, Debug, PartialEq)]
pub struct Said {
    /// The verdict's word; `refused` if there is none.
    pub verdict: String,
    /// What is named.
    pub named: Kinds,
    /// Whether that explains part of the error only.
    pub in_part: bool,
    /// Every explanation that the verdict leaves open, the named one included.
    pub answer_set: BTreeSet<Kinds>,
    /// The family of `cannot_tell`.
    pub family: Option<String>,
    /// What a repair without a name is a function of.
    pub repair: Option<String>,
    /// Held-out RMSE of the repaired model over the refit's.
    pub held_out: Option<f64>,
}

impl Said {
    /// Reads the fields of the published schema; `strength`, `family` and `repair` may be
    /// absent.
    pub fn of(outcome: &Outcome) -> Self {
        let nothing = serde_json::Value::Null;
        let verdict = outcome.verdict.as_ref().unwrap_or(&nothing);
        let word = verdict["verdict"].as_str().unwrap_or("refused").to_owned();
        let sorted = |mut kinds: Kinds| {
            kinds.sort_unstable();
            kinds
        };
        let list = |value: &serde_json::Value| value.as_array().cloned().unwrap_or_default();
        let text = |value: &serde_json::Value| value.as_str().unwrap_or_default().to_owned();
        let is_named = word == "effect_found";
        let named = if is_named {
            let effects = list(&verdict["effects"]);
            sorted(effects.iter().map(|effect| text(&effect["kind"])).collect())
        } else {
            Vec::new()
        };
        let mut answer_set = BTreeSet::new();
        if is_named {
            answer_set.insert(named.clone());
        }
        if is_named || word == "cannot_tell" {
            for entry in list(&verdict["alternatives"]) {
                let probability = entry["probability"].as_f64().unwrap_or(0.0);
                if !is_named || probability >= PROBABLE {
                    answer_set.insert(sorted(list(&entry["kinds"]).iter().map(text).collect()));
                }
            }
        }
        let error = |which: &str| verdict["holdout_rmse_deg"][which].as_f64();
        let of = verdict["repair"]["of"].as_array().map(|list| {
            let words: Vec<&str> = list.iter().filter_map(|word| word.as_str()).collect();
            words.join(", ")
        });
        Self {
            in_part: verdict["strength"] == "part",
            family: verdict["family"].as_str().map(str::to_owned),
            repair: of.or_else(|| verdict["repair"]["kind"].as_str().map(str::to_owned)),
            held_out: match (error("repaired"), error("refit")) {
                (Some(repaired), Some(refit)) if refit > 0.0 => Some(repaired / refit),
                _ => None,
            },
            verdict: word,
            named,
            answer_set,
        }
    }

    /// Whether a name is given.
    pub fn names(&self) -> bool {
        !self.named.is_empty()
    }

    /// Named, strict.
    pub fn names_exactly(&self, truth: &[String]) -> bool {
        self.names() && self.named == truth
    }

    /// Named, lenient.
    pub fn names_group(&self, truth: &[String]) -> bool {
        if self.names_exactly(truth) {
            return true;
        }
        let [kind] = truth else { return false };
        self.verdict == "cannot_tell"
            && self.answer_set.len() <= 2
            && self.answer_set.contains(truth)
            && self.answer_set.iter().all(
                |entry| matches!(entry.as_slice(), [one] if one == kind || look_alike(one, kind)),
            )
    }

    /// In the answer set.
    pub fn holds(&self, truth: &[String]) -> bool {
        self.answer_set.contains(truth)
    }
}

/// How a case is counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Class {
    /// One effect of the tool's catalogue.
    One,
    /// Two of them.
    Two,
    /// Nothing, or parameters only.
    EffectFree,
    /// An effect outside EFFECTS.md.
    Outside,
}

impl Class {
    /// The class of an answer.
    pub fn of(answer: &Answer) -> Self {
        match answer.hidden {
            Hidden::Nothing | Hidden::Parameters => Self::EffectFree,
            Hidden::Outside => Self::Outside,
            Hidden::One => Self::One,
            Hidden::Two => Self::Two,
        }
    }
}

/// A fitted number beside the true one.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Name.
    pub name: String,
    /// Whether it is a base parameter (its ratio to the inertia).
    pub base: bool,
    /// |estimate − truth| / |truth|.
    pub relative_error: f64,
    /// Whether the 95 % interval holds the truth; none without an interval.
    pub covered: Option<bool>,
}

/// RMS on fresh runs (rad).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Against what the noisy sensor shows.
    pub noisy: f64,
    /// Against what a perfect sensor would show.
    pub clean: f64,
}

/// A case with its score.
#[derive(Clone, Debug)]
pub struct Scored {
    /// The answer.
    pub answer: Answer,
    /// How it is counted.
    pub class: Class,
    /// What the verdict said.
    pub said: Said,
    /// The repaired model on fresh runs.
    pub tool: Option<Errors>,
    /// The right structure, refitted to the same recordings, on fresh runs.
    pub oracle: Option<Errors>,
    /// Fitted numbers, where the structure is right to the formula.
    pub estimates: Vec<Estimate>,
    /// Wall time (s).
    pub seconds: f64,
}

/// Scores every case that has a verdict.
pub fn score(answers: &[Answer], verdicts: &Path, sealed: &Path) -> Vec<Scored> {
    let case = |answer: &Answer| answer.case.clone();
    of_verdicts(answers, verdicts, case, |answer, outcome| {
        Scored::of(answer, outcome, sealed)
    })
}

/// The score of every answer whose case has a verdict.
pub(super) fn of_verdicts<A: Sync, S: Send>(
    answers: &[A],
    verdicts: &Path,
    case: impl Fn(&A) -> String + Sync,
    score: impl Fn(&A, &Outcome) -> S + Sync,
) -> Vec<S> {
    answers
        .par_iter()
        .filter_map(|answer| {
            let outcome = Outcome::read(&verdicts.join(format!("{}.json", case(answer))))?;
            Some(score(answer, &outcome))
        })
        .collect()
}

impl Scored {
    fn of(answer: &Answer, outcome: &Outcome, sealed: &Path) -> Self {
        let class = Class::of(answer);
        let said = Said::of(outcome);
        // Where the phase of a disturbance is another one in every run, nobody
        // can predict a fresh one.
        let predictable = answer
            .truth
            .effects
            .iter()
            .all(|effect| effect.formula != Formula::PeriodicUnsynchronised);
        let comparable = matches!(class, Class::One | Class::Two) && predictable;
        Self {
            tool: comparable.then(|| on_fresh(answer, outcome)).flatten(),
            oracle: comparable.then(|| oracle(answer, sealed)),
            estimates: estimates(answer, outcome, &said),
            seconds: outcome.seconds,
            answer: answer.clone(),
            class,
            said,
        }
    }

    /// Held-out error against the oracle's, against noisy and perfect sensors.
    pub fn ratios(&self) -> Option<(f64, f64)> {
        let (tool, oracle) = (self.tool?, self.oracle?);
        Some((tool.noisy / oracle.noisy, tool.clean / oracle.clean))
    }
}

/// The oracle's errors; they take seconds and do not depend on the tool, so
/// they are kept beside the answers.
fn oracle(answer: &Answer, sealed: &Path) -> Errors {
    let path = sealed.join(format!("oracle_{}.json", answer.case));
    let kept = std::fs::read_to_string(&path)
        .ok()
        .and_then(|text| serde_json::from_str(&text).ok());
    kept.unwrap_or_else(|| {
        let (noisy, clean) = answer.on_fresh(&answer.oracle());
        let errors = Errors { noisy, clean };
        // Where it cannot be kept, it is computed again.
        if let Ok(text) = serde_json::to_string(&errors) {
            let _ = softrig_formats::error::write_atomically(&path, text.as_bytes());
        }
        errors
    })
}

/// The repaired model over fresh runs, in the tool's own simulation.
fn on_fresh(answer: &Answer, outcome: &Outcome) -> Option<Errors> {
    let file = ModelFile::parse(&outcome.repaired, Path::new("repaired.toml")).ok()?;
    let fresh = answer.fresh();
    let recordings: Vec<_> = fresh
        .iter()
        .map(|(_, recording, _)| recording.clone())
        .collect();
    let data = Dataset::of(&recordings);
    let compared = Fitter::new(&file.model, &data).compare(&file.model);
    let (mut noisy, mut clean, mut count) = (0.0, 0.0, 0.0);
    for ((_, recording, reading), residuals) in fresh.iter().zip(compared.residuals.iter()) {
        for ((measured, shown), residual) in recording.angle.iter().zip(reading).zip(residuals) {
            noisy += residual * residual;
            clean += (residual + measured - shown).powi(2);
            count += 1.0;
        }
    }
    Some(Errors {
        noisy: (noisy / count).sqrt(),
        clean: (clean / count).sqrt(),
    })
}

/// Fitted numbers beside true ones, where the tool has the very equations.
fn estimates(answer: &Answer, outcome: &Outcome, said: &Said) -> Vec<Estimate> {
    let structure_is_right = match answer.hidden {
        Hidden::Nothing | Hidden::Outside => false,
        Hidden::Parameters => !said.names(),
        Hidden::One | Hidden::Two => answer.same_formulas && said.names_exactly(&answer.kinds),
    };
    if !structure_is_right {
        return Vec::new();
    }
    let Base {
        damping,
        stiffness,
        input_gain,
        ..
    } = answer.truth.base;
    let mut true_values = vec![
        ("damping".to_owned(), damping),
        ("stiffness".to_owned(), stiffness),
        ("input_gain".to_owned(), input_gain * 1e3),
    ];
    for effect in &answer.truth.effects {
        let row = effect.formula.row();
        for (quantity, value) in row.quantities.iter().zip(effect.values) {
            true_values.push((
                format!("{}.{}", row.kind.unwrap_or_default(), quantity.key),
                value * quantity.per_si,
            ));
        }
    }
    outcome
        .fitted
        .iter()
        .filter_map(|fitted| {
            let (name, truth) = true_values.iter().find(|(name, _)| *name == fitted.name)?;
            Some(Estimate {
                name: name.clone(),
                base: !name.contains('.'),
                relative_error: (fitted.value - truth).abs() / truth.abs(),
                covered: fitted
                    .interval95
                    .map(|(low, high)| (low..=high).contains(truth)),
            })
        })
        .collect()
}

/// So many of so many.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Rate {
    /// Counted.
    pub hits: u32,
    /// Of these.
    pub of: u32,
}

impl Rate {
    /// Counts.
    pub fn count(items: impl IntoIterator<Item = bool>) -> Self {
        items.into_iter().fold(Self::default(), |rate, hit| Self {
            hits: rate.hits + u32::from(hit),
            of: rate.of + 1,
        })
    }

    /// The share; none of nothing.
    pub fn share(self) -> Option<f64> {
        (self.of > 0).then(|| f64::from(self.hits) / f64::from(self.of))
    }

    /// 95 % interval of the share (Wilson 1927).
    pub fn wilson(self) -> Option<(f64, f64)> {
        let p = self.share()?;
        let z = Normal::standard().inverse_cdf(0.975);
        let n = f64::from(self.of);
        let middle = p + z * z / (2.0 * n);
        let half = z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
        let whole = 1.0 + z * z / n;
        Some((
            ((middle - half) / whole).max(0.0),
            ((middle + half) / whole).min(1.0),
        ))
    }
}

/// The figures of a set of experiments.
#[derive(Clone, Debug, PartialEq)]
pub struct Figures {
    /// Which experiments.
    pub set: Set,
    /// One effect: named, strict.
    pub strict: Rate,
    /// One effect: named, lenient.
    pub lenient: Rate,
    /// One effect: in the answer set.
    pub in_set: Rate,
    /// One effect by the catalogue's formula: named, lenient.
    pub same_formula: Rate,
    /// One effect by another formula: named, lenient.
    pub other_formula: Rate,
    /// One effect: something else is named.
    pub wrong: Rate,
    /// Nothing hidden: a name.
    pub false_on_nothing: Rate,
    /// Parameters only: a name.
    pub false_on_parameters: Rate,
    /// Both together.
    pub false_names: Rate,
    /// Outside the catalogue: a name.
    pub outside: Rate,
    /// Two effects: both and nothing else named.
    pub pair: Rate,
    /// Two effects: everything that is named is hidden.
    pub part_of_pair: Rate,
    /// Effect parameters whose interval holds the truth.
    pub effect_coverage: Rate,
    /// Base ratios whose interval holds the truth.
    pub base_coverage: Rate,
    /// Median relative error of effect parameters.
    pub effect_error: Option<f64>,
    /// Median relative error of base ratios.
    pub base_error: Option<f64>,
    /// Median held-out error against the oracle's, one effect, noisy sensor.
    pub held_out: Option<f64>,
    /// The same against a perfect sensor.
    pub held_out_clean: Option<f64>,
    /// Median wall time (s).
    pub seconds_median: Option<f64>,
    /// Longest wall time (s).
    pub seconds_worst: Option<f64>,
}

pub(super) fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    (!values.is_empty()).then(|| softrig::statistics::median(&mut values))
}

impl Figures {
    /// Counts the cases of a set; none if there are none.
    pub fn of(set: Set, scored: &[Scored]) -> Option<Self> {
        let cases: Vec<&Scored> = scored
            .iter()
            .filter(|case| case.answer.set == set)
            .collect();
        if cases.is_empty() {
            return None;
        }
        let of = |class: Class| cases.iter().filter(move |case| case.class == class);
        let hidden = |hidden: Hidden| {
            cases
                .iter()
                .filter(move |case| case.answer.hidden == hidden)
        };
        let lenient = |case: &&&Scored| case.said.names_group(&case.answer.kinds);
        let estimates = |base: bool| {
            cases
                .iter()
                .flat_map(|case| &case.estimates)
                .filter(move |estimate| estimate.base == base)
        };
        Some(Self {
            set,
            strict: Rate::count(
                of(Class::One).map(|case| case.said.names_exactly(&case.answer.kinds)),
            ),
            lenient: Rate::count(of(Class::One).map(|case| lenient(&case))),
            in_set: Rate::count(of(Class::One).map(|case| case.said.holds(&case.answer.kinds))),
            same_formula: Rate::count(
                of(Class::One)
                    .filter(|case| case.answer.same_formulas)
                    .map(|case| lenient(&case)),
            ),
            other_formula: Rate::count(
                of(Class::One)
                    .filter(|case| !case.answer.same_formulas)
                    .map(|case| lenient(&case)),
            ),
            wrong: Rate::count(
                of(Class::One)
                    .map(|case| case.said.names() && !case.said.names_exactly(&case.answer.kinds)),
            ),
            false_on_nothing: Rate::count(hidden(Hidden::Nothing).map(|case| case.said.names())),
            false_on_parameters: Rate::count(
                hidden(Hidden::Parameters).map(|case| case.said.names()),
            ),
            false_names: Rate::count(of(Class::EffectFree).map(|case| case.said.names())),
            outside: Rate::count(
                of(Class::Outside).map(|case| case.said.names() && !case.said.in_part),
            ),
            pair: Rate::count(
                of(Class::Two).map(|case| case.said.names_exactly(&case.answer.kinds)),
            ),
            part_of_pair: Rate::count(of(Class::Two).map(|case| {
                let named = &case.said.named;
                case.said.names() && named.iter().all(|kind| case.answer.kinds.contains(kind))
            })),
            effect_coverage: Rate::count(estimates(false).filter_map(|e| e.covered)),
            base_coverage: Rate::count(estimates(true).filter_map(|e| e.covered)),
            effect_error: median(estimates(false).map(|e| e.relative_error)),
            base_error: median(estimates(true).map(|e| e.relative_error)),
            held_out: median(of(Class::One).filter_map(|case| Some(case.ratios()?.0))),
            held_out_clean: median(of(Class::One).filter_map(|case| Some(case.ratios()?.1))),
            seconds_median: median(cases.iter().map(|case| case.seconds)),
            seconds_worst: cases.iter().map(|case| case.seconds).reduce(f64::max),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn said(verdict: serde_json::Value) -> Said {
        Said::of(&Outcome {
            verdict: Some(verdict),
            ..Outcome::default()
        })
    }

    fn kinds(names: &[&str]) -> Kinds {
        names.iter().map(|name| (*name).to_owned()).collect()
    }

    #[test]
    fn a_name_beside_unlikely_rivals_is_a_set_of_one() {
        let said = said(json!({
            "verdict": "effect_found",
            "effects": [{ "kind": "gravity" }],
            "alternatives": [{ "kinds": ["exponent_shift"], "probability": 0.01 },
                             { "kinds": ["cubic_stiffness"], "probability": 0.2 }],
        }));
        let gravity = kinds(&["gravity"]);
        assert!(said.names_exactly(&gravity) && said.names_group(&gravity));
        assert!(said.holds(&kinds(&["cubic_stiffness"])));
        assert!(!said.holds(&kinds(&["exponent_shift"])));
        assert!(!said.names_group(&kinds(&["cubic_stiffness"])));
    }

    #[test]
    fn cannot_tell_counts_for_two_look_alikes_and_no_more() {
        let of = |others: &[&[&str]]| {
            let list: Vec<_> = others
                .iter()
                .map(|kinds| json!({ "kinds": kinds, "probability": 0.3 }))
                .collect();
            said(json!({ "verdict": "cannot_tell", "effects": [], "alternatives": list }))
        };
        let truth = kinds(&["pneumatic_lag"]);
        let two = of(&[&["sensor_lag"], &["pneumatic_lag"]]);
        assert!(two.names_group(&truth) && !two.names_exactly(&truth) && !two.names());
        let three = of(&[&["sensor_lag"], &["pneumatic_lag"], &["dead_time"]]);
        assert!(!three.names_group(&truth) && three.holds(&truth));
        let unlike = of(&[&["gravity"], &["pneumatic_lag"]]);
        assert!(!unlike.names_group(&truth) && unlike.holds(&truth));
        let pair = of(&[&["gravity", "sensor_lag"], &["pneumatic_lag"]]);
        assert!(!pair.names_group(&truth));
    }

    #[test]
    fn unexplained_has_no_answer_set() {
        let said = said(json!({
            "verdict": "unexplained", "effects": [],
            "alternatives": [{ "kinds": ["leak"], "probability": 0.9 }],
        }));
        assert!(!said.holds(&kinds(&["leak"])) && !said.names());
    }

    /// Figures of Newcombe (1998), table I: 81 of 263, and 0 of 20.
    #[test]
    fn wilson_intervals_are_those_of_the_literature() {
        let (low, high) = Rate { hits: 81, of: 263 }.wilson().unwrap();
        assert!((low - 0.2553).abs() < 1e-4 && (high - 0.3662).abs() < 1e-4);
        let (low, high) = Rate { hits: 0, of: 20 }.wilson().unwrap();
        assert!(low.abs() < 1e-12 && (high - 0.1611).abs() < 1e-4);
        assert_eq!(Rate::default().wilson(), None);
    }
}
