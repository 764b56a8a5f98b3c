//! The layout of the page.
//!
//! Headings wrap, legends have different heights, and the axes of one column have to
//! line up. So all positions are computed first, in pixels, before anything is drawn.

use super::axis::drawable;
use super::canvas::{Anchor, Canvas, Medium, TextLook};
use super::panel::Placed;
use super::rectangle::Rectangle;
use super::style::Colour;
use super::text::{LEADING, SUBTITLE_PX, TITLE_PX, Weight, wrap};
use super::{Figure, Panel};

/// The narrowest and the widest picture.
pub(super) const WIDTHS_PX: (f64, f64) = (240.0, 4000.0);
const MARGIN: f64 = 16.0;
const COLUMN_GAP: f64 = 22.0;
const ROW_GAP: f64 = 14.0;

/// Where everything goes, in pixels.
pub(super) struct Layout {
    pub(super) width: f64,
    pub(super) height: f64,
    title: Vec<String>,
    subtitle: Vec<String>,
    panels: Vec<Placed>,
}

impl Layout {
    pub(super) fn of(figure: &Figure) -> Self {
        let width = if drawable(figure.width_px) {
            figure.width_px.clamp(WIDTHS_PX.0, WIDTHS_PX.1)
        } else {
            860.0
        };
        let row_height = if drawable(figure.row_height_px) {
            figure.row_height_px.clamp(60.0, 2000.0)
        } else {
            230.0
        };
        let text_room = width - 2.0 * MARGIN;
        let title = wrap(&figure.title, TITLE_PX, Weight::Bold, text_room);
        let subtitle = wrap(&figure.subtitle, SUBTITLE_PX, Weight::Regular, text_room);
        let mut top = MARGIN
            + title.len() as f64 * TITLE_PX * LEADING
            + subtitle.len() as f64 * SUBTITLE_PX * LEADING
            + if title.is_empty() && subtitle.is_empty() {
                0.0
            } else {
                8.0
            };

        let columns = figure.columns.clamp(1, figure.panels.len().max(1));
        let column_width = (text_room - COLUMN_GAP * (columns - 1) as f64) / columns as f64;
        let heights: Vec<f64> = figure
            .panels
            .chunks(columns)
            .map(|row| row_height * weight_of(row))
            .collect();
        // Axes of one column start at the same place, so that a shared abscissa lines up.
        let mut gutters = vec![0.0; columns];
        for (place, panel) in figure.panels.iter().enumerate() {
            let gutter: &mut f64 = &mut gutters[place % columns];
            *gutter = gutter.max(Placed::gutter(panel, heights[place / columns]));
        }
        let mut panels: Vec<Placed> = Vec::new();
        let count = figure.panels.len();
        for (row_index, row) in figure.panels.chunks(columns).enumerate() {
            let plot_height = heights[row_index];
            let mut placed: Vec<Placed> = row
                .iter()
                .enumerate()
                .map(|(column, panel)| {
                    let left = MARGIN + column as f64 * (column_width + COLUMN_GAP);
                    let lowest = row_index * columns + column + columns >= count;
                    Placed::of(
                        panel,
                        figure,
                        (left + gutters[column], left + column_width),
                        plot_height,
                        column % columns,
                        lowest || !figure.shared_x,
                    )
                })
                .collect();
            let header = placed.iter().map(Placed::header_height).fold(0.0, f64::max);
            let footer = placed
                .iter()
                .zip(row)
                .map(|(placed, panel)| placed.footer_height(panel))
                .fold(0.0, f64::max);
            for panel in &mut placed {
                panel.header_top = top + header - panel.header_height();
                panel.area.top = top + header;
                panel.area.bottom = panel.area.top + plot_height;
            }
            top += header + plot_height + footer + ROW_GAP;
            panels.append(&mut placed);
        }
        Self {
            width,
            height: (top - ROW_GAP).max(0.0) + MARGIN,
            title,
            subtitle,
            panels,
        }
    }

    /// Its height over its width.
    pub(super) fn aspect(&self) -> f64 {
        self.height / self.width
    }

    pub(super) fn draw(&self, figure: &Figure, canvas: &mut Canvas) {
        let page = Rectangle {
            left: 0.0,
            top: 0.0,
            right: self.width,
            bottom: self.height,
        };
        if canvas.medium != Medium::Page {
            canvas.fill(&page, Colour(0xFF, 0xFF, 0xFF));
        }
        let mut y = MARGIN;
        for (lines, size, look) in [
            (&self.title, TITLE_PX, TextLook::BOLD),
            (&self.subtitle, SUBTITLE_PX, TextLook::SOFT),
        ] {
            for line in lines {
                let height = size * LEADING;
                canvas.text(line, (MARGIN, y + height / 2.0), size, Anchor::Start, look);
                y += height;
            }
        }
        for (placed, panel) in self.panels.iter().zip(&figure.panels) {
            placed.draw(panel, canvas);
        }
    }
}

/// The height of a row, in usual rows: that of its highest panel.
fn weight_of(row: &[Panel]) -> f64 {
    let weights = row.iter().map(|panel| panel.weight);
    let highest = weights
        .filter(|weight| drawable(*weight) && *weight > 0.0)
        .fold(0.0, f64::max);
    if highest > 0.0 {
        highest.min(10.0)
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::{Series, Style};

    /// Numbers of one panel push the axes of all panels of its column aside, and legends wrap where
    /// they end then.
    #[test]
    fn a_legend_stays_within_the_axes_of_its_column() {
        let panel = |largest: f64| {
            let labels = ["measured", "refitted", "repaired"];
            labels
                .iter()
                .fold(Panel::new("time (s)", "angle (°)"), |panel, label| {
                    let line = Series::new(*label, &[0.0, 1.0], &[0.0, largest], Style::AFTER);
                    panel.with_series(line)
                })
        };
        for width in [300.0, 320.0, 340.0, 360.0, 380.0] {
            let mut figure = Figure::new("")
                .with_panel(panel(1.0))
                .with_panel(panel(123_456.0));
            (figure.columns, figure.width_px) = (1, width);
            for placed in &Layout::of(&figure).panels {
                assert!(placed.room_beside_legend() >= 0.0, "{width}");
            }
        }
    }
}
