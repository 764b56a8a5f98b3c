//! The third phase: open the answers, and lay beside each what was said.
//!
//! What the tables count are questions to a case ([`Scored`]) and grades
//! ([`Grade`]). On data that hide nothing, or only parameters, every name is false.
//! On an effect that the catalogue does not hold, a name that explains the error is
//! false; one that says itself that it explains a part is counted apart.

use std::path::Path;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use softrig::estimate::Dataset;
use softrig::estimate::fitter::Fitter;
use softrig_formats::model_file::ModelFile;

use super::answer::Answer;
use super::cases;
use super::grade::{Grade, Strength};
use super::hidden::{Hidden, Secret};
use super::law::Law;
use super::said::Said;
use super::verdicts::Outcome;
use super::world::Base;

/// A fitted number beside the true one.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Name.
    pub name: String,
    /// Whether it is a base parameter (its ratio to the inertia).
    pub base: bool,
    /// |estimate − truth| / |truth|.
    pub relative_error: f64,
    /// Whether the 95 % interval holds the truth; none without an interval.
    pub covered: Option<bool>,
}

/// RMS on fresh runs (rad).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Against what the noisy sensor shows.
    pub noisy: f64,
    /// Against what a perfect sensor would show.
    pub clean: f64,
}

/// A case with its score.
#[derive(Clone, Debug)]
pub struct Scored {
    /// The answer.
    pub answer: Answer,
    /// What the verdict said.
    pub said: Said,
    /// What it is worth.
    pub grade: Grade,
    /// The repaired model on fresh runs, where a set has them.
    pub tool: Option<Errors>,
    /// The right structure, refitted to the same recordings, on fresh runs.
    pub oracle: Option<Errors>,
    /// Fitted numbers, where the structure is right to the formula.
    pub estimates: Vec<Estimate>,
    /// Why there is no verdict.
    pub refused: Option<String>,
    /// Wall time (s).
    pub seconds: f64,
    /// Processor time (s), where it is known.
    pub cpu_seconds: Option<f64>,
}

/// Scores every case that has a verdict. `sealed` is where the answers are.
pub fn score(answers: &[Answer], verdicts: &Path, sealed: &Path) -> Vec<Scored> {
    answers
        .par_iter()
        .filter_map(|answer| {
            let path = verdicts.join(format!("{}.json", answer.secret().case));
            let outcome = Outcome::read(&path)?;
            let mut scored = Scored::of(answer, &outcome);
            if let Answer::Runs(runs) = answer {
                scored.compare_on_fresh(runs, &outcome, sealed);
            }
            Some(scored)
        })
        .collect()
}

impl Scored {
    /// What was said of a case, without a comparison on fresh runs.
    pub fn of(answer: &Answer, outcome: &Outcome) -> Self {
        let said = Said::of(outcome);
        let grade = match answer {
            Answer::Law(law) => law.grade(outcome, &said),
            Answer::Runs(_) | Answer::Session(_) => Grade::of(&answer.secret().kinds, &said),
        };
        Self {
            grade,
            tool: None,
            oracle: None,
            estimates: Vec::new(),
            refused: outcome.refused.clone(),
            seconds: outcome.seconds,
            cpu_seconds: outcome.cpu_seconds,
            answer: answer.clone(),
            said,
        }
    }

    fn compare_on_fresh(&mut self, runs: &cases::Answer, outcome: &Outcome, sealed: &Path) {
        // Where the phase of a disturbance is another one in every run, nobody
        // can predict a fresh one.
        let mut effects = runs.secret.truth.effects.iter();
        let predictable = effects.all(|effect| effect.law != Law::PeriodicUnsynchronised);
        if runs.secret.hidden.has_a_name() && predictable {
            self.tool = on_fresh(runs, outcome);
            self.oracle = Some(oracle(runs, sealed));
        }
        self.estimates = estimates(&runs.secret, outcome, &self.said);
    }

    /// What is hidden.
    pub fn secret(&self) -> &Secret {
        self.answer.secret()
    }

    /// The name is the truth and nothing else: named, strict.
    pub fn is_exact(&self) -> bool {
        self.grade == Grade::Exact
    }

    /// Named, lenient.
    pub fn is_lenient(&self) -> bool {
        self.said.names_group(&self.secret().kinds)
    }

    /// The truth is in the answer set.
    pub fn holds(&self) -> bool {
        self.said.holds(&self.secret().kinds)
    }

    /// Anything is named.
    pub fn names(&self) -> bool {
        self.said.names()
    }

    /// Something else than the truth is named, if only in part.
    pub fn names_else(&self) -> bool {
        self.names() && !self.is_exact()
    }

    /// Something is named, and all of it is hidden.
    pub fn names_what_is_hidden(&self) -> bool {
        let kinds = &self.secret().kinds;
        self.names() && self.said.named.iter().all(|kind| kinds.contains(kind))
    }

    /// Another family is named, or anything where nothing has a name, so strongly.
    pub fn is_wrong(&self, strength: Strength) -> bool {
        self.grade == Grade::Wrong(strength)
    }

    /// The law is named or in the set, or one that pushes alike.
    pub fn has_the_law(&self) -> bool {
        matches!(self.grade, Grade::Exact | Grade::Set)
    }

    /// A formula that is not the law is named as strongly as an effect.
    pub fn is_wrong_formula(&self) -> bool {
        self.is_wrong(Strength::Full) && self.said.is_formula
    }

    /// What the repaired model leaves, over what a fit of the hidden law leaves.
    pub fn over_law(&self) -> Option<f64> {
        let law = self.answer.law()?;
        Some(self.said.fitted?[1] / law.law_rmse_deg)
    }

    /// Error on fresh runs over the oracle's, against what a noisy sensor shows.
    pub fn over_oracle(&self) -> Option<f64> {
        Some(self.tool?.noisy / self.oracle?.noisy)
    }

    /// The same against what a perfect sensor shows.
    pub fn over_oracle_clean(&self) -> Option<f64> {
        Some(self.tool?.clean / self.oracle?.clean)
    }
}

/// The oracle's errors; they take seconds and do not depend on the tool, so
/// they are kept beside the answers.
fn oracle(answer: &cases::Answer, sealed: &Path) -> Errors {
    let path = sealed.join(format!("oracle_{}.json", answer.secret.case));
    let kept = std::fs::read_to_string(&path)
        .ok()
        .and_then(|text| serde_json::from_str(&text).ok());
    kept.unwrap_or_else(|| {
        let (noisy, clean) = answer.on_fresh(&answer.oracle());
        let errors = Errors { noisy, clean };
        // Where it cannot be kept, it is computed again.
        if let Ok(text) = serde_json::to_string(&errors) {
            let _ = softrig_formats::error::write_atomically(&path, text.as_bytes());
        }
        errors
    })
}

/// The repaired model over fresh runs, in the tool's own simulation.
fn on_fresh(answer: &cases::Answer, outcome: &Outcome) -> Option<Errors> {
    let file = ModelFile::parse(&outcome.repaired, Path::new("repaired.toml")).ok()?;
    let fresh = answer.fresh();
    let recordings: Vec<_> = fresh
        .iter()
        .map(|(_, recording, _)| recording.clone())
        .collect();
    let data = Dataset::of(&recordings);
    let compared = Fitter::new(&file.model, &data).compare(&file.model);
    let (mut noisy, mut clean, mut count) = (0.0, 0.0, 0.0);
    for ((_, recording, reading), residuals) in fresh.iter().zip(compared.residuals.iter()) {
        for ((measured, shown), residual) in recording.angle.iter().zip(reading).zip(residuals) {
            noisy += residual * residual;
            clean += (residual + measured - shown).powi(2);
            count += 1.0;
        }
    }
    Some(Errors {
        noisy: (noisy / count).sqrt(),
        clean: (clean / count).sqrt(),
    })
}

/// Fitted numbers beside true ones, where the tool has the very equations.
fn estimates(secret: &Secret, outcome: &Outcome, said: &Said) -> Vec<Estimate> {
    let structure_is_right = match secret.hidden {
        Hidden::Nothing | Hidden::Outside => false,
        Hidden::Parameters => !said.names(),
        Hidden::One | Hidden::Two => secret.same_laws && said.names_exactly(&secret.kinds),
    };
    if !structure_is_right {
        return Vec::new();
    }
    let Base {
        damping,
        stiffness,
        input_gain,
        ..
    } = secret.truth.base;
    let mut true_values = vec![
        ("damping".to_owned(), damping),
        ("stiffness".to_owned(), stiffness),
        ("input_gain".to_owned(), input_gain * 1e3),
    ];
    for effect in &secret.truth.effects {
        let row = effect.law.row();
        for (quantity, value) in row.quantities.iter().zip(effect.values) {
            true_values.push((
                format!("{}.{}", row.kind.unwrap_or_default(), quantity.key),
                value * quantity.per_si,
            ));
        }
    }
    outcome
        .fitted
        .iter()
        .filter_map(|fitted| {
            let (name, truth) = true_values.iter().find(|(name, _)| *name == fitted.name)?;
            Some(Estimate {
                name: name.clone(),
                base: !name.contains('.'),
                relative_error: (fitted.value - truth).abs() / truth.abs(),
                covered: fitted
                    .interval95
                    .map(|(low, high)| (low..=high).contains(truth)),
            })
        })
        .collect()
}
