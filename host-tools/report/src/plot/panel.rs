//! One panel on the page: its axes, grid, heading and numbers.
//!
//! The height around a panel depends on its texts, and the page needs it before the
//! panel has a position. So a panel is measured first, then placed, then drawn.

use super::axis::{Axis, drawable};
use super::canvas::{Anchor, Canvas, Stroke, TextLook, tenths};
use super::legend::{
    LEGEND_GAP, LEGEND_SAMPLE, LegendEntry, draw_sample, legend_rows, legend_width,
};
use super::rectangle::Rectangle;
use super::style::Colour;
use super::text::{
    LABEL_PX, LEADING, LEGEND_PX, PANEL_TITLE_PX, TICK_PX, Weight, text_width, wrap,
};
use super::{Figure, Mark, Panel};

const FRAME: Colour = Colour(0x9A, 0x9A, 0x9A);
const GRID: Colour = Colour(0xE6, 0xE6, 0xE6);
const LEVEL: Colour = Colour(0x77, 0x77, 0x77);

/// How far a note stands beside its point, and above or below it.
const NOTE_PX: f64 = 5.0;

/// A panel's place on the page.
#[derive(Clone, Debug)]
pub(super) struct Placed {
    pub(super) area: Rectangle,
    x: Axis,
    y: Axis,
    /// Centre line of the first line of the title.
    pub(super) header_top: f64,
    title: Vec<String>,
    legend: Vec<Vec<LegendEntry>>,
    legend_beside_title: bool,
    y_label: Vec<String>,
    /// Whether the numbers and the label of the abscissa are written.
    labelled_x: bool,
}

/// The ordinate of a panel, and its label in lines.
fn ordinate(panel: &Panel, plot_height: f64) -> (Axis, Vec<String>) {
    let values = panel
        .series
        .iter()
        .flat_map(|s| s.y.iter().chain(&s.upper))
        .chain(&panel.levels)
        .copied()
        .chain(panel.cells.iter().flat_map(|cell| [cell.y.0, cell.y.1]));
    let axis = Axis::over(values, panel.y_range, 0.05, plot_height, 42.0);
    (
        axis,
        wrap(&panel.y_label, LABEL_PX, Weight::Regular, plot_height),
    )
}

impl Placed {
    /// The width that label and numbers of the ordinate take.
    pub(super) fn gutter(panel: &Panel, plot_height: f64) -> f64 {
        let (y, label) = ordinate(panel, plot_height);
        label.len() as f64 * LABEL_PX * LEADING + 6.0 + y.label_width() + 8.0
    }

    /// A panel between `left` and `right`, whose axes begin there.
    pub(super) fn of(
        panel: &Panel,
        figure: &Figure,
        (left, right): (f64, f64),
        plot_height: f64,
        column: usize,
        labelled_x: bool,
    ) -> Self {
        let columns = figure.columns.clamp(1, figure.panels.len().max(1));
        let (y, y_label) = ordinate(panel, plot_height);
        let area = Rectangle {
            left,
            top: 0.0,
            // Half of the last tick's number hangs over the edge.
            right: right - 14.0,
            bottom: plot_height,
        };
        let shares_x: Vec<&Panel> = if figure.shared_x {
            figure.panels.iter().skip(column).step_by(columns).collect()
        } else {
            vec![panel]
        };
        let has_dots = shares_x
            .iter()
            .flat_map(|p| &p.series)
            .any(|s| matches!(s.style.mark, Mark::Points | Mark::Discs | Mark::Rings));
        let x = Axis::over(
            shares_x.iter().flat_map(|p| {
                let cells = p.cells.iter().flat_map(|cell| [cell.x.0, cell.x.1]);
                p.series
                    .iter()
                    .flat_map(|s| s.x.iter().copied())
                    .chain(cells)
            }),
            panel
                .x_range
                .or_else(|| shares_x.iter().find_map(|p| p.x_range)),
            // Lines may end at the edge, dots would be cut in half there.
            if has_dots { 0.02 } else { 0.0 },
            area.right - area.left,
            78.0,
        );
        let x = if panel.decades { x.of_decades() } else { x };
        let title = wrap(
            &panel.title,
            PANEL_TITLE_PX,
            Weight::Bold,
            area.right - area.left,
        );
        let legend = if panel.legend {
            legend_rows(panel, area.right - area.left)
        } else {
            Vec::new()
        };
        let legend_beside_title = legend.len() == 1
            && title.len() <= 1
            && title
                .iter()
                .map(|line| text_width(line, PANEL_TITLE_PX, Weight::Bold) + 2.0 * LEGEND_GAP)
                .sum::<f64>()
                + legend.first().map_or(0.0, |row| legend_width(row))
                <= area.right - area.left;
        Self {
            area,
            x,
            y,
            header_top: 0.0,
            title,
            legend,
            legend_beside_title,
            y_label,
            labelled_x,
        }
    }

    /// What the widest row of the legend leaves of the width of the axes.
    #[cfg(test)]
    pub(super) fn room_beside_legend(&self) -> f64 {
        let rows = self.legend.iter().map(|row| legend_width(row));
        self.area.right - self.area.left - rows.fold(0.0, f64::max)
    }

    pub(super) fn header_height(&self) -> f64 {
        let title = self.title.len() as f64 * PANEL_TITLE_PX * LEADING;
        let legend = self.legend.len() as f64 * LEGEND_PX * LEADING;
        let texts = if self.legend_beside_title {
            title.max(legend)
        } else {
            title + legend
        };
        let power = if self.y.power == 0 {
            0.0
        } else {
            TICK_PX * LEADING
        };
        texts + power + 7.0
    }

    pub(super) fn footer_height(&self, panel: &Panel) -> f64 {
        if !self.labelled_x {
            return 4.0;
        }
        let label = if panel.x_label.is_empty() && self.x.power == 0 {
            0.0
        } else {
            LABEL_PX * LEADING + 2.0
        };
        6.0 + TICK_PX * LEADING + label
    }

    pub(super) fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        (
            self.area.left + self.x.share(x) * (self.area.right - self.area.left),
            self.area.bottom - self.y.share(y) * (self.area.bottom - self.area.top),
        )
    }

    pub(super) fn draw(&self, panel: &Panel, canvas: &mut Canvas) {
        canvas.group(&self.attributes(panel), |canvas| {
            self.draw_inside(panel, canvas);
        });
    }

    /// The attributes from which a script reads values off the panel.
    fn attributes(&self, panel: &Panel) -> [(&'static str, String); 6] {
        let Rectangle {
            left,
            top,
            right,
            bottom,
        } = self.area;
        let edges = [left, top, right, bottom].map(|edge| tenths(edge).to_string());
        [
            ("class", "panel".to_owned()),
            ("data-area", edges.join(" ")),
            ("data-x", format!("{} {}", self.x.low, self.x.high)),
            ("data-y", format!("{} {}", self.y.low, self.y.high)),
            ("data-x-label", panel.x_label.clone()),
            ("data-y-label", panel.y_label.clone()),
        ]
    }

    fn draw_inside(&self, panel: &Panel, canvas: &mut Canvas) {
        self.draw_grid(panel, canvas);
        self.draw_header(canvas);
        for cell in &panel.cells {
            self.draw_cell(cell, canvas);
        }
        for series in &panel.series {
            let mut attributes = vec![("class", "series".to_owned())];
            for (name, value) in [("data-label", &series.label), ("data-key", &series.key)] {
                if !value.is_empty() {
                    attributes.push((name, value.clone()));
                }
            }
            canvas.group(&attributes, |canvas| self.draw_series(series, canvas));
        }
        self.draw_notes(panel, canvas);
        let Rectangle {
            left,
            top,
            right,
            bottom,
        } = self.area;
        canvas.path(
            &[(left, top), (left, bottom), (right, bottom)],
            FRAME,
            Stroke::HAIR,
        );
        let empty = panel.cells.is_empty()
            && panel
                .series
                .iter()
                .all(|s| !s.points().any(|(x, y)| drawable(x) && drawable(y)));
        if empty {
            canvas.text(
                "no data",
                (f64::midpoint(left, right), f64::midpoint(top, bottom)),
                LABEL_PX,
                Anchor::Middle,
                TextLook::SOFT,
            );
        }
    }

    /// Notes stand above and to the right of their points, or where no other note is yet.
    fn draw_notes(&self, panel: &Panel, canvas: &mut Canvas) {
        const SIDES: [(f64, f64); 4] = [(1.0, -1.0), (-1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        let mut taken: Vec<(f64, f64)> = Vec::new();
        for note in &panel.notes {
            let (x, y) = self.at((note.x, note.y));
            if !self.area.contains((x, y)) {
                continue;
            }
            let width = text_width(&note.text, TICK_PX, Weight::Regular);
            let is_free = |centre: &(f64, f64)| {
                taken.iter().all(|other| {
                    (centre.0 - other.0).abs() > width || (centre.1 - other.1).abs() > TICK_PX
                })
            };
            let beside = |(right, down): (f64, f64)| {
                (x + right * (NOTE_PX + width / 2.0), y + down * NOTE_PX)
            };
            let centre = SIDES.map(beside).into_iter().find(is_free);
            let centre = centre.unwrap_or_else(|| beside(SIDES[0]));
            canvas.text(&note.text, centre, TICK_PX, Anchor::Middle, TextLook::SOFT);
            taken.push(centre);
        }
    }

    fn draw_grid(&self, panel: &Panel, canvas: &mut Canvas) {
        let Rectangle {
            left,
            top,
            right,
            bottom,
        } = self.area;
        for (tick, label) in self.y.ticks.iter().zip(&self.y.labels) {
            let (_, y) = self.at((self.x.low, *tick));
            canvas.path(&[(left, y), (right, y)], GRID, Stroke::HAIR);
            canvas.text(label, (left - 7.0, y), TICK_PX, Anchor::End, TextLook::SOFT);
        }
        for (tick, label) in self.x.ticks.iter().zip(&self.x.labels) {
            let (x, _) = self.at((*tick, self.y.low));
            canvas.path(&[(x, top), (x, bottom)], GRID, Stroke::HAIR);
            if self.labelled_x {
                let y = bottom + 6.0 + TICK_PX * LEADING / 2.0;
                canvas.text(label, (x, y), TICK_PX, Anchor::Middle, TextLook::SOFT);
            }
        }
        for level in panel.levels.iter().filter(|level| drawable(**level)) {
            let (_, y) = self.at((self.x.low, *level));
            if y >= top && y <= bottom {
                canvas.path(&[(left, y), (right, y)], LEVEL, Stroke::HAIR);
            }
        }
        if let Some(note) = self.y.power_note() {
            let y = top - 7.0 - TICK_PX * LEADING / 2.0 + 3.0;
            canvas.text(&note, (left, y), TICK_PX, Anchor::Start, TextLook::SOFT);
        }
        if self.labelled_x {
            let y = bottom + 8.0 + TICK_PX * LEADING + LABEL_PX * LEADING / 2.0;
            let centre = f64::midpoint(left, right);
            canvas.text(
                &panel.x_label,
                (centre, y),
                LABEL_PX,
                Anchor::Middle,
                TextLook::PLAIN,
            );
            if let Some(note) = self.x.power_note() {
                canvas.text(&note, (right, y), TICK_PX, Anchor::End, TextLook::SOFT);
            }
        }
        let mut x = left
            - 7.0
            - self.y.label_width()
            - 6.0
            - self.y_label.len() as f64 * LABEL_PX * LEADING
            + LABEL_PX * LEADING / 2.0;
        for line in &self.y_label {
            let y = f64::midpoint(top, bottom);
            canvas.text(line, (x, y), LABEL_PX, Anchor::Middle, TextLook::UPWARDS);
            x += LABEL_PX * LEADING;
        }
    }

    fn draw_header(&self, canvas: &mut Canvas) {
        let mut y = self.header_top;
        for line in &self.title {
            let height = PANEL_TITLE_PX * LEADING;
            let at = (self.area.left, y + height / 2.0);
            canvas.text(line, at, PANEL_TITLE_PX, Anchor::Start, TextLook::BOLD);
            y += height;
        }
        if self.legend_beside_title {
            y = self.header_top;
        }
        for row in &self.legend {
            let height = LEGEND_PX * LEADING;
            let middle = y + height / 2.0;
            // To the right where it shares the line with the title, else from
            // the left.
            let mut x = if self.legend_beside_title {
                self.area.right - legend_width(row)
            } else {
                self.area.left
            };
            for entry in row {
                draw_sample(entry.style, (x, middle), canvas);
                canvas.text(
                    &entry.label,
                    (x + LEGEND_SAMPLE + 6.0, middle),
                    LEGEND_PX,
                    Anchor::Start,
                    TextLook::PLAIN,
                );
                x += entry.width() + LEGEND_GAP;
            }
            y += height;
        }
    }
}
