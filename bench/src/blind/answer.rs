//! The sets of the benchmark as one: their plans, and the answers to their cases.

use serde::{Deserialize, Serialize};

use super::GENERATOR;
use super::bench::cases as sessions;
use super::cases::{self, stable_hash};
use super::experiments::Set;
use super::hidden::{Hidden, Secret};
use super::law::Law;
use super::laws;
use super::verdicts::tool_hash;

/// A set of cases.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Collection {
    /// Runs from rest.
    Runs(Set),
    /// Whole sessions, as on a bench.
    Bench,
    /// Forces that no catalogue has.
    Laws,
}

impl Collection {
    /// The sets whose truths are worlds.
    pub const WORLDS: [Self; 3] = [Self::Runs(Set::Rich), Self::Runs(Set::Paper), Self::Bench];
    /// Every set, in the order of the pages.
    pub const ALL: [Self; 4] = {
        let [rich, paper, bench] = Self::WORLDS;
        [rich, paper, bench, Self::Laws]
    };

    /// Reads a name.
    ///
    /// # Errors
    ///
    /// Says which names there are.
    pub fn named(name: &str) -> Result<Self, String> {
        let mut all = Self::ALL.into_iter();
        all.find(|set| set.name() == name)
            .ok_or_else(|| "give rich, paper, bench or laws".into())
    }

    /// Name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Runs(set) => set.name(),
            Self::Bench => "bench",
            Self::Laws => "laws",
        }
    }

    /// The folder of its cases. Cases of another generator are other cases, and runs are others where
    /// there are more of them; sessions of a seed share a folder, and all laws.
    pub fn folder(self, count: u32, only: &[String], seed: u64) -> String {
        let (name, generator) = match self {
            Self::Runs(_) => (format!("seed{seed}_{count}"), GENERATOR),
            Self::Bench => (format!("bench_seed{seed}"), GENERATOR),
            // They are simulated by the tool.
            Self::Laws => (format!("laws_{}", tool_hash()), include_str!("laws.rs")),
        };
        let hash = stable_hash(generator.as_bytes()) >> 32;
        let kinds = only
            .iter()
            .fold(String::new(), |all, kind| all + "_" + kind);
        format!("{name}{kinds}_{hash:08x}")
    }
}

/// What the cases of a set hide, before anything is drawn.
#[derive(Clone, Debug)]
pub enum Plans {
    /// Of runs: they depend on how many cases there are.
    Runs(Set, Vec<cases::Plan>),
    /// Of sessions: each depends on its number alone.
    Bench(Vec<sessions::Plan>),
    /// Seeds of laws, which decide all.
    Laws(Vec<u64>),
}

impl Plans {
    /// What `count` cases hide. With `only`, each hides one of these kinds.
    pub fn of(collection: Collection, count: u32, only: &[String], seed: u64) -> Self {
        match collection {
            Collection::Runs(set) => Self::Runs(set, cases::plan(set, count, only, seed)),
            Collection::Bench => Self::Bench(sessions::plan(count, only, seed)),
            // None of them is one of the catalogue.
            Collection::Laws if !only.is_empty() => Self::Laws(Vec::new()),
            Collection::Laws => Self::Laws((seed..).take(count as usize).collect()),
        }
    }

    /// Which set.
    pub const fn collection(&self) -> Collection {
        match self {
            Self::Runs(set, _) => Collection::Runs(*set),
            Self::Bench(_) => Collection::Bench,
            Self::Laws(_) => Collection::Laws,
        }
    }

    /// The names of the cases' folders.
    pub fn names(&self) -> Vec<String> {
        let count = match self {
            Self::Runs(_, plans) => plans.len(),
            Self::Bench(plans) => plans.len(),
            Self::Laws(seeds) => return seeds.iter().map(|&seed| laws::name(seed)).collect(),
        };
        let set = self.collection().name();
        (0..count)
            .map(|number| format!("{set}_{number:03}"))
            .collect()
    }

    /// What each case hides, and by which laws; nothing of a set of laws, which are drawn with their
    /// actuators.
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
            Self::Laws(_) => Vec::new(),
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
    /// To a law.
    Law(laws::Answer),
}

impl Answer {
    /// What is hidden.
    pub const fn secret(&self) -> &Secret {
        match self {
            Self::Runs(answer) => &answer.secret,
            Self::Session(answer) => &answer.secret,
            Self::Law(answer) => &answer.secret,
        }
    }

    /// Which set the case is of.
    pub const fn collection(&self) -> Collection {
        match self {
            Self::Runs(answer) => Collection::Runs(answer.set),
            Self::Session(_) => Collection::Bench,
            Self::Law(_) => Collection::Laws,
        }
    }

    /// The answer of a session.
    pub const fn session(&self) -> Option<&sessions::Answer> {
        match self {
            Self::Session(answer) => Some(answer),
            Self::Runs(_) | Self::Law(_) => None,
        }
    }

    /// The answer of a law.
    pub const fn law(&self) -> Option<&laws::Answer> {
        match self {
            Self::Law(answer) => Some(answer),
            Self::Runs(_) | Self::Session(_) => None,
        }
    }
}
