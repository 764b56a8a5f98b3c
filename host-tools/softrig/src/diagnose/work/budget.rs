//! A budget for the search.
//!
//! Once the budget is spent no further fit starts, and running fits finish: the answer follows
//! from complete fits. Parts of the search that were not done are noted, and the answer claims
//! no more than the others allow. An effect is named only if every other one was tried as
//! well, and the answer is `unexplained` only if nothing is left to try.

use std::collections::BTreeSet;
use std::time::Duration;

use model_core::catalogue::Kind;

use softrig_formats::numbers::spelled;

/// The budget of a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Budget {
    /// A time. What is finished by then depends on the computer.
    Time(Duration),
    /// A number of fits.
    Fits(usize),
}

/// A part of a diagnosis that a budget can leave out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SearchPart {
    /// An effect alone: its fits, or its validation on held-out segments.
    Alone(Kind),
    /// Effects at several horizons.
    Horizons,
    /// Combinations of effects, some or all.
    Combinations,
    /// Terms of the grammar, some or all.
    Terms,
    /// A table of the remaining force.
    Table,
    /// Effects with zeros as they were calibrated.
    Calibrated,
    /// Everything again without the outlying recording.
    WithoutOutlier,
    /// The setups that sessions contradict.
    Setups,
    /// The next experiment.
    Experiment,
}

impl SearchPart {
    /// The part to which a structure with these effects added belongs.
    pub fn of(added: &[Kind]) -> Self {
        match added {
            [] => Self::Horizons,
            [only] => Self::Alone(*only),
            _ => Self::Combinations,
        }
    }

    /// The name in the verdict.
    const fn name(self) -> &'static str {
        match self {
            Self::Alone(kind) => kind.name(),
            Self::Horizons => "several horizons",
            Self::Combinations => "combinations",
            Self::Terms => "formulas beyond the catalogue",
            Self::Table => "table of what is left",
            Self::Calibrated => "zeros as calibrated",
            Self::WithoutOutlier => "without the odd recording",
            Self::Setups => "contradicted setups",
            Self::Experiment => "next experiment",
        }
    }

    /// The clause of a sentence.
    const fn clause(self) -> &'static str {
        match self {
            Self::Alone(_) => "not every effect was tried",
            Self::Horizons => "effects were not tried at several horizons",
            Self::Combinations => "not every combination of effects was tried",
            Self::Terms => "not every formula beyond the catalogue was tried",
            Self::Table => "no table of what is left was tried",
            Self::Calibrated => "effects were not tried with zeros as calibrated",
            Self::WithoutOutlier => "the search was not repeated without the outlying recording",
            Self::Setups => "the stated rig setups were not checked",
            Self::Experiment => "no run to separate the rivals was planned",
        }
    }
}

/// The end of a search by its budget.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BudgetEnd {
    /// The budget.
    pub budget: Budget,
    /// The parts that were not done; never empty.
    pub undone: BTreeSet<SearchPart>,
}

impl BudgetEnd {
    /// The effects that were not fully tried alone.
    pub fn kinds(&self) -> Vec<Kind> {
        let alone = |part: &SearchPart| match part {
            SearchPart::Alone(kind) => Some(*kind),
            _ => None,
        };
        self.undone.iter().filter_map(alone).collect()
    }

    /// Whether something that was not tried could be the answer.
    pub fn is_open(&self) -> bool {
        is_open(&self.undone)
    }

    /// Whether a part was left undone.
    pub fn lacks(&self, part: SearchPart) -> bool {
        self.undone.contains(&part)
    }

    /// The parts that were not done, as named in the verdict.
    pub fn not_tried(&self) -> Vec<String> {
        self.undone
            .iter()
            .map(|part| part.name().to_owned())
            .collect()
    }

    /// Two sentences: the budget and what was not tried.
    pub fn sentence(&self) -> String {
        let budget = match self.budget {
            Budget::Time(time) => format!("time of {}", spelled(time)),
            Budget::Fits(fits) => format!("budget of {fits} fits"),
        };
        let kinds = self.kinds().len();
        let mut clauses: Vec<String> = match kinds {
            0 => Vec::new(),
            1 => vec!["one effect was not fully tried".into()],
            _ => vec![format!("{kinds} effects were not fully tried")],
        };
        let others = self.undone.iter();
        let others = others.filter(|part| !matches!(part, SearchPart::Alone(_)));
        clauses.extend(others.map(|part| part.clause().to_owned()));
        let advice = if self.is_open() {
            "With more time the answer may change."
        } else {
            "With more time the answer is the same."
        };
        let undone = match clauses.as_slice() {
            [head @ .., last] if !head.is_empty() => format!("{}, and {last}", head.join(", ")),
            _ => clauses.concat(),
        };
        format!("The {budget} ran out before the search ended: {undone}. {advice}")
    }
}

/// How far a search got.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Coverage {
    /// Not every effect alone.
    Some,
    /// Every effect alone.
    Singles,
    /// Every effect alone, and every combination that is looked at.
    Everything,
}

fn leaves(undone: &BTreeSet<SearchPart>) -> Coverage {
    let is_single = |part: &SearchPart| matches!(part, SearchPart::Alone(_));
    if undone.iter().any(is_single) {
        Coverage::Some
    } else if [
        SearchPart::Horizons,
        SearchPart::Combinations,
        SearchPart::Terms,
        SearchPart::Calibrated,
    ]
    .iter()
    .any(|part| undone.contains(part))
    {
        Coverage::Singles
    } else {
        Coverage::Everything
    }
}

/// The largest size whose structures were all tried.
pub fn tried_sizes(undone: &BTreeSet<SearchPart>) -> usize {
    match leaves(undone) {
        Coverage::Some => 0,
        Coverage::Singles => 1,
        Coverage::Everything => usize::MAX,
    }
}

/// Whether something that was not tried could be the answer.
pub fn is_open(undone: &BTreeSet<SearchPart>) -> bool {
    leaves(undone) != Coverage::Everything
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ended(budget: Budget, undone: &[SearchPart]) -> BudgetEnd {
        BudgetEnd {
            budget,
            undone: undone.iter().copied().collect(),
        }
    }

    #[test]
    fn what_was_not_tried_is_said() {
        let parts = [
            SearchPart::Alone(Kind::Gravity),
            SearchPart::Alone(Kind::Leak),
            SearchPart::Combinations,
        ];
        let ended_by = ended(Budget::Time(Duration::from_secs(90)), &parts);
        assert_eq!(
            ended_by.sentence(),
            "The time of 1 min 30 s ran out before the search ended: 2 effects were not fully \
             tried, and not every combination of effects was tried. With more time the answer may \
             change."
        );
        let mut names = ended_by.not_tried();
        names.sort_unstable();
        assert_eq!(names, ["combinations", "gravity", "leak"]);
        let ended_by = ended(Budget::Fits(12), &[SearchPart::Table]);
        assert!(ended_by.sentence().contains("The budget of 12 fits"));
        assert!(ended_by.sentence().ends_with("the same."));
    }
}
