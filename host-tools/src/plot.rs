//! Pictures: panels of curves against a shared axis, as SVG.
//!
//! Every command that compares a model with a rig draws the same kind of
//! figure, and a reader compares figures across commands. So the meaning of a
//! colour ([`Role`]), the way long recordings are thinned and the place of the
//! legend are decided once, here. The drawing itself is done by the SVG backend
//! of `plotters`, which needs no system font.
//!
//! The same figure gives the same bytes on every machine.
//!
//! # Examples
//!
//! ```
//! use host_tools::plot::{Figure, Panel, Series, Style, to_svg_string};
//!
//! let time_s: Vec<f64> = (0..100).map(|i| f64::from(i) * 0.01).collect();
//! let angle_deg: Vec<f64> = time_s.iter().map(|t| 60.0 * (1.0 - (-5.0 * t).exp())).collect();
//! let figure = Figure::new("Step to 60°").with_panel(
//!     Panel::new("time (s)", "angle (°)")
//!         .with_series(Series::new("nominal", &time_s, &angle_deg, Style::NOMINAL)),
//! );
//! assert!(to_svg_string(&figure)?.starts_with("<svg"));
//! # Ok::<(), host_tools::plot::PlotError>(())
//! ```

use std::path::Path;

use plotters::backend::{DrawingBackend, SVGBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontFamily, FontStyle, FontTransform, RGBColor, ShapeStyle, TextStyle};

use crate::error::{InputError, write_atomically};

/// Why a picture could not be drawn or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlotError {
    /// The file could not be written.
    #[error(transparent)]
    Write(#[from] InputError),
    /// The drawing backend refused an element.
    #[error("cannot draw the picture: {0}")]
    Draw(String),
}

/// What a curve stands for; it decides the colour.
///
/// The hues are those of Okabe and Ito, which readers with the common colour
/// deficiencies can tell apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// What the rig did: grey.
    Measured,
    /// The model as supplied: blue.
    Nominal,
    /// The model before a repair, or the rival: vermilion.
    Before,
    /// The model after a repair: green.
    After,
    /// The one curve to look at: purple.
    Emphasis,
    /// A threshold, a set-point, a noise floor: near black.
    Reference,
    /// Further curves that need telling apart; the colours repeat after four.
    Other(usize),
}

impl Role {
    fn colour(self) -> RGBColor {
        match self {
            Self::Measured => RGBColor(0xA0, 0xA0, 0xA0),
            Self::Nominal => RGBColor(0x00, 0x72, 0xB2),
            Self::Before => RGBColor(0xD5, 0x5E, 0x00),
            Self::After => RGBColor(0x00, 0x9E, 0x73),
            Self::Emphasis => RGBColor(0xA0, 0x3C, 0x78),
            Self::Reference => RGBColor(0x33, 0x33, 0x33),
            Self::Other(index) => match index % 4 {
                0 => RGBColor(0x56, 0xB4, 0xE9),
                1 => RGBColor(0xE6, 0x9F, 0x00),
                2 => RGBColor(0xCC, 0x79, 0xA7),
                _ => RGBColor(0x8C, 0x6B, 0x3F),
            },
        }
    }
}

/// How a curve is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A continuous line.
    Line,
    /// A dashed line.
    Dashed,
    /// A thin line, for a curve in the background.
    Thin,
    /// A wide line, for a curve that others are meant to cover.
    Wide,
    /// Separate dots.
    Points,
    /// The area between two curves; see [`Series::band`].
    Band,
}

/// Colour and mark of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Style {
    /// What the series stands for.
    pub role: Role,
    /// How it is drawn.
    pub mark: Mark,
}

impl Style {
    /// Grey dots: measured samples.
    pub const MEASURED_POINTS: Self = Self::new(Role::Measured, Mark::Points);
    /// Wide grey line: a measured recording, still seen under a model that
    /// agrees with it.
    pub const MEASURED: Self = Self::new(Role::Measured, Mark::Wide);
    /// Blue line: the model as supplied.
    pub const NOMINAL: Self = Self::new(Role::Nominal, Mark::Line);
    /// Vermilion line: before the repair.
    pub const BEFORE: Self = Self::new(Role::Before, Mark::Line);
    /// Green line: after the repair.
    pub const AFTER: Self = Self::new(Role::After, Mark::Line);
    /// Purple line: the curve to look at.
    pub const EMPHASIS: Self = Self::new(Role::Emphasis, Mark::Line);
    /// Dark dashes: a set-point or threshold.
    pub const REFERENCE: Self = Self::new(Role::Reference, Mark::Dashed);

    /// Creates a style.
    pub const fn new(role: Role, mark: Mark) -> Self {
        Self { role, mark }
    }

    /// Replaces the mark by dashes.
    pub const fn dashed(self) -> Self {
        Self::new(self.role, Mark::Dashed)
    }
}

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

    fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        self.x.iter().copied().zip(self.y.iter().copied())
    }
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
    /// The curves, drawn in this order.
    pub series: Vec<Series>,
    /// Limits of the abscissa; from the data if absent. Data outside is cut off.
    pub x_range: Option<(f64, f64)>,
    /// Limits of the ordinate; from the data if absent. Data outside is cut off.
    pub y_range: Option<(f64, f64)>,
    /// Ordinates at which a thin horizontal line is drawn, such as 0 for
    /// residuals; the range is widened to show them.
    pub levels: Vec<f64>,
    /// Height relative to the other rows; 1 is usual.
    pub weight: f64,
}

impl Panel {
    /// Creates an empty panel.
    pub fn new(x_label: impl Into<String>, y_label: impl Into<String>) -> Self {
        Self {
            title: String::new(),
            x_label: x_label.into(),
            y_label: y_label.into(),
            series: Vec::new(),
            x_range: None,
            y_range: None,
            levels: Vec::new(),
            weight: 1.0,
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

/// Draws a figure and writes it, replacing an existing file only when the new
/// one is complete.
///
/// # Errors
///
/// [`PlotError::Write`] if the folder is missing or not writable.
pub fn write_svg(path: &Path, figure: &Figure) -> Result<(), PlotError> {
    let svg = to_svg_string(figure)?;
    Ok(write_atomically(path, svg.as_bytes())?)
}

/// Draws a figure.
///
/// # Errors
///
/// [`PlotError::Draw`] if the backend refuses an element, which no figure is
/// known to cause.
pub fn to_svg_string(figure: &Figure) -> Result<String, PlotError> {
    let layout = Layout::of(figure);
    let mut body = String::new();
    {
        let mut canvas = Canvas::new(&mut body, layout.width, layout.height);
        layout.draw(figure, &mut canvas)?;
    }
    // The backend writes whole pixels and knows neither dashes nor joins. So it
    // is given tenths of a pixel, and the head of the document scales them.
    let elements = body.split_once('\n').map_or("", |(_, rest)| rest);
    let dashed = format!("stroke-width=\"{DASHED_TENTHS}\"");
    let with_dashes = elements.replace(
        &dashed,
        &format!("stroke-width=\"{LINE_TENTHS}\" stroke-dasharray=\"55 40\""),
    );
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" viewBox=\"0 0 {} {}\" \
         stroke-linejoin=\"round\" stroke-linecap=\"butt\" role=\"img\">\n{with_dashes}",
        tenths(layout.width) / 10,
        tenths(layout.height) / 10,
        tenths(layout.width),
        tenths(layout.height),
    ))
}

const FONT: &str = "Helvetica, Arial, Liberation Sans, sans-serif";
const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
const SOFT_INK: RGBColor = RGBColor(0x55, 0x55, 0x55);
const FRAME: RGBColor = RGBColor(0x9A, 0x9A, 0x9A);
const GRID: RGBColor = RGBColor(0xE6, 0xE6, 0xE6);
const LEVEL: RGBColor = RGBColor(0x77, 0x77, 0x77);

const MARGIN: f64 = 16.0;
const TITLE_PX: f64 = 16.0;
const SUBTITLE_PX: f64 = 12.0;
const PANEL_TITLE_PX: f64 = 13.0;
const LABEL_PX: f64 = 12.0;
const TICK_PX: f64 = 11.0;
const LEGEND_PX: f64 = 12.0;
const LEADING: f64 = 1.35;
const LEGEND_SAMPLE: f64 = 24.0;
const LEGEND_GAP: f64 = 18.0;
const COLUMN_GAP: f64 = 22.0;
const ROW_GAP: f64 = 14.0;

/// Widths in tenths of a pixel. No other line may have the width that stands
/// for dashes.
const LINE_TENTHS: u32 = 16;
const DASHED_TENTHS: u32 = 17;
const THIN_TENTHS: u32 = 9;
const WIDE_TENTHS: u32 = 42;
const HAIR_TENTHS: u32 = 8;
const DOT_RADIUS_TENTHS: u32 = 17;
/// More dots than this in one series say nothing more and make slow files.
const MAXIMUM_DOTS: usize = 900;

#[allow(clippy::cast_possible_truncation)] // saturates, and callers pass clipped pixels
fn tenths(pixels: f64) -> i32 {
    (pixels * 10.0).round() as i32
}

/// Advance width of a text in a Helvetica-like face, a little on the wide side
/// because the reader's face is unknown.
fn text_width(text: &str, size_px: f64) -> f64 {
    let em: f64 = text
        .chars()
        .map(|c| match c {
            'i' | 'j' | 'l' | '\'' | '|' => 0.24,
            'f' | 't' | 'r' | ' ' | '.' | ',' | ':' | ';' | '!' | '(' | ')' | '[' | ']' | '/'
            | '·' | '-' => 0.32,
            'm' | 'M' | 'W' | '%' | '—' => 0.88,
            'w' => 0.74,
            c if c.is_uppercase() => 0.70,
            _ => 0.57,
        })
        .sum();
    em * size_px * 1.03
}

/// Breaks a text into lines at spaces; a word longer than the line stays whole.
fn wrap(text: &str, size_px: f64, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if text_width(&format!("{line} {word}"), size_px) <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// A value that can be drawn: finite, and far enough from the ends of `f64`
/// that differences and paddings stay finite too.
fn drawable(value: f64) -> bool {
    value.abs() < 1e150
}

/// One axis: limits, tick positions, and how their numbers are written.
#[derive(Clone, Debug, PartialEq)]
struct Axis {
    low: f64,
    high: f64,
    ticks: Vec<f64>,
    labels: Vec<String>,
    /// Power of ten taken out of the labels.
    power: i32,
}

impl Axis {
    /// Lays an axis over the given values, with about one tick per
    /// `spacing_px`.
    fn over(
        values: impl Iterator<Item = f64>,
        fixed: Option<(f64, f64)>,
        padding: f64,
        length_px: f64,
        spacing_px: f64,
    ) -> Self {
        let usable = fixed.filter(|&(low, high)| drawable(low) && drawable(high) && low < high);
        let (low, high) = usable.unwrap_or_else(|| {
            let (low, high) = values
                .filter(|v| drawable(*v))
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
                    (low.min(v), high.max(v))
                });
            if low > high {
                return (0.0, 1.0);
            }
            let span = high - low;
            // A constant series still needs an axis, and one that does not
            // magnify rounding.
            let smallest = 1e-9 * low.abs().max(high.abs());
            if span <= smallest {
                let half = if high == 0.0 { 0.5 } else { 0.05 * high.abs() };
                (low - half, high + half)
            } else {
                (low - padding * span, high + padding * span)
            }
        });
        let count = (length_px / spacing_px).clamp(2.0, 12.0);
        let step = nice_step((high - low) / count);
        let first = (low / step - 1e-9).ceil();
        let ticks: Vec<f64> = (0..40)
            .map(|i| (first + f64::from(i)) * step)
            .take_while(|tick| *tick <= high + 1e-9 * step)
            // −0 and remainders such as 1e-17 would be labelled oddly.
            .map(|tick| if tick.abs() < 1e-6 * step { 0.0 } else { tick })
            .collect();
        let largest = low.abs().max(high.abs());
        let power = if (1e-2..1e5).contains(&largest) {
            0
        } else {
            order_of(largest).div_euclid(3) * 3
        };
        let unit = 10f64.powi(power);
        let decimals = decimals_of(step / unit);
        let labels = ticks
            .iter()
            .map(|tick| {
                let number = format!("{:.*}", decimals, (tick / unit).abs());
                if *tick < 0.0 {
                    format!("\u{2212}{number}")
                } else {
                    number
                }
            })
            .collect();
        Self {
            low,
            high,
            ticks,
            labels,
            power,
        }
    }

    /// Position of a value along the axis: 0 at the lower limit, 1 at the upper.
    fn share(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    fn label_width(&self) -> f64 {
        self.labels
            .iter()
            .map(|label| text_width(label, TICK_PX))
            .fold(0.0, f64::max)
    }

    /// The axis label with the power of ten that was taken out of the numbers.
    fn power_note(&self) -> Option<String> {
        (self.power != 0).then(|| {
            let digits: String = self
                .power
                .to_string()
                .chars()
                .map(|c| match c {
                    '0' => '⁰',
                    '1' => '¹',
                    '2' => '²',
                    '3' => '³',
                    '4' => '⁴',
                    '5' => '⁵',
                    '6' => '⁶',
                    '7' => '⁷',
                    '8' => '⁸',
                    '9' => '⁹',
                    _ => '⁻',
                })
                .collect();
            format!("×10{digits}")
        })
    }
}

#[allow(clippy::cast_possible_truncation)] // a decimal exponent of f64 is below 400
fn order_of(value: f64) -> i32 {
    if value > 0.0 {
        value.log10().floor() as i32
    } else {
        0
    }
}

/// The smallest of 1, 2, 2.5, 5 times a power of ten that is not far below
/// `rough`; far enough that a short axis still gets more than two numbers.
fn nice_step(rough: f64) -> f64 {
    let magnitude = 10f64.powi(order_of(rough));
    [1.0, 2.0, 2.5, 5.0, 10.0]
        .into_iter()
        .map(|factor| factor * magnitude)
        .find(|step| *step >= 0.7 * rough)
        .unwrap_or(magnitude)
}

fn decimals_of(step: f64) -> usize {
    (0..9)
        .find(|decimals| {
            let scaled = step * 10f64.powi(*decimals);
            (scaled - scaled.round()).abs() < 1e-6 * scaled
        })
        .and_then(|decimals| usize::try_from(decimals).ok())
        .unwrap_or(9)
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Rectangle {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

impl Rectangle {
    fn contains(&self, (x, y): (f64, f64)) -> bool {
        x >= self.left && x <= self.right && y >= self.top && y <= self.bottom
    }

    /// The part of a segment inside the rectangle (Liang and Barsky).
    fn clip(&self, from: (f64, f64), to: (f64, f64)) -> Option<[(f64, f64); 2]> {
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for (direction, room) in [
            (-dx, from.0 - self.left),
            (dx, self.right - from.0),
            (-dy, from.1 - self.top),
            (dy, self.bottom - from.1),
        ] {
            if direction == 0.0 {
                if room < 0.0 {
                    return None;
                }
            } else if direction < 0.0 {
                enter = enter.max(room / direction);
            } else {
                leave = leave.min(room / direction);
            }
        }
        (enter <= leave).then(|| {
            let at = |share: f64| (from.0 + share * dx, from.1 + share * dy);
            // Unmoved ends keep their exact coordinates, so that neighbouring
            // segments join.
            [
                if enter > 0.0 { at(enter) } else { from },
                if leave < 1.0 { at(leave) } else { to },
            ]
        })
    }
}

/// The backend behind a few calls in pixels.
struct Canvas<'a> {
    backend: SVGBackend<'a>,
}

#[derive(Clone, Copy)]
enum Anchor {
    Start,
    Middle,
    End,
}

#[allow(clippy::needless_pass_by_value)] // the signature that `map_err` wants
fn refused(error: impl std::fmt::Display) -> PlotError {
    PlotError::Draw(error.to_string())
}

fn pixel((x, y): (f64, f64)) -> (i32, i32) {
    (tenths(x), tenths(y))
}

impl<'a> Canvas<'a> {
    fn new(buffer: &'a mut String, width: f64, height: f64) -> Self {
        let size = (tenths(width).unsigned_abs(), tenths(height).unsigned_abs());
        Self {
            backend: SVGBackend::with_string(buffer, size),
        }
    }

    fn finish(&mut self) -> Result<(), PlotError> {
        self.backend.present().map_err(refused)
    }

    fn fill(&mut self, area: &Rectangle, colour: RGBColor) -> Result<(), PlotError> {
        self.backend
            .draw_rect(
                pixel((area.left, area.top)),
                pixel((area.right, area.bottom)),
                &ShapeStyle::from(colour).filled(),
                true,
            )
            .map_err(refused)
    }

    fn polygon(&mut self, corners: &[(f64, f64)], colour: RGBColor) -> Result<(), PlotError> {
        use plotters::style::Color as _;
        self.backend
            .fill_polygon(
                corners.iter().map(|corner| pixel(*corner)),
                &colour.mix(0.22),
            )
            .map_err(refused)
    }

    fn path(
        &mut self,
        points: &[(f64, f64)],
        colour: RGBColor,
        width_tenths: u32,
    ) -> Result<(), PlotError> {
        self.backend
            .draw_path(
                points.iter().map(|point| pixel(*point)),
                &ShapeStyle::from(colour).stroke_width(width_tenths),
            )
            .map_err(refused)
    }

    fn dot(&mut self, centre: (f64, f64), colour: RGBColor) -> Result<(), PlotError> {
        use plotters::style::Color as _;
        self.backend
            .draw_circle(
                pixel(centre),
                DOT_RADIUS_TENTHS,
                &ShapeStyle::from(&colour.mix(0.7)).filled(),
                true,
            )
            .map_err(refused)
    }

    /// Writes a text whose baseline box is centred on `at` vertically.
    fn text(
        &mut self,
        text: &str,
        at: (f64, f64),
        size_px: f64,
        anchor: Anchor,
        look: TextLook,
    ) -> Result<(), PlotError> {
        // Control characters are not allowed in XML, even escaped.
        let clean: String = text
            .chars()
            .map(|c| if c.is_control() { ' ' } else { c })
            .collect();
        let horizontal = match anchor {
            Anchor::Start => HPos::Left,
            Anchor::Middle => HPos::Center,
            Anchor::End => HPos::Right,
        };
        // The backend divides sizes by 1.24.
        let mut style = TextStyle::from((FontFamily::Name(FONT), size_px * 12.4))
            .color(&look.colour)
            .pos(Pos::new(horizontal, VPos::Center));
        if look.bold {
            style.font = style.font.style(FontStyle::Bold);
        }
        if look.upwards {
            style = style.transform(FontTransform::Rotate270);
        }
        self.backend
            .draw_text(&clean, &style, pixel(at))
            .map_err(refused)
    }
}

#[derive(Clone, Copy)]
struct TextLook {
    colour: RGBColor,
    bold: bool,
    upwards: bool,
}

impl TextLook {
    const PLAIN: Self = Self {
        colour: INK,
        bold: false,
        upwards: false,
    };
    const SOFT: Self = Self {
        colour: SOFT_INK,
        ..Self::PLAIN
    };
    const BOLD: Self = Self {
        bold: true,
        ..Self::PLAIN
    };
    const UPWARDS: Self = Self {
        upwards: true,
        ..Self::PLAIN
    };
}

/// A panel's place on the page.
#[derive(Clone, Debug)]
struct Placed {
    area: Rectangle,
    x: Axis,
    y: Axis,
    /// Centre line of the first line of the title.
    header_top: f64,
    title: Vec<String>,
    legend: Vec<Vec<LegendEntry>>,
    legend_beside_title: bool,
    y_label: Vec<String>,
    /// Whether the numbers and the label of the abscissa are written.
    labelled_x: bool,
}

#[derive(Clone, Debug, PartialEq)]
struct LegendEntry {
    label: String,
    style: Style,
}

impl LegendEntry {
    fn width(&self) -> f64 {
        LEGEND_SAMPLE + 6.0 + text_width(&self.label, LEGEND_PX)
    }
}

fn legend_width(row: &[LegendEntry]) -> f64 {
    row.iter().map(LegendEntry::width).sum::<f64>()
        + LEGEND_GAP * row.len().saturating_sub(1) as f64
}

fn legend_rows(panel: &Panel, width: f64) -> Vec<Vec<LegendEntry>> {
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

/// Where everything goes, in pixels.
struct Layout {
    width: f64,
    height: f64,
    title: Vec<String>,
    subtitle: Vec<String>,
    panels: Vec<Placed>,
}

impl Layout {
    fn of(figure: &Figure) -> Self {
        let width = if drawable(figure.width_px) {
            figure.width_px.clamp(240.0, 4000.0)
        } else {
            860.0
        };
        let row_height = if drawable(figure.row_height_px) {
            figure.row_height_px.clamp(60.0, 2000.0)
        } else {
            230.0
        };
        let text_room = width - 2.0 * MARGIN;
        let title = wrap(&figure.title, TITLE_PX, text_room);
        let subtitle = wrap(&figure.subtitle, SUBTITLE_PX, text_room);
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

    fn draw(&self, figure: &Figure, canvas: &mut Canvas) -> Result<(), PlotError> {
        let page = Rectangle {
            left: 0.0,
            top: 0.0,
            right: self.width,
            bottom: self.height,
        };
        canvas.fill(&page, RGBColor(0xFF, 0xFF, 0xFF))?;
        let mut y = MARGIN;
        for (lines, size, look) in [
            (&self.title, TITLE_PX, TextLook::BOLD),
            (&self.subtitle, SUBTITLE_PX, TextLook::SOFT),
        ] {
            for line in lines {
                let height = size * LEADING;
                canvas.text(line, (MARGIN, y + height / 2.0), size, Anchor::Start, look)?;
                y += height;
            }
        }
        for (placed, panel) in self.panels.iter().zip(&figure.panels) {
            placed.draw(panel, canvas)?;
        }
        canvas.finish()
    }
}

impl Placed {
    fn of(
        panel: &Panel,
        figure: &Figure,
        (left, width): (f64, f64),
        plot_height: f64,
        column: usize,
        labelled_x: bool,
    ) -> Self {
        let columns = figure.columns.clamp(1, figure.panels.len().max(1));
        let y = Axis::over(
            panel
                .series
                .iter()
                .flat_map(|s| s.y.iter().chain(&s.upper))
                .chain(&panel.levels)
                .copied(),
            panel.y_range,
            0.05,
            plot_height,
            42.0,
        );
        let y_label = wrap(&panel.y_label, LABEL_PX, plot_height);
        let gutter = y_label.len() as f64 * LABEL_PX * LEADING + 6.0 + y.label_width() + 8.0;
        let area = Rectangle {
            left: left + gutter,
            top: 0.0,
            // Half of the last tick's number hangs over the edge.
            right: left + width - 14.0,
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
            .any(|s| s.style.mark == Mark::Points);
        let x = Axis::over(
            shares_x
                .iter()
                .flat_map(|p| &p.series)
                .flat_map(|s| s.x.iter().copied()),
            panel
                .x_range
                .or_else(|| shares_x.iter().find_map(|p| p.x_range)),
            // Lines may end at the edge, dots would be cut in half there.
            if has_dots { 0.02 } else { 0.0 },
            area.right - area.left,
            78.0,
        );
        let title = wrap(&panel.title, PANEL_TITLE_PX, area.right - area.left);
        let legend = legend_rows(panel, area.right - area.left);
        let legend_beside_title = legend.len() == 1
            && title.len() <= 1
            && title
                .iter()
                .map(|line| text_width(line, PANEL_TITLE_PX) + 2.0 * LEGEND_GAP)
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

    fn header_height(&self) -> f64 {
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

    fn footer_height(&self, panel: &Panel) -> f64 {
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

    fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        (
            self.area.left + self.x.share(x) * (self.area.right - self.area.left),
            self.area.bottom - self.y.share(y) * (self.area.bottom - self.area.top),
        )
    }

    fn draw(&self, panel: &Panel, canvas: &mut Canvas) -> Result<(), PlotError> {
        self.draw_grid(panel, canvas)?;
        self.draw_header(canvas)?;
        for series in &panel.series {
            self.draw_series(series, canvas)?;
        }
        let Rectangle {
            left,
            top,
            right,
            bottom,
        } = self.area;
        canvas.path(
            &[(left, top), (left, bottom), (right, bottom)],
            FRAME,
            HAIR_TENTHS,
        )?;
        let empty = panel
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
            )?;
        }
        Ok(())
    }

    fn draw_grid(&self, panel: &Panel, canvas: &mut Canvas) -> Result<(), PlotError> {
        let Rectangle {
            left,
            top,
            right,
            bottom,
        } = self.area;
        for (tick, label) in self.y.ticks.iter().zip(&self.y.labels) {
            let (_, y) = self.at((self.x.low, *tick));
            canvas.path(&[(left, y), (right, y)], GRID, HAIR_TENTHS)?;
            canvas.text(label, (left - 7.0, y), TICK_PX, Anchor::End, TextLook::SOFT)?;
        }
        for (tick, label) in self.x.ticks.iter().zip(&self.x.labels) {
            let (x, _) = self.at((*tick, self.y.low));
            canvas.path(&[(x, top), (x, bottom)], GRID, HAIR_TENTHS)?;
            if self.labelled_x {
                let y = bottom + 6.0 + TICK_PX * LEADING / 2.0;
                canvas.text(label, (x, y), TICK_PX, Anchor::Middle, TextLook::SOFT)?;
            }
        }
        for level in panel.levels.iter().filter(|level| drawable(**level)) {
            let (_, y) = self.at((self.x.low, *level));
            if y >= top && y <= bottom {
                canvas.path(&[(left, y), (right, y)], LEVEL, HAIR_TENTHS)?;
            }
        }
        if let Some(note) = self.y.power_note() {
            let y = top - 7.0 - TICK_PX * LEADING / 2.0 + 3.0;
            canvas.text(&note, (left, y), TICK_PX, Anchor::Start, TextLook::SOFT)?;
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
            )?;
            if let Some(note) = self.x.power_note() {
                canvas.text(&note, (right, y), TICK_PX, Anchor::End, TextLook::SOFT)?;
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
            canvas.text(line, (x, y), LABEL_PX, Anchor::Middle, TextLook::UPWARDS)?;
            x += LABEL_PX * LEADING;
        }
        Ok(())
    }

    fn draw_header(&self, canvas: &mut Canvas) -> Result<(), PlotError> {
        let mut y = self.header_top;
        for line in &self.title {
            let height = PANEL_TITLE_PX * LEADING;
            let at = (self.area.left, y + height / 2.0);
            canvas.text(line, at, PANEL_TITLE_PX, Anchor::Start, TextLook::BOLD)?;
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
                Self::draw_sample(entry.style, (x, middle), canvas)?;
                canvas.text(
                    &entry.label,
                    (x + LEGEND_SAMPLE + 6.0, middle),
                    LEGEND_PX,
                    Anchor::Start,
                    TextLook::PLAIN,
                )?;
                x += entry.width() + LEGEND_GAP;
            }
            y += height;
        }
        Ok(())
    }

    fn draw_sample(style: Style, (x, y): (f64, f64), canvas: &mut Canvas) -> Result<(), PlotError> {
        let colour = style.role.colour();
        match style.mark {
            Mark::Points => [4.0, 12.0, 20.0]
                .into_iter()
                .try_for_each(|offset| canvas.dot((x + offset, y), colour)),
            Mark::Band => {
                let (x2, top, bottom) = (x + LEGEND_SAMPLE, y - 4.5, y + 4.5);
                canvas.polygon(&[(x, top), (x2, top), (x2, bottom), (x, bottom)], colour)
            }
            mark => canvas.path(&[(x, y), (x + LEGEND_SAMPLE, y)], colour, stroke(mark)),
        }
    }

    fn draw_series(&self, series: &Series, canvas: &mut Canvas) -> Result<(), PlotError> {
        let colour = series.style.role.colour();
        match series.style.mark {
            Mark::Points => {
                let inside: Vec<(f64, f64)> = series
                    .points()
                    .filter(|(x, y)| drawable(*x) && drawable(*y))
                    .map(|point| self.at(point))
                    .filter(|point| self.area.contains(*point))
                    .collect();
                for centre in thin_dots(&inside) {
                    canvas.dot(centre, colour)?;
                }
            }
            Mark::Band => {
                for corners in self.bands(series) {
                    canvas.polygon(&corners, colour)?;
                }
            }
            mark => {
                for run in runs(series.points()) {
                    let pixels: Vec<(f64, f64)> = run.into_iter().map(|p| self.at(p)).collect();
                    for visible in self.clip_path(&thin_line(&pixels)) {
                        canvas.path(&visible, colour, stroke(mark))?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Cuts a path at the edges of the panel.
    fn clip_path(&self, path: &[(f64, f64)]) -> Vec<Vec<(f64, f64)>> {
        let mut pieces: Vec<Vec<(f64, f64)>> = Vec::new();
        if let [only] = path
            && self.area.contains(*only)
        {
            // A lone sample between two gaps would vanish as a line.
            let (x, y) = *only;
            pieces.push(vec![(x - 0.8, y), (x + 0.8, y)]);
        }
        for segment in path.windows(2) {
            let Some([from, to]) = self.area.clip(segment[0], segment[1]) else {
                continue;
            };
            match pieces.last_mut() {
                Some(piece) if piece.last() == Some(&from) => piece.push(to),
                _ => pieces.push(vec![from, to]),
            }
        }
        pieces
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

fn stroke(mark: Mark) -> u32 {
    match mark {
        Mark::Dashed => DASHED_TENTHS,
        Mark::Thin => THIN_TENTHS,
        Mark::Wide => WIDE_TENTHS,
        Mark::Line | Mark::Points | Mark::Band => LINE_TENTHS,
    }
}

/// Splits a curve where a value cannot be drawn.
fn runs(points: impl Iterator<Item = (f64, f64)>) -> Vec<Vec<(f64, f64)>> {
    let mut runs: Vec<Vec<(f64, f64)>> = vec![Vec::new()];
    for (x, y) in points {
        if !(drawable(x) && drawable(y)) {
            runs.push(Vec::new());
        } else if let Some(run) = runs.last_mut() {
            run.push((x, y));
        }
    }
    runs.retain(|run| !run.is_empty());
    runs
}

/// Keeps what can be seen of a path in pixels.
///
/// Where `x` never decreases, each pixel column keeps its extremes in the order
/// in which they came, so that a spike of one sample survives. Other paths lose
/// only points that fall on their predecessor.
fn thin_line(path: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let forwards = path.windows(2).all(|pair| pair[0].0 <= pair[1].0);
    let mut kept: Vec<(f64, f64)> = Vec::new();
    if forwards {
        let mut rest = path;
        while let Some(&(x, _)) = rest.first() {
            let column = x.floor();
            let length = rest
                .iter()
                .position(|point| point.0.floor() > column)
                .unwrap_or(rest.len());
            let (here, after) = rest.split_at(length);
            rest = after;
            if here.len() <= 2 {
                kept.extend_from_slice(here);
                continue;
            }
            let mut lowest = 0;
            let mut highest = 0;
            for (index, point) in here.iter().enumerate() {
                if point.1 < here[lowest].1 {
                    lowest = index;
                }
                if point.1 > here[highest].1 {
                    highest = index;
                }
            }
            kept.push(here[lowest.min(highest)]);
            if lowest != highest {
                kept.push(here[lowest.max(highest)]);
            }
        }
    } else {
        for point in path {
            if kept.last().is_none_or(|last| pixel(*last) != pixel(*point)) {
                kept.push(*point);
            }
        }
    }
    kept
}

/// Keeps one dot per cell of a grid, coarse enough that few enough remain.
fn thin_dots(dots: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut cell = 0.5;
    loop {
        let mut taken = std::collections::BTreeSet::new();
        let kept: Vec<(f64, f64)> = dots
            .iter()
            .filter(|(x, y)| taken.insert((tenths(x / cell), tenths(y / cell))))
            .copied()
            .collect();
        if kept.len() <= MAXIMUM_DOTS {
            return kept;
        }
        cell *= 1.3;
    }
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
        assert_eq!(
            to_svg_string(&figure).unwrap(),
            to_svg_string(&figure.clone()).unwrap()
        );
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
                let svg = to_svg_string(&Figure::new("odd").with_panel(panel)).unwrap();
                assert!(!svg.contains("NaN") && !svg.contains("inf"), "{x:?} {y:?}");
            }
        }
        let bare = to_svg_string(&Figure::new("")).unwrap();
        assert!(bare.ends_with("</svg>\n"));
        let no_series = Figure::new("t").with_panel(Panel::new("x", "y"));
        assert!(to_svg_string(&no_series).unwrap().contains("no data"));
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
        assert_eq!(count(&to_svg_string(&figure(&y)).unwrap()), 1);
        y[50] = f64::NAN;
        assert_eq!(count(&to_svg_string(&figure(&y)).unwrap()), 2);
    }

    #[test]
    fn thinning_keeps_a_spike_and_a_small_file() {
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
        let svg = to_svg_string(&figure).unwrap();
        assert!(svg.len() < 300_000, "{} bytes", svg.len());
        assert!(points_of(&svg) < 2_000);

        let pixels: Vec<(f64, f64)> = x.iter().map(|t| t * 5.0).zip(y).collect();
        let top = thin_line(&pixels)
            .into_iter()
            .fold(0.0, |top, point| f64::max(top, point.1));
        assert!((top - 500.0).abs() < f64::EPSILON);
    }

    #[test]
    fn data_outside_the_range_is_cut_at_the_edge() {
        let area = Rectangle {
            left: 0.0,
            top: 0.0,
            right: 10.0,
            bottom: 10.0,
        };
        assert_eq!(
            area.clip((-10.0, 5.0), (20.0, 5.0)),
            Some([(0.0, 5.0), (10.0, 5.0)])
        );
        assert_eq!(
            area.clip((5.0, 5.0), (5.0, 25.0)),
            Some([(5.0, 5.0), (5.0, 10.0)])
        );
        assert_eq!(area.clip((-1.0, -5.0), (11.0, -5.0)), None);
        assert_eq!(area.clip((-4.0, 3.0), (3.0, -4.0)), None);
    }

    #[test]
    fn ticks_are_round_numbers_inside_the_limits() {
        let axis =
            |low: f64, high: f64| Axis::over([low, high].into_iter(), None, 0.0, 400.0, 80.0);
        assert_eq!(
            axis(0.0, 10.0).labels,
            ["0", "2", "4", "6", "8", "10"].map(str::to_owned)
        );
        assert_eq!(
            axis(-0.3, 0.31).labels,
            [
                "\u{2212}0.3",
                "\u{2212}0.2",
                "\u{2212}0.1",
                "0.0",
                "0.1",
                "0.2",
                "0.3"
            ]
            .map(str::to_owned)
        );
        let tiny = axis(0.0, 4.2e-6);
        assert_eq!(tiny.power_note().as_deref(), Some("×10⁻⁶"));
        assert_eq!(tiny.labels, ["0", "1", "2", "3", "4"].map(str::to_owned));
        let large = axis(0.0, 2.0e6);
        assert_eq!(large.power_note().as_deref(), Some("×10⁶"));
        for (low, high) in [(0.0, 1.0), (-7.3, 91.2), (1e-9, 3e-9), (99.0, 99.5)] {
            let axis = axis(low, high);
            assert!(axis.ticks.len() >= 2, "{low} {high}");
            assert!(
                axis.ticks
                    .iter()
                    .all(|tick| *tick >= low - 1e-12 && *tick <= high + 1e-12)
            );
        }
    }

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

    #[test]
    fn a_file_is_replaced_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.svg");
        std::fs::write(&path, "old").unwrap();
        write_svg(&path, &Figure::new("new")).unwrap();
        assert!(std::fs::read_to_string(&path).unwrap().contains("new"));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        let missing = folder.path().join("none").join("a.svg");
        let error = write_svg(&missing, &Figure::new("")).unwrap_err();
        assert!(error.to_string().contains("folder exists"));
    }
}
