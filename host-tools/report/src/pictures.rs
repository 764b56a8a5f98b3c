//! The pictures of a report.
//!
//! Pictures of the page fit a narrow column: side by side on a desktop and on paper, one
//! below the other on a phone, with readable text on either. The pressure of every run is
//! drawn below its angle, since the first question is whether an error follows the input.

use std::path::Path;

use super::content::sentence;
use super::runs::{RunView, runs};
use crate::plot::{Cell, Figure, LINE_PX, Mark, Panel, Role, Series, Style};
use softrig::diagnose::Diagnosis;
use softrig::diagnose::decide::finding::Finding;
use softrig::diagnose::recordings::noise::NoiseFloor;
use softrig::diagnose::score::localise::{Feature, ForceMap, Gap, MapAxis};
use softrig::statistics::{rms, swing};
use softrig_formats::error::InputError;
use softrig_formats::numbers::{degrees, short};
use softrig_formats::recording::Recording;
use softrig_formats::removed::Channel;

/// Height of a row of panels: low enough for a picture in a README.
pub(super) const ROW_HEIGHT_PX: f64 = 150.0;

/// Width of a picture on the page.
pub(super) const COLUMN_PX: f64 = 420.0;

/// Width of a picture of which many stand side by side.
const SMALL_PX: f64 = 300.0;

/// Labels of the curves; the page's switches go by them.
pub const MEASURED: &str = "measured";
/// The input.
pub const PRESSURE: &str = "pressure";
/// The model as supplied.
pub const NOMINAL: &str = "nominal";
/// The same structure, refitted.
pub const REFITTED: &str = "refitted";
/// With the effects added.
pub const REPAIRED: &str = "repaired";

/// With the first, second and third explanation that these recordings cannot tell
/// apart.
pub const RIVALS: [&str; 3] = ["with A", "with B", "with C"];

/// The picture of `--plot`: the fitted and the held-out run with the largest error,
/// measured, before and after, with the residuals below.
pub fn figure(diagnosis: &Diagnosis) -> Figure {
    let all = runs(diagnosis);
    let fitted = worst(&all, |run| !run.held_out);
    let shown: Vec<usize> = fitted.iter().map(|run| run.index).collect();
    let other = if diagnosis.held_out.in_turn {
        let skip = with_repeats(&diagnosis.floor, &shown);
        worst(&all, |run| !skip.contains(&run.index))
    } else {
        worst(&all, |run| run.held_out)
    };
    let drawn: Vec<&RunView<'_>> = [fitted, other].into_iter().flatten().collect();
    figure_of(diagnosis, &drawn)
}

/// The picture of `--plot` with these runs.
///
/// # Errors
///
/// Names a run that there is not, and those that there are.
pub fn figure_of_runs(diagnosis: &Diagnosis, names: &[String]) -> Result<Figure, InputError> {
    let all = runs(diagnosis);
    let find = |name: &String| {
        let is_it = |run: &&RunView<'_>| {
            run.recording.name == *name.trim() || run.recording.path == Path::new(name.trim())
        };
        all.iter().find(is_it).ok_or_else(|| {
            let names: Vec<&str> = all.iter().map(|it| it.recording.name.as_str()).collect();
            InputError::new(
                format!("there is no run {name} to draw"),
                format!("give some of {}", names.join(", ")),
            )
        })
    };
    let drawn: Vec<&RunView<'_>> = names.iter().map(find).collect::<Result<_, _>>()?;
    Ok(figure_of(diagnosis, &drawn))
}

fn figure_of(diagnosis: &Diagnosis, drawn: &[&RunView<'_>]) -> Figure {
    let repaired = if diagnosis.repaired.added.is_empty() {
        String::new()
    } else {
        format!(
            "{} repaired, ",
            degrees(diagnosis.held_out.repaired_on_board)
        )
    };
    let gap = format!(
        "RMS error on validation runs: {} refitted, {repaired}{} noise",
        degrees(diagnosis.held_out.refit),
        degrees(diagnosis.held_out.floor)
    );
    let mut figure = Figure::new(sentence(diagnosis)).with_subtitle(gap);
    figure.row_height_px = ROW_HEIGHT_PX;
    figure.columns = drawn.len().max(1);
    let curves = |run: &RunView<'_>| -> Vec<(&'static str, Style)> {
        if run.repaired == run.refit {
            vec![(REFITTED, Style::BEFORE)]
        } else {
            vec![(REFITTED, Style::BEFORE), (REPAIRED, Style::AFTER)]
        }
    };
    let residual = |run: &RunView<'_>, label: &str| {
        if label == REFITTED {
            run.refit.clone()
        } else {
            run.repaired.clone()
        }
    };
    for run in drawn {
        let title = if run.held_out { "validation" } else { "fitted" };
        let time = &run.recording.time;
        let mut panel = Panel::new("time (s)", "angle (°)")
            .with_title(format!("{} ({title})", run.recording.name))
            .with_weight(2.0)
            .with_series(Series::new(MEASURED, time, &run.measured, Style::MEASURED));
        for (label, style) in curves(run) {
            let angle = run.angle(&residual(run, label));
            panel = panel.with_series(Series::new(label, time, &angle, style));
        }
        figure = figure.with_panel(with_left_out(panel, run, Channel::Angle));
    }
    for run in drawn {
        figure = figure.with_panel(pressure_panel(run));
    }
    for run in drawn {
        let mut panel = Panel::new("time (s)", "simulated − measured (°)")
            .with_legend(false)
            .with_level(0.0);
        for (label, style) in curves(run) {
            let error = residual(run, label);
            let style = Style::new(style.role, Mark::Thin);
            panel = panel.with_series(Series::new(label, &run.recording.time, &error, style));
        }
        figure = figure.with_panel(panel);
    }
    figure
}

/// The panel with rings where samples of a channel were left out. A straight line stands there:
/// what the file has may be far beyond the panel.
fn with_left_out(panel: Panel, run: &RunView<'_>, channel: Channel) -> Panel {
    let values = match channel {
        Channel::Angle => &run.measured,
        Channel::Pressure => &run.pressure,
    };
    let (time, values): (Vec<f64>, Vec<f64>) = run
        .recording
        .removed_from(channel)
        .filter(|removed| removed.why.is_fault())
        .flat_map(|removed| removed.samples.clone())
        .map(|sample| (run.recording.time[sample], values[sample]))
        .unzip();
    if time.is_empty() {
        return panel;
    }
    let style = Style::new(Role::Emphasis, Mark::Rings);
    panel.with_series(Series::new("left out", &time, &values, style))
}

/// The selected run with the largest error of the refit.
fn worst<'v, 'a>(
    all: &'v [RunView<'a>],
    wanted: impl Fn(&RunView<'a>) -> bool,
) -> Option<&'v RunView<'a>> {
    all.iter()
        .filter(|run| wanted(run))
        .max_by(|a, b| rms(&a.refit).total_cmp(&rms(&b.refit)))
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

fn column() -> Figure {
    let mut figure = Figure::new("");
    figure.width_px = COLUMN_PX;
    figure.row_height_px = ROW_HEIGHT_PX;
    figure
}

/// Which curves of a run are drawn, beside the measured one, above and below.
pub fn curves_of(diagnosis: &Diagnosis) -> [Vec<&'static str>; 2] {
    let curves: [&[&str]; 2] = match diagnosis.finding {
        Finding::Quiet {
            refitted: false, ..
        } => [&[NOMINAL], &[NOMINAL]],
        Finding::Quiet { refitted: true, .. } => [&[NOMINAL, REFITTED], &[NOMINAL, REFITTED]],
        Finding::Rivals { .. } | Finding::Shape { .. } | Finding::Trace { .. } => {
            let rivals = &RIVALS[..diagnosis.rivals.len().min(RIVALS.len())];
            let curves = || [&[REFITTED], rivals].concat();
            return [curves(), curves()];
        }
        _ if diagnosis.repaired.added.is_empty() => [&[NOMINAL, REFITTED], &[REFITTED]],
        Finding::Noisy
        | Finding::Named { .. }
        | Finding::OutOfTime { .. }
        | Finding::Unexplained { .. } => [&[NOMINAL, REFITTED, REPAIRED], &[REFITTED, REPAIRED]],
    };
    curves.map(<[&str]>::to_vec)
}

/// The residual (°) of the curve with this label.
fn residual_of<'r>(run: &'r RunView<'_>, label: &str) -> &'r [f64] {
    match label {
        NOMINAL => &run.nominal,
        REFITTED => &run.refit,
        REPAIRED => &run.repaired,
        _ => RIVALS
            .iter()
            .position(|rival| *rival == label)
            .and_then(|place| run.rivals.get(place))
            .unwrap_or(&run.repaired),
    }
}

/// RMS error (°) of the model of the curve with this label on a run.
pub fn error_of(run: &RunView<'_>, label: &str) -> f64 {
    let [nominal, refit, repaired] = run.errors();
    match label {
        NOMINAL => nominal,
        REFITTED => refit,
        REPAIRED => repaired,
        _ => rms(residual_of(run, label)),
    }
}

/// Look of the curve with this label.
pub fn style_of(label: &str) -> Style {
    match label {
        NOMINAL => Style::NOMINAL.dashed(),
        REFITTED => Style::BEFORE,
        REPAIRED => Style::AFTER,
        _ => match RIVALS.iter().position(|rival| *rival == label) {
            Some(0) => Style::AFTER,
            Some(1) => Style::EMPHASIS.dashed(),
            Some(_) => Style::NOMINAL.dashed(),
            None => Style::MEASURED,
        },
    }
}

/// The measured pressure of a run, in a low panel: its timing matters here, not its size.
fn pressure_panel(run: &RunView<'_>) -> Panel {
    let style = Style::new(Role::Measured, Mark::Line);
    let panel = Panel::new("time (s)", "pressure (kPa)")
        .with_legend(false)
        .with_weight(0.4)
        .with_series(Series::new(
            PRESSURE,
            &run.recording.time,
            &run.pressure,
            style,
        ));
    with_left_out(panel, run, Channel::Pressure)
}

/// A recording as it was read: the angle above, the pressure under it.
pub fn recording_figure(recording: &Recording) -> Figure {
    let angle: Vec<f64> = recording.angle.iter().map(|it| it.to_degrees()).collect();
    let pressure: Vec<f64> = recording.pressure.iter().map(|it| it / 1e3).collect();
    let style = Style::new(Role::Measured, Mark::Line);
    let panel = |quantity, weight, label, values: &[f64]| {
        Panel::new("time (s)", quantity)
            .with_legend(false)
            .with_weight(weight)
            .with_series(Series::new(label, &recording.time, values, style))
    };
    let mut figure = column();
    figure.width_px = SMALL_PX;
    figure
        .with_panel(panel("angle (°)", 0.8, MEASURED, &angle))
        .with_panel(panel("pressure (kPa)", 0.6, PRESSURE, &pressure))
}

/// One run: angles above, the pressure under them, residuals below. A curve may have a band
/// with these half widths (°).
pub fn run_figure(
    run: &RunView<'_>,
    [above, below]: &[Vec<&'static str>; 2],
    band: Option<(&str, &[f64])>,
) -> Figure {
    let time = &run.recording.time;
    let mut angles = Panel::new("time (s)", "angle (°)")
        .with_legend(false)
        .with_series(Series::new(MEASURED, time, &run.measured, Style::MEASURED));
    if let Some((label, half)) = band {
        let middle = run.angle(residual_of(run, label));
        let edge = |sign: f64| -> Vec<f64> {
            let both = middle.iter().zip(half);
            both.map(|(angle, half)| angle + sign * half).collect()
        };
        let role = style_of(label).role;
        angles = angles.with_series(Series::band(label, time, &edge(-1.0), &edge(1.0), role));
    }
    for &label in above {
        let angle = run.angle(residual_of(run, label));
        angles = angles.with_series(Series::new(label, time, &angle, style_of(label)));
    }
    angles = with_left_out(angles, run, Channel::Angle);
    let mut errors = Panel::new("time (s)", "simulated − measured (°)")
        .with_legend(false)
        .with_level(0.0)
        .with_weight(0.75);
    for &label in below {
        // Noise would fill the picture with wider lines.
        let style = Style::new(style_of(label).role, Mark::Thin);
        errors = errors.with_series(Series::new(label, time, residual_of(run, label), style));
    }
    column()
        .with_panel(angles)
        .with_panel(pressure_panel(run))
        .with_panel(errors)
}

/// Whether a band with these half widths (°) is thinner than its line.
pub fn is_thinner_than_its_line(run: &RunView<'_>, half: &[f64]) -> bool {
    let widest = half.iter().copied().fold(0.0, f64::max);
    2.0 * widest / swing(&run.measured) * ROW_HEIGHT_PX < LINE_PX
}

/// Runs whose missing force is drawn: as many as there are colours.
const FORCES_DRAWN: usize = 4;

/// The runs with the largest missing force, one of each group of repeats, by
/// their index among the fitted ones.
pub fn largest_forces(diagnosis: &Diagnosis) -> Vec<usize> {
    let forces = &diagnosis.gap.runs;
    let mut order: Vec<usize> = (0..forces.len()).collect();
    order.sort_by(|&a, &b| rms(&forces[b].force).total_cmp(&rms(&forces[a].force)));
    let mut shown = Vec::new();
    for index in order {
        if shown.len() < FORCES_DRAWN && !with_repeats(&diagnosis.floor, &shown).contains(&index) {
            shown.push(index);
        }
    }
    shown.sort_unstable();
    shown
}

/// The missing force over the time in each of some runs, with their names.
pub fn force_figure(gap: &Gap, shown: &[(usize, &str)]) -> Figure {
    let mut panel = Panel::new("time (s)", "missing force (N)")
        .with_legend(false)
        .with_level(0.0);
    for (place, &(index, name)) in shown.iter().enumerate() {
        let Some(series) = gap.runs.get(index) else {
            continue;
        };
        let style = Style::new(Role::Other(place), Mark::Line);
        panel = panel.with_series(
            Series::new(name, &series.time, &series.force, style).with_key(index.to_string()),
        );
    }
    column().with_panel(panel)
}

/// The missing force over one feature: samples, and the mean with its standard
/// deviation.
pub fn feature_figure(feature: &Feature) -> Figure {
    let columns = |of: fn(&(f64, f64)) -> f64| feature.dots.iter().map(of).collect::<Vec<f64>>();
    let at: Vec<f64> = feature.curve.iter().map(|point| point.at).collect();
    let mean: Vec<f64> = feature.curve.iter().map(|point| point.force).collect();
    let edge = |sign: f64| -> Vec<f64> {
        feature
            .curve
            .iter()
            .map(|point| point.force + sign * point.standard_deviation)
            .collect()
    };
    let panel = Panel::new(with_unit(feature.name, feature.unit), "missing force (N)")
        .with_legend(false)
        .with_level(0.0)
        .with_series(Series::new(
            "",
            &columns(|dot| dot.0),
            &columns(|dot| dot.1),
            Style::MEASURED_POINTS,
        ))
        .with_series(Series::band(
            "",
            &at,
            &edge(-1.0),
            &edge(1.0),
            Role::Emphasis,
        ))
        .with_series(Series::new("mean", &at, &mean, Style::EMPHASIS));
    column().with_panel(panel)
}

/// The missing force over two features, and the force (N) of the darkest shade.
pub fn map_figure(map: &ForceMap) -> Option<(Figure, f64)> {
    let forces = || map.force.iter().flatten().copied().flatten();
    let scale = forces().fold(0.0, |largest: f64, force| largest.max(force.abs()));
    if scale <= 0.0 {
        return None;
    }
    let [across, up] = &map.axes;
    let bins = |axis: &MapAxis| -> Vec<(f64, f64)> {
        axis.edges
            .windows(2)
            .map(|pair| (pair[0], pair[1]))
            .collect()
    };
    let (across_bins, up_bins) = (bins(across), bins(up));
    let mut cells = Vec::new();
    for (row, &x) in map.force.iter().zip(&across_bins) {
        for (force, &y) in row.iter().zip(&up_bins) {
            let Some(force) = *force else { continue };
            let range = |axis: &MapAxis, (from, to): (f64, f64)| {
                format!(
                    "{} {} … {} {}",
                    axis.name,
                    short(from),
                    short(to),
                    axis.unit
                )
            };
            cells.push(Cell {
                x,
                y,
                shade: force / scale,
                text: format!("{} N\n{}\n{}", short(force), range(across, x), range(up, y)),
            });
        }
    }
    let outline = |axis: &MapAxis| {
        let first = axis.edges.first().copied().unwrap_or(0.0);
        (first, axis.edges.last().copied().unwrap_or(1.0))
    };
    let (x, y) = (outline(across), outline(up));
    let panel = Panel::new(
        with_unit(across.name, across.unit),
        with_unit(up.name, up.unit),
    )
    .with_x_range(x.0, x.1)
    .with_y_range(y.0, y.1)
    .with_weight(1.5)
    .with_cells(cells);
    Some((column().with_panel(panel), scale))
}

fn with_unit(name: &str, unit: &str) -> String {
    if unit.is_empty() {
        name.to_owned()
    } else {
        format!("{name} ({unit})")
    }
}
