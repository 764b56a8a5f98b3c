//! The picture of a validation run of real data.
//!
//! The curves come from `softrig simulate -o`, whose column `predicted_deg` stands beside
//! the measured angle.

use std::ops::Range;
use std::path::{Path, PathBuf};

use softrig_formats::error::write_atomically;
use softrig_formats::recording::Recording;
use softrig_report::plot::{Figure, Mark, Panel, Series, Style, to_svg_string};

/// One validation run: measured, refitted, repaired, and the errors below. Of several runs,
/// the one on which the refit misses most.
#[derive(Clone, Debug)]
pub struct Picture<'a> {
    /// Heading.
    pub title: String,
    /// Text below the heading.
    pub subtitle: String,
    /// What the column `angle_deg` holds.
    pub quantity: &'a str,
    /// Command that draws this picture.
    pub command: &'a str,
    /// Runs as the refitted model simulates them.
    pub refit: Vec<PathBuf>,
    /// The same runs as the repaired model simulates them; may be none.
    pub repaired: Vec<PathBuf>,
}

/// Oscillations that can be told apart at the picture's width.
const MOST_PERIODS: f64 = 15.0;
const WIDTH_PX: f64 = 760.0;
const ROW_HEIGHT_PX: f64 = 105.0;

impl Picture<'_> {
    /// Draws it.
    ///
    /// # Errors
    ///
    /// Which run cannot be read, or that the picture cannot be written.
    pub fn draw(&self, path: &Path) -> Result<(), String> {
        let refit = read_all(&self.refit)?;
        let repaired = read_all(&self.repaired)?;
        let worst = (0..refit.len())
            .max_by(|&a, &b| refit[a].rms().total_cmp(&refit[b].rms()))
            .ok_or("there is no run to draw")?;
        let shown = refit[worst].excerpt();
        let figure = figure(self, &refit[worst], repaired.get(worst), shown);
        let svg = to_svg_string(&figure);
        // Behind the opening tag: viewers do not show it, editors and readers of the file do.
        let command = self.command.replace('&', "&amp;").replace('<', "&lt;");
        let start = svg.find('>').map_or(0, |end| end + 1);
        let svg = format!(
            "{}\n<desc>Drawn by `{command}`.</desc>{}",
            &svg[..start],
            &svg[start..]
        );
        write_atomically(path, svg.as_bytes()).map_err(|error| error.to_string())
    }
}

/// A run with what one model says to it.
struct Simulated {
    name: String,
    time: Vec<f64>,
    measured_deg: Vec<f64>,
    predicted_deg: Vec<f64>,
}

fn read_all(paths: &[PathBuf]) -> Result<Vec<Simulated>, String> {
    paths.iter().map(|path| Simulated::read(path)).collect()
}

impl Simulated {
    fn read(path: &Path) -> Result<Self, String> {
        let (recording, _) = Recording::read(path).map_err(|error| error.to_string())?;
        let predicted_deg = recording.column("predicted_deg").ok_or_else(|| {
            format!(
                "{}: no column predicted_deg, which `softrig simulate --recording` writes",
                path.display()
            )
        })?;
        Ok(Self {
            name: recording.name,
            time: recording.time,
            measured_deg: recording.angle.iter().map(|a| a.to_degrees()).collect(),
            predicted_deg,
        })
    }

    fn error(&self) -> Vec<f64> {
        let pairs = self.predicted_deg.iter().zip(&self.measured_deg);
        pairs
            .map(|(predicted, measured)| predicted - measured)
            .collect()
    }

    fn rms(&self) -> f64 {
        softrig::statistics::rms(&self.error())
    }

    /// The samples to draw: all, or those few periods in which the model misses most.
    fn excerpt(&self) -> Range<usize> {
        let all = 0..self.time.len();
        let mean = self.measured_deg.iter().sum::<f64>() / self.measured_deg.len().max(1) as f64;
        let crossings = self
            .measured_deg
            .windows(2)
            .filter(|pair| (pair[0] - mean) * (pair[1] - mean) < 0.0)
            .count();
        let periods = crossings as f64 / 2.0;
        if periods <= 2.0 * MOST_PERIODS {
            return all;
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let length = (self.time.len() as f64 * MOST_PERIODS / periods) as usize;
        let squares: Vec<f64> = self.error().iter().map(|error| error * error).collect();
        (0..self.time.len() / length.max(1))
            .map(|place| place * length..(place + 1) * length)
            .max_by(|a, b| {
                let sum = |range: &Range<usize>| squares[range.clone()].iter().sum::<f64>();
                sum(a).total_cmp(&sum(b))
            })
            .unwrap_or(all)
    }
}

fn figure(
    picture: &Picture<'_>,
    refit: &Simulated,
    repaired: Option<&Simulated>,
    shown: Range<usize>,
) -> Figure {
    let time = &refit.time[shown.clone()];
    let part = if shown.len() < refit.time.len() {
        ", an excerpt"
    } else {
        ""
    };
    let mut models = vec![("refitted", Style::BEFORE, refit)];
    models.extend(repaired.map(|run| ("repaired", Style::AFTER, run)));
    let mut angles = Panel::new("", picture.quantity)
        .with_title(format!("{} (validation{part})", refit.name))
        .with_weight(2.0)
        .with_series(Series::new(
            "measured",
            time,
            &refit.measured_deg[shown.clone()],
            Style::MEASURED,
        ));
    let mut errors = Panel::new("time (s)", "error")
        .with_level(0.0)
        .with_legend(false);
    for (label, style, run) in models {
        let predicted = &run.predicted_deg[shown.clone()];
        angles = angles.with_series(Series::new(label, time, predicted, style));
        let thin = Style::new(style.role, Mark::Thin);
        let error = &run.error()[shown.clone()];
        errors = errors.with_series(Series::new(label, time, error, thin));
    }
    let mut figure = Figure::new(picture.title.clone())
        .with_subtitle(picture.subtitle.clone())
        .with_panel(angles)
        .with_panel(errors);
    figure.width_px = WIDTH_PX;
    figure.row_height_px = ROW_HEIGHT_PX;
    figure
}
