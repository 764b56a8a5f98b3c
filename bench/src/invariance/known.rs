//! What is known about a case, and what an answer is worth beside it.
//!
//! Invariance needs no labels. Where there are some, the same answers show what asking
//! otherwise costs: how many names are still right, and how many become wrong.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::answer::Answer;
use crate::blind::hidden::{Hidden, kinds_of};
use crate::blind::law::Law;
use softrig_tests::rig_loop::added;
use softrig_tests::text_of;
use softrig_tests::verdict::Kinds;

/// Labels by the name of the case.
pub type Labels = BTreeMap<String, Known>;

/// What somebody knows about a case.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(default)]
pub struct Known {
    /// The sets of effects that are right; none if nobody knows.
    pub accept: Option<Vec<Kinds>>,
    /// What the sets are about: for people, or a family's name.
    pub family: Option<String>,
    /// How sure it is: certain, textbook, paper or plausible.
    pub certainty: Option<String>,
    /// Whether nothing is missing, so that a name is an error.
    pub control: bool,
    /// Starts of the names of the recordings to fit, where a folder does not say it.
    pub fit: Vec<String>,
    /// Starts of the names of the recordings for validation.
    pub holdout: Vec<String>,
}

impl Known {
    /// How sure a label is that was drawn.
    pub const CERTAIN: &'static str = "certain";

    /// Exactly these effects are missing; where there are none, it is a control.
    pub fn exactly(kinds: Kinds) -> Self {
        Self {
            control: kinds.is_empty(),
            accept: Some(vec![kinds]),
            certainty: Some(Self::CERTAIN.into()),
            ..Self::default()
        }
    }

    /// What an answer is worth; none without a label.
    pub fn grade(&self, answer: &Answer) -> Option<Grade> {
        let accept = self.accept.as_ref()?;
        Some(if self.control {
            if answer.names() {
                Grade::ControlNamed
            } else {
                Grade::ControlQuiet
            }
        } else if answer.names() {
            if accept.contains(&answer.named) {
                Grade::Named
            } else if answer.in_part {
                Grade::WrongForAPart
            } else {
                Grade::Wrong
            }
        } else if answer.is_open() && self.is_held_by(answer, accept) {
            Grade::Hedged
        } else {
            Grade::Silent
        })
    }

    /// Whether an answer set has an accepted set in it, by its effects or by its family.
    fn is_held_by(&self, answer: &Answer, accept: &[Kinds]) -> bool {
        answer.rivals.iter().any(|rival| accept.contains(rival))
            || (answer.family.is_some() && answer.family == self.family)
            || accept.iter().any(|kinds| answer.is_family_of(kinds))
    }
}

/// What an answer is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// An accepted set is named.
    Named,
    /// `cannot_tell`, with an accepted set among the rivals, or with its family.
    Hedged,
    /// Something else is named, and said to explain the gap.
    Wrong,
    /// Something else is named, for a part of the gap.
    WrongForAPart,
    /// No name, and no set that holds an accepted one.
    Silent,
    /// An effect is named where none is missing.
    ControlNamed,
    /// None is named where none is missing.
    ControlQuiet,
}

/// Reads a file of labels: `{"name": {"accept": [["gravity"]], "control": false}}`.
///
/// # Errors
///
/// What is wrong with the file.
pub fn read(path: &Path) -> Result<Labels, String> {
    read_json(path)
}

/// Reads a file of JSON.
///
/// # Errors
///
/// What is wrong with the file.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, String> {
    let text = text_of(path)?;
    serde_json::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))
}

/// The labels of the rigs in `data/real`, from what their authors say.
///
/// # Errors
///
/// What is wrong with the file of this repository.
pub fn real() -> Result<Labels, String> {
    read(&real_file())
}

/// Where these labels are; [`real::rigs`](crate::real::rigs) reads what else is in the file.
pub fn real_file() -> PathBuf {
    softrig_tests::process::root().join("bench/data/real_known.json")
}

/// Reads the answers of the sample cases.
///
/// # Errors
///
/// What is wrong with the file.
pub fn of_answers(path: &Path) -> Result<Labels, String> {
    #[derive(Deserialize)]
    struct Hides {
        what: String,
        effects: Kinds,
    }
    let answers: BTreeMap<String, Hides> = read_json(path)?;
    // What the catalogue does not have, it cannot name.
    let labels = answers.into_iter().filter(|(_, it)| it.what != "unknown");
    Ok(labels
        .map(|(case, hides)| (case, Known::exactly(hides.effects)))
        .collect())
}

/// What a drawn case hides; none if it is outside the catalogue.
pub fn of_drawn(hidden: Hidden, laws: &[Law]) -> Option<Known> {
    (hidden != Hidden::Outside).then(|| Known::exactly(kinds_of(laws).into_iter().collect()))
}

/// What a virtual rig hides: the effects of `truth.toml` that `model.toml` beside it lacks.
pub fn of_truth(model: &Path) -> Option<Known> {
    Some(Known::exactly(added(model)?))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use model_core::catalogue::Kind;
    use serde_json::{Value, json};

    fn known() -> Known {
        serde_json::from_value(json!({
            "accept": [["gravity"], ["coulomb_friction", "gravity"]],
            "family": "gravity and thrust", "certainty": "paper", "control": false,
        }))
        .unwrap()
    }

    fn grade(known: &Known, verdict: &Value) -> Option<Grade> {
        known.grade(&Answer::of(verdict).unwrap())
    }

    fn named(kinds: &[&str], strength: &str) -> Value {
        let effects: Vec<Value> = kinds.iter().map(|kind| json!({ "kind": kind })).collect();
        json!({ "verdict": "effect_found", "effects": effects, "strength": strength })
    }

    #[test]
    fn names_are_right_in_any_order_and_wrong_at_their_strength() {
        let pair = named(&["gravity", "coulomb_friction"], "explains");
        assert_eq!(grade(&known(), &pair), Some(Grade::Named));
        for (kinds, strength, expected) in [
            (&["leak"][..], "explains", Grade::Wrong),
            (&["leak"], "part", Grade::WrongForAPart),
            // Friction alone is not what is known.
            (&["coulomb_friction"], "explains", Grade::Wrong),
            (&["gravity", "leak"], "part", Grade::WrongForAPart),
        ] {
            assert_eq!(grade(&known(), &named(kinds, strength)), Some(expected));
        }
    }

    #[test]
    fn answer_sets_hold_what_is_known_by_effects_or_by_family() {
        let open = |kinds: &[&str], family: &str| {
            json!({ "verdict": "cannot_tell", "family": family,
                    "alternatives": [{ "kinds": ["leak"] }, { "kinds": kinds }] })
        };
        for (kinds, family, expected) in [
            (&["gravity"][..], "", Grade::Hedged),
            (&["end_stop"], "stiffness shape", Grade::Hedged),
            (
                &["end_stop"],
                "dry friction + stiffness shape",
                Grade::Hedged,
            ),
            (&["end_stop"], "gravity and thrust", Grade::Hedged),
            (&["end_stop"], "dry friction", Grade::Silent),
            (&["end_stop"], "", Grade::Silent),
        ] {
            assert_eq!(
                grade(&known(), &open(kinds, family)),
                Some(expected),
                "{kinds:?} {family}"
            );
        }
        let silent = json!({ "verdict": "unexplained" });
        assert_eq!(grade(&known(), &silent), Some(Grade::Silent));
    }

    #[test]
    fn in_a_control_every_name_is_an_error() {
        let control = Known::exactly(Kinds::new());
        let name = named(&["gravity"], "part");
        assert_eq!(grade(&control, &name), Some(Grade::ControlNamed));
        let quiet = json!({ "verdict": "unexplained" });
        assert_eq!(grade(&control, &quiet), Some(Grade::ControlQuiet));
        assert_eq!(grade(&Known::default(), &name), None);
    }

    #[test]
    fn what_is_known_of_real_rigs_can_be_named() {
        let labels = real().unwrap();
        assert_eq!(labels.len(), 13);
        for (rig, known) in &labels {
            let accept = known.accept.iter().flatten();
            for kind in accept.flatten() {
                assert!(Kind::from_name(kind).is_some(), "{rig}: {kind}");
            }
            assert_eq!(known.fit.is_empty(), known.holdout.is_empty(), "{rig}");
            assert!(known.certainty.is_some(), "{rig}");
        }
    }

    #[test]
    fn other_forms_of_labels_are_read() {
        let folder = std::env::temp_dir().join(format!("softrig-known-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let write = |name: &str, text: &str| {
            fs::write(folder.join(name), text).unwrap();
            folder.join(name)
        };
        let answers = write(
            "answers.json",
            r#"{"a": {"what": "one", "effects": ["leak"], "form": "T1"},
                "b": {"what": "params", "effects": []},
                "c": {"what": "unknown", "effects": ["unknown_random_force"]}}"#,
        );
        let labels = of_answers(&answers).unwrap();
        write(
            "truth.toml",
            "[[effect]]\nkind = \"leak\"\n[[effect]]\nkind = \"gravity\"\n",
        );
        let model = write("model.toml", "[[effect]]\nkind = \"leak\"\n");
        let truth = of_truth(&model).unwrap();
        let damaged = read(&model).unwrap_err();
        fs::remove_dir_all(&folder).unwrap();
        assert_eq!(labels.keys().collect::<Vec<_>>(), ["a", "b"]);
        assert!(!labels["a"].control && labels["b"].control);
        assert_eq!(
            truth.accept,
            Some(vec![Kinds::from(["gravity".to_owned()])])
        );
        assert!(damaged.contains("model.toml"), "{damaged}");
    }
}
