//! The residual before and after the repair: one sentence and two panels on whether it is
//! white and whether it is correlated with the pressure ([`super::correlation`]).

use super::correlation::{Correlation, Correlations, Level, RunResiduals};
use super::pictures::{COLUMN_PX, NOMINAL, REFITTED, REPAIRED, ROW_HEIGHT_PX, style_of};
use super::runs::RunView;
use crate::plot::{Figure, Mark, Panel, Role, Series, Style};
use softrig::diagnose::Diagnosis;
use softrig::diagnose::decide::finding::Finding;
use softrig::estimate::filter::Pace;
use softrig_formats::numbers::{percent, short};

/// Largest lag, in swing periods: a longer correlation is an offset.
const SWINGS: f64 = 1.0;

/// A correlation below this is a hundredth of the power, and not worth a repair.
const FAINT: f64 = 0.1;

/// The residual of a model.
#[derive(Clone, Debug)]
pub struct Left {
    /// Which model, by the label of its curve.
    pub label: &'static str,
    /// Its correlations.
    pub correlations: Correlations,
}

/// The residuals of the models, before and after.
#[derive(Clone, Debug)]
pub struct Residuals {
    /// In the order of the steps; one where nothing was changed.
    pub left: Vec<Left>,
    /// Whether they are of held-out runs.
    pub held_out: bool,
}

impl Residuals {
    /// Correlates the residuals of the held-out runs, or of the fitted runs if there are no
    /// others; none if they are zero.
    pub fn of(diagnosis: &Diagnosis, views: &[RunView<'_>]) -> Option<Self> {
        let held_out = views.iter().any(|view| view.held_out);
        let chosen: Vec<&RunView<'_>> = views
            .iter()
            .filter(|view| view.held_out == held_out)
            .collect();
        let longest = SWINGS * Pace::of(&diagnosis.data).period;
        let labels: &[&'static str] = match diagnosis.finding {
            Finding::Quiet {
                refitted: false, ..
            } => &[NOMINAL],
            Finding::Quiet { refitted: true, .. } => &[NOMINAL, REFITTED],
            _ if diagnosis.repaired.added.is_empty() => &[REFITTED],
            _ => &[REFITTED, REPAIRED],
        };
        let left: Vec<Left> = labels
            .iter()
            .filter_map(|&label| {
                let runs: Vec<RunResiduals<'_>> = chosen
                    .iter()
                    .map(|view| RunResiduals {
                        time: &view.recording.time,
                        residual: match label {
                            NOMINAL => &view.nominal,
                            REFITTED => &view.refit,
                            _ => &view.repaired,
                        },
                        input: &view.pressure,
                        silent: &view.silent,
                    })
                    .collect();
                let correlations = Correlations::of(&runs, longest)?;
                Some(Left {
                    label,
                    correlations,
                })
            })
            .collect();
        (!left.is_empty()).then_some(Self { left, held_out })
    }

    /// A sentence about the last model, and the change from the first.
    pub fn sentence(&self) -> String {
        let Some(last) = self.left.last() else {
            return String::new();
        };
        let Correlations {
            own, with_input, ..
        } = &last.correlations;
        let itself = whiteness(own);
        let and = match (with_input, itself.is_white) {
            (None, _) => ". The pressure never changes in these runs.".to_owned(),
            (Some(input), white) => match going_with(input) {
                Some(goes) if white => format!(", but {goes}."),
                Some(goes) => format!(", and {goes}."),
                None if white => ", and does not go with the pressure.".to_owned(),
                // A slow residual hides its correlation with a slow input.
                None => format!(
                    "; its correlation with the pressure ({}) is within chance for signals this \
                     slow.",
                    short(input.peak().map_or(0.0, |(_, peak)| peak.abs()))
                ),
            },
        };
        let before = match &self.left[..] {
            [first, _] => format!(" {}", change(first, last)),
            _ => String::new(),
        };
        format!("{}{and}{before}", itself.text)
    }

    /// The caption of the panels.
    pub fn caption(&self) -> String {
        let samples = self.left.last().map_or(0, |left| left.correlations.samples);
        let runs = if self.held_out {
            "the validation runs"
        } else {
            "the fitted runs"
        };
        format!(
            "Simulated minus measured angle of {runs}, {samples} samples. First: its correlation \
             with itself a lag earlier; white noise stays within the grey band, ±1.96/√N, at 95 % \
             of the lags. Second: its correlation with the pressure a lag earlier; the band of the \
             same colour holds 95 % of chance correlations between signals this slow. \
             Beyond it at lags above zero are dynamics that the model lacks; below zero \
             the pressure follows the angle, as under a controller. (Residual analysis: Ljung, \
             System Identification, §16.6.)"
        )
    }

    /// The two panels.
    pub fn figures(&self) -> Vec<(&'static str, Figure)> {
        let mut own = panel("correlation with itself");
        if let Some(left) = self.left.last() {
            own = own.with_series(band(&left.correlations.own, "95 %", Role::Measured));
        }
        let mut crossed = panel("correlation with the pressure");
        for left in &self.left {
            let style = Style::new(style_of(left.label).role, Mark::Line);
            let line = |of: &Correlation| Series::new(left.label, &of.lag, &of.value, style);
            own = own.with_series(line(&left.correlations.own));
            if let Some(input) = &left.correlations.with_input {
                crossed = crossed
                    .with_series(band(input, "", style.role))
                    .with_series(line(input));
            }
        }
        let mut figures = vec![("Autocorrelation of the residual", own)];
        if !crossed.series.is_empty() {
            figures.push(("Correlation of the residual with the pressure", crossed));
        }
        let figure = |panel| {
            let mut figure = Figure::new("").with_panel(panel);
            figure.width_px = COLUMN_PX;
            figure.row_height_px = ROW_HEIGHT_PX;
            figure
        };
        figures
            .into_iter()
            .map(|(name, panel)| (name, figure(panel)))
            .collect()
    }
}

fn panel(what: &str) -> Panel {
    Panel::new("lag (s)", what).with_level(0.0)
}

fn band(of: &Correlation, label: &str, role: Role) -> Series {
    let ends = [of.lag.first(), of.lag.last()].map(|lag| lag.copied().unwrap_or(0.0));
    Series::band(label, &ends, &[-of.band; 2], &[of.band; 2], role)
}

/// The whiteness of a residual.
struct Whiteness {
    is_white: bool,
    text: String,
}

fn whiteness(own: &Correlation) -> Whiteness {
    let (lag, peak) = own.peak().unwrap_or((0.0, 0.0));
    let share = percent(own.share_outside(Level::P95));
    if own.is_white(Level::P95) {
        Whiteness {
            is_white: true,
            text: format!(
                "What is left is white ({share} of the lags lie outside the band; 5 % do by \
                 chance)"
            ),
        }
    } else if peak.abs() < FAINT {
        Whiteness {
            is_white: true,
            text: format!(
                "What is left is nearly white ({share} of the lags lie outside of the band, but no \
                 correlation is larger than {})",
                short(peak.abs())
            ),
        }
    } else {
        let memory = match own.memory() {
            Some(memory) => format!("and is lost after {} s", short(memory)),
            None => "and is not lost at any lag shown".to_owned(),
        };
        Whiteness {
            is_white: false,
            text: format!(
                "What is left is not white: its autocorrelation is {} at {} s {memory}",
                short(peak),
                short(lag)
            ),
        }
    }
}

/// A clause that the residual is correlated with the pressure; none if it is not.
fn going_with(input: &Correlation) -> Option<String> {
    let (lag, peak) = input.peak()?;
    (input.is_beyond_chance() && peak.abs() >= FAINT).then(|| {
        format!(
            "goes with the pressure (correlation {} with that {} s before)",
            short(peak),
            short(lag)
        )
    })
}

/// The largest correlations before and after.
fn change(first: &Left, last: &Left) -> String {
    let size = |of: &Correlation| of.peak().map_or(0.0, |(_, peak)| peak.abs());
    let from_to = |before: &Correlation, after: &Correlation| {
        format!("{} → {}", short(size(before)), short(size(after)))
    };
    let [before, after] = [first, last].map(|left| &left.correlations);
    let mut said = format!(
        "Largest correlation, {} → {}: {} with itself",
        first.label,
        last.label,
        from_to(&before.own, &after.own)
    );
    if let (Some(before), Some(after)) = (&before.with_input, &after.with_input) {
        said += &format!(", {} with the pressure", from_to(before, after));
    }
    said + "."
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(value: f64) -> Correlation {
        Correlation {
            lag: (0..=100).map(|k| f64::from(k) * 0.01).collect(),
            value: (0..=100)
                .map(|k| if k == 0 { 1.0 } else { value })
                .collect(),
            band: 0.02,
        }
    }

    fn left(label: &'static str, own: f64, with_input: f64) -> Left {
        Left {
            label,
            correlations: Correlations {
                own: flat(own),
                with_input: Some(flat(with_input)),
                samples: 9_604,
            },
        }
    }

    #[test]
    fn the_sentence_says_what_the_panels_show() {
        let said = |own, with_input| {
            Residuals {
                left: vec![left(REFITTED, 0.6, 0.5), left(REPAIRED, own, with_input)],
                held_out: true,
            }
            .sentence()
        };
        let white = said(0.01, -0.01);
        assert!(white.starts_with("What is left is white"), "{white}");
        assert!(white.contains("and does not go with the pressure."));
        assert!(white.contains("0.600 → 0.0100 with itself, 0.500 → 0.0100 with the pressure."));
        let faint = said(0.05, 0.01);
        assert!(faint.starts_with("What is left is nearly white"), "{faint}");
        let coloured = said(0.3, -0.4);
        assert!(coloured.contains("is not white"), "{coloured}");
        assert!(coloured.contains("and is not lost at any lag shown, and goes with"));
        assert!(said(0.3, 0.01).contains("the pressure (0.0100) is within chance"));
    }
}
