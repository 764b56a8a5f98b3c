//! Calibration: is what is stated with a probability right as often as it says?
//!
//! A diagnosis states a probability of every effect that it names and, where it cannot tell,
//! of every rival. Over many cases with a known answer, of what is stated with 0.9 nine in ten
//! have to be right. `cargo xtask bench calibration` counts.

use std::fmt::Write as _;

use serde::Serialize;
use softrig_report::plot::{Figure, Mark, Panel, Role, Series, Style, to_svg_string};

use super::answer::in_words;
use super::ask::CaseReplies;
use super::cases::CaseSet;
use super::known::Known;

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
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
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
}

impl Bin {
    /// The share that is right.
    pub fn share(&self) -> f64 {
        self.right as f64 / self.of as f64
    }

    /// An interval that holds the true share in nine of ten cases (Wilson 1927).
    pub fn interval(&self) -> [f64; 2] {
        /// Standard deviations of a normal distribution's middle 90 %.
        const Z: f64 = 1.645;
        let n = self.of as f64;
        let share = self.share();
        let middle = (share + Z * Z / (2.0 * n)) / (1.0 + Z * Z / n);
        let spread = (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
        let half = Z * spread / (1.0 + Z * Z / n);
        [(middle - half).max(0.0), (middle + half).min(1.0)]
    }
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
                bins.push(Bin {
                    from,
                    to,
                    of: here.len(),
                    right: here.iter().filter(|it| it.right).count(),
                    stated: stated / here.len() as f64,
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
            .map(|bin| bin.of as f64 * (bin.stated - bin.share()).abs());
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

    /// The table, in Markdown.
    pub fn table(&self) -> String {
        let mut text = "| stated | mean | right | of | share | 90 % interval |\n|---|---:|---:|---:|---:|---|\n".to_owned();
        for bin in self.bins() {
            let [low, high] = bin.interval();
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "| {:.2} to {:.2} | {:.2} | {} | {} | {:.2} | {low:.2} to {high:.2} |",
                bin.from,
                bin.to,
                bin.stated,
                bin.right,
                bin.of,
                bin.share(),
            );
        }
        text
    }

    /// The figures in a sentence.
    pub fn summary(&self) -> String {
        let [right, of] = self.sure_names();
        format!(
            "{} statements: expected calibration error {:.3}, log loss {:.3}; of {of} names stated with {SURE} or more, {right} are right.",
            self.statements.len(),
            self.expected_error(),
            self.log_loss(),
        )
    }

    /// The share that is right over what was stated, as a picture.
    pub fn picture(&self, subtitle: &str) -> String {
        let bins = self.bins();
        let line = |role| Style::new(role, Mark::Line);
        let mut panel = Panel::new("stated probability", "share that is right")
            .with_x_range(0.0, 1.1)
            .with_y_range(0.0, 1.02)
            .with_series(Series::new(
                "as stated",
                &[0.0, 1.0],
                &[0.0, 1.0],
                Style::new(Role::Reference, Mark::Dashed),
            ));
        for (place, bin) in bins.iter().enumerate() {
            let label = if place == 0 { "90 % interval" } else { "" };
            let stated = [bin.stated; 2];
            panel = panel.with_series(Series::new(
                label,
                &stated,
                &bin.interval(),
                line(Role::Measured),
            ));
        }
        let stated: Vec<f64> = bins.iter().map(|bin| bin.stated).collect();
        let shares: Vec<f64> = bins.iter().map(Bin::share).collect();
        panel = panel.with_series(Series::new(
            "right",
            &stated,
            &shares,
            Style::new(Role::Measured, Mark::Discs),
        ));
        for bin in &bins {
            panel = panel.with_note(
                bin.stated,
                bin.share(),
                format!("{} of {}", bin.right, bin.of),
            );
        }
        let mut figure = Figure::new("What is stated, and how often it is right")
            .with_subtitle(subtitle)
            .with_panel(panel);
        figure.width_px = 560.0;
        figure.row_height_px = 420.0;
        to_svg_string(&figure)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let [low, high] = boaster.bins()[0].interval();
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
        assert!(all.table().contains("| 0.95 to 1.00 |"), "{}", all.table());
        assert!(all.picture("seven").contains("<svg"));
    }
}
