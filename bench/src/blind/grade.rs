//! What a verdict is worth, by name, family and strength.
//!
//! A diagnosis that cannot tell two members of a family apart is still right; one that names another
//! family is wrong, of all of the gap or of a part ([`Grade`]).

use std::collections::BTreeSet;

use super::kinds::family;
use super::said::{Kinds, Said};

/// The most explanations in an answer set that counts.
const LARGEST_SET: usize = 3;

/// How much of the gap a name is said to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Strength {
    /// All of it, or nothing is said.
    Full,
    /// A part.
    Part,
}

impl Strength {
    /// How strong what is said is; full without a name.
    pub fn of(said: &Said) -> Self {
        if said.in_part { Self::Part } else { Self::Full }
    }
}

/// What a verdict is worth, on a case that hides an effect.
///
/// Two effects are right by the same words, with the families of both. On data that hide nothing,
/// or only parameters, every name is false; what is outside the catalogue has no name either.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Grade {
    /// The verdict is `effect_found` and names exactly the truth.
    Exact,
    /// It names another member of the truth's family and nothing else, or it is `cannot_tell` with
    /// that family.
    Family,
    /// It is `cannot_tell`, and its answer set has three explanations or fewer, one of which is the
    /// truth.
    Set,
    /// What is said is right for one of two effects and wrong for none.
    OneOfTwo,
    /// `effect_found` with anything of another family, at full strength (`"strength": "explains"`,
    /// or none) or for a part of the gap (`"part"`).
    Wrong(Strength),
    /// `cannot_tell` without any of these.
    Open,
    /// `unexplained`.
    Silent,
    /// Nothing is said to be missing.
    Denied,
    /// No verdict.
    Refused,
}

impl Grade {
    /// Grades what was said by what is hidden. Where nothing of the catalogue is
    /// hidden, every name is wrong.
    pub fn of(truth: &[String], said: &Said) -> Self {
        match said.verdict.as_str() {
            "effect_found" => Self::of_name(truth, said),
            "cannot_tell" => Self::of_open(truth, said),
            "unexplained" => Self::Silent,
            "parameters_only" | "no_discrepancy" => Self::Denied,
            _ => Self::Refused,
        }
    }

    fn of_name(truth: &[String], said: &Said) -> Self {
        let families = |kinds: &[String]| -> BTreeSet<String> {
            kinds.iter().map(|kind| family(kind).to_owned()).collect()
        };
        let (families, named) = (families(truth), families(&said.named));
        if truth.is_empty() || named.is_empty() {
            Self::Wrong(Strength::of(said))
        } else if said.names_exactly(truth) {
            Self::Exact
        } else if named == families && said.named.len() <= truth.len() {
            Self::Family
        } else if named.is_subset(&families) && said.named.len() < truth.len() {
            Self::OneOfTwo
        } else {
            Self::Wrong(Strength::of(said))
        }
    }

    fn of_open(truth: &[String], said: &Said) -> Self {
        let in_family = |kind: &String| said.family.as_deref().is_some_and(|it| it == family(kind));
        let holds = |kinds: Kinds| {
            (1..=LARGEST_SET).contains(&said.answer_set.len()) && said.answer_set.contains(&kinds)
        };
        match truth {
            [] => Self::Open,
            [kind] if in_family(kind) => Self::Family,
            _ if holds(truth.to_vec()) => Self::Set,
            [_] => Self::Open,
            several => {
                let half = |kind: &String| in_family(kind) || holds(vec![kind.clone()]);
                if several.iter().any(half) {
                    Self::OneOfTwo
                } else {
                    Self::Open
                }
            }
        }
    }

    /// Exact, family or set.
    pub fn is_right(self) -> bool {
        matches!(self, Self::Exact | Self::Family | Self::Set)
    }
}

#[cfg(test)]
mod tests {
    use super::super::verdicts::Outcome;
    use super::*;
    use serde_json::json;

    fn grade(truth: &[&str], verdict: serde_json::Value) -> Grade {
        let truth: Vec<String> = truth.iter().map(|kind| (*kind).to_owned()).collect();
        let outcome = Outcome {
            verdict: Some(verdict),
            ..Outcome::default()
        };
        Grade::of(&truth, &Said::of(&outcome))
    }

    fn named(kinds: &[&str], strength: Option<&str>) -> serde_json::Value {
        let effects: Vec<_> = kinds.iter().map(|kind| json!({ "kind": kind })).collect();
        let mut verdict =
            json!({ "verdict": "effect_found", "effects": effects, "alternatives": [] });
        if let Some(strength) = strength {
            verdict["strength"] = json!(strength);
        }
        verdict
    }

    fn open(sets: &[&[&str]], family: Option<&str>) -> serde_json::Value {
        let list: Vec<_> = sets
            .iter()
            .map(|kinds| json!({ "kinds": kinds, "probability": 0.2 }))
            .collect();
        let mut verdict = json!({ "verdict": "cannot_tell", "effects": [], "alternatives": list });
        if let Some(family) = family {
            verdict["family"] = json!(family);
        }
        verdict
    }

    #[test]
    fn names_count_by_family_and_strength() {
        let truth = &["coulomb_friction"];
        assert_eq!(
            grade(truth, named(&["coulomb_friction"], None)),
            Grade::Exact
        );
        assert_eq!(
            grade(truth, named(&["coulomb_friction"], Some("part"))),
            Grade::Exact
        );
        assert_eq!(
            grade(truth, named(&["bouc_wen_hysteresis"], None)),
            Grade::Family
        );
        // A second name is one too many, even of the same family.
        for kinds in [
            &["coulomb_friction", "gravity"][..],
            &["coulomb_friction", "stribeck_friction"],
            &["gravity"],
        ] {
            assert_eq!(
                grade(truth, named(kinds, None)),
                Grade::Wrong(Strength::Full)
            );
        }
        assert_eq!(
            grade(truth, named(&["gravity"], Some("explains"))),
            Grade::Wrong(Strength::Full)
        );
        assert_eq!(
            grade(truth, named(&["gravity"], Some("part"))),
            Grade::Wrong(Strength::Part)
        );
        assert_eq!(
            grade(&[], named(&["gravity"], Some("part"))),
            Grade::Wrong(Strength::Part)
        );
    }

    #[test]
    fn open_answers_count_by_family_or_in_a_small_set() {
        let truth = &["gravity"];
        let three: &[&[&str]] = &[&["leak"], &["gravity"], &["dead_time"]];
        assert_eq!(grade(truth, open(three, None)), Grade::Set);
        let four: &[&[&str]] = &[&["leak"], &["gravity"], &["dead_time"], &["sensor_lag"]];
        assert_eq!(grade(truth, open(four, None)), Grade::Open);
        assert_eq!(
            grade(truth, open(four, Some("stiffness shape"))),
            Grade::Family
        );
        assert_eq!(grade(truth, open(&[&["leak"]], Some("creep"))), Grade::Open);
        assert_eq!(grade(&[], open(three, None)), Grade::Open);
    }

    #[test]
    fn pairs_can_be_half_right() {
        let truth = &["coulomb_friction", "gravity"];
        assert_eq!(
            grade(truth, named(&["gravity", "coulomb_friction"], None)),
            Grade::Exact
        );
        assert_eq!(
            grade(truth, named(&["gravity", "stribeck_friction"], None)),
            Grade::Family
        );
        assert_eq!(
            grade(truth, named(&["cubic_stiffness"], Some("part"))),
            Grade::OneOfTwo
        );
        assert_eq!(
            grade(truth, named(&["gravity", "leak"], None)),
            Grade::Wrong(Strength::Full)
        );
        assert_eq!(grade(truth, open(&[&["gravity"]], None)), Grade::OneOfTwo);
        let pair: &[&[&str]] = &[&["leak"], &["gravity", "coulomb_friction"]];
        assert_eq!(grade(truth, open(pair, None)), Grade::Set);
        assert_eq!(
            grade(truth, open(&[&["leak"]], Some("dry friction"))),
            Grade::OneOfTwo
        );
    }

    #[test]
    fn silence_and_refusals_are_told_apart() {
        let word = |word: &str| grade(&["gravity"], json!({ "verdict": word }));
        assert_eq!(word("unexplained"), Grade::Silent);
        assert_eq!(word("parameters_only"), Grade::Denied);
        let outcome = Outcome {
            refused: Some("too short".to_owned()),
            ..Outcome::default()
        };
        assert_eq!(Grade::of(&[], &Said::of(&outcome)), Grade::Refused);
    }
}
