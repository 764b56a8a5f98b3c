//! What a verdict said, as far as it is scored, and whether that is the truth.

use std::collections::BTreeSet;

use super::kinds::look_alike;
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
    /// Whether a formula beyond the catalogue is among what is named.
    pub is_formula: bool,
    /// RMSE (°) on the fitted recordings, of the refit and of the repaired model.
    pub fitted: Option<[f64; 2]>,
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
        let fitted = |which: &str| verdict["rmse_deg"][which].as_f64();
        let of = verdict["repair"]["of"].as_array().map(|list| {
            let words: Vec<&str> = list.iter().filter_map(|word| word.as_str()).collect();
            words.join(", ")
        });
        Self {
            is_formula: list(&verdict["effects"])
                .iter()
                .any(|it| it["formula"].is_string()),
            fitted: fitted("refit")
                .zip(fitted("repaired"))
                .map(<[f64; 2]>::from),
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

    /// Whether a name is given: the verdict is `effect_found`.
    pub fn names(&self) -> bool {
        !self.named.is_empty()
    }

    /// Named, strict: the verdict is `effect_found` and names exactly the truth.
    pub fn names_exactly(&self, truth: &[String]) -> bool {
        self.names() && self.named == truth
    }

    /// Named, lenient: strictly, or the verdict is `cannot_tell` and its answer set is the truth and
    /// at most one other single effect, which the catalogue lists as a look-alike of the truth.
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

    /// In the answer set: the truth is what is named, or one of the alternatives. Beside a name only
    /// alternatives with a probability of 5 % or more count. `unexplained` has no answer set.
    pub fn holds(&self, truth: &[String]) -> bool {
        self.answer_set.contains(truth)
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

    #[test]
    fn repairs_and_held_out_errors_are_read() {
        let said = Said::of(&Outcome {
            verdict: Some(json!({
                "verdict": "unexplained",
                "repair": { "kind": "table", "of": ["rate"], "nodes": [0.0] },
                "holdout_rmse_deg": { "nominal": 3.0, "refit": 2.0, "repaired": 0.5 },
            })),
            ..Outcome::default()
        });
        assert_eq!(said.repair.as_deref(), Some("rate"));
        assert!((said.held_out.unwrap() - 0.25).abs() < 1e-12);
    }
}
