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
use softrig_formats::measurand::Measurand;
use softrig_formats::numbers::short;
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
/// What the lowest panels show.
const RESIDUAL: &str = "simulated − measured";
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
    let drawn = named(&all, names, |run| {
        (&run.recording.name, &run.recording.path)
    })?;
    Ok(figure_of(diagnosis, &drawn))
}

/// The runs with these names, or paths, in the order in which they are named.
///
/// # Errors
///
/// Names a run that there is not, and those that there are.
pub fn named<'r, T>(
    all: &'r [T],
    names: &[String],
    known_by: impl Fn(&T) -> (&str, &Path),
) -> Result<Vec<&'r T>, InputError> {
    let find = |name: &String| {
        let name = name.trim();
        let is_it = |run: &&T| {
            let (known, path) = known_by(run);
            known == name || path == Path::new(name)
        };
        all.iter().find(is_it).ok_or_else(|| {
            let names: Vec<&str> = all.iter().map(|it| known_by(it).0).collect();
            InputError::new(
                format!("there is no run {name} to draw"),
                format!("give some of {}", names.join(", ")),
            )
        })
    };
    names.iter().map(find).collect()
}

fn figure_of(diagnosis: &Diagnosis, drawn: &[&RunView<'_>]) -> Figure {
    let repaired = if diagnosis.repaired.added.is_empty() {
        String::new()
    } else {
        format!(
            "{} repaired, ",
            diagnosis.shown(diagnosis.held_out.repaired_on_board)
        )
    };
    let gap = format!(
        "RMS error on validation runs: {} refitted, {repaired}{} noise",
        diagnosis.shown(diagnosis.held_out.refit),
        diagnosis.shown(diagnosis.held_out.floor)
    );
    let runs: Vec<DrawnRun<'_>> = drawn.iter().map(|run| DrawnRun::of(run)).collect();
    figure_of_drawn(sentence(diagnosis), gap, &diagnosis.data.measurand(), &runs)
}

/// A run as a picture shows it: angles, the pressure under them, residuals below.
#[derive(Clone, Debug)]
pub struct DrawnRun<'a> {
    /// The heading of its panels.
    pub title: String,
    /// Time of each sample (s).
    pub time: &'a [f64],
    /// The measured angle (°).
    pub measured: &'a [f64],
    /// The measured pressure (kPa).
    pub pressure: &'a [f64],
    /// Label and style of each model, and simulated minus measured angle (°).
    pub models: Vec<(&'static str, Style, &'a [f64])>,
    /// Samples of the angle and of the pressure that were [left out](left_out).
    pub left_out: [Vec<usize>; 2],
}

impl<'a> DrawnRun<'a> {
    fn of(run: &'a RunView<'_>) -> Self {
        let title = if run.held_out { "validation" } else { "fitted" };
        let mut models = vec![(REFITTED, Style::BEFORE, run.refit.as_slice())];
        if run.repaired != run.refit {
            models.push((REPAIRED, Style::AFTER, &run.repaired));
        }
        Self {
            title: format!("{} ({title})", run.recording.name),
            time: &run.recording.time,
            measured: &run.measured,
            pressure: &run.pressure,
            models,
            left_out: left_out(run.recording),
        }
    }
}

/// A figure with a column for each run.
pub fn figure_of_drawn(
    title: impl Into<String>,
    subtitle: impl Into<String>,
    measurand: &Measurand,
    runs: &[DrawnRun<'_>],
) -> Figure {
    let mut figure = Figure::new(title).with_subtitle(subtitle);
    figure.row_height_px = ROW_HEIGHT_PX;
    figure.columns = runs.len().max(1);
    for run in runs {
        let mut panel = Panel::new("time (s)", measurand.label())
            .with_title(run.title.as_str())
            .with_weight(2.0)
            .with_series(Series::new(
                MEASURED,
                run.time,
                run.measured,
                Style::MEASURED,
            ));
        for &(label, style, residual) in &run.models {
            let both = residual.iter().zip(run.measured);
            let angle: Vec<f64> = both.map(|(residual, angle)| residual + angle).collect();
            panel = panel.with_series(Series::new(label, run.time, &angle, style));
        }
        figure = figure.with_panel(with_left_out(
            panel,
            run.time,
            run.measured,
            &run.left_out[0],
        ));
    }
    for run in runs {
        figure = figure.with_panel(pressure_panel(run.time, run.pressure, &run.left_out[1]));
    }
    for run in runs {
        let mut panel = Panel::new("time (s)", measurand.with_unit(RESIDUAL))
            .with_legend(false)
            .with_level(0.0);
        for &(label, style, residual) in &run.models {
            let style = Style::new(style.role, Mark::Thin);
            panel = panel.with_series(Series::new(label, run.time, residual, style));
        }
        figure = figure.with_panel(panel);
    }
    figure
}

/// Samples of the angle and of the pressure of a recording that are not believed.
pub fn left_out(recording: &Recording) -> [Vec<usize>; 2] {
    [Channel::Angle, Channel::Pressure].map(|channel| {
        recording
            .removed_from(channel)
            .filter(|removed| removed.why.is_fault())
            .flat_map(|removed| removed.samples.clone())
            .collect()
    })
}

/// The panel with rings where samples were left out. A straight line stands there: what the file
/// has may be far beyond the panel.
fn with_left_out(panel: Panel, time: &[f64], values: &[f64], samples: &[usize]) -> Panel {
    if samples.is_empty() {
        return panel;
    }
    let pick = |all: &[f64]| -> Vec<f64> { samples.iter().map(|&sample| all[sample]).collect() };
    let style = Style::new(Role::Emphasis, Mark::Rings);
    panel.with_series(Series::new("left out", &pick(time), &pick(values), style))
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

/// The measured pressure (kPa) of a run, in a low panel: its timing matters here, not its size.
fn pressure_panel(time: &[f64], pressure: &[f64], left_out: &[usize]) -> Panel {
    let style = Style::new(Role::Measured, Mark::Line);
    let panel = Panel::new("time (s)", "pressure (kPa)")
        .with_legend(false)
        .with_weight(0.4)
        .with_series(Series::new(PRESSURE, time, pressure, style));
    with_left_out(panel, time, pressure, left_out)
}

/// A recording as it was read: the angle above, the pressure under it.
pub fn recording_figure(recording: &Recording) -> Figure {
    let angle: Vec<f64> = recording.angle.iter().map(|it| it.to_degrees()).collect();
    let pressure: Vec<f64> = recording.pressure.iter().map(|it| it / 1e3).collect();
    let style = Style::new(Role::Measured, Mark::Line);
    let panel = |quantity: String, weight, label, values: &[f64]| {
        Panel::new("time (s)", quantity)
            .with_legend(false)
            .with_weight(weight)
            .with_series(Series::new(label, &recording.time, values, style))
    };
    let mut figure = column();
    figure.width_px = SMALL_PX;
    figure
        .with_panel(panel(recording.measurand.label(), 0.8, MEASURED, &angle))
        .with_panel(panel("pressure (kPa)".to_owned(), 0.6, PRESSURE, &pressure))
}

/// One run: angles above, the pressure under them, residuals below. A curve may have a band
/// with these half widths (°).
pub fn run_figure(
    run: &RunView<'_>,
    [above, below]: &[Vec<&'static str>; 2],
    band: Option<(&str, &[f64])>,
) -> Figure {
    let time = &run.recording.time;
    let [of_angle, of_pressure] = left_out(run.recording);
    let measurand = &run.recording.measurand;
    let mut angles = Panel::new("time (s)", measurand.label())
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
    angles = with_left_out(angles, time, &run.measured, &of_angle);
    let mut errors = Panel::new("time (s)", measurand.with_unit(RESIDUAL))
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
        .with_panel(pressure_panel(time, &run.pressure, &of_pressure))
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
pub fn feature_figure(feature: &Feature, measurand: &Measurand) -> Figure {
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
    let panel = Panel::new(
        with_unit(measurand.named(feature.name, feature.unit)),
        "missing force (N)",
    )
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
pub fn map_figure(map: &ForceMap, measurand: &Measurand) -> Option<(Figure, f64)> {
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
                let (name, unit) = measurand.named(axis.name, axis.unit);
                format!("{name} {} … {} {unit}", short(from), short(to))
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
        with_unit(measurand.named(across.name, across.unit)),
        with_unit(measurand.named(up.name, up.unit)),
    )
    .with_x_range(x.0, x.1)
    .with_y_range(y.0, y.1)
    .with_weight(1.5)
    .with_cells(cells);
    Some((column().with_panel(panel), scale))
}

fn with_unit((name, unit): (String, String)) -> String {
    if unit.is_empty() {
        name
    } else {
        format!("{name} ({unit})")
    }
}
