//! Reads the results of `rig diagnose` and the black-box models.

use crate::{
    json::Value,
    rig_loop::{Verdict, in_words},
};

/// Rivals that are listed of an answer that is left open.
const MOST_RIVALS: usize = 3;

/// The results of a diagnosis that the table shows. All but the verdict may be
/// absent: older and newer versions of `rig` write other fields.
#[derive(Clone, Debug, PartialEq)]
pub struct Diagnosed {
    /// The answer.
    pub verdict: Verdict,
    /// Whether `strength` is given.
    pub has_strength: bool,
    /// How much of the gap is explained, 0 to 1.
    pub closure: Option<f64>,
    /// Held-out RMS error (°) of the model as supplied.
    pub nominal: Option<f64>,
    /// The same, refitted.
    pub refit: Option<f64>,
    /// The same, with the repair.
    pub repaired: Option<f64>,
    /// The repair, where it is not a named effect: its kind and variables.
    pub repair: Option<(String, Vec<String>)>,
    /// The discrepancy that remains after the repair.
    pub remaining: Option<Remaining>,
}

/// The remaining discrepancy.
#[derive(Clone, Debug, PartialEq)]
pub struct Remaining {
    /// RMS error (°).
    pub rmse_deg: Option<f64>,
    /// How many times the noise that is.
    pub times_noise: Option<f64>,
    /// The variable with which it goes.
    pub goes_with: Option<String>,
}

impl Diagnosed {
    /// Reads the text of a verdict; none if it is no verdict.
    pub fn parse(text: &str) -> Option<Self> {
        let verdict = Verdict::parse(text)?;
        let json = Value::parse(text)?;
        let number = |keys: [&str; 2]| json.get(keys[0])?.get(keys[1])?.number();
        let said =
            |value: &Value, key: &str| value.get(key).and_then(Value::text).map(str::to_owned);
        Some(Self {
            verdict,
            has_strength: said(&json, "strength").is_some(),
            closure: number(["closure", "overall"])
                .or_else(|| number(["adequacy", "holdout_gap_closed"])),
            nominal: number(["holdout_rmse_deg", "nominal"]),
            refit: number(["holdout_rmse_deg", "refit"]),
            repaired: number(["holdout_rmse_deg", "repaired"]),
            repair: json.get("repair").and_then(|repair| {
                let of = repair.get("of").map_or(&[][..], Value::items);
                let of = of.iter().filter_map(Value::text).map(str::to_owned);
                Some((said(repair, "kind")?, of.collect()))
            }),
            remaining: json.get("remaining").and_then(|remaining| {
                let number = |key| remaining.get(key).and_then(Value::number);
                let remaining = Remaining {
                    rmse_deg: number("rmse_deg"),
                    times_noise: number("times_noise"),
                    goes_with: said(remaining, "goes_with"),
                };
                remaining.rmse_deg.is_some().then_some(remaining)
            }),
        })
    }

    /// The answer in a few words, for the heading of a picture: of a family, without its
    /// members, which stand in the text beside it.
    pub fn heading(&self) -> String {
        match &self.verdict.family {
            Some(family) if self.verdict.answer == "cannot_tell" => format!("family {family}"),
            _ => self.answer(),
        }
    }

    /// The answer in one cell.
    pub fn answer(&self) -> String {
        let verdict = &self.verdict;
        let mut text = match verdict.answer.as_str() {
            "effect_found" => {
                let named = in_words(&verdict.named);
                match (self.has_strength, verdict.is_part) {
                    (false, _) => named,
                    (true, false) => format!("{named} (explains)"),
                    (true, true) => format!("{named} (part)"),
                }
            }
            "cannot_tell" => {
                let rivals = verdict.alternatives.iter().take(MOST_RIVALS);
                let mut rivals: Vec<String> = rivals.map(|kinds| in_words(kinds)).collect();
                if verdict.alternatives.len() > MOST_RIVALS {
                    rivals.push("…".into());
                }
                let rivals = rivals.join(" / ");
                match &verdict.family {
                    Some(family) => format!("family {family}: {rivals}"),
                    None => format!("cannot tell: {rivals}"),
                }
            }
            "parameters_only" => "parameters only".into(),
            "no_discrepancy" => "nothing missing".into(),
            other => other.replace('_', " "),
        };
        if let Some((kind, of)) = &self.repair {
            text += &format!("; {kind}");
            if !of.is_empty() {
                text += &format!(" of {}", in_words(of));
            }
        }
        text
    }

    /// Whether an effect or a family is named.
    pub fn names_something(&self) -> bool {
        !self.verdict.named.is_empty() || self.verdict.family.is_some()
    }

    /// Whether the answer is that no effect is missing.
    pub fn lacks_nothing(&self) -> bool {
        ["parameters_only", "no_discrepancy"].contains(&self.verdict.answer.as_str())
    }

    /// The repaired over the refitted error.
    pub fn ratio(&self) -> Option<f64> {
        Some(self.repaired? / self.refit?).filter(|ratio| ratio.is_finite())
    }

    /// Sentences on what is missing, for people.
    pub fn sentence(&self) -> String {
        let said = self.verdict.sentence();
        let mut letters = said.chars();
        let mut said: String = letters
            .next()
            .map(|first| first.to_uppercase().chain(letters).collect())
            .unwrap_or_default();
        if let Some((kind, of)) = &self.repair {
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

/// The Python script's results for one black box.
#[derive(Clone, Debug, PartialEq)]
pub struct BlackBox {
    /// Held-out RMS error (°) of the free run from measured samples; none if it diverges.
    pub rms: Option<f64>,
    /// The same with zeros and start estimated on the validation recordings.
    pub with_freedom: Option<f64>,
    /// Past outputs, inputs, terms, and their degree.
    pub orders: [u32; 4],
    /// Its sampling rate (Hz).
    pub rate_hz: f64,
    /// Wall and CPU time (s).
    pub seconds: Seconds,
}

impl BlackBox {
    /// Reads one of the script's results.
    pub fn parse(json: &Value, name: &str) -> Option<Self> {
        let model = json.get(name)?;
        let number = |key: &str| model.get(key).and_then(Value::number);
        let length = |key: &str| {
            let items = model.get(key).map_or(&[][..], Value::items);
            u32::try_from(items.len()).unwrap_or(u32::MAX)
        };
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let count = |key: &str| number(key).map(|value| value as u32);
        let diverges = model.get("diverges") == Some(&Value::Bool(true));
        Some(Self {
            rms: number("rms_deg").filter(|_| !diverges),
            with_freedom: number("rms_with_freedom_deg"),
            orders: [
                length("output_lags"),
                length("input_lags"),
                count("terms")?,
                count("degree")?,
            ],
            rate_hz: number("rate_hz")?,
            seconds: Seconds {
                wall: number("wall_s")?,
                cpu: number("cpu_s"),
            },
        })
    }

    /// Its orders in words.
    pub fn words(&self) -> String {
        let [outputs, inputs, terms, degree] = self.orders;
        format!(
            "past outputs {outputs}, inputs {inputs}, terms {terms} (degree {degree}), at {} Hz",
            significant(self.rate_hz)
        )
    }
}

/// How long something took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seconds {
    /// Wall time (s).
    pub wall: f64,
    /// CPU time of all cores (s), where the system tells.
    pub cpu: Option<f64>,
}

impl Seconds {
    /// `wall (CPU)`.
    pub fn words(self) -> String {
        let cpu = self.cpu.map_or("–".into(), |cpu| format!("{cpu:.1}"));
        format!("{:.1} ({cpu})", self.wall)
    }
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

    /// As `rig` wrote it before answers were graded.
    const PLAIN: &str = r#"{ "schema": 1, "verdict": "effect_found",
        "effects": [{"kind": "gravity"}, {"kind": "coulomb_friction"}],
        "alternatives": [], "adequacy": {"adequate": true, "holdout_gap_closed": 0.951},
        "holdout_rmse_deg": {"nominal": 4.0, "refit": 2.5, "repaired": 0.5}, "seconds": 3.2 }"#;

    /// With every field of the design.
    const GRADED: &str = r#"{ "verdict": "unexplained", "strength": "part", "effects": [],
        "closure": {"short": 0.1, "medium": 0.2, "full": 0.3, "overall": 0.72},
        "adequacy": {"holdout_gap_closed": 0.9},
        "remaining": {"rmse_deg": 0.19, "times_noise": 12, "goes_with": "pressure"},
        "repair": {"kind": "table", "of": ["rate", "angle"]} }"#;

    #[test]
    fn a_verdict_without_the_later_fields_is_read() {
        let diagnosed = Diagnosed::parse(PLAIN).unwrap();
        assert_eq!(diagnosed.answer(), "gravity and coulomb friction");
        assert_eq!(diagnosed.closure, Some(0.951));
        assert_eq!(diagnosed.nominal, Some(4.0));
        assert_eq!(diagnosed.ratio(), Some(0.2));
        assert_eq!(
            (diagnosed.repair.as_ref(), diagnosed.remaining.as_ref()),
            (None, None)
        );
        assert!(diagnosed.names_something());
        assert_eq!(
            diagnosed.sentence(),
            "Gravity and coulomb friction are missing."
        );
    }

    #[test]
    fn the_fields_of_graded_answers_are_read() {
        let diagnosed = Diagnosed::parse(GRADED).unwrap();
        assert_eq!(diagnosed.closure, Some(0.72));
        assert_eq!(diagnosed.answer(), "unexplained; table of rate and angle");
        assert_eq!((diagnosed.refit, diagnosed.ratio()), (None, None));
        assert!(!diagnosed.names_something());
        let said = diagnosed.sentence();
        assert!(
            said.ends_with("0.190 remain, 12.0 times the noise, and go with the pressure."),
            "{said}"
        );

        let strong = PLAIN.replace("\"schema\": 1", "\"strength\": \"explains\"");
        let part = PLAIN.replace("\"schema\": 1", "\"strength\": \"part\"");
        for (text, end) in [(strong, "(explains)"), (part, "(part)")] {
            assert!(Diagnosed::parse(&text).unwrap().answer().ends_with(end));
        }
        let family = r#"{"verdict": "cannot_tell", "family": "dry friction", "alternatives":
            [{"kinds": ["a"]}, {"kinds": ["b", "c_d"]}, {"kinds": ["e"]}, {"kinds": ["f"]}]}"#;
        let open = Diagnosed::parse(family).unwrap();
        assert_eq!(open.answer(), "family dry friction: a / b and c d / e / …");
        assert_eq!(open.heading(), "family dry friction");
        assert!(open.names_something());
        assert_eq!(Diagnosed::parse("{}"), None);
    }

    #[test]
    fn black_boxes_are_read() {
        let text = r#"{"arx": {"rms_deg": null, "diverges": true, "rms_with_freedom_deg": null,
            "output_lags": [1, 2], "input_lags": [0], "terms": 4, "degree": 1,
            "rate_hz": 12.5, "wall_s": 0.25, "cpu_s": 0.125}, "narx": {}}"#;
        let json = Value::parse(text).unwrap();
        let arx = BlackBox::parse(&json, "arx").unwrap();
        assert_eq!((arx.rms, arx.with_freedom), (None, None));
        assert_eq!(
            arx.words(),
            "past outputs 2, inputs 1, terms 4 (degree 1), at 12.5 Hz"
        );
        assert_eq!(arx.seconds.words(), "0.2 (0.1)");
        assert_eq!(BlackBox::parse(&json, "narx"), None);
        assert_eq!(BlackBox::parse(&json, "mlp"), None);
    }

    #[test]
    fn numbers_have_three_significant_digits() {
        for (value, text) in [
            (0.0, "0"),
            (0.084_12, "0.0841"),
            (0.999_6, "1.00"),
            (2.469_57, "2.47"),
            (9.996, "10.0"),
            (42.497, "42.5"),
            (123.4, "123"),
            (12_345.0, "12300"),
            (-0.002_353, "-0.00235"),
            (f64::NAN, "–"),
            (f64::INFINITY, "–"),
        ] {
            assert_eq!(significant(value), text);
        }
    }
}
