//! The data inside a panel.
//!
//! Recordings have gaps, exceed the limits and have more samples than pixels. Here a
//! series becomes the lines, dots and areas to draw.

use super::axis::drawable;
use super::canvas::{Canvas, Stroke};
use super::panel::Placed;
use super::rectangle::Rectangle;
use super::style::Colour;
use super::thin::{runs, thin_dots, thin_line};
use super::{Cell, Mark, Series, diverging};

impl Placed {
    pub(super) fn draw_cell(&self, cell: &Cell, canvas: &mut Canvas) {
        let corners = [(cell.x.0, cell.y.1), (cell.x.1, cell.y.0)];
        if !corners.iter().all(|(x, y)| drawable(*x) && drawable(*y)) {
            return;
        }
        let [(left, top), (right, bottom)] = corners.map(|corner| self.at(corner));
        let area = Rectangle {
            left: left.max(self.area.left),
            top: top.max(self.area.top),
            right: right.min(self.area.right),
            bottom: bottom.min(self.area.bottom),
        };
        let (red, green, blue) = diverging(cell.shade);
        let attributes = [
            ("class", "cell".to_owned()),
            ("data-text", cell.text.clone()),
        ];
        canvas.group(&attributes, |canvas| {
            canvas.fill(&area, Colour(red, green, blue));
        });
    }

    pub(super) fn draw_series(&self, series: &Series, canvas: &mut Canvas) {
        let colour = canvas.colour(series.style);
        match series.style.mark {
            Mark::Points => {
                let inside: Vec<(f64, f64)> = series
                    .points()
                    .filter(|(x, y)| drawable(*x) && drawable(*y))
                    .map(|point| self.at(point))
                    .filter(|point| self.area.contains(*point))
                    .collect();
                for centre in thin_dots(&inside) {
                    canvas.dot(centre, colour);
                }
            }
            Mark::Discs | Mark::Rings => {
                let is_ring = series.style.mark == Mark::Rings;
                let points = series.points();
                for point in points.filter(|(x, y)| drawable(*x) && drawable(*y)) {
                    let centre = self.at(point);
                    if self.area.contains(centre) {
                        canvas.disc(centre, colour, is_ring);
                    }
                }
            }
            Mark::Band => {
                for corners in self.bands(series) {
                    canvas.polygon(&corners, colour);
                }
            }
            mark => {
                for run in runs(series.points()) {
                    let pixels: Vec<(f64, f64)> = run.into_iter().map(|p| self.at(p)).collect();
                    for visible in self.area.clip_path(&thin_line(&pixels)) {
                        canvas.path(&visible, colour, Stroke::of(mark));
                    }
                }
            }
        }
    }

    /// The outlines of a band, one for each uninterrupted stretch.
    fn bands(&self, series: &Series) -> Vec<Vec<(f64, f64)>> {
        let lower: Vec<(f64, f64)> = series.points().collect();
        let mut outlines = Vec::new();
        let mut stretch: Vec<[(f64, f64); 2]> = Vec::new();
        let mut close = |stretch: &mut Vec<[(f64, f64); 2]>| {
            let edge = |which: usize| -> Vec<(f64, f64)> {
                let pixels: Vec<(f64, f64)> = stretch
                    .iter()
                    .map(|pair| self.at(pair[which]))
                    // Clamping keeps the outline closed where a band leaves the
                    // panel.
                    .map(|(x, y)| {
                        (
                            x.clamp(self.area.left, self.area.right),
                            y.clamp(self.area.top, self.area.bottom),
                        )
                    })
                    .collect();
                thin_line(&pixels)
            };
            if stretch.len() > 1 {
                let mut outline = edge(0);
                outline.extend(edge(1).into_iter().rev());
                outlines.push(outline);
            }
            stretch.clear();
        };
        for ((x, low), high) in lower.into_iter().zip(series.upper.iter().copied()) {
            if drawable(x) && drawable(low) && drawable(high) {
                stretch.push([(x, low), (x, high)]);
            } else {
                close(&mut stretch);
            }
        }
        close(&mut stretch);
        outlines
    }
}
