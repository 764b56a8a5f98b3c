//! The fast subset as a gate: figures that must not get worse.

use serde::Deserialize;
use softrig_formats::error::InputError;

use super::answer::Collection;
use super::counts::{Group, Rate};
use super::experiments::Set;
use super::grade::Strength;
use super::hidden::Hidden;
use super::score::Scored;

/// Limits, from `bench/blind_gate.toml`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gate {
    /// Cases of the rich set.
    pub cases: u32,
    /// Their seed.
    pub seed: u64,
    /// Least number of single effects of the catalogue that are named (lenient).
    pub named_at_least: u32,
    /// Least number whose answer set holds the truth.
    pub in_answer_set_at_least: u32,
    /// Most single effects for which something else is named.
    pub wrong_at_most: u32,
    /// Most names on data without an effect.
    pub false_names_at_most: u32,
    /// Most names on effects outside the catalogue.
    pub outside_names_at_most: u32,
    /// Largest median of the held-out error over the oracle's.
    pub held_out_at_most: f64,
}

impl Gate {
    /// The limits in the repository.
    ///
    /// # Errors
    ///
    /// Says what is wrong with the file.
    pub fn committed() -> Result<Self, InputError> {
        let path = softrig_tests::process::root().join("bench/blind_gate.toml");
        let text =
            std::fs::read_to_string(&path).map_err(|error| InputError::from_io(&path, &error))?;
        toml::from_str(&text).map_err(|error| {
            InputError::new(error.message().to_owned(), "correct the limits").in_file(&path)
        })
    }

    /// What has become worse than the limits allow, a sentence each.
    pub fn check(&self, scored: &[Scored]) -> Vec<String> {
        let cases = Group::of(Collection::Runs(Set::Rich), scored);
        if cases.is_empty() {
            return vec!["no case was diagnosed".to_owned()];
        }
        let one = cases.hiding(&[Hidden::One]);
        let quiet = cases.quiet();
        let outside = cases.hiding(&[Hidden::Outside]);
        let mut failures = Vec::new();
        let mut at_least = |what: &str, rate: Rate, limit: u32| {
            if rate.hits < limit {
                failures.push(format!(
                    "{what}: {} of {}, and {limit} is the least",
                    rate.hits, rate.of
                ));
            }
        };
        at_least(
            "single effects named",
            one.rate(Scored::is_lenient),
            self.named_at_least,
        );
        at_least(
            "answer sets that hold the truth",
            one.rate(Scored::holds),
            self.in_answer_set_at_least,
        );
        let mut at_most = |what: &str, rate: Rate, limit: u32| {
            if rate.hits > limit {
                failures.push(format!(
                    "{what}: {} of {}, and {limit} is the most",
                    rate.hits, rate.of
                ));
            }
        };
        at_most(
            "wrong names for a single effect",
            one.rate(Scored::names_else),
            self.wrong_at_most,
        );
        at_most(
            "names on data without an effect",
            quiet.rate(Scored::names),
            self.false_names_at_most,
        );
        at_most(
            "names on effects outside the catalogue",
            outside.rate(|case| case.is_wrong(Strength::Full)),
            self.outside_names_at_most,
        );
        match one.median(Scored::over_oracle) {
            Some(ratio) if ratio > self.held_out_at_most => failures.push(format!(
                "held-out error over the oracle's: {ratio:.3}, and {} is the most",
                self.held_out_at_most
            )),
            _ => {}
        }
        failures
    }
}
