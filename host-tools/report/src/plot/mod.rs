//! Pictures: panels of curves against a shared axis, as SVG.
//!
//! Every command that compares a model with a rig draws the same kind of figure, and readers
//! compare figures across commands. So the meaning of a colour ([`Role`]), the thinning of long
//! recordings and the place of the legend are decided here. The module writes the SVG text
//! itself (`canvas`): it needs no system font, and a script can read values off it.
//!
//! The same figure gives the same bytes on every machine.

mod axis;
mod canvas;
mod curves;
mod layout;
mod legend;
mod look;
mod panel;
mod rectangle;
mod style;
mod text;
mod thin;

use canvas::{Medium, Size};
use layout::Layout;

pub use canvas::LINE_PX;
pub use look::{Colours, Format, Length, Look, Printer, install, write};
pub use style::{Mark, Role, Style, css_colour, diverging};

/// One curve.
///
/// `x` and `y` are paired up to the shorter of the two. A NaN or infinite value
/// interrupts the line.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// The legend's text; a series without one is left out of the legend.
    pub label: String,
    /// Abscissae, in the unit that the panel's `x_label` names.
    pub x: Vec<f64>,
    /// Ordinates, in the unit that the panel's `y_label` names; the lower edge
    /// of a band.
    pub y: Vec<f64>,
    /// The upper edge of a band; empty otherwise.
    pub upper: Vec<f64>,
    /// How it looks.
    pub style: Style,
    /// A key for scripts besides its label, such as the number of a
    /// run; may be empty.
    pub key: String,
}

impl Series {
    /// Creates a curve.
    pub fn new(label: impl Into<String>, x: &[f64], y: &[f64], style: Style) -> Self {
        Self {
            label: label.into(),
            x: x.to_vec(),
            y: y.to_vec(),
            upper: Vec::new(),
            style,
            key: String::new(),
        }
    }

    /// Creates a shaded area between `lower` and `upper`.
    pub fn band(
        label: impl Into<String>,
        x: &[f64],
        lower: &[f64],
        upper: &[f64],
        role: Role,
    ) -> Self {
        Self {
            upper: upper.to_vec(),
            ..Self::new(label, x, lower, Style::new(role, Mark::Band))
        }
    }

    /// Sets what a script may know it by.
    pub fn with_key(mut self, key: impl Into<String>) -> Self {
        self.key = key.into();
        self
    }

    fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        self.x.iter().copied().zip(self.y.iter().copied())
    }
}

/// A coloured rectangle of a map.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// From and to along the abscissa.
    pub x: (f64, f64),
    /// From and to along the ordinate.
    pub y: (f64, f64),
    /// Its value, −1 to 1 on the scale of the map.
    pub shade: f64,
    /// Its text.
    pub text: String,
}

/// A word or number beside a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Note {
    /// Abscissa of the point.
    pub x: f64,
    /// Ordinate of the point.
    pub y: f64,
    /// Its text.
    pub text: String,
}

/// One pair of axes with its curves.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// A short heading; may be empty.
    pub title: String,
    /// Quantity and unit of the abscissa, such as `time (s)`.
    pub x_label: String,
    /// Quantity and unit of the ordinate, such as `angle (°)`.
    pub y_label: String,
    /// The cells of a map, drawn before the curves.
    pub cells: Vec<Cell>,
    /// The curves, drawn in this order.
    pub series: Vec<Series>,
    /// Words and numbers beside points.
    pub notes: Vec<Note>,
    /// Limits of the abscissa; from the data if absent. Data outside is cut off.
    pub x_range: Option<(f64, f64)>,
    /// Limits of the ordinate; from the data if absent. Data outside is cut off.
    pub y_range: Option<(f64, f64)>,
    /// Ordinates at which a thin horizontal line is drawn, such as 0 for
    /// residuals; the range is widened to show them.
    pub levels: Vec<f64>,
    /// Height relative to the other rows; 1 is usual.
    pub weight: f64,
    /// Whether the abscissa of the curves is the decimal logarithm of what it is labelled as.
    pub decades: bool,
    /// Whether the labels of the curves are listed above; not where the text
    /// around the picture does.
    pub legend: bool,
}

impl Panel {
    /// Creates an empty panel.
    pub fn new(x_label: impl Into<String>, y_label: impl Into<String>) -> Self {
        Self {
            title: String::new(),
            x_label: x_label.into(),
            y_label: y_label.into(),
            cells: Vec::new(),
            series: Vec::new(),
            notes: Vec::new(),
            x_range: None,
            y_range: None,
            levels: Vec::new(),
            weight: 1.0,
            decades: false,
            legend: true,
        }
    }

    /// Sets the heading.
    pub fn with_title(mut self, title: impl Into<String>) -> Self {
        self.title = title.into();
        self
    }

    /// Adds a curve.
    pub fn with_series(mut self, series: Series) -> Self {
        self.series.push(series);
        self
    }

    /// Writes beside a point.
    pub fn with_note(mut self, x: f64, y: f64, text: impl Into<String>) -> Self {
        let text = text.into();
        self.notes.push(Note { x, y, text });
        self
    }

    /// Sets the cells of a map.
    pub fn with_cells(mut self, cells: Vec<Cell>) -> Self {
        self.cells = cells;
        self
    }

    /// Fixes the limits of the abscissa.
    pub fn with_x_range(mut self, low: f64, high: f64) -> Self {
        self.x_range = Some((low, high));
        self
    }

    /// Fixes the limits of the ordinate.
    pub fn with_y_range(mut self, low: f64, high: f64) -> Self {
        self.y_range = Some((low, high));
        self
    }

    /// Adds a thin horizontal line.
    pub fn with_level(mut self, level: f64) -> Self {
        self.levels.push(level);
        self
    }

    /// Labels the abscissa, which is a decimal logarithm, with the numbers themselves.
    pub fn with_decades(mut self) -> Self {
        self.decades = true;
        self
    }

    /// Shows or hides the labels of the curves.
    pub fn with_legend(mut self, legend: bool) -> Self {
        self.legend = legend;
        self
    }

    /// Sets the height relative to the other rows.
    pub fn with_weight(mut self, weight: f64) -> Self {
        self.weight = weight;
        self
    }
}

/// A whole picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// The heading.
    pub title: String,
    /// One or two sentences under the heading, wrapped to the width.
    pub subtitle: String,
    /// The panels, row by row from the top left.
    pub panels: Vec<Panel>,
    /// Panels per row; 1 stacks them.
    pub columns: usize,
    /// Whether the panels of a column have the same abscissa; then only the
    /// lowest shows its numbers and label.
    pub shared_x: bool,
    /// Width in pixels.
    pub width_px: f64,
    /// Height of the drawing area of a panel of weight 1, in pixels.
    pub row_height_px: f64,
}

impl Figure {
    /// Creates a figure without panels.
    pub fn new(title: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            subtitle: String::new(),
            panels: Vec::new(),
            columns: 1,
            shared_x: true,
            width_px: 860.0,
            row_height_px: 230.0,
        }
    }

    /// Sets the text under the heading.
    pub fn with_subtitle(mut self, subtitle: impl Into<String>) -> Self {
        self.subtitle = subtitle.into();
        self
    }

    /// Adds a panel.
    pub fn with_panel(mut self, panel: Panel) -> Self {
        self.panels.push(panel);
        self
    }

    /// Sets the number of panels per row.
    pub fn with_columns(mut self, columns: usize) -> Self {
        self.columns = columns;
        self
    }

    /// Gives every panel its own abscissa.
    pub fn with_separate_x(mut self) -> Self {
        self.shared_x = false;
        self
    }
}

/// Draws a figure.
///
/// # Examples
///
/// ```
/// use softrig_report::plot::{Figure, Panel, Series, Style, to_svg_string};
///
/// let time_s: Vec<f64> = (0..100).map(|i| f64::from(i) * 0.01).collect();
/// let angle_deg: Vec<f64> = time_s.iter().map(|t| 60.0 * (1.0 - (-5.0 * t).exp())).collect();
/// let figure = Figure::new("Step to 60°").with_panel(
///     Panel::new("time (s)", "angle (°)")
///         .with_series(Series::new("nominal", &time_s, &angle_deg, Style::NOMINAL)),
/// );
/// assert!(to_svg_string(&figure).starts_with("<svg"));
/// ```
pub fn to_svg_string(figure: &Figure) -> String {
    drawn(figure, Medium::File, &figure.title, None)
}

/// Draws a figure as part of an HTML page: as wide as there is room, without a
/// ground. `name` is what someone hears who does not see it.
///
/// Panels, series and cells stand in groups that say what is in them: the axes
/// of a panel in tenths of a pixel and in their units (`data-area`, `data-x`,
/// `data-y`), the label of a series, the text of a cell. So a script can read
/// values off the drawing, and no number is there twice.
pub fn to_inline_svg(figure: &Figure, name: &str) -> String {
    drawn(figure, Medium::Page, name, None)
}

fn drawn(figure: &Figure, medium: Medium, name: &str, size: Option<Size>) -> String {
    let layout = Layout::of(figure);
    let extent = (layout.width, layout.height);
    canvas::document(extent, medium, name, size, |canvas| {
        layout.draw(figure, canvas);
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(count: u32) -> (Vec<f64>, Vec<f64>) {
        let x: Vec<f64> = (0..count).map(|i| f64::from(i) * 0.01).collect();
        let y = x.iter().map(|t| 60.0 * (3.0 * t).sin()).collect();
        (x, y)
    }

    fn points_of(svg: &str) -> usize {
        svg.lines()
            .filter(|line| line.contains("#0072B2") && line.contains("points="))
            .map(|line| line.matches(',').count())
            .sum()
    }

    #[test]
    fn the_same_figure_gives_the_same_bytes() {
        let (x, y) = wave(500);
        let figure = Figure::new("A < B & \"C\"").with_panel(
            Panel::new("time (s)", "angle (°)").with_series(Series::new("a", &x, &y, Style::AFTER)),
        );
        assert_eq!(to_svg_string(&figure), to_svg_string(&figure.clone()));
    }

    #[test]
    fn empty_and_odd_data_draw_without_numbers_that_are_none() {
        let nan = f64::NAN;
        let odd: [(&[f64], &[f64]); 7] = [
            (&[], &[]),
            (&[0.0], &[nan]),
            (&[0.0], &[1.0]),
            (&[0.0, 1.0], &[2.0, 2.0]),
            (&[nan, f64::INFINITY], &[1.0, 2.0]),
            (&[0.0, 1.0, 2.0], &[f64::MAX, -f64::MAX, 1e-300]),
            (&[0.0, 1.0], &[1.0]),
        ];
        for (x, y) in odd {
            for mark in [
                Mark::Line,
                Mark::Dashed,
                Mark::Points,
                Mark::Band,
                Mark::Thin,
            ] {
                let style = Style::new(Role::Nominal, mark);
                let series = Series {
                    upper: y.to_vec(),
                    ..Series::new("odd", x, y, style)
                };
                let panel = Panel::new("x", "y").with_series(series).with_level(nan);
                let svg = to_svg_string(&Figure::new("odd").with_panel(panel));
                assert!(!svg.contains("NaN") && !svg.contains("inf"), "{x:?} {y:?}");
            }
        }
        let bare = to_svg_string(&Figure::new(""));
        assert!(bare.ends_with("</svg>\n"));
        let no_series = Figure::new("t").with_panel(Panel::new("x", "y"));
        assert!(to_svg_string(&no_series).contains("no data"));
    }

    #[test]
    fn a_gap_breaks_the_line() {
        let (x, mut y) = wave(100);
        let figure = |y: &[f64]| {
            Figure::new("").with_panel(Panel::new("x", "y").with_series(Series::new(
                "",
                &x,
                y,
                Style::NOMINAL,
            )))
        };
        let count = |svg: &str| svg.matches("stroke=\"#0072B2\"").count();
        assert_eq!(count(&to_svg_string(&figure(&y))), 1);
        y[50] = f64::NAN;
        assert_eq!(count(&to_svg_string(&figure(&y))), 2);
    }

    #[test]
    fn a_long_recording_gives_a_small_file() {
        let (x, mut y) = wave(12_000);
        for (i, value) in y.iter_mut().enumerate() {
            *value += if i % 2 == 0 { 5.0 } else { -5.0 };
        }
        y[6_001] = 500.0;
        let mut panel = Panel::new("time (s)", "angle (°)");
        for role in [Role::Nominal, Role::Before, Role::After] {
            panel = panel.with_series(Series::new("a", &x, &y, Style::new(role, Mark::Line)));
        }
        let dots = Series::new("d", &x, &y, Style::MEASURED_POINTS);
        let figure = Figure::new("long").with_panel(panel.with_series(dots));
        let svg = to_svg_string(&figure);
        assert!(svg.len() < 300_000, "{} bytes", svg.len());
        assert!(points_of(&svg) < 2_000);
    }

    #[test]
    fn a_picture_on_a_page_says_what_is_in_it() {
        let (x, y) = wave(50);
        let cell = Cell {
            x: (0.0, 0.1),
            y: (0.0, 20.0),
            shade: -0.5,
            text: "−2 N \"here\"".into(),
        };
        let panel = Panel::new("time (s)", "a < b (°)")
            .with_cells(vec![cell])
            .with_series(Series::new("measured", &x, &y, Style::MEASURED).with_key("3"));
        let figure = Figure::new("").with_panel(panel);
        let page = to_inline_svg(&figure, "Run \"3\" <b>");
        for part in [
            "aria-label=\"Run &quot;3&quot; &lt;b&gt;\"",
            "data-y-label=\"a &lt; b (°)\"",
            "data-label=\"measured\" data-key=\"3\"",
            "data-text=\"−2 N &quot;here&quot;\"",
        ] {
            assert!(page.contains(part), "{part} is not in {page}");
        }
        assert_eq!(page.matches("<g").count(), page.matches("</g>").count());
        // No ground, and no name space that looks like an address to load.
        assert!(!page.contains("#FFFFFF") && !page.contains("http"));
        let file = to_svg_string(&figure);
        assert!(file.contains("#FFFFFF") && !file.contains("<g"));
    }

    #[test]
    fn a_file_is_replaced_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.svg");
        std::fs::write(&path, "old").unwrap();
        write(&path, &Figure::new("new"), &Look::default()).unwrap();
        assert!(std::fs::read_to_string(&path).unwrap().contains("new"));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        let missing = folder.path().join("none").join("a.svg");
        let error = write(&missing, &Figure::new(""), &Look::default()).unwrap_err();
        assert!(error.to_string().contains("folder exists"));
    }
}
