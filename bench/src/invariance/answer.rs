//! What a diagnosis answers, and how alike two answers to one question are.

use std::collections::BTreeSet;
use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use softrig_tests::verdict::Kinds;

use crate::blind::kinds::family;

/// So many rivals count where two answer sets are compared: nobody reads on.
const COMPARED: usize = 3;
/// A refit whose error moves by more than this share is another one.
const OTHER_REFIT: f64 = 0.01;

/// What a verdict answers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// The verdict, as in the file.
    pub verdict: String,
    /// The effects that are named.
    pub named: Kinds,
    /// Whether they explain only a part.
    pub in_part: bool,
    /// The answer set of `cannot_tell`, best first.
    pub rivals: Vec<Kinds>,
    /// The family of these rivals.
    pub family: Option<String>,
    /// The probability of each named effect, or of each rival.
    pub stated: Vec<(Kinds, f64)>,
    /// RMS error of the refitted model on the fitted recordings (°).
    pub refit_deg: f64,
}

impl Answer {
    /// Reads what `softrig diagnose --json` writes; none if it is no verdict.
    pub fn of(verdict: &Value) -> Option<Self> {
        let kinds = |list: &Value| -> Kinds {
            let list = list.as_array().into_iter().flatten();
            list.filter_map(|kind| Some(kind.as_str()?.to_owned()))
                .collect()
        };
        let word = verdict["verdict"].as_str()?.to_owned();
        let list = |key: &str| verdict[key].as_array().into_iter().flatten();
        let probability = |it: &Value| it["probability"].as_f64();
        let stated: Vec<(Kinds, f64)> = if word == "cannot_tell" {
            list("alternatives")
                .filter_map(|rival| Some((kinds(&rival["kinds"]), probability(rival)?)))
                .collect()
        } else {
            let name = |effect: &Value| Some(Kinds::from([effect["kind"].as_str()?.to_owned()]));
            list("effects")
                .filter_map(|effect| Some((name(effect)?, probability(effect)?)))
                .collect()
        };
        Some(Self {
            stated,
            named: list("effects")
                .filter_map(|effect| Some(effect["kind"].as_str()?.to_owned()))
                .collect(),
            in_part: verdict["strength"] == "part",
            rivals: list("alternatives")
                .filter(|_| word == "cannot_tell")
                .map(|rival| kinds(&rival["kinds"]))
                .collect(),
            family: verdict["family"].as_str().map(str::to_owned),
            refit_deg: verdict["rmse_deg"]["refit"].as_f64().unwrap_or(0.0),
            verdict: word,
        })
    }

    /// Whether effects are named.
    pub fn names(&self) -> bool {
        self.verdict == "effect_found"
    }

    /// Whether it leaves an answer set.
    pub fn is_open(&self) -> bool {
        self.verdict == "cannot_tell"
    }

    /// Whether it says that no effect is missing.
    pub fn is_quiet(&self) -> bool {
        matches!(self.verdict.as_str(), "parameters_only" | "no_discrepancy")
    }

    /// How many times the error of the refit is that of another answer's.
    pub fn refit_ratio(&self, before: &Self) -> f64 {
        const NOTHING_DEG: f64 = 1e-9;
        (self.refit_deg + NOTHING_DEG) / (before.refit_deg + NOTHING_DEG)
    }

    fn is_same(&self, other: &Self, quiet_is_one: bool) -> bool {
        if quiet_is_one && self.is_quiet() && other.is_quiet() {
            return true;
        }
        if self.verdict != other.verdict {
            return false;
        }
        if self.names() {
            return self.named == other.named;
        }
        let first = |answer: &Self| -> BTreeSet<Kinds> {
            answer.rivals.iter().take(COMPARED).cloned().collect()
        };
        !self.is_open()
            || !first(self).is_disjoint(&first(other))
            || (self.family.is_some() && self.family == other.family)
    }

    /// Whether it says less than another answer, and nothing against it.
    fn is_vaguer_than(&self, other: &Self) -> bool {
        let part_of = |kinds: &Kinds, whole: &Kinds| !kinds.is_empty() && kinds.is_subset(whole);
        match (self.verdict.as_str(), other.verdict.as_str()) {
            ("unexplained", "effect_found" | "cannot_tell") => true,
            ("effect_found", "effect_found") => {
                part_of(&self.named, &other.named) && self.named != other.named
            }
            // What all rivals have in common.
            ("effect_found", "cannot_tell") => {
                !other.rivals.is_empty()
                    && other
                        .rivals
                        .iter()
                        .all(|rival| part_of(&self.named, rival) && self.named != *rival)
            }
            ("cannot_tell", "effect_found") => {
                self.rivals.iter().any(|rival| part_of(rival, &other.named))
                    || self.family_holds(&other.named)
            }
            ("cannot_tell", "cannot_tell") => {
                !other.rivals.is_empty()
                    && other.rivals.iter().all(|rival| self.rivals.contains(rival))
            }
            _ => false,
        }
    }

    /// The families of its rivals, as far as they share them.
    fn families(&self) -> BTreeSet<&str> {
        let families = self.family.iter();
        families.flat_map(|family| family.split(" + ")).collect()
    }

    /// Whether its family is that of these effects, or of some of them.
    fn family_holds(&self, kinds: &Kinds) -> bool {
        let ours = self.families();
        !ours.is_empty() && ours.is_subset(&families(kinds))
    }

    /// Whether its family is that of these effects.
    pub fn is_family_of(&self, kinds: &Kinds) -> bool {
        !kinds.is_empty() && self.families() == families(kinds)
    }
}

/// The families of effects; one without a family is its own.
fn families(kinds: &Kinds) -> BTreeSet<&str> {
    kinds.iter().map(|kind| family(kind)).collect()
}

/// Effects as one reads them.
pub fn in_words(kinds: &Kinds) -> String {
    let kinds: Vec<String> = kinds.iter().map(|kind| kind.replace('_', " ")).collect();
    kinds.join(" + ")
}

impl fmt::Display for Answer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.names() {
            let part = if self.in_part { " (part)" } else { "" };
            return write!(f, "{}{part}", in_words(&self.named));
        }
        if !self.is_open() {
            return f.write_str(&self.verdict.replace('_', " "));
        }
        let rivals: Vec<String> = self.rivals.iter().take(COMPARED).map(in_words).collect();
        let more = if self.rivals.len() > COMPARED {
            " / …"
        } else {
            ""
        };
        write!(f, "cannot tell: {}{more}", rivals.join(" / "))?;
        match &self.family {
            Some(family) => write!(f, " [{family}]"),
            None => Ok(()),
        }
    }
}

/// How alike two answers are, the one before and the one after.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Likeness {
    /// The same verdict with the same names, or with answer sets that share one of their
    /// first three rivals or their family.
    Same,
    /// The answer after says less than the one before, and nothing against it: an answer set
    /// or a family that holds the name, one of two names, or no name.
    Vaguer,
    /// The other way round.
    Sharper,
    /// Both name effects, and neither names all that the other does.
    Contradicting,
    /// Another verdict, and none of these.
    Another,
}

impl Likeness {
    /// All of them, in the order of the tables.
    pub const ALL: [Self; 5] = [
        Self::Same,
        Self::Vaguer,
        Self::Sharper,
        Self::Contradicting,
        Self::Another,
    ];

    /// Compares two answers. Where `quiet_is_one`, "nothing is missing" and "only the
    /// parameters were off" are the same answer.
    pub fn of(before: &Answer, after: &Answer, quiet_is_one: bool) -> Self {
        if before.is_same(after, quiet_is_one) {
            Self::Same
        } else if after.is_vaguer_than(before) {
            Self::Vaguer
        } else if before.is_vaguer_than(after) {
            Self::Sharper
        } else if before.names() && after.names() {
            Self::Contradicting
        } else {
            Self::Another
        }
    }

    /// Its name in tables and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Same => "same",
            Self::Vaguer => "vaguer",
            Self::Sharper => "sharper",
            Self::Contradicting => "contradicting",
            Self::Another => "another",
        }
    }
}

/// Whether the error of a refit moved: by how many times it is what it was.
pub fn is_other_refit(ratio: f64) -> bool {
    (ratio - 1.0).abs() > OTHER_REFIT
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn found(kinds: &[&str]) -> Answer {
        let effects: Vec<Value> = kinds.iter().map(|kind| json!({ "kind": kind })).collect();
        Answer::of(&json!({ "verdict": "effect_found", "effects": effects })).unwrap()
    }

    fn open(rivals: &[&[&str]], family: Option<&str>) -> Answer {
        let rivals: Vec<Value> = rivals
            .iter()
            .map(|kinds| json!({ "kinds": kinds }))
            .collect();
        let mut verdict =
            json!({ "verdict": "cannot_tell", "effects": [], "alternatives": rivals });
        if let Some(family) = family {
            verdict["family"] = json!(family);
        }
        Answer::of(&verdict).unwrap()
    }

    fn word(verdict: &str) -> Answer {
        Answer::of(&json!({ "verdict": verdict })).unwrap()
    }

    #[track_caller]
    fn assert_likeness(before: &Answer, after: &Answer, expected: Likeness) {
        assert_eq!(
            Likeness::of(before, after, false),
            expected,
            "{before} → {after}"
        );
    }

    #[test]
    fn verdicts_are_read() {
        let answer = Answer::of(&json!({
            "verdict": "effect_found", "strength": "part",
            "effects": [{ "kind": "gravity" }, { "kind": "coulomb_friction" }],
            "alternatives": [{ "kinds": ["leak"] }],
            "rmse_deg": { "refit": 2.5 },
        }))
        .unwrap();
        assert!(answer.in_part && answer.rivals.is_empty());
        assert!((answer.refit_deg - 2.5).abs() < 1e-12);
        assert_eq!(answer.to_string(), "coulomb friction + gravity (part)");
        assert_eq!(Answer::of(&json!({})), None);
        let answer = open(&[&["leak"], &["gravity", "leak"]], Some("creep"));
        assert_eq!(
            answer.to_string(),
            "cannot tell: leak / gravity + leak [creep]"
        );
        assert_eq!(word("no_discrepancy").to_string(), "no discrepancy");
    }

    #[test]
    fn the_same_names_are_the_same_answer() {
        let pair = found(&["gravity", "coulomb_friction"]);
        assert_likeness(
            &pair,
            &found(&["coulomb_friction", "gravity"]),
            Likeness::Same,
        );
        assert_likeness(&word("unexplained"), &word("unexplained"), Likeness::Same);
        // A name at another strength is the same name.
        let part = Answer {
            in_part: true,
            ..found(&["gravity"])
        };
        assert_likeness(&part, &found(&["gravity"]), Likeness::Same);
    }

    #[test]
    fn answer_sets_are_the_same_by_a_rival_or_by_the_family() {
        let creep = open(&[&["leak"], &["maxwell_branch"]], Some("creep"));
        assert_likeness(
            &creep,
            &open(&[&["gravity"], &["leak"]], None),
            Likeness::Same,
        );
        assert_likeness(
            &creep,
            &open(&[&["gravity"]], Some("creep")),
            Likeness::Same,
        );
        assert_likeness(&creep, &open(&[&["gravity"]], None), Likeness::Another);
        // Without a family on either side there is none that they share.
        let (one, other) = (open(&[&["leak"]], None), open(&[&["gravity"]], None));
        assert_likeness(&one, &other, Likeness::Another);
        // The fourth rival is read by nobody: then the whole set only holds the smaller one.
        let many = open(&[&["a"], &["b"], &["c"], &["leak"]], None);
        assert_likeness(&one, &many, Likeness::Vaguer);
        assert_likeness(&many, &one, Likeness::Sharper);
    }

    #[test]
    fn quiet_answers_are_one_where_the_first_model_was_changed() {
        let (nothing, parameters) = (word("no_discrepancy"), word("parameters_only"));
        assert_eq!(Likeness::of(&nothing, &parameters, true), Likeness::Same);
        assert_likeness(&nothing, &parameters, Likeness::Another);
        assert_eq!(
            Likeness::of(&nothing, &word("unexplained"), true),
            Likeness::Another
        );
    }

    #[test]
    fn an_answer_that_holds_the_other_is_vaguer_and_back_again_sharper() {
        let gravity = found(&["gravity"]);
        let pair = found(&["gravity", "coulomb_friction"]);
        for (sharp, vague) in [
            (&gravity, open(&[&["leak"], &["gravity"]], None)),
            (&gravity, open(&[&["end_stop"]], Some("stiffness shape"))),
            (&gravity, word("unexplained")),
            (&pair, gravity.clone()),
            (&pair, open(&[&["gravity"], &["leak"]], None)),
            (&pair, open(&[], Some("dry friction + stiffness shape"))),
            (&pair, open(&[], Some("stiffness shape"))),
            (&open(&[&["leak"]], None), word("unexplained")),
            // Each rival has gravity.
            (
                &open(&[&["gravity", "leak"], &["gravity", "end_stop"]], None),
                gravity.clone(),
            ),
        ] {
            assert_likeness(sharp, &vague, Likeness::Vaguer);
            assert_likeness(&vague, sharp, Likeness::Sharper);
        }
    }

    #[test]
    fn names_contradict_where_neither_holds_the_other() {
        let pair = found(&["gravity", "coulomb_friction"]);
        assert_likeness(
            &found(&["leak"]),
            &found(&["gravity"]),
            Likeness::Contradicting,
        );
        assert_likeness(&pair, &found(&["gravity", "leak"]), Likeness::Contradicting);
        assert_likeness(&pair, &found(&["leak"]), Likeness::Contradicting);
    }

    #[test]
    fn all_else_is_another_answer() {
        let gravity = found(&["gravity"]);
        for other in [
            word("parameters_only"),
            open(&[&["leak"]], Some("creep")),
            // More than gravity, and not in every rival.
            open(&[&["gravity", "leak"], &["end_stop"]], None),
        ] {
            assert_likeness(&gravity, &other, Likeness::Another);
            assert_likeness(&other, &gravity, Likeness::Another);
        }
        assert_likeness(
            &word("parameters_only"),
            &word("unexplained"),
            Likeness::Another,
        );
    }

    #[test]
    fn refits_are_compared_by_their_ratio() {
        let of = |refit_deg| Answer {
            refit_deg,
            ..Answer::default()
        };
        let ratio = |before, after| of(after).refit_ratio(&of(before));
        assert!(!is_other_refit(ratio(2.0, 2.019)) && is_other_refit(ratio(2.0, 2.021)));
        assert!(is_other_refit(ratio(2.0, 1.97)));
        assert!(!is_other_refit(ratio(0.0, 0.0)) && is_other_refit(ratio(0.0, 1.0)));
    }
}
