//! The report: one self-contained HTML file.
//!
//! The texts come from [`super::content`], the pictures from [`super::pictures`]; the
//! template arranges them. The template engine escapes all input of a user, down to the
//! names of files; only our own drawings, style and script are inserted unescaped.

use minijinja::value::Serde;
use minijinja::{Environment, UndefinedBehavior, Value};
use serde::Serialize;

use super::confidence::Confidence;
use super::content::{CLOSEST, Content};
use super::equation;
use super::pictures::{
    MEASURED, curves_of, error_of, feature_figure, force_figure, is_thinner_than_its_line,
    largest_forces, map_figure, run_figure, style_of,
};
use super::provenance::{FITTED, Provenance, Source};
use super::residuals::Residuals;
use super::runs::{RunView, runs};
use crate::plot::{Figure, Mark, css_colour, diverging, to_inline_svg};
use softrig::diagnose::decide::verdict::Answer;
use softrig::diagnose::score::localise::{Feature, Gap, SINCE_LAST_EDGE};
use softrig::diagnose::{Diagnosis, Request};
use softrig::statistics::{median, squares_about_mean};
use softrig_formats::numbers::{fit, percent, short};
use softrig_formats::terminal::printable;

const TEMPLATE: &str = include_str!("assets/template.html");
/// The style of all pages.
pub const STYLE: &str = include_str!("assets/style.css");
const SCRIPT: &str = include_str!("assets/script.js");

/// Number of drawn runs; others are in the table only.
const RUNS_DRAWN: usize = 12;

/// Number of drawn features besides the time since the last edge, strongest first. An
/// even number fills the rows.
const FEATURES_DRAWN: usize = 4;

/// Least share of a drawn feature; the first two are always drawn.
const FEATURE_WORTH: f64 = 0.1;

/// The note where the repaired model is not the best fit to whole runs.
const HORIZON: &str = "The repaired model was fitted over the shorter horizon at which it predicts validation runs best. The others were fitted over whole runs, so their errors on fitted runs are smaller.";

/// A picture with its caption.
#[derive(Debug, Serialize)]
struct Picture {
    svg: String,
    title: String,
    caption: String,
    /// Number of the run that it shows, if it shows one.
    run: Option<usize>,
}

/// A map with its scale.
#[derive(Debug, Serialize)]
struct Map {
    picture: Picture,
    /// The forces at the ends of the scale.
    scale: [String; 3],
    /// The colours of the scale.
    colours: String,
}

/// The residual, before and after.
#[derive(Debug, Serialize)]
struct Left {
    sentence: String,
    caption: String,
    panels: Vec<String>,
}

/// A run as a row of the table.
#[derive(Debug, Serialize)]
struct RunRow {
    name: String,
    role: &'static str,
    seconds: String,
    samples: usize,
    /// Nominal, refitted, repaired.
    errors: [String; 3],
    /// Their fits.
    fits: [String; 3],
    /// Refitted and repaired while the run was left out.
    left_out: Option<[String; 2]>,
}

/// A curve that can be switched off.
#[derive(Debug, Serialize)]
struct Legend {
    label: &'static str,
    colour: String,
    mark: &'static str,
}

/// A run that can be switched off.
#[derive(Debug, Serialize)]
struct Switch {
    key: usize,
    name: String,
    colour: String,
}

/// The data of the template.
#[derive(Debug, Serialize)]
struct Page<'a> {
    style: &'static str,
    script: &'static str,
    content: &'a Content,
    model: &'a str,
    simulated: bool,
    something_is_missing: bool,
    closest: &'static str,
    in_turn: bool,
    gap_switches: Vec<Switch>,
    force: Option<Picture>,
    features: Vec<Picture>,
    maps: Vec<Map>,
    legend: Vec<Legend>,
    run_switches: Vec<Switch>,
    runs: Vec<Picture>,
    /// Explains the band behind a curve, or why there is none.
    confidence: Option<String>,
    /// Why the errors on fitted runs are not all of one kind.
    horizon: Option<&'static str>,
    left: Option<Left>,
    runs_total: usize,
    table: Vec<RunRow>,
    model_text: String,
    noise: Vec<[String; 2]>,
    provenance: &'a Provenance,
    files: Vec<Source>,
    seed: u64,
    seconds: String,
}

/// Makes the page. The same diagnosis gives the same bytes, but for the line
/// with `seconds`, the wall time.
///
/// # Errors
///
/// If the template and its data do not match, which no diagnosis is known to cause.
pub fn page(
    request: &Request<'_>,
    diagnosis: &Diagnosis,
    content: &Content,
    provenance: &Provenance,
    seconds: f64,
) -> Result<String, minijinja::Error> {
    let views = runs(diagnosis);
    let drawn = most_telling(&views);
    let missing = content.something_is_missing();
    let curves = curves_of(diagnosis);
    let confidence = Confidence::of(request, diagnosis);
    let shown: Vec<(usize, &str)> = largest_forces(diagnosis)
        .into_iter()
        .filter_map(|index| Some((index, views.get(index)?.recording.name.as_str())))
        .collect();
    let filled = Page {
        style: STYLE,
        script: SCRIPT,
        content,
        model: &request.file.name,
        simulated: views
            .iter()
            .all(|view| view.recording.meta.simulated == Some(true)),
        something_is_missing: missing,
        closest: CLOSEST,
        in_turn: diagnosis.held_out.in_turn,
        gap_switches: if missing {
            shown
                .iter()
                .enumerate()
                .map(|(place, &(key, name))| Switch {
                    key,
                    name: name.to_owned(),
                    colour: css_colour(crate::plot::Role::Other(place)),
                })
                .collect()
        } else {
            Vec::new()
        },
        force: if missing {
            Some(force_picture(&diagnosis.gap, &shown))
        } else {
            None
        },
        features: if missing {
            features(&diagnosis.gap)
        } else {
            Vec::new()
        },
        maps: if content.answer == Answer::Unexplained {
            maps(&diagnosis.gap)
        } else {
            Vec::new()
        },
        legend: legend(&curves[0]),
        run_switches: drawn
            .iter()
            .map(|&view| Switch {
                key: view,
                name: views[view].recording.name.clone(),
                colour: String::new(),
            })
            .collect(),
        runs: drawn
            .iter()
            .map(|&view| run_picture(view, &views[view], &curves, confidence.as_ref()))
            .collect(),
        confidence: confidence.as_ref().map(Confidence::text),
        horizon: (content.repaired && diagnosis.repaired.level.is_some()).then_some(HORIZON),
        left: Residuals::of(diagnosis, &views).as_ref().map(left),
        runs_total: views.len(),
        table: views.iter().map(run_row).collect(),
        model_text: diagnosis.model_text(request.file),
        noise: noise(diagnosis),
        files: files(diagnosis.left_out, provenance),
        provenance,
        seed: request.seed,
        seconds: format!("{seconds:.1}"),
    };
    let mut environment = Environment::new();
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment.add_filter("set", set);
    environment.add_filter("equation", equation);
    // A name may hold what an editor or a terminal obeys in the source of the page.
    environment.set_formatter(|out, state, value| match value.as_str() {
        Some(text) if !value.is_safe() => {
            minijinja::escape_formatter(out, state, &Value::from(printable(text)))
        }
        _ => minijinja::escape_formatter(out, state, value),
    });
    // The name decides that values are escaped.
    environment.add_template("report.html", TEMPLATE)?;
    environment
        .get_template("report.html")?
        .render(Serde(&filled))
}

/// Sets an equation or a symbol.
#[allow(clippy::needless_pass_by_value)] // the signature that a filter has
fn equation(plain: String) -> Value {
    Value::from_safe_string(equation::html(&plain))
}

/// Sets a text typographically: a number stays on one line with its unit, and a minus is
/// not a hyphen.
#[allow(clippy::needless_pass_by_value)] // the signature that a filter has
fn set(text: String) -> String {
    let text = text.replace(" %", "\u{a0}%").replace(" N ", "\u{a0}N ");
    let mut set = String::with_capacity(text.len());
    let mut before = ' ';
    let mut letters = text.chars().peekable();
    while let Some(letter) = letters.next() {
        let number_follows = letters.peek().is_some_and(char::is_ascii_digit);
        let is_minus = letter == '-' && number_follows && matches!(before, ' ' | '(' | 'e');
        set.push(if is_minus { '−' } else { letter });
        before = letter;
    }
    set
}

/// The drawn runs, in order: all of them, or those with the largest error of the refit.
fn most_telling(views: &[RunView<'_>]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..views.len()).collect();
    order.sort_by(|&a, &b| views[b].rms()[1].total_cmp(&views[a].rms()[1]));
    order.truncate(RUNS_DRAWN);
    order.sort_unstable();
    order
}

fn picture(figure: &Figure, title: String, caption: String) -> Picture {
    let spoken = format!("{title}. {caption}");
    Picture {
        svg: to_inline_svg(figure, &spoken),
        title,
        caption,
        run: None,
    }
}

fn force_picture(gap: &Gap, shown: &[(usize, &str)]) -> Picture {
    picture(
        &force_figure(gap, shown),
        "Over the time of each recording".into(),
        "Missing force of the refitted model, estimated from the angle alone, in the runs where it \
         is largest."
            .into(),
    )
}

fn features(gap: &Gap) -> Vec<Picture> {
    let folded = |feature: &&Feature| feature.name == SINCE_LAST_EDGE;
    let mut others: Vec<&Feature> = gap
        .features
        .iter()
        // The number of a run is no state; the pictures of runs show it.
        .filter(|feature| !folded(feature) && feature.unit != "number")
        .enumerate()
        .filter(|(place, feature)| *place < 2 || feature.share > FEATURE_WORTH)
        .map(|(_, feature)| feature)
        .take(FEATURES_DRAWN)
        .collect();
    others.truncate(others.len() / 2 * 2);
    gap.features
        .iter()
        .filter(folded)
        .chain(others)
        .map(|feature| {
            picture(
                &feature_figure(feature, &gap.measurand),
                format!(
                    "Against the {}",
                    gap.measurand.named(feature.name, feature.unit).0
                ),
                format!(
                    "It explains {} of the missing force. Dots: single samples; line and band: \
                     their mean and standard deviation.",
                    percent(feature.share)
                ),
            )
        })
        .collect()
}

fn maps(gap: &Gap) -> Vec<Map> {
    let titles = ["Over the state", "Over time"];
    let colours = [-1.0, -0.5, 0.0, 0.5, 1.0]
        .map(|shade| {
            let (red, green, blue) = diverging(shade);
            format!("rgb({red},{green},{blue})")
        })
        .join(", ");
    gap.maps
        .iter()
        .zip(titles)
        .filter_map(|(map, title)| map_figure(map, &gap.measurand).map(|drawn| (map, title, drawn)))
        .map(|(map, title, (figure, scale))| {
            let [across, up] =
                [0, 1].map(|at: usize| gap.measurand.named(map.axes[at].name, map.axes[at].unit).0);
            let caption = format!(
                "Mean missing force for each {across} and {up}; blank where data are too sparse."
            );
            Map {
                picture: picture(&figure, title.to_owned(), caption),
                scale: [
                    format!("{} N", short(-scale)),
                    "0".to_owned(),
                    format!("+{} N", short(scale)),
                ],
                colours: colours.clone(),
            }
        })
        .collect()
}

/// The curves of the runs' pictures.
fn legend(curves: &[&'static str]) -> Vec<Legend> {
    std::iter::once(MEASURED)
        .chain(curves.iter().copied())
        .map(|label| {
            let style = style_of(label);
            Legend {
                label,
                colour: css_colour(style.role),
                mark: match style.mark {
                    Mark::Dashed => "dashed",
                    Mark::Wide => "wide",
                    _ => "line",
                },
            }
        })
        .collect()
}

fn run_picture(
    place: usize,
    view: &RunView<'_>,
    curves: &[Vec<&'static str>; 2],
    confidence: Option<&Confidence>,
) -> Picture {
    let unit = view.recording.measurand.unit();
    let errors: Vec<String> = curves[1]
        .iter()
        .map(|label| format!("{}{unit} {label}", short(error_of(view, label))))
        .collect();
    let band = confidence.and_then(|all| Some((all.label, all.of_run(place)?)));
    let width = band.map_or_else(String::new, |(_, half)| {
        let thin = if is_thinner_than_its_line(view, half) {
            ", thinner than its line"
        } else {
            ""
        };
        let widest = half.iter().copied().fold(0.0, f64::max);
        let usual = median(&mut half.to_vec());
        format!(
            "; 95 % band ±{}{unit}, at most ±{}{unit}{thin}",
            short(usual),
            short(widest)
        )
    });
    let role = if view.held_out {
        "validation"
    } else {
        "fitted"
    };
    Picture {
        run: Some(place),
        ..picture(
            &run_figure(view, curves, band),
            view.recording.name.clone(),
            format!("{role}; RMS error {}{width}.", errors.join(", ")),
        )
    }
}

fn left(residuals: &Residuals) -> Left {
    let panels = residuals.figures();
    Left {
        sentence: residuals.sentence(),
        caption: residuals.caption(),
        panels: panels
            .iter()
            .map(|(name, figure)| to_inline_svg(figure, name))
            .collect(),
    }
}

fn run_row(view: &RunView<'_>) -> RunRow {
    let measured = &view.measured;
    let spread = (squares_about_mean(measured) / measured.len().max(1) as f64).sqrt();
    RunRow {
        name: view.recording.name.clone(),
        role: if view.held_out {
            "validation"
        } else {
            "fitted"
        },
        seconds: short(view.recording.duration()),
        samples: view.recording.len(),
        errors: view.errors().map(short),
        fits: view.errors().map(|error| fit(error, spread)),
        left_out: view
            .not_fitted
            .filter(|_| !view.held_out)
            .map(|[_, refit, repaired]| [refit, repaired].map(short)),
    }
}

/// The files and their roles: the model, then the recordings.
fn files(left_out: Option<usize>, provenance: &Provenance) -> Vec<Source> {
    let mut files = provenance.files.clone();
    let left_out = left_out.and_then(|recording| {
        let mut fitted = files.iter_mut().filter(|file| file.role == FITTED);
        fitted.nth(recording)
    });
    if let Some(file) = left_out {
        file.role = "left out";
    }
    files
}

/// The sources of the noise floor.
fn noise(diagnosis: &Diagnosis) -> Vec<[String; 2]> {
    let floor = &diagnosis.floor;
    let mut rows = vec![
        [
            "noise floor of the fitted runs".to_owned(),
            diagnosis.shown(floor.rms),
        ],
        [
            format!("noise of the {} sensor", diagnosis.data.measurand().name()),
            diagnosis.shown(floor.white),
        ],
    ];
    if let Some(repeats) = floor.repeats {
        rows.push([
            format!("spread between repeats ({} groups)", floor.groups.len()),
            diagnosis.shown(repeats),
        ]);
    }
    if let Some(rest) = floor.rest {
        rows.push([
            "noise at rest, about a line".to_owned(),
            diagnosis.shown(rest),
        ]);
    }
    if floor.quantisation_step > 0.0 {
        rows.push([
            "step of the converter".to_owned(),
            diagnosis.shown(floor.quantisation_step),
        ]);
    }
    rows.push([
        "left by the noise of the pressure, on top of the floor".to_owned(),
        diagnosis.shown(floor.input),
    ]);
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::provenance::METADATA;

    #[test]
    fn the_file_of_a_recording_that_was_left_out_says_so() {
        let source = |role| Source {
            role,
            path: String::new(),
            bytes: 0,
            sha256: String::new(),
        };
        let provenance = Provenance {
            files: ["model", FITTED, METADATA, FITTED, METADATA, "held out"]
                .map(source)
                .to_vec(),
            ..Provenance::default()
        };
        let roles = |left_out| -> Vec<&str> {
            let files = files(left_out, &provenance);
            files.iter().map(|file| file.role).collect()
        };
        assert_eq!(roles(Some(1))[3], "left out");
        assert_eq!(roles(Some(1))[1], FITTED);
        assert!(!roles(None).contains(&"left out"));
    }

    #[test]
    fn a_minus_is_not_a_hyphen() {
        assert_eq!(
            set("-0.97 and 2e-5 (-3), run-1, 5 % of 2 N RMS".into()),
            "−0.97 and 2e−5 (−3), run-1, 5\u{a0}% of 2\u{a0}N RMS"
        );
    }
}
