//! A search that may not take as long as it needs.
//!
//! Once the time is up no further fit is begun, and those under way are finished: the answer
//! follows from whole fits. What was left undone is noted part by part, and the answer claims
//! no more than the other parts allow: an effect is named only where every other one was tried
//! as well, and `unexplained` is said only where nothing is left to try.

use std::collections::BTreeSet;
use std::time::Duration;

use model_core::catalogue::Kind;

use super::progress::spelled;
use super::verdict::Answer;

/// How much a search may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Budget {
    /// So much time. What is finished by then depends on the computer.
    Time(Duration),
    /// So many fits.
    Fits(usize),
}

/// A part of a diagnosis that can be left undone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// An effect alone: its fits, or its measurement on segments that were not fitted.
    Alone(Kind),
    /// Effects at several horizons, any of them.
    Horizons,
    /// Combinations of effects, some or all.
    Combinations,
    /// A table of what the effects leave.
    Table,
    /// Effects with zeros as they were calibrated.
    Calibrated,
    /// All of it without a recording that does not belong.
    WithoutOdd,
    /// A run that would separate what remains.
    Experiment,
}

impl Part {
    /// The part to which a structure with these effects added belongs.
    pub fn of(added: &[Kind]) -> Self {
        match added {
            [] => Self::Horizons,
            [only] => Self::Alone(*only),
            _ => Self::Combinations,
        }
    }

    /// As in the verdict.
    const fn name(self) -> &'static str {
        match self {
            Self::Alone(kind) => kind.name(),
            Self::Horizons => "several horizons",
            Self::Combinations => "combinations",
            Self::Table => "table of what is left",
            Self::Calibrated => "zeros as calibrated",
            Self::WithoutOdd => "without the odd recording",
            Self::Experiment => "next experiment",
        }
    }

    /// In a sentence.
    const fn clause(self) -> &'static str {
        match self {
            Self::Alone(_) => "not every effect was tried",
            Self::Horizons => "effects were not tried at several horizons",
            Self::Combinations => "not every combination of effects was tried",
            Self::Table => "no table of what is left was tried",
            Self::Calibrated => "effects were not tried with zeros as calibrated",
            Self::WithoutOdd => {
                "nothing was tried again without the recording that behaves like another actuator"
            }
            Self::Experiment => "no run that would separate what remains was looked for",
        }
    }
}

/// A search that its budget has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ended {
    /// The budget.
    pub budget: Budget,
    /// What was left undone; never empty.
    pub undone: BTreeSet<Part>,
}

impl Ended {
    /// The effects that were not tried alone, or not to the end.
    pub fn kinds(&self) -> Vec<Kind> {
        let alone = |part: &Part| match part {
            Part::Alone(kind) => Some(*kind),
            _ => None,
        };
        self.undone.iter().filter_map(alone).collect()
    }

    /// Whether something that was not tried could be the answer.
    pub fn is_open(&self) -> bool {
        leaves(&self.undone) != Tried::Everything
    }

    /// Whether a part was left undone.
    pub fn lacks(&self, part: Part) -> bool {
        self.undone.contains(&part)
    }

    /// What was left undone, as in the verdict.
    pub fn not_tried(&self) -> Vec<String> {
        self.undone
            .iter()
            .map(|part| part.name().to_owned())
            .collect()
    }

    /// What ended and what was not tried, in two sentences.
    pub fn sentence(&self) -> String {
        let budget = match self.budget {
            Budget::Time(time) => format!("time of {}", spelled(time)),
            Budget::Fits(fits) => format!("budget of {fits} fits"),
        };
        let kinds = self.kinds().len();
        let mut clauses: Vec<String> = match kinds {
            0 => Vec::new(),
            1 => vec!["one effect was not tried to the end".into()],
            _ => vec![format!("{kinds} effects were not tried to the end")],
        };
        let others = self.undone.iter();
        let others = others.filter(|part| !matches!(part, Part::Alone(_)));
        clauses.extend(others.map(|part| part.clause().to_owned()));
        let advice = if self.is_open() {
            "With more time the answer may be another."
        } else {
            "With more time the answer is the same."
        };
        let undone = match clauses.as_slice() {
            [head @ .., last] if !head.is_empty() => format!("{}, and {last}", head.join(", ")),
            _ => clauses.concat(),
        };
        format!("The {budget} was up before the search was done: {undone}. {advice}")
    }
}

/// What a search has tried for certain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Tried {
    /// Not every effect alone.
    Some,
    /// Every effect alone.
    Singles,
    /// Every effect alone, and every combination that is looked at.
    Everything,
}

fn leaves(undone: &BTreeSet<Part>) -> Tried {
    let is_single = |part: &Part| matches!(part, Part::Alone(_));
    if undone.iter().any(is_single) {
        Tried::Some
    } else if [Part::Horizons, Part::Combinations, Part::Calibrated]
        .iter()
        .any(|part| undone.contains(part))
    {
        Tried::Singles
    } else {
        Tried::Everything
    }
}

/// The largest structures of which every one was tried.
pub fn tried_sizes(undone: &BTreeSet<Part>) -> usize {
    match leaves(undone) {
        Tried::Some => 0,
        Tried::Singles => 1,
        Tried::Everything => usize::MAX,
    }
}

/// As much of an answer that names so many effects as what was tried allows.
pub fn as_far_as_tried(answer: Answer, named: usize, undone: &BTreeSet<Part>) -> Answer {
    let stands = match answer {
        Answer::EffectFound => named <= tried_sizes(undone),
        Answer::ParametersOnly | Answer::Unexplained => leaves(undone) == Tried::Everything,
        Answer::NoDiscrepancy | Answer::CannotTell => true,
    };
    if stands { answer } else { Answer::CannotTell }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ended(budget: Budget, undone: &[Part]) -> Ended {
        Ended {
            budget,
            undone: undone.iter().copied().collect(),
        }
    }

    #[test]
    fn an_answer_claims_no_more_than_was_tried() {
        use Answer::{CannotTell, EffectFound, NoDiscrepancy, Unexplained};
        let after = |answer, named, undone: &[Part]| {
            as_far_as_tried(answer, named, &undone.iter().copied().collect())
        };
        let single = Part::Alone(Kind::Gravity);
        assert_eq!(after(EffectFound, 1, &[]), EffectFound);
        assert_eq!(after(EffectFound, 1, &[single]), CannotTell);
        assert_eq!(after(EffectFound, 1, &[Part::Combinations]), EffectFound);
        assert_eq!(after(EffectFound, 2, &[Part::Combinations]), CannotTell);
        assert_eq!(after(EffectFound, 2, &[Part::Table]), EffectFound);
        assert_eq!(after(Unexplained, 0, &[Part::Horizons]), CannotTell);
        assert_eq!(after(Unexplained, 0, &[Part::Experiment]), Unexplained);
        // What agrees within its noise does so whatever else was not tried.
        assert_eq!(after(NoDiscrepancy, 0, &[Part::Calibrated]), NoDiscrepancy);
    }

    #[test]
    fn what_was_not_tried_is_said() {
        let parts = [
            Part::Alone(Kind::Gravity),
            Part::Alone(Kind::Leak),
            Part::Combinations,
        ];
        let ended_by = ended(Budget::Time(Duration::from_secs(90)), &parts);
        assert_eq!(
            ended_by.sentence(),
            "The time of 1 min 30 s was up before the search was done: 2 effects were not tried \
             to the end, and not every combination of effects was tried. With more time the \
             answer may be another."
        );
        let mut names = ended_by.not_tried();
        names.sort_unstable();
        assert_eq!(names, ["combinations", "gravity", "leak"]);
        let ended_by = ended(Budget::Fits(12), &[Part::Table]);
        assert!(ended_by.sentence().contains("The budget of 12 fits"));
        assert!(ended_by.sentence().ends_with("the same."));
    }
}
