//! The fast subset as a gate: figures that must not get worse.

use serde::Deserialize;
use softrig_formats::error::InputError;

use super::answer::Collection;
use super::counts::{Group, Rate};
use super::experiments::Set;
use super::grade::Strength;
use super::hidden::Hidden;
use super::laws::Class;
use super::score::Scored;

/// Limits of the laws.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Laws {
    /// Laws, and actuators without one.
    pub cases: u32,
    /// The first of their seeds.
    pub seed: u64,
    /// Least number of laws that the grammar has which are named.
    pub named_at_least: u32,
    /// Most formulas that are not the law, at full strength.
    pub wrong_formulas_at_most: u32,
    /// Most names on actuators without a law.
    pub false_names_at_most: u32,
}

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
    /// Limits of the laws.
    pub laws: Laws,
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

    /// How many cases of a set there are, and their seed.
    pub const fn drawn(&self, set: Collection) -> (u32, u64) {
        match set {
            Collection::Laws => (self.laws.cases, self.laws.seed),
            _ => (self.cases, self.seed),
        }
    }

    /// What has become worse than the limits allow, a sentence each.
    // A table: a row of it is a line.
    #[rustfmt::skip]
    pub fn check(&self, scored: &[Scored]) -> Vec<String> {
        let cases = Group::of(Collection::Runs(Set::Rich), scored);
        let laws = Group::of(Collection::Laws, scored);
        if cases.is_empty() || laws.is_empty() {
            return vec!["no case was diagnosed".to_owned()];
        }
        let one = cases.hiding(&[Hidden::One]);
        let outside = cases.hiding(&[Hidden::Outside]);
        let within = laws.that(|case| case.answer.law().is_some_and(|it| it.class == Class::Within));
        let full = |case: &Scored| case.is_wrong(Strength::Full);
        let least = [
            ("single effects named", one.rate(Scored::is_lenient), self.named_at_least),
            ("answer sets that hold the truth", one.rate(Scored::holds), self.in_answer_set_at_least),
            ("laws of the grammar named", within.rate(Scored::is_exact), self.laws.named_at_least),
        ];
        let most = [
            ("wrong names for a single effect", one.rate(Scored::names_else), self.wrong_at_most),
            ("names on data without an effect", cases.quiet().rate(Scored::names), self.false_names_at_most),
            ("names on effects outside the catalogue", outside.rate(full), self.outside_names_at_most),
            ("formulas that are not the law", laws.rate(Scored::is_wrong_formula), self.laws.wrong_formulas_at_most),
            ("names on actuators without a law", laws.quiet().rate(Scored::names), self.laws.false_names_at_most),
        ];
        let few = least.iter().filter(|(_, rate, limit)| rate.hits < *limit).map(|row| (row, "least"));
        let many = most.iter().filter(|(_, rate, limit)| rate.hits > *limit).map(|row| (row, "most"));
        let missed = few.chain(many).map(|((what, Rate { hits, of }, limit), is)| {
            format!("{what}: {hits} of {of}, and {limit} is the {is}")
        });
        let ratio = one.median(Scored::over_oracle).filter(|ratio| *ratio > self.held_out_at_most);
        let ratio = ratio.map(|ratio| {
            format!("held-out error over the oracle's: {ratio:.3}, and {} is the most", self.held_out_at_most)
        });
        missed.chain(ratio).collect()
    }
}
