//! Asks the same question otherwise.

use std::path::Path;

use clap::Args;
use serde_json::{Value, json};

use super::cases::Set;
use super::choice::Choice;
use super::counts::{Figures, Limits};
use super::ways::Way;

/// Does the same question, asked otherwise, get the same answer?
///
/// Diagnoses every case as it is, then with another seed, another order, other units, another
/// first model and so on, and counts how often the answer stays. It needs no labels. Answers
/// are kept: the same command goes on where it was interrupted.
#[derive(Args, Debug)]
#[command(after_help = "\
A case is a folder with model.toml, recordings/*.csv and, where there is one, holdout/*.csv.
Unless sets are named, those of other laboratories are asked: rigs and real.
docs/benchmarks.md says what the columns of the tables mean.

Examples:
  cargo xtask bench invariance
  cargo xtask bench invariance --sets bench --limit 12 --ways seed,order,units
  cargo xtask bench invariance --folder my-rigs --known my-rigs/known.json
  cargo xtask bench invariance --sets rigs,real --at-least same=0.9,contradicting=0.02
  cargo xtask bench dirt --sets cases --limit 6")]
pub struct Options {
    #[command(flatten)]
    choice: Choice,
    /// In which ways to ask [default: all]
    #[arg(long, value_enum, value_delimiter = ',')]
    ways: Vec<Way>,
    /// Fail unless every way of every set has at least this share of `same`, and at most this
    /// share of any other column: same=0.9,contradicting=0.02
    #[arg(long, visible_alias = "limits", value_name = "LIMITS", value_parser = Limits::parse)]
    at_least: Option<Limits>,
}

impl Options {
    /// Asks every case in the ways that were chosen, or in all of a benchmark.
    ///
    /// # Errors
    ///
    /// If there are no cases, or answers cannot be kept.
    pub fn measure(&self, target: &Path, benchmark: &str, in_all: &[Way]) -> Result<Value, String> {
        let choice = &self.choice;
        let mut ways = self.ways.clone();
        if ways.is_empty() {
            ways = in_all.to_vec();
        }
        // It is asked in any case.
        ways.retain(|way| *way != Way::Plain);
        let (rig, sets) = choice.ask(target, &[Set::Rigs, Set::Real], &ways)?;
        let figures: Vec<Figures> = sets
            .iter()
            .map(|(set, cases)| Figures::of(set, cases, &ways))
            .collect();
        let limits = self.at_least.iter();
        let missed: Vec<String> = limits
            .flat_map(|limits| figures.iter().flat_map(|set| limits.missed(set)))
            .collect();
        Ok(json!({
            "benchmark": benchmark, "rig": choice.rig, "rig_hash": rig.hash, "jobs": choice.jobs,
            "threads": choice.threads(), "sets": figures, "missed": missed,
        }))
    }
}
