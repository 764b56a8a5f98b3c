//! The results of `softrig diagnose` and of the black-box models, as the page shows them.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::invariance::known::read_json;

/// The Python script's results.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct BlackBoxes {
    /// A linear model.
    pub arx: BlackBox,
    /// A polynomial.
    pub narx: BlackBox,
    /// Whether all recordings have one sampling rate.
    #[serde(default)]
    pub sampled_alike: bool,
}

impl BlackBoxes {
    /// Reads the script's file.
    ///
    /// # Errors
    ///
    /// What is wrong with it.
    pub fn read(path: &Path) -> Result<Self, String> {
        read_json(path)
    }
}

/// One black box.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct BlackBox {
    #[serde(default)]
    diverges: bool,
    rms_deg: Option<f64>,
    /// The error of [`rms`](Self::rms) with zeros and start estimated on the validation
    /// recordings (°).
    #[serde(rename = "rms_with_freedom_deg")]
    pub with_freedom: Option<f64>,
    output_lags: Vec<u32>,
    input_lags: Vec<u32>,
    terms: u32,
    degree: u32,
    /// Its sampling rate (Hz).
    pub rate_hz: f64,
    /// Wall and CPU time (s).
    #[serde(flatten)]
    pub seconds: Seconds,
}

impl BlackBox {
    /// Held-out RMS error (°) of the free run from measured samples; none if it diverges.
    pub fn rms(&self) -> Option<f64> {
        self.rms_deg.filter(|_| !self.diverges)
    }
}

/// How long something took.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub struct Seconds {
    /// Wall time (s).
    #[serde(rename = "wall_s")]
    pub wall: f64,
    /// CPU time of all cores (s), where the system tells.
    #[serde(rename = "cpu_s")]
    pub cpu: Option<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use softrig_tests::verdict::{Verdict, significant};

    /// As `softrig` wrote it before answers were graded.
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
        let diagnosed = Verdict::parse(PLAIN).unwrap();
        assert_eq!(diagnosed.in_a_cell(), "gravity and coulomb friction");
        assert_eq!(diagnosed.closed(), Some(0.951));
        assert_eq!(diagnosed.holdout_rmse_deg.nominal, Some(4.0));
        assert_eq!(diagnosed.ratio(), Some(0.2));
        assert_eq!(
            (diagnosed.repair.as_ref(), diagnosed.remaining.as_ref()),
            (None, None)
        );
        assert!(diagnosed.names_something());
        assert_eq!(
            diagnosed.report(),
            "Gravity and coulomb friction are missing."
        );
    }

    #[test]
    fn the_fields_of_graded_answers_are_read() {
        let diagnosed = Verdict::parse(GRADED).unwrap();
        assert_eq!(diagnosed.closed(), Some(0.72));
        assert_eq!(
            diagnosed.in_a_cell(),
            "unexplained; table of rate and angle"
        );
        assert_eq!(
            (diagnosed.holdout_rmse_deg.refit, diagnosed.ratio()),
            (None, None)
        );
        assert!(!diagnosed.names_something());
        let said = diagnosed.report();
        assert!(
            said.ends_with("0.190 remain, 12.0 times the noise, and go with the pressure."),
            "{said}"
        );

        let strong = PLAIN.replace("\"schema\": 1", "\"strength\": \"explains\"");
        let part = PLAIN.replace("\"schema\": 1", "\"strength\": \"part\"");
        for (text, end) in [(strong, "(explains)"), (part, "(part)")] {
            assert!(Verdict::parse(&text).unwrap().in_a_cell().ends_with(end));
        }
        let family = r#"{"verdict": "cannot_tell", "family": "dry friction", "alternatives":
            [{"kinds": ["a"]}, {"kinds": ["b", "c_d"]}, {"kinds": ["e"]}, {"kinds": ["f"]}]}"#;
        let open = Verdict::parse(family).unwrap();
        assert_eq!(
            open.in_a_cell(),
            "family dry friction: a / b and c d / e / …"
        );
        assert_eq!(open.heading(), "family dry friction");
        assert!(open.names_something());
    }

    #[test]
    fn black_boxes_are_read() {
        let text = r#"{"rms_deg": null, "diverges": true, "rms_with_freedom_deg": null,
            "output_lags": [1, 2], "input_lags": [0], "terms": 4, "degree": 1,
            "rate_hz": 12.5, "wall_s": 0.25, "cpu_s": 0.125}"#;
        let arx: BlackBox = serde_json::from_str(text).unwrap();
        assert_eq!((arx.rms(), arx.with_freedom), (None, None));
        assert_eq!((arx.seconds.wall, arx.seconds.cpu), (0.25, Some(0.125)));
        assert!(serde_json::from_str::<BlackBox>("{}").is_err());
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
