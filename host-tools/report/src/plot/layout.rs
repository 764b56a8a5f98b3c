//! The layout of the page.
//!
//! Headings wrap, legends have different heights, and the axes of one column have to
//! line up. So all positions are computed first, in pixels, before anything is drawn.

use super::Figure;
use super::axis::drawable;
use super::canvas::{Anchor, Canvas, Medium, TextLook};
use super::panel::Placed;
use super::rectangle::Rectangle;
use super::style::Colour;
use super::text::{LEADING, SUBTITLE_PX, TITLE_PX, Weight, wrap};

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
        let mut panels: Vec<Placed> = Vec::new();
        let count = figure.panels.len();
        for (row_index, row) in figure.panels.chunks(columns).enumerate() {
            let weight = row
                .iter()
                .map(|panel| panel.weight)
                .filter(|w| drawable(*w) && *w > 0.0)
                .fold(0.0, f64::max);
            let plot_height = row_height * if weight > 0.0 { weight.min(10.0) } else { 1.0 };
            let mut placed: Vec<Placed> = row
                .iter()
                .enumerate()
                .map(|(column, panel)| {
                    let left = MARGIN + column as f64 * (column_width + COLUMN_GAP);
                    let lowest = row_index * columns + column + columns >= count;
                    Placed::of(
                        panel,
                        figure,
                        (left, column_width),
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
        // Axes of one column start at the same place, so that a shared abscissa
        // lines up.
        for column in 0..columns {
            let left = panels
                .iter()
                .skip(column)
                .step_by(columns)
                .map(|panel| panel.area.left)
                .fold(0.0, f64::max);
            for panel in panels.iter_mut().skip(column).step_by(columns) {
                panel.area.left = left;
            }
        }
        Self {
            width,
            height: (top - ROW_GAP).max(0.0) + MARGIN,
            title,
            subtitle,
            panels,
        }
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
