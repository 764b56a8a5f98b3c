//! What `softrig diagnose --json` says, as far as tables and summaries show it.
//!
//! Names stand in the order of the file, the first one first.

use std::collections::BTreeSet;
use std::path::Path;

use serde::Deserialize;

/// Rivals that are listed of an answer that is left open.
const MOST_RIVALS: usize = 3;

/// Effects that act together.
pub type Kinds = BTreeSet<String>;

/// A verdict. All but the first field may be absent: older and newer versions of `softrig` write
/// other fields.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct Verdict {
    /// One of the five verdicts.
    pub verdict: String,
    /// The effects that are named.
    #[serde(default)]
    pub effects: Vec<Effect>,
    /// The alternatives, best first.
    #[serde(default)]
    pub alternatives: Vec<Alternative>,
    /// The family of the alternatives, where they are of one.
    pub family: Option<String>,
    /// `explains`, or `part` where the effects explain only a part of the gap.
    pub strength: Option<String>,
    /// Whether the board gains by the repaired model; it does unless this says otherwise.
    pub upload: Option<bool>,
    /// How much of the gap is explained, by horizon.
    #[serde(default)]
    pub closure: Closure,
    /// Whether the repair is good enough.
    #[serde(default)]
    pub adequacy: Adequacy,
    /// RMS errors on the validation recordings.
    #[serde(default)]
    pub holdout_rmse_deg: HeldOut,
    /// The repair, where it is not a named effect.
    pub repair: Option<Repair>,
    /// The discrepancy that remains after the repair.
    pub remaining: Option<Remaining>,
    /// Wall time (s).
    pub seconds: Option<f64>,
}

/// A named effect.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Effect {
    /// Its kind.
    pub kind: String,
    /// The stated probability.
    pub probability: Option<f64>,
}

/// An alternative, which may be several effects together.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Alternative {
    /// Their kinds.
    pub kinds: Vec<String>,
}

/// How much of the gap is explained.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct Closure {
    /// Over all horizons, 0 to 1.
    pub overall: Option<f64>,
}

/// Whether the repair is good enough.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct Adequacy {
    /// Share of the gap on the validation recordings that is closed, 0 to 1.
    pub holdout_gap_closed: Option<f64>,
}

/// RMS errors (°).
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct HeldOut {
    /// Of the model as supplied.
    pub nominal: Option<f64>,
    /// Of the refitted model.
    pub refit: Option<f64>,
    /// With the repair.
    pub repaired: Option<f64>,
}

/// A repair that is not a named effect.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Repair {
    /// What it is.
    pub kind: String,
    /// The variables that it is a function of.
    #[serde(default)]
    pub of: Vec<String>,
}

/// The remaining discrepancy.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Remaining {
    /// RMS error (°).
    pub rmse_deg: Option<f64>,
    /// How many times the noise that is.
    pub times_noise: Option<f64>,
    /// The variable with which it goes.
    pub goes_with: Option<String>,
}

impl Verdict {
    /// Reads the file that a diagnosis wrote.
    ///
    /// # Errors
    ///
    /// What is wrong with it.
    pub fn read(path: &Path) -> Result<Self, String> {
        let text = crate::text_of(path)?;
        Self::parse(&text).map_err(|error| format!("{} is no verdict: {error}", path.display()))
    }

    /// Reads the file's text.
    ///
    /// # Errors
    ///
    /// If it is no verdict.
    pub fn parse(text: &str) -> Result<Self, serde_json::Error> {
        serde_json::from_str(text)
    }

    /// The stated probability of the effects that are named: that of the least sure one.
    pub fn probability(&self) -> Option<f64> {
        let stated = self.effects.iter().filter_map(|it| it.probability);
        stated.reduce(f64::min)
    }

    /// The kinds of the named effects.
    pub fn named(&self) -> Vec<&str> {
        self.effects.iter().map(|it| it.kind.as_str()).collect()
    }

    /// The same, to compare.
    pub fn kinds(&self) -> Kinds {
        self.effects.iter().map(|it| it.kind.clone()).collect()
    }

    /// Whether the named effects explain only a part of the gap.
    pub fn is_part(&self) -> bool {
        self.strength.as_deref() == Some("part")
    }

    /// Whether the board gains by the repaired model.
    pub fn is_for_the_board(&self) -> bool {
        self.upload != Some(false)
    }

    /// A sentence for someone who has never seen a verdict.
    pub fn sentence(&self) -> String {
        let named = in_words(self.named());
        let (are, they) = if self.effects.len() > 1 {
            ("are", "they explain")
        } else {
            ("is", "it explains")
        };
        match self.verdict.as_str() {
            "effect_found" if self.is_part() => {
                format!("{named} {are} missing; {they} part of the gap.")
            }
            "effect_found" => format!("{named} {are} missing."),
            "parameters_only" => {
                "no effect is missing; the parameters were off, and are corrected.".into()
            }
            "no_discrepancy" => "nothing is missing; the model was right already.".into(),
            "cannot_tell" => {
                let sets: Vec<String> = self.sets().collect();
                let sets = if sets.is_empty() {
                    "several effects".into()
                } else {
                    sets.join(", or ")
                };
                let family = self.family.as_ref();
                let family = family.map_or(String::new(), |family| format!(" (all are {family})"));
                format!("something is missing, and these data cannot tell what: {sets}{family}.")
            }
            "unexplained" => {
                "something is missing that no effect of the catalogue explains; no name is given."
                    .into()
            }
            other => format!("{}.", other.replace('_', " ")),
        }
    }

    /// The alternatives, in words.
    pub fn sets(&self) -> impl Iterator<Item = String> {
        self.alternatives.iter().map(|it| in_words(&it.kinds))
    }

    /// How much of the gap is explained, 0 to 1.
    pub fn closed(&self) -> Option<f64> {
        self.closure.overall.or(self.adequacy.holdout_gap_closed)
    }

    /// The answer in a few words, for the heading of a picture: of a family, without its
    /// members, which stand in the text beside it.
    pub fn heading(&self) -> String {
        match &self.family {
            Some(family) if self.verdict == "cannot_tell" => format!("family {family}"),
            _ => self.in_a_cell(),
        }
    }

    /// The answer in one cell.
    pub fn in_a_cell(&self) -> String {
        let mut text = match self.verdict.as_str() {
            "effect_found" => {
                let named = in_words(self.named());
                match (&self.strength, self.is_part()) {
                    (None, _) => named,
                    (Some(_), false) => format!("{named} (explains)"),
                    (Some(_), true) => format!("{named} (part)"),
                }
            }
            "cannot_tell" => {
                let mut rivals: Vec<String> = self.sets().take(MOST_RIVALS).collect();
                if self.alternatives.len() > MOST_RIVALS {
                    rivals.push("…".into());
                }
                let rivals = rivals.join(" / ");
                match &self.family {
                    Some(family) => format!("family {family}: {rivals}"),
                    None => format!("cannot tell: {rivals}"),
                }
            }
            "parameters_only" => "parameters only".into(),
            "no_discrepancy" => "nothing missing".into(),
            other => other.replace('_', " "),
        };
        if let Some(Repair { kind, of }) = &self.repair {
            text += &format!("; {kind}");
            if !of.is_empty() {
                text += &format!(" of {}", in_words(of));
            }
        }
        text
    }

    /// Whether an effect or a family is named.
    pub fn names_something(&self) -> bool {
        !self.effects.is_empty() || self.family.is_some()
    }

    /// Whether the answer is that no effect is missing.
    pub fn lacks_nothing(&self) -> bool {
        ["parameters_only", "no_discrepancy"].contains(&self.verdict.as_str())
    }

    /// The repaired over the refitted error.
    pub fn ratio(&self) -> Option<f64> {
        let held_out = &self.holdout_rmse_deg;
        Some(held_out.repaired? / held_out.refit?).filter(|ratio| ratio.is_finite())
    }

    /// Sentences on what is missing, for people.
    pub fn report(&self) -> String {
        let said = self.sentence();
        let mut letters = said.chars();
        let mut said: String = letters
            .next()
            .map(|first| first.to_uppercase().chain(letters).collect())
            .unwrap_or_default();
        if let Some(Repair { kind, of }) = &self.repair {
            said += &format!(" The repair is a {kind} of {}.", in_words(of));
        }
        if let Some(remaining) = &self.remaining
            && let Some(rmse) = remaining.rmse_deg
        {
            said += &format!(" Of the error, {} remain", significant(rmse));
            if let Some(times) = remaining.times_noise {
                said += &format!(", {} times the noise", significant(times));
            }
            if let Some(variable) = &remaining.goes_with {
                said += &format!(", and go with the {}", variable.replace('_', " "));
            }
            said.push('.');
        }
        said
    }
}

/// Kinds as one says them.
pub fn in_words(kinds: impl IntoIterator<Item = impl AsRef<str>>) -> String {
    let kinds = kinds.into_iter();
    let kinds: Vec<String> = kinds.map(|it| it.as_ref().replace('_', " ")).collect();
    kinds.join(" and ")
}

/// Three significant digits.
pub fn significant(value: f64) -> String {
    if !value.is_finite() {
        return "–".into();
    }
    if value == 0.0 {
        return "0".into();
    }
    // The exponent after rounding: 9.996 has three digits as 10.0.
    let scientific = format!("{value:.2e}");
    let (digits, exponent) = scientific
        .split_once('e')
        .and_then(|(digits, exponent)| Some((digits, exponent.parse::<i32>().ok()?)))
        .unwrap_or(("0", 0));
    match usize::try_from(2 - exponent) {
        Ok(decimals) if decimals <= 8 => format!("{value:.decimals$}"),
        Ok(_) => scientific,
        // 12345 is shown as 12300.
        Err(_) => {
            let rounded = digits.parse::<f64>().unwrap_or(0.0) * 10_f64.powi(exponent);
            format!("{rounded:.0}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VERDICT: &str = r#"{ "schema": 1, "verdict": "cannot_tell", "family": "dry friction",
        "effects": [], "where": [{"kind": "of another thing"}], "closure": {"short": null},
        "alternatives": [ { "kinds": ["lugre_friction"], "probability": 0.6 },
                          { "kinds": ["creep", "gravity"], "probability": 0.4 } ],
        "upload": false, "seconds": 3.25 }"#;

    #[test]
    fn verdicts_are_read() {
        let verdict = Verdict::parse(VERDICT).unwrap();
        assert_eq!(verdict.verdict, "cannot_tell");
        assert!(verdict.named().is_empty());
        let sets: Vec<String> = verdict.sets().collect();
        assert_eq!(sets, ["lugre friction", "creep and gravity"]);
        assert_eq!(verdict.family.as_deref(), Some("dry friction"));
        assert!(!verdict.is_for_the_board() && !verdict.is_part());
        assert_eq!(verdict.seconds, Some(3.25));
        let found = Verdict::parse(
            r#"{"verdict": "effect_found", "strength": "part",
                "effects": [{"parameters": {"kind": 1}, "kind": "gravity"}]}"#,
        )
        .unwrap();
        assert_eq!(found.named(), ["gravity"]);
        assert!(found.is_for_the_board() && found.is_part());
        assert!(Verdict::parse("{}").is_err());
        assert!(Verdict::parse("effect_found").is_err());
    }

    #[test]
    fn each_verdict_has_a_sentence() {
        let mut verdict = Verdict::parse(VERDICT).unwrap();
        let said = verdict.sentence();
        assert!(
            said.contains("lugre friction, or creep and gravity (all are dry friction)"),
            "{said}"
        );
        verdict.effects = vec![Effect {
            kind: "gravity".into(),
            probability: None,
        }];
        for (name, part) in [
            ("effect_found", "gravity is missing."),
            ("parameters_only", "the parameters were off"),
            ("no_discrepancy", "right already"),
            ("unexplained", "no name is given"),
        ] {
            verdict.verdict = name.into();
            let said = verdict.sentence();
            assert!(said.contains(part) && !said.contains('_'), "{said}");
        }
    }
}
