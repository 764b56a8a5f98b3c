//! A diagnosis for people: the summary on the terminal and the picture.

use std::fmt::Write;
use std::path::Path;

use model_core::actuator::ParameterId;

use crate::cmd::fit::number;
use crate::diagnose::noise::NoiseFloor;
use crate::diagnose::verdict::Answer;
use crate::diagnose::{Diagnosis, Request};
use crate::fit::{Fit, Fitter, Run};
use crate::model_file::{parameter_name, parameter_unit, to_file_units};
use crate::plot::{Figure, Panel, Series, Style};
use crate::recording::Recording;
use crate::statistics::rms;

/// Where results were written.
#[derive(Clone, Copy, Debug, Default)]
pub struct Outputs<'a> {
    /// The verdict as JSON.
    pub verdict: Option<&'a Path>,
    /// The picture.
    pub picture: Option<&'a Path>,
    /// The repaired model.
    pub model: Option<&'a Path>,
}

/// Height of a row of panels: low enough for a picture in a README.
const ROW_HEIGHT_PX: f64 = 150.0;

/// The verdict in one sentence.
pub fn sentence(diagnosis: &Diagnosis) -> String {
    let titles: Vec<String> = diagnosis
        .repaired
        .added
        .iter()
        .map(|kind| kind.info().title.to_owned())
        .collect();
    match diagnosis.answer {
        Answer::NoDiscrepancy => {
            "Nothing is missing: the model agrees with the recordings within their noise.".into()
        }
        Answer::ParametersOnly => {
            "No effect is missing: the structure is right, only the parameters were off.".into()
        }
        Answer::EffectFound => format!("The model lacks {}.", listed(&titles)),
        Answer::CannotTell => {
            let rivals: Vec<String> = diagnosis
                .alternatives
                .iter()
                .map(|rival| rival.kinds.join(" with "))
                .collect();
            format!(
                "Something is missing, but these recordings cannot tell apart {}.",
                listed(&rivals)
            )
        }
        Answer::Unexplained => {
            "Something is missing, and it is none of the effects that are known.".into()
        }
    }
}

/// "a, b and c".
fn listed(items: &[String]) -> String {
    match items {
        [] => String::new(),
        [only] => only.clone(),
        [head @ .., last] => format!("{} and {last}", head.join(", ")),
    }
}

/// The summary for a terminal.
pub fn summary(
    request: &Request<'_>,
    diagnosis: &Diagnosis,
    outputs: &Outputs<'_>,
    seconds: f64,
) -> String {
    let mut text = String::new();
    // Formatting into a string does not fail.
    let mut line = |line: String| {
        let _ = writeln!(text, "{line}");
    };
    line(sentence(diagnosis));
    line(String::new());
    for row in errors(request, diagnosis) {
        line(row);
    }
    for row in notes(diagnosis) {
        line(row);
    }
    line(String::new());
    let named = !diagnosis.repaired.added.is_empty();
    if named {
        line(format!(
            "On runs that were not fitted it closes {:.0} % of the gap to the noise{}.",
            100.0 * diagnosis.adequacy.holdout_gap_closed,
            if diagnosis.adequacy.adequate {
                ", and what is left is noise"
            } else {
                "; what is left is still more than noise"
            }
        ));
        line(String::new());
        for row in effects(diagnosis) {
            line(row);
        }
    }
    line("Base parameters, nominal → fitted:".into());
    for row in base(request, &diagnosis.repaired.fit) {
        line(row);
    }
    for text in &diagnosis.identifiability[0].text {
        line(format!("  {text}."));
    }
    line(String::new());
    if !matches!(
        diagnosis.answer,
        Answer::NoDiscrepancy | Answer::ParametersOnly
    ) {
        if !diagnosis.gap.sentences.is_empty() {
            line(format!(
                "Where the gap lives: {}",
                diagnosis.gap.sentences.join(" ")
            ));
        }
        let rivals: Vec<String> = diagnosis
            .alternatives
            .iter()
            .map(|rival| {
                format!(
                    "{} (probability {}, ΔBIC {:.0})",
                    rival.kinds.join(" + "),
                    probability(rival.probability),
                    rival.delta_bic
                )
            })
            .collect();
        if !rivals.is_empty() {
            line(format!("Rivals: {}", rivals.join("; ")));
        }
        if let Some(row) = next_experiment(diagnosis) {
            line(row);
        }
        for untried in &diagnosis.untried {
            line(format!(
                "Not tried: {}, because {}",
                untried.kind.name(),
                untried.reason
            ));
        }
    }
    for (what, path) in [
        ("Picture", outputs.picture),
        (
            if named {
                "Repaired model"
            } else {
                "Refitted model"
            },
            outputs.model,
        ),
        ("Verdict", outputs.verdict),
    ] {
        if let Some(path) = path {
            line(format!("{what}: {}", path.display()));
        }
    }
    if outputs.picture.is_none() && outputs.model.is_none() && outputs.verdict.is_none() {
        line(
            "Add --plot gap.svg, -o repaired.toml or --json verdict.json to keep the result."
                .into(),
        );
    }
    line(format!("{seconds:.1} s, seed {}", request.seed));
    text
}

/// The run that would separate the rivals best.
fn next_experiment(diagnosis: &Diagnosis) -> Option<String> {
    let (proposal, [a, b]) = diagnosis.proposals.first()?;
    Some(format!(
        "Next experiment: {} ({}), {:.0} s; it separates {} from {} by about {:.0} in χ².",
        proposal.protocol.name,
        proposal.protocol.title,
        f64::from(proposal.protocol.total_ms()) / 1000.0,
        a.join(" + "),
        b.join(" + "),
        proposal.evidence
    ))
}

/// What is noteworthy about the recordings.
fn notes(diagnosis: &Diagnosis) -> Vec<String> {
    let floor = &diagnosis.floor;
    let scatter = floor.repeats.filter(|scatter| *scatter > 2.0 * floor.white);
    let repeats = scatter.map(|scatter| {
        format!(
            "The repeats differ by {}° among themselves, more than the sensor's noise of {}°: the rig does not repeat.",
            number(scatter.to_degrees()),
            number(floor.white.to_degrees())
        )
    });
    let concerns = diagnosis.concerns.iter().map(|concern| {
        let about = concern
            .recording
            .as_ref()
            .map_or_else(String::new, |name| format!("{name}: "));
        format!("Note: {about}{}; {}.", concern.text, concern.advice)
    });
    repeats.into_iter().chain(concerns).collect()
}

/// The table: nominal, refit and repaired on fitted and on held-out runs.
fn errors(request: &Request<'_>, diagnosis: &Diagnosis) -> Vec<String> {
    let held_out = &diagnosis.held_out;
    let row = |name: &str, runs: usize, values: [f64; 4]| {
        let [nominal, refit, repaired, floor] = values.map(|value| number(value.to_degrees()));
        format!("{name:<18} {runs:>4} {nominal:>10} {refit:>10} {repaired:>10} {floor:>10}")
    };
    let held_out_name = if held_out.in_turn {
        "left out in turn"
    } else {
        "held out"
    };
    let held_out_runs = if held_out.in_turn {
        request.recordings.len()
    } else {
        request.holdout.len()
    };
    vec![
        format!(
            "{:<18} {:>4} {:>10} {:>10} {:>10} {:>10}",
            "RMS error (°)", "runs", "nominal", "refitted", "repaired", "noise"
        ),
        row(
            "fitted",
            request.recordings.len(),
            [
                diagnosis.nominal.rmse(),
                diagnosis.refit.rmse(),
                diagnosis.repaired.fit.rmse(),
                diagnosis.floor.rms,
            ],
        ),
        row(
            held_out_name,
            held_out_runs,
            [
                held_out.nominal,
                held_out.refit,
                held_out.repaired_on_board,
                held_out.floor,
            ],
        ),
    ]
}

/// Equation and parameters of each named effect.
fn effects(diagnosis: &Diagnosis) -> Vec<String> {
    let fit = &diagnosis.repaired.fit;
    let first = fit.model.effects().count() - diagnosis.repaired.added.len();
    let mut rows = Vec::new();
    for (offset, kind) in diagnosis.repaired.added.iter().enumerate() {
        rows.push(format!(
            "{}: {}   (probability {})",
            kind.name(),
            kind.info().equation,
            probability(diagnosis.probability.get(offset).copied().unwrap_or(0.0))
        ));
        for parameter in 0..kind.parameters().len() {
            let id = ParameterId::Effect {
                slot: first + offset,
                parameter,
            };
            rows.push(parameter_row(fit, id, None));
        }
        rows.push(String::new());
    }
    rows
}

/// Base parameters that were free.
fn base(request: &Request<'_>, fit: &Fit) -> Vec<String> {
    fit.free
        .iter()
        .filter(|id| !matches!(id, ParameterId::Effect { .. }))
        .map(|&id| parameter_row(fit, id, request.file.model.value(id)))
        .collect()
}

fn parameter_row(fit: &Fit, id: ParameterId, nominal: Option<f64>) -> String {
    let shown = |value: f64| number(to_file_units(&fit.model, id, value));
    let name = parameter_name(&fit.model, id);
    let name = name.rsplit('.').next().unwrap_or(&name).to_owned();
    let value = fit.model.value(id).map_or_else(String::new, shown);
    let before = nominal.map_or_else(String::new, |nominal| format!("{} → ", shown(nominal)));
    let interval = fit.free.iter().position(|&free| free == id).map_or_else(
        || "held".to_owned(),
        |index| match fit.interval95(index) {
            Some((low, high)) if (high - low).is_finite() => {
                format!("95 %: {} … {}", shown(low), shown(high))
            }
            _ => "not determined by these runs".to_owned(),
        },
    );
    // Keys of effects carry their unit already.
    let unit = match id {
        ParameterId::Effect { .. } => "",
        _ => parameter_unit(&fit.model, id),
    };
    format!("  {name} = {before}{value} {unit}  [{interval}]").replace("  [", " [")
}

fn probability(value: f64) -> String {
    if value > 0.995 {
        "> 0.99".into()
    } else if value < 0.005 {
        "< 0.01".into()
    } else {
        format!("{value:.2}")
    }
}

/// The picture: the fitted and the held-out run with the largest gap, measured,
/// before and after, and what is left of each below.
pub fn figure(request: &Request<'_>, diagnosis: &Diagnosis) -> Figure {
    let mut figure = Figure::new(sentence(diagnosis))
        .with_columns(2)
        .with_separate_x();
    figure.row_height_px = ROW_HEIGHT_PX;
    let gap = format!(
        "RMS error on runs that were not fitted: {}° refitted, {}° repaired, {}° noise",
        number(diagnosis.held_out.refit.to_degrees()),
        number(diagnosis.held_out.repaired_on_board.to_degrees()),
        number(diagnosis.held_out.floor.to_degrees())
    );
    figure = figure.with_subtitle(gap);
    let fitted = Curves::worst(request, diagnosis, request.recordings, &[]);
    let shown: Vec<usize> = fitted.iter().map(|curves| curves.index).collect();
    let held_out = if request.holdout.is_empty() {
        Curves::worst(
            request,
            diagnosis,
            request.recordings,
            &with_repeats(&diagnosis.floor, &shown),
        )
    } else {
        Curves::worst(request, diagnosis, request.holdout, &[])
    };
    let titles = [
        "fitted",
        if request.holdout.is_empty() {
            "fitted"
        } else {
            "not fitted"
        },
    ];
    let curves: Vec<(Curves, &str)> = [fitted, held_out]
        .into_iter()
        .zip(titles)
        .filter_map(|(curves, title)| curves.map(|curves| (curves, title)))
        .collect();
    let named = !diagnosis.repaired.added.is_empty();
    for (curves, title) in &curves {
        let mut panel = Panel::new("time (s)", "angle (°)")
            .with_title(format!("{} ({title})", curves.name))
            .with_weight(2.0)
            .with_series(Series::new(
                "measured",
                &curves.time,
                &curves.measured,
                Style::MEASURED,
            ))
            .with_series(Series::new(
                "refitted",
                &curves.time,
                &curves.before,
                Style::BEFORE,
            ));
        if named {
            panel = panel.with_series(Series::new(
                "repaired",
                &curves.time,
                &curves.after,
                Style::AFTER,
            ));
        }
        figure = figure.with_panel(panel);
    }
    for (curves, _) in &curves {
        let error = |simulated: &[f64]| -> Vec<f64> {
            simulated
                .iter()
                .zip(&curves.measured)
                .map(|(simulated, measured)| simulated - measured)
                .collect()
        };
        let mut panel =
            Panel::new("time (s)", "simulated − measured (°)").with_series(Series::new(
                "refitted",
                &curves.time,
                &error(&curves.before),
                Style::BEFORE,
            ));
        if named {
            panel = panel.with_series(Series::new(
                "repaired",
                &curves.time,
                &error(&curves.after),
                Style::AFTER,
            ));
        }
        figure = figure.with_panel(panel);
    }
    figure
}

/// The recordings in `shown` and all that repeat them.
fn with_repeats(floor: &NoiseFloor, shown: &[usize]) -> Vec<usize> {
    floor
        .groups
        .iter()
        .filter(|group| group.iter().any(|index| shown.contains(index)))
        .flatten()
        .chain(shown)
        .copied()
        .collect()
}

/// The curves of one recording in degrees.
struct Curves {
    index: usize,
    name: String,
    time: Vec<f64>,
    measured: Vec<f64>,
    before: Vec<f64>,
    after: Vec<f64>,
}

impl Curves {
    /// The recording on which the refit misses most, but for those in `skip`.
    fn worst(
        request: &Request<'_>,
        diagnosis: &Diagnosis,
        recordings: &[Recording],
        skip: &[usize],
    ) -> Option<Self> {
        let runs = Run::all(recordings);
        let fitter = Fitter {
            nominal: &request.file.model,
            runs: &runs,
        };
        let before = fitter.compare(&diagnosis.refit.model);
        let after = fitter.compare(&diagnosis.repaired.fit.model);
        let index = (0..recordings.len())
            .filter(|index| !skip.contains(index))
            .max_by(|&a, &b| rms(&before.residuals[a]).total_cmp(&rms(&before.residuals[b])))?;
        let recording = &recordings[index];
        let measured: Vec<f64> = recording
            .angle
            .iter()
            .map(|angle| angle.to_degrees())
            .collect();
        let simulated = |fit: &Fit| -> Vec<f64> {
            fit.residuals[index]
                .iter()
                .zip(&measured)
                .map(|(residual, measured)| residual.to_degrees() + measured)
                .collect()
        };
        Some(Self {
            index,
            name: recording.name.clone(),
            time: recording.time.clone(),
            before: simulated(&before),
            after: simulated(&after),
            measured,
        })
    }
}
