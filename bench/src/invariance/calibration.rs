//! Calibration: is what is stated with a probability right as often as it says?
//!
//! A diagnosis states a probability of every effect that it names and, where it cannot tell,
//! of every rival. Over many cases with a known answer, of what is stated with 0.9 nine in ten
//! have to be right. `cargo xtask bench calibration` counts.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use softrig_tests::write;

use super::answer::in_words;
use super::ask::CaseReplies;
use super::cases::{CaseSet, Set};
use super::choice::Choice;
use super::known::Known;
use crate::blind::counts::wilson;
use crate::pictures;

/// Is what is stated with a probability right as often as it says?
///
/// Diagnoses cases with a known answer, and counts what was stated with which probability
/// against what is right. Answers are kept: the same command goes on where it was interrupted.
#[derive(Args, Debug)]
#[command(after_help = "\
Unless sets are named, drawn cases and bench sessions are asked. Rivals count where exactly
one set of effects is right; of rigs of other laboratories, names alone do.

Examples:
  cargo xtask bench calibration --limit 48 --draw-seed 7
  cargo xtask bench calibration --sets drawn,bench,loop,rigs,real --json calibration.json")]
pub struct Options {
    #[command(flatten)]
    choice: Choice,
    /// Draw the picture
    #[arg(long, value_name = "OUT.svg")]
    plot: Option<PathBuf>,
}

impl Options {
    /// Asks every case.
    ///
    /// # Errors
    ///
    /// If there are no cases, or answers cannot be kept.
    pub fn measure(&self, target: &Path) -> Result<Value, String> {
        let choice = &self.choice;
        let (rig, sets) = choice.ask(target, &[Set::Drawn, Set::Bench], &[])?;
        let each: Vec<(&str, Calibration)> = sets
            .iter()
            .map(|(set, cases)| (set.name.as_str(), Calibration::of(set, cases)))
            .collect();
        let words: Vec<String> = sets
            .iter()
            .map(|(set, _)| format!("{} cases of the set {}", set.cases.len(), set.name))
            .collect();
        let measured_on = format!("{}; seed {}", words.join(", "), choice.draw_seed);
        let mut figures = figures(&measured_on, &each);
        figures["rig_hash"] = rig.hash.into();
        if let Some(path) = &self.plot {
            for (_, svg) in pictures::of(&figures)? {
                write(path, &svg)?;
            }
        }
        Ok(figures)
    }
}

/// The figures of each set, and of all sets together with every statement.
fn figures(measured_on: &str, each: &[(&str, Calibration)]) -> Value {
    let all = Calibration::joined(each.iter().map(|(_, part)| part));
    let sets: Vec<Value> = each.iter().map(|(name, part)| part.figures(name)).collect();
    let mut figures = all.figures("all");
    figures["benchmark"] = "calibration".into();
    figures["measured_on"] = measured_on.into();
    figures["sure"] = SURE.into();
    figures["sets"] = sets.into();
    figures["statements"] = json!(all.statements);
    figures
}

/// Upper edges of the bins of stated probability.
const EDGES: [f64; 6] = [0.05, 0.2, 0.5, 0.8, 0.95, 1.0];
/// From here on a name is stated as sure.
const SURE: f64 = 0.95;
/// A probability of 0 or 1 that is wrong would cost infinitely much.
const LEAST: f64 = 0.005;

/// Something that was stated with a probability, in a case whose answer is known.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Statement {
    /// The set of the case.
    pub set: String,
    /// Name of the case.
    pub case: String,
    /// The effects.
    pub effects: String,
    /// Whether they are named; a rival of an answer set otherwise.
    pub is_name: bool,
    /// The probability.
    pub probability: f64,
    /// Whether they are right: a named effect, that an accepted set holds it; a rival, that it
    /// is the accepted set.
    pub right: bool,
}

/// Statements with similar probabilities.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Bin {
    /// Lower edge of the probability.
    pub from: f64,
    /// Upper edge.
    pub to: f64,
    /// Statements.
    pub of: usize,
    /// Those that are right.
    pub right: usize,
    /// Mean stated probability.
    pub stated: f64,
    /// The share that is right.
    pub share: f64,
    /// An interval that holds the true share in nine of ten cases.
    pub interval: [f64; 2],
}

/// All that was stated over some cases.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Calibration {
    /// The statements.
    pub statements: Vec<Statement>,
}

impl Calibration {
    /// What the plain answers of a set state. Rivals count where exactly one set of effects
    /// is right; what is known of real rigs accepts several.
    pub fn of(set: &CaseSet, replies: &[CaseReplies]) -> Self {
        let mut statements = Vec::new();
        for case in replies {
            let known = set.labels.get(&case.name);
            let Some((known, answer)) = known.zip(case.plain.answer()) else {
                continue;
            };
            let Some(accept) = &known.accept else {
                continue;
            };
            let is_exact = known.certainty.as_deref() == Some(Known::CERTAIN) && accept.len() == 1;
            for (kinds, probability) in &answer.stated {
                let is_name = answer.names();
                if !is_name && !is_exact {
                    continue;
                }
                let right = if is_name {
                    accept.iter().any(|set| kinds.is_subset(set))
                } else {
                    accept.contains(kinds)
                };
                statements.push(Statement {
                    set: set.name.clone(),
                    case: case.name.clone(),
                    effects: in_words(kinds),
                    is_name,
                    probability: *probability,
                    right,
                });
            }
        }
        Self { statements }
    }

    /// All statements of several sets.
    pub fn joined<'a>(parts: impl IntoIterator<Item = &'a Self>) -> Self {
        let statements = parts.into_iter().flat_map(|part| part.statements.clone());
        Self {
            statements: statements.collect(),
        }
    }

    /// The bins that hold any statement.
    pub fn bins(&self) -> Vec<Bin> {
        let mut from = 0.0;
        let mut bins = Vec::new();
        for to in EDGES {
            let is_here =
                |it: &&Statement| it.probability <= to && (it.probability > from || from == 0.0);
            let here: Vec<&Statement> = self.statements.iter().filter(is_here).collect();
            if !here.is_empty() {
                let stated: f64 = here.iter().map(|it| it.probability).sum();
                let right = here.iter().filter(|it| it.right).count();
                bins.push(Bin {
                    from,
                    to,
                    of: here.len(),
                    right,
                    stated: stated / here.len() as f64,
                    share: right as f64 / here.len() as f64,
                    interval: wilson(right as f64, here.len() as f64, 0.9),
                });
            }
            from = to;
        }
        bins
    }

    /// Expected calibration error: the mean distance of what is stated from the share that is
    /// right, weighed by the number of statements.
    pub fn expected_error(&self) -> f64 {
        let all = self.statements.len().max(1) as f64;
        let bins = self.bins();
        let apart = bins
            .iter()
            .map(|bin| bin.of as f64 * (bin.stated - bin.share).abs());
        apart.sum::<f64>() / all
    }

    /// The mean of −ln of the probability that was given to what is true.
    pub fn log_loss(&self) -> f64 {
        let loss = |it: &Statement| {
            let stated = it.probability.clamp(LEAST, 1.0 - LEAST);
            -(if it.right { stated } else { 1.0 - stated }).ln()
        };
        self.statements.iter().map(loss).sum::<f64>() / self.statements.len().max(1) as f64
    }

    /// Of the names that are stated as sure, those that are right, and all of them.
    pub fn sure_names(&self) -> [usize; 2] {
        let sure = |it: &&Statement| it.is_name && it.probability >= SURE;
        let right = self.statements.iter().filter(sure).filter(|it| it.right);
        [right.count(), self.statements.iter().filter(sure).count()]
    }

    fn figures(&self, name: &str) -> Value {
        json!({
            "name": name, "count": self.statements.len(), "expected_error": self.expected_error(),
            "log_loss": self.log_loss(), "sure_names": self.sure_names(), "bins": self.bins(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pages::render;

    fn stated(probability: f64, right: usize, of: usize) -> Vec<Statement> {
        let one = |place: usize| Statement {
            set: "drawn".into(),
            case: place.to_string(),
            effects: "gravity".into(),
            is_name: true,
            probability,
            right: place < right,
        };
        (0..of).map(one).collect()
    }

    #[test]
    fn what_is_right_as_often_as_stated_has_no_error() {
        let statements = [stated(0.9, 9, 10), stated(0.3, 3, 10)].concat();
        let calibrated = Calibration { statements };
        assert!(calibrated.expected_error() < 1e-12);
        assert_eq!(calibrated.bins().len(), 2);
        let entropy = |p: f64| -p * p.ln() - (1.0 - p) * (1.0 - p).ln();
        let expected = f64::midpoint(entropy(0.9), entropy(0.3));
        assert!((calibrated.log_loss() - expected).abs() < 1e-12);
    }

    #[test]
    fn one_who_is_always_sure_and_often_wrong_is_found_out() {
        let boaster = Calibration {
            statements: stated(1.0, 6, 10),
        };
        assert!((boaster.expected_error() - 0.4).abs() < 1e-12);
        assert_eq!(boaster.sure_names(), [6, 10]);
        assert!(boaster.log_loss() > 2.0);
        let [low, high] = boaster.bins()[0].interval;
        // Wilson's interval of 6 in 10 at 90 %, from its formula by hand.
        assert!(
            (low - 0.351_8).abs() < 5e-4 && (high - 0.806_1).abs() < 5e-4,
            "{low} {high}"
        );
    }

    #[test]
    fn every_statement_is_in_one_bin() {
        let probabilities = [0.0, 0.05, 0.050_001, 0.5, 0.95, 0.950_1, 1.0];
        let statements = probabilities.into_iter().flat_map(|it| stated(it, 1, 1));
        let all = Calibration {
            statements: statements.collect(),
        };
        let counted: usize = all.bins().iter().map(|bin| bin.of).sum();
        assert_eq!(counted, probabilities.len());
        let figures = figures("seven", &[("drawn", all)]);
        let text = render(&figures).unwrap();
        assert!(text.contains("| 0.95 to 1.00 |"), "{text}");
        assert!(text.contains("Measured on seven. 7 statements: "), "{text}");
        let (name, svg) = pictures::of(&figures).unwrap().remove(0);
        assert_eq!(name, "calibration.svg");
        assert!(svg.contains("<svg"));
    }
}
