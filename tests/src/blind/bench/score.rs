//! Counting by name, family and strength.
//!
//! What the rates count, of cases that hide one effect:
//!
//! - **exact**: the verdict is `effect_found` and names exactly the truth.
//! - **family**: it names another member of the truth's family and nothing
//!   else, or it is `cannot_tell` with that family.
//! - **set**: it is `cannot_tell`, and its answer set has three explanations or
//!   fewer, one of which is the truth.
//! - **right**: one of these three.
//! - **wrong**: `effect_found` with anything of another family, at full strength
//!   (`"strength": "explains"`, or none) or for a part of the gap (`"part"`).
//! - **silent**: `unexplained`.
//!
//! Two effects are right by the same words, with the families of both; and
//! **one of two** if what is said is right for one of them and wrong for none.
//! On data that hide nothing, or only parameters, every name is false; what is
//! outside the catalogue has no name either.

use std::collections::BTreeSet;
use std::path::Path;

use super::super::cases::Hidden;
use super::super::kinds::family;
use super::super::score::{Kinds, Rate, Said, median, of_verdicts};
use super::super::verdicts::Outcome;
use super::cases::Answer;
use super::session::Rig;

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

/// What a verdict is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Grade {
    /// Exactly the truth.
    Exact,
    /// Its family.
    Family,
    /// In a set of three or fewer.
    Set,
    /// Right for one of two.
    OneOfTwo,
    /// Something of another family.
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

    fn is_name_at(self, strength: Strength) -> bool {
        self == Self::Wrong(strength)
    }
}

/// A case with its score.
#[derive(Clone, Debug)]
pub struct Scored {
    /// The answer.
    pub answer: Answer,
    /// What was said.
    pub said: Said,
    /// What it is worth.
    pub grade: Grade,
    /// Why there is no verdict.
    pub refused: Option<String>,
    /// Wall time (s).
    pub seconds: f64,
    /// Processor time (s), where it is known.
    pub cpu_seconds: Option<f64>,
}

impl Scored {
    /// Scores a case.
    pub fn of(answer: &Answer, outcome: &Outcome) -> Self {
        let said = Said::of(outcome);
        Self {
            grade: Grade::of(&answer.kinds, &said),
            answer: answer.clone(),
            said,
            refused: outcome.refused.clone(),
            seconds: outcome.seconds,
            cpu_seconds: outcome.cpu_seconds,
        }
    }

    fn is_quiet(&self) -> bool {
        matches!(self.answer.hidden, Hidden::Nothing | Hidden::Parameters)
    }
}

/// Scores every case that has a verdict.
pub fn score(answers: &[Answer], verdicts: &Path) -> Vec<Scored> {
    of_verdicts(answers, verdicts, |answer| answer.case.clone(), Scored::of)
}

/// Counts of grades, of single effects or of pairs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Grades {
    /// Exact, family or set.
    pub right: Rate,
    /// The exact name.
    pub exact: Rate,
    /// … of which as a part of the gap.
    pub exact_as_part: u32,
    /// In the family.
    pub family: Rate,
    /// In a set of three or fewer.
    pub set: Rate,
    /// Right for one of two.
    pub one_of_two: Rate,
    /// Another family at full strength.
    pub wrong_full: Rate,
    /// Another family for a part.
    pub wrong_part: Rate,
    /// `cannot_tell` without the truth.
    pub open: Rate,
    /// `unexplained`.
    pub silent: Rate,
    /// Nothing is said to be missing, or no verdict.
    pub denied: Rate,
}

impl Grades {
    /// Counts cases.
    pub fn of(cases: &[&Scored]) -> Self {
        let rate =
            |is: &dyn Fn(Grade) -> bool| Rate::count(cases.iter().map(|case| is(case.grade)));
        let as_part = |case: &&&Scored| case.grade == Grade::Exact && case.said.in_part;
        Self {
            right: rate(&Grade::is_right),
            exact: rate(&|grade| grade == Grade::Exact),
            exact_as_part: u32::try_from(cases.iter().filter(as_part).count()).unwrap_or(u32::MAX),
            family: rate(&|grade| grade == Grade::Family),
            set: rate(&|grade| grade == Grade::Set),
            one_of_two: rate(&|grade| grade == Grade::OneOfTwo),
            wrong_full: rate(&|grade| grade.is_name_at(Strength::Full)),
            wrong_part: rate(&|grade| grade.is_name_at(Strength::Part)),
            open: rate(&|grade| grade == Grade::Open),
            silent: rate(&|grade| grade == Grade::Silent),
            denied: rate(&|grade| matches!(grade, Grade::Denied | Grade::Refused)),
        }
    }
}

/// The figures of the set.
#[derive(Clone, Debug, PartialEq)]
pub struct Figures {
    /// Cases that hide one effect.
    pub one: Grades,
    /// Cases that hide two.
    pub two: Grades,
    /// Single effects by rig: right.
    pub by_rig: Vec<(&'static str, Rate)>,
    /// Single effects in a whole session: right.
    pub whole: Rate,
    /// Single effects in a session that was cut into files: right.
    pub cut: Rate,
    /// Quiet cases: a name at full strength.
    pub quiet_full: Rate,
    /// Quiet cases: a name for a part.
    pub quiet_part: Rate,
    /// Quiet cases: that nothing is missing.
    pub quiet_right: Rate,
    /// Outside the catalogue: a name at full strength.
    pub outside_full: Rate,
    /// Outside the catalogue: a name for a part.
    pub outside_part: Rate,
    /// Outside the catalogue: `unexplained`.
    pub outside_silent: Rate,
    /// Any case: no verdict.
    pub refused: Rate,
    /// Median held-out RMSE of the repaired model over the refit's, where one or
    /// two effects are hidden.
    pub held_out: Option<f64>,
    /// The same where what is hidden is outside the catalogue.
    pub held_out_outside: Option<f64>,
    /// Median wall time (s).
    pub seconds_median: Option<f64>,
    /// Longest wall time (s).
    pub seconds_worst: Option<f64>,
    /// Median processor time (s).
    pub cpu_median: Option<f64>,
    /// Longest processor time (s).
    pub cpu_worst: Option<f64>,
}

impl Figures {
    /// Counts the cases.
    pub fn of(scored: &[Scored]) -> Self {
        let that = |is: &dyn Fn(&Scored) -> bool| -> Vec<&Scored> {
            scored.iter().filter(|case| is(case)).collect()
        };
        let rate = |cases: &[&Scored], is: &dyn Fn(Grade) -> bool| {
            Rate::count(cases.iter().map(|case| is(case.grade)))
        };
        let held_out =
            |cases: &[&Scored]| median(cases.iter().filter_map(|case| case.said.held_out));
        let one = that(&|case| case.answer.hidden == Hidden::One);
        let hides = that(&|case| matches!(case.answer.hidden, Hidden::One | Hidden::Two));
        let quiet = that(&Scored::is_quiet);
        let outside = that(&|case| case.answer.hidden == Hidden::Outside);
        let single = |is: &dyn Fn(&Answer) -> bool| {
            let cases: Vec<&Scored> = one
                .iter()
                .copied()
                .filter(|case| is(&case.answer))
                .collect();
            rate(&cases, &Grade::is_right)
        };
        let cpu = || scored.iter().filter_map(|case| case.cpu_seconds);
        Self {
            one: Grades::of(&one),
            two: Grades::of(&that(&|case| case.answer.hidden == Hidden::Two)),
            by_rig: Rig::ALL
                .into_iter()
                .map(|rig| (rig.name(), single(&|answer| answer.rig == rig)))
                .collect(),
            whole: single(&|answer| answer.rig != Rig::Swing && !answer.cut),
            cut: single(&|answer| answer.rig != Rig::Swing && answer.cut),
            quiet_full: rate(&quiet, &|grade| grade.is_name_at(Strength::Full)),
            quiet_part: rate(&quiet, &|grade| grade.is_name_at(Strength::Part)),
            quiet_right: rate(&quiet, &|grade| grade == Grade::Denied),
            outside_full: rate(&outside, &|grade| grade.is_name_at(Strength::Full)),
            outside_part: rate(&outside, &|grade| grade.is_name_at(Strength::Part)),
            outside_silent: rate(&outside, &|grade| grade == Grade::Silent),
            refused: rate(&that(&|_| true), &|grade| grade == Grade::Refused),
            held_out: held_out(&hides),
            held_out_outside: held_out(&outside),
            seconds_median: median(scored.iter().map(|case| case.seconds)),
            seconds_worst: scored.iter().map(|case| case.seconds).reduce(f64::max),
            cpu_median: median(cpu()),
            cpu_worst: cpu().reduce(f64::max),
        }
    }
}

#[cfg(test)]
mod tests {
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
