//! The pictures of `docs/images`, drawn from the figures of a benchmark.

use serde::Deserialize;
use serde_json::Value;
use softrig_report::plot::{Figure, Mark, Panel, Role, Series, Style, to_svg_string};
use softrig_tests::verdict::significant;

use crate::invariance::calibration::Bin;
use crate::many::Measured;
use crate::pages::{fill, name_of};
use crate::public::Course;
use crate::real::validation::Validation;

/// Name and SVG of each picture of a benchmark.
///
/// # Errors
///
/// If a figure is missing.
pub fn of(figures: &Value) -> Result<Vec<(String, String)>, String> {
    let one = |name: &str, figure: Figure| Ok(vec![(name.to_owned(), to_svg_string(&figure))]);
    match name_of(figures)? {
        "blind" => {
            let sets = list::<Value>(figures, "sets")?.into_iter();
            sets.filter(|set| set["name"] != "bench" && set["name"] != "laws")
                .map(|set| {
                    let name = format!("blind_{}.svg", set["name"].as_str().unwrap_or_default());
                    let svg = fill(&name, include_str!("../pages/blind.svg"), &set)?;
                    Ok((name, svg))
                })
                .collect()
        }
        "calibration" => {
            let measured_on = figures["measured_on"].as_str().unwrap_or_default();
            one(
                "calibration.svg",
                calibration(measured_on, &list(figures, "bins")?),
            )
        }
        "control" => one("closed_loop_steps.svg", control(&list(figures, "steps")?)),
        "many" => one("many_recordings.svg", many(&list(figures, "diagnoses")?)),
        "public" => Ok(list::<Value>(figures, "sets")?
            .iter()
            .filter_map(public)
            .collect()),
        "real" => Ok(list::<Value>(figures, "rigs")?
            .iter()
            .filter_map(real)
            .collect()),
        _ => Ok(Vec::new()),
    }
}

fn list<T: for<'a> Deserialize<'a>>(figures: &Value, name: &str) -> Result<Vec<T>, String> {
    Vec::deserialize(&figures[name]).map_err(|error| format!("{name}: {error}"))
}

/// Time and memory over the number of recordings.
fn many(found: &[Measured]) -> Figure {
    let recordings: Vec<f64> = found.iter().map(|it| it.recordings as f64).collect();
    let seconds: Vec<f64> = found.iter().map(|it| it.seconds).collect();
    let megabytes: Vec<f64> = found
        .iter()
        .map(|it| it.megabytes.unwrap_or(f64::NAN))
        .collect();
    let panel = |label: &str, values: &[f64]| {
        let highest = values
            .iter()
            .copied()
            .filter(|it| it.is_finite())
            .fold(0.0, f64::max);
        Panel::new("recordings of 10 s at 100 Hz", label)
            .with_series(Series::new("", &recordings, values, Style::EMPHASIS))
            .with_y_range(0.0, 1.1 * highest.max(1.0))
    };
    Figure::new("One diagnosis of many recordings")
        .with_subtitle(
            "Each is a session of its own; two cores. Drawn by cargo xtask bench many --docs.",
        )
        .with_panel(panel("time (s)", &seconds))
        .with_panel(panel("memory (MB)", &megabytes))
}

/// The share that is right over what was stated.
fn calibration(measured_on: &str, bins: &[Bin]) -> Figure {
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
            &bin.interval,
            line(Role::Measured),
        ));
    }
    let stated: Vec<f64> = bins.iter().map(|bin| bin.stated).collect();
    let shares: Vec<f64> = bins.iter().map(|bin| bin.share).collect();
    panel = panel.with_series(Series::new(
        "right",
        &stated,
        &shares,
        Style::new(Role::Measured, Mark::Discs),
    ));
    for bin in bins {
        panel = panel.with_note(
            bin.stated,
            bin.share,
            format!("{} of {}", bin.right, bin.of),
        );
    }
    let mut figure = Figure::new("What is stated, and how often it is right")
        .with_subtitle(measured_on)
        .with_panel(panel);
    figure.width_px = 560.0;
    figure.row_height_px = 420.0;
    figure
}

/// A step of the angle, as `closed_loop_steps` writes it.
#[derive(Deserialize)]
struct Step {
    angle_deg: f64,
    responses: Vec<Response>,
}

#[derive(Deserialize)]
struct Response {
    stiffness: f64,
    /// A hundred a second.
    angles_deg: Vec<f64>,
}

/// Steps of the angle in closed loop.
fn control(steps: &[Step]) -> Figure {
    let mut figure = Figure::new("Steps of the angle in closed loop")
        .with_subtitle(
            "The firmware in the simulator; actuators of 0.7, 1 and 1.3 times the model's \
             stiffness K. Drawn by cargo xtask bench control --docs.",
        )
        .with_columns(2);
    for step in steps {
        let mut panel = Panel::new("time (s)", "angle (°)")
            .with_y_range(-2.0, 1.15 * step.angle_deg)
            .with_level(step.angle_deg);
        for response in &step.responses {
            let count = response.angles_deg.len();
            let times: Vec<f64> = (0..count).map(|k| k as f64 / 100.0).collect();
            let style = if response.stiffness < 1.0 {
                Style::BEFORE
            } else if response.stiffness > 1.0 {
                Style::NOMINAL
            } else {
                Style::EMPHASIS
            };
            let label = format!("K × {}", response.stiffness);
            panel = panel.with_series(Series::new(label, &times, &response.angles_deg, style));
        }
        figure = figure.with_panel(panel);
    }
    figure
}

/// The test records of a public set, and the errors on them. None without any.
fn public(row: &Value) -> Option<(String, String)> {
    let courses = Vec::<Course>::deserialize(&row["courses"]).ok()?;
    let unit = row["set"]["unit"].as_str().unwrap_or_default();
    let title = row["set"]["title"].as_str().unwrap_or_default();
    let mut figure = Figure::new(title).with_subtitle(
        "Simulated minus measured over the whole test records; of each part of the picture the ends.",
    );
    for course in &courses {
        let time = &course.time_s;
        let thin = |role| Style::new(role, Mark::Thin);
        figure = figure
            .with_panel(
                Panel::new("", unit)
                    .with_title(course.name.clone())
                    .with_series(Series::new(
                        "measured",
                        time,
                        &course.measured,
                        thin(Role::Measured),
                    )),
            )
            .with_panel(
                Panel::new("time (s)", format!("error ({unit})"))
                    .with_level(0.0)
                    .with_legend(false)
                    .with_series(Series::new("error", time, &course.error, thin(Role::After))),
            );
    }
    figure.width_px = 760.0;
    figure.row_height_px = 105.0;
    let name = row["name"].as_str().unwrap_or_default();
    (!courses.is_empty()).then(|| (format!("public_{name}.svg"), to_svg_string(&figure)))
}

/// The validation run of a rig: measured, refitted, repaired, and the errors below. None without a diagnosis.
fn real(rig: &Value) -> Option<(String, String)> {
    let shown = Validation::deserialize(&rig["validation"]).ok()?;
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let number = |name: &str| {
        let value = rig["diagnosis"][name].as_f64();
        value.map_or("–".into(), significant)
    };
    let part = if shown.is_excerpt { ", an excerpt" } else { "" };
    let mut models = vec![("refitted", Style::BEFORE, &shown.refit)];
    let mut subtitle = format!(
        "RMS error on all validation runs: {} refitted",
        number("refit")
    );
    if let Some(repaired) = &shown.repaired {
        models.push(("repaired", Style::AFTER, repaired));
        subtitle += &format!(", {} repaired", number("repaired"));
    }
    let time = &shown.time_s;
    let mut angles = Panel::new("", text(&rig["page"]["quantity"]))
        .with_title(format!("{} (validation{part})", shown.run))
        .with_weight(2.0)
        .with_series(Series::new(
            "measured",
            time,
            &shown.measured,
            Style::MEASURED,
        ));
    let mut errors = Panel::new("time (s)", "error")
        .with_level(0.0)
        .with_legend(false);
    for (label, style, predicted) in models {
        angles = angles.with_series(Series::new(label, time, predicted, style));
        let thin = Style::new(style.role, Mark::Thin);
        let pairs = predicted.iter().zip(&shown.measured);
        let error: Vec<f64> = pairs
            .map(|(predicted, measured)| predicted - measured)
            .collect();
        errors = errors.with_series(Series::new(label, time, &error, thin));
    }
    let title = format!(
        "{}: {}",
        text(&rig["page"]["title"]),
        text(&rig["diagnosis"]["heading"])
    );
    let mut figure = Figure::new(title)
        .with_subtitle(subtitle)
        .with_panel(angles)
        .with_panel(errors);
    figure.width_px = 760.0;
    figure.row_height_px = 105.0;
    // Behind the opening tag: viewers do not show it, editors and readers of the file do.
    let svg = to_svg_string(&figure).replacen(
        '>',
        ">\n<desc>Drawn by `cargo xtask bench real --docs`.</desc>",
        1,
    );
    Some((format!("real_{}.svg", text(&rig["name"])), svg))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_rig_without_a_repair_has_two_curves() {
        let validation = |repaired: Value| {
            json!({
                "run": "vad_a", "is_excerpt": true, "time_s": [0.0, 0.1], "measured": [1.0, 2.0],
                "refit": [1.5, 2.5], "repaired": repaired,
            })
        };
        let svg = |validation: Value| {
            let rig = json!({
                "name": "pendulum", "page": { "title": "Pendulum", "quantity": "angle (°)" },
                "diagnosis": { "heading": "gravity", "refit": 2.5, "repaired": 0.25 },
                "validation": validation,
            });
            of(&json!({ "benchmark": "real", "rigs": [rig] })).unwrap()
        };
        assert!(svg(Value::Null).is_empty());
        let (name, text) = svg(validation(json!([1.0, 2.0]))).remove(0);
        assert_eq!(name, "real_pendulum.svg");
        for part in [
            "2.50 refitted, 0.250 repaired",
            "vad_a (validation, an excerpt)",
            "<desc>",
        ] {
            assert!(text.contains(part), "{part} not in {text}");
        }
        let (_, text) = svg(validation(Value::Null)).remove(0);
        assert!(!text.contains("repaired"), "{text}");
    }

    #[test]
    fn what_is_unknown_leaves_a_gap() {
        let found = json!({ "benchmark": "many", "diagnoses": [
            { "recordings": 10, "seconds": 0.9, "megabytes": 13.0 },
            { "recordings": 50, "seconds": 1.9, "megabytes": null },
        ]});
        assert!(of(&found).unwrap()[0].1.contains("memory (MB)"));
        let damaged = of(&json!({ "benchmark": "many" })).unwrap_err();
        assert!(damaged.starts_with("diagnoses: "), "{damaged}");
    }
}
