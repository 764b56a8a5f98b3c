//! The sets of the benchmark as one: their plans, and the answers to their cases.

use serde::{Deserialize, Serialize};

use super::bench::cases as sessions;
use super::cases;
use super::experiments::Set;
use super::hidden::{Hidden, Secret};
use super::law::Law;

/// A set of cases.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Collection {
    /// Runs from rest.
    Runs(Set),
    /// Whole sessions, as on a bench.
    Bench,
}

impl Collection {
    /// Every set, in the order of the pages.
    pub const ALL: [Self; 3] = [Self::Runs(Set::Rich), Self::Runs(Set::Paper), Self::Bench];

    /// Name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Runs(set) => set.name(),
            Self::Bench => "bench",
        }
    }
}

/// What the cases of a set hide, before anything is drawn.
#[derive(Clone, Debug)]
pub enum Plans {
    /// Of runs: they depend on how many cases there are.
    Runs(Set, Vec<cases::Plan>),
    /// Of sessions: each depends on its number alone.
    Bench(Vec<sessions::Plan>),
}

impl Plans {
    /// What `count` cases hide. With `only`, each hides one of these kinds.
    pub fn of(collection: Collection, count: u32, only: &[String], seed: u64) -> Self {
        match collection {
            Collection::Runs(set) => Self::Runs(set, cases::plan(set, count, only, seed)),
            Collection::Bench => Self::Bench(sessions::plan(count, only, seed)),
        }
    }

    /// Which set.
    pub const fn collection(&self) -> Collection {
        match self {
            Self::Runs(set, _) => Collection::Runs(*set),
            Self::Bench(_) => Collection::Bench,
        }
    }

    /// The names of the cases' folders.
    pub fn names(&self) -> Vec<String> {
        let count = match self {
            Self::Runs(_, plans) => plans.len(),
            Self::Bench(plans) => plans.len(),
        };
        let set = self.collection().name();
        (0..count)
            .map(|number| format!("{set}_{number:03}"))
            .collect()
    }

    /// What each case hides, and by which laws.
    pub fn hidden(&self) -> Vec<(Hidden, &[Law])> {
        match self {
            Self::Runs(_, plans) => plans
                .iter()
                .map(|plan| (plan.hidden, plan.laws.as_slice()))
                .collect(),
            Self::Bench(plans) => plans
                .iter()
                .map(|plan| (plan.hidden, plan.laws.as_slice()))
                .collect(),
        }
    }
}

/// The answer to a case of any set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// To runs from rest.
    Runs(cases::Answer),
    /// To a session.
    Session(sessions::Answer),
}

impl Answer {
    /// What is hidden.
    pub const fn secret(&self) -> &Secret {
        match self {
            Self::Runs(answer) => &answer.secret,
            Self::Session(answer) => &answer.secret,
        }
    }

    /// Which set the case is of.
    pub const fn collection(&self) -> Collection {
        match self {
            Self::Runs(answer) => Collection::Runs(answer.set),
            Self::Session(_) => Collection::Bench,
        }
    }

    /// The answer of a session.
    pub const fn session(&self) -> Option<&sessions::Answer> {
        match self {
            Self::Runs(_) => None,
            Self::Session(answer) => Some(answer),
        }
    }
}
