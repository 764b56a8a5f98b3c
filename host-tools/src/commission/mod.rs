//! The result of an acceptance test: JSON, and one self-contained page.

use minijinja::value::Serde;
use minijinja::{Environment, UndefinedBehavior};
use schemars::JsonSchema;
use serde::Serialize;
use softrig_link::commission::{Curve, Measurement, Outcome, Result as Finding};
use softrig_link::rig_file::ClockRate;

use softrig_formats::numbers::four_digits;
use softrig_report::html::STYLE;
use softrig_report::plot::{Figure, Panel, Series, Style, to_inline_svg};

const TEMPLATE: &str = include_str!("page.html");

/// Everything that was found: the JSON, and the page's data.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct Report {
    /// The version of this format: 1.
    pub(crate) schema: u8,
    /// Whether no step failed.
    pub(crate) passed: bool,
    /// Whether a simulator was tested.
    pub(crate) simulated: bool,
    /// When it began (RFC 3339, UTC).
    pub(crate) started: String,
    /// How long it took (s).
    pub(crate) seconds: f64,
    /// Its serial port.
    pub(crate) port: String,
    /// The board, as `softrig.toml` names it.
    pub(crate) board: String,
    /// Version of its firmware.
    pub(crate) firmware: String,
    /// Version of its protocol.
    pub(crate) wire: u8,
    /// Checksum of its settings, as it says it itself.
    pub(crate) settings: String,
    /// Version of `softrig`.
    pub(crate) rig: String,
    /// System and processor of the computer.
    pub(crate) computer: String,
    /// The board's clock, where it was measured.
    pub(crate) clock: Option<ClockRate>,
    /// Every step, made or not, in its order.
    pub(crate) steps: Vec<Finding>,
}

/// Counts of steps.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Tally {
    pub(crate) passed: usize,
    pub(crate) failed: usize,
    pub(crate) skipped: usize,
}

impl Report {
    pub(crate) fn tally(&self) -> Tally {
        let count = |outcome| self.steps.iter().filter(|it| it.outcome == outcome).count();
        Tally {
            passed: count(Outcome::Passed),
            failed: count(Outcome::Failed),
            skipped: count(Outcome::Skipped),
        }
    }

    /// In one sentence.
    pub(crate) fn sentence(&self) -> String {
        let Tally {
            passed,
            failed,
            skipped,
        } = self.tally();
        let rest = match skipped {
            0 => String::new(),
            count => format!(", {count} not made"),
        };
        if failed == 0 {
            format!("{passed} steps passed{rest}")
        } else {
            format!("{failed} of {} steps failed{rest}", passed + failed)
        }
    }
}

#[derive(Debug, Serialize)]
struct Row {
    name: String,
    value: String,
    limit: String,
    passed: bool,
}

#[derive(Debug, Serialize)]
struct Card<'a> {
    finding: &'a Finding,
    rows: Vec<Row>,
    picture: Option<String>,
}

#[derive(Debug, Serialize)]
struct Page<'a> {
    style: &'static str,
    report: &'a Report,
    sentence: String,
    tally: Tally,
    duration: String,
    clock: Option<String>,
    cards: Vec<Card<'a>>,
}

/// The page.
///
/// # Errors
///
/// If the template and its data do not match, which no report is known to cause.
pub(crate) fn page(report: &Report) -> Result<String, minijinja::Error> {
    let cards = report
        .steps
        .iter()
        .map(|finding| Card {
            finding,
            rows: finding.measured.iter().map(row).collect(),
            picture: picture(finding),
        })
        .collect();
    let filled = Page {
        style: STYLE,
        report,
        sentence: report.sentence(),
        tally: report.tally(),
        duration: format!("{:.0} s", report.seconds),
        clock: report
            .clock
            .map(|it| format!("{:+.3} %", (it.factor - 1.0) * 100.0)),
        cards,
    };
    let mut environment = Environment::new();
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    // The name decides that values are escaped.
    environment.add_template("page.html", TEMPLATE)?;
    environment
        .get_template("page.html")?
        .render(Serde(&filled))
}

fn row(measured: &Measurement) -> Row {
    Row {
        name: measured.name.clone(),
        value: shown_value(measured),
        limit: shown_limit(measured),
        passed: measured.passed,
    }
}

/// The value with its unit.
pub(crate) fn shown_value(measured: &Measurement) -> String {
    if measured.is_flag() {
        return if measured.passed { "yes" } else { "no" }.to_owned();
    }
    match measured.value {
        Some(value) => format!("{} {}", number(value), unit(measured.unit))
            .trim_end()
            .to_owned(),
        None => "not measured".to_owned(),
    }
}

/// What it is held to.
pub(crate) fn shown_limit(measured: &Measurement) -> String {
    if measured.is_flag() {
        return String::new();
    }
    match (measured.least, measured.most) {
        (None, None) => String::new(),
        (None, Some(most)) => format!("at most {}", number(most)),
        (Some(least), None) => format!("at least {}", number(least)),
        (Some(least), Some(most)) if (least + most).abs() < f64::EPSILON => {
            format!("within ±{}", number(most))
        }
        (Some(least), Some(most)) => format!("{} to {}", number(least), number(most)),
    }
}

fn unit(unit: &str) -> &str {
    if unit == "1" { "" } else { unit }
}

fn number(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e6 {
        // Minus zero is zero.
        format!("{:.0}", value + 0.0)
    } else if value.abs() < 1e-3 {
        format!("{value:.1e}")
    } else {
        four_digits(value)
    }
}

fn picture(finding: &Finding) -> Option<String> {
    let curves: Vec<&Curve> = finding
        .curves
        .iter()
        .filter(|it| it.points.len() > 1)
        .collect();
    if curves.is_empty() {
        return None;
    }
    let mut figure = Figure::new("").with_columns(2).with_separate_x();
    figure.row_height_px = 170.0;
    for curve in curves {
        let (x, y): (Vec<f64>, Vec<f64>) = curve.points.iter().copied().unzip();
        figure = figure.with_panel(
            Panel::new(curve.x_label, curve.y_label)
                .with_legend(false)
                .with_series(Series::new(curve.y_label, &x, &y, Style::NOMINAL)),
        );
    }
    Some(to_inline_svg(&figure, finding.title))
}

#[cfg(test)]
mod tests {
    use super::*;
    use softrig_link::commission::{Limit, Step};

    fn report(steps: Vec<Finding>) -> Report {
        Report {
            schema: 1,
            passed: steps.iter().all(|it| it.outcome != Outcome::Failed),
            simulated: true,
            started: "2026-05-01T12:00:00Z".into(),
            seconds: 61.0,
            port: "/dev/<ttyACM0>".into(),
            board: "simulated".into(),
            firmware: "0.1.0".into(),
            wire: 3,
            settings: "f21b".into(),
            rig: "0.1.0".into(),
            computer: "linux".into(),
            clock: None,
            steps,
        }
    }

    #[test]
    fn the_page_says_what_failed_with_its_limit_and_what_to_do() {
        let lost = Measurement::new("lines lost on the way", 3.0, "", Limit::AtMost(0.0));
        let failed = Finding::judge(Step::Telemetry, vec![lost], "").with_curves(vec![Curve {
            x_label: "time (s)",
            y_label: "angle (°)",
            points: vec![(0.0, 1.0), (1.0, 2.0)],
        }]);
        let skipped = Finding::skipped(Step::Relief, "The virtual rig has no relief valve.");
        let page = page(&report(vec![failed, skipped])).unwrap();
        for part in [
            "1 of 1 steps failed, 1 not made",
            "lines lost on the way",
            "at most 0",
            "Use another cable",
            "no relief valve",
            "<svg",
            "&lt;ttyACM0&gt;",
        ] {
            assert!(page.contains(part), "{part}");
        }
        for elsewhere in ["src=", "href=\"http", "url("] {
            assert!(!page.contains(elsewhere), "{elsewhere}: not self-contained");
        }
    }

    #[test]
    fn values_are_written_with_their_units_and_limits() {
        let shown = |measured: &Measurement| (shown_value(measured), shown_limit(measured));
        let pair = |value: &str, limit: &str| (value.to_owned(), limit.to_owned());
        let drift = Measurement::new("drift", -0.25, "kPa/min", Limit::Within(-1.0, 1.0));
        assert_eq!(shown(&drift), pair("-0.25 kPa/min", "within ±1"));
        let nothing = Measurement::new("time", f64::NAN, "s", Limit::AtMost(2.0));
        assert_eq!(shown(&nothing), pair("not measured", "at most 2"));
        assert_eq!(shown(&Measurement::flag("closed", true)), pair("yes", ""));
        let count = Measurement::new("lines", 6000.0, "", Limit::AtLeast(5994.0));
        assert_eq!(shown(&count), pair("6000", "at least 5994"));
    }
}
