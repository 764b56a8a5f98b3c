//! The key to the curves of a panel.
//!
//! Figures here often hold many runs of few kinds. The legend names each kind
//! once and wraps to the width of its panel, so that it never covers a curve.

use super::canvas::{Canvas, Stroke};
use super::text::{LEGEND_PX, Weight, text_width};
use super::{Mark, Panel, Style};

pub(super) const LEGEND_SAMPLE: f64 = 24.0;
pub(super) const LEGEND_GAP: f64 = 18.0;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct LegendEntry {
    pub(super) label: String,
    pub(super) style: Style,
}

impl LegendEntry {
    pub(super) fn width(&self) -> f64 {
        LEGEND_SAMPLE + 6.0 + text_width(&self.label, LEGEND_PX, Weight::Regular)
    }
}

pub(super) fn legend_width(row: &[LegendEntry]) -> f64 {
    row.iter().map(LegendEntry::width).sum::<f64>()
        + LEGEND_GAP * row.len().saturating_sub(1) as f64
}

pub(super) fn legend_rows(panel: &Panel, width: f64) -> Vec<Vec<LegendEntry>> {
    let mut rows: Vec<Vec<LegendEntry>> = Vec::new();
    let mut seen: Vec<LegendEntry> = Vec::new();
    for series in panel.series.iter().filter(|s| !s.label.is_empty()) {
        let entry = LegendEntry {
            label: series.label.clone(),
            style: series.style,
        };
        // Repeats of one run share a label and need one entry.
        if seen.contains(&entry) {
            continue;
        }
        seen.push(entry.clone());
        match rows.last_mut() {
            Some(row) if legend_width(row) + LEGEND_GAP + entry.width() <= width => row.push(entry),
            _ => rows.push(vec![entry]),
        }
    }
    rows
}

/// A short piece of what the entry stands for.
pub(super) fn draw_sample(style: Style, (x, y): (f64, f64), canvas: &mut Canvas) {
    let colour = canvas.colour(style);
    match style.mark {
        Mark::Points => [4.0, 12.0, 20.0]
            .into_iter()
            .for_each(|offset| canvas.dot((x + offset, y), colour)),
        Mark::Discs | Mark::Rings => {
            let middle = (x + LEGEND_SAMPLE / 2.0, y);
            canvas.disc(middle, colour, style.mark == Mark::Rings);
        }
        Mark::Band => {
            let (x2, top, bottom) = (x + LEGEND_SAMPLE, y - 4.5, y + 4.5);
            canvas.polygon(&[(x, top), (x2, top), (x2, bottom), (x, bottom)], colour);
        }
        mark => canvas.path(&[(x, y), (x + LEGEND_SAMPLE, y)], colour, Stroke::of(mark)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::{Role, Series};

    #[test]
    fn the_legend_wraps_and_names_repeats_once() {
        let mut panel = Panel::new("x", "y");
        for _ in 0..7 {
            panel = panel.with_series(Series::new("repeat", &[0.0], &[0.0], Style::MEASURED));
        }
        assert_eq!(legend_rows(&panel, 700.0).concat().len(), 1);
        for i in 0..12 {
            let style = Style::new(Role::Other(i), Mark::Line);
            let label = format!("a candidate with a long name {i}");
            panel = panel.with_series(Series::new(label, &[0.0], &[0.0], style));
        }
        let rows = legend_rows(&panel, 700.0);
        assert_eq!(rows.concat().len(), 13);
        assert!(rows.iter().all(|row| legend_width(row) <= 700.0));
    }
}
