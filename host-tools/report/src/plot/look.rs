//! The look of a picture on paper: its file format, width, size of type, panels and colours.
//!
//! A column of a journal is 89 mm wide and printed in grey as often as not. A picture of the screen
//! made that small has type of three points. So the type keeps its size in points and the layout
//! is computed anew for the width, and the curves get colours that differ in lightness.
//!
//! Every format is made of the same SVG. What makes PDF and PNG of it takes long to build, so it is a
//! crate of its own, `softrig-print`, and a program that has it says so once, with [`install`].

use std::path::Path;
use std::str::FromStr;
use std::sync::OnceLock;

use softrig_formats::error::{InputError, is_stream, write_atomically};
use softrig_formats::formats::binary::WITH_LAB;
use softrig_formats::numbers::short;

use super::canvas::{Medium, Size};
use super::layout::{Layout, WIDTHS_PX};
use super::text::{LABEL_PX, Weight, text_width};
use super::{Figure, Panel, drawn};

/// Pixels of an inch, as in SVG and style sheets.
const PX_PER_INCH: f64 = 96.0;
const MM_PER_INCH: f64 = 25.4;
const PT_PER_INCH: f64 = 72.0;

/// Dots of an inch in a PNG whose width is a length on paper.
const DOTS_PER_INCH: f64 = 300.0;

/// What a page of A4 holds between its margins (mm).
const PAGE_MM: f64 = 250.0;

/// Type on paper (pt) where only the width is given: what most journals ask for.
const FONT_PT: f64 = 8.0;

/// Sizes of type (pt) that make sense on paper.
const FONTS_PT: std::ops::RangeInclusive<f64> = 4.0..=40.0;

/// Panels narrower than this (px of the layout) go one below the other.
const COLUMN_PX: f64 = 220.0;

/// A row keeps at least this share of its height where the picture gets narrower.
const LOWEST_ROW: f64 = 0.55;

/// The file format of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Scalable vector graphics.
    Svg,
    /// One page of PDF, with text as text.
    Pdf,
    /// Pixels.
    Png,
}

impl Format {
    /// The format that the extension of a file name stands for; SVG for a stream.
    ///
    /// # Errors
    ///
    /// Refuses any other extension, and none.
    pub fn of(path: &Path) -> Result<Self, InputError> {
        let extension = path.extension().map(|it| it.to_string_lossy());
        match extension.as_deref().map(str::to_lowercase).as_deref() {
            Some("svg") => Ok(Self::Svg),
            Some("pdf") => Ok(Self::Pdf),
            Some("png") => Ok(Self::Png),
            None if is_stream(path) => Ok(Self::Svg),
            other => {
                let is = other.map_or_else(
                    || "has no extension, which says what picture to write".to_owned(),
                    |it| format!("would be a picture as .{it}, which softrig does not write"),
                );
                let remedy = "end its name in .svg, .pdf or .png";
                Err(InputError::new(is, remedy).in_file(path))
            }
        }
    }

    /// Checks that this program writes the format.
    ///
    /// # Errors
    ///
    /// Says what writes it where this program was built without.
    pub fn check(self, path: &Path) -> Result<(), InputError> {
        if self == Self::Svg || PRINTER.get().is_some() {
            return Ok(());
        }
        let name = if self == Self::Pdf { "PDF" } else { "PNG" };
        Err(InputError::new(
            format!("is {name}, which this program was built without"),
            format!("write .svg, or use a softrig that has all formats, {WITH_LAB}"),
        )
        .in_file(path))
    }
}

/// Makes other formats of SVG.
pub trait Printer: Sync {
    /// One page of PDF, of the size that the SVG says.
    ///
    /// # Errors
    ///
    /// Says what is missing on this machine.
    fn pdf(&self, svg: &str) -> Result<Vec<u8>, InputError>;

    /// A PNG of so many pixels across, and the density that it names.
    ///
    /// # Errors
    ///
    /// Says what is missing on this machine.
    fn png(&self, svg: &str, width_px: u32, dots_per_inch: f64) -> Result<Vec<u8>, InputError>;
}

static PRINTER: OnceLock<&'static dyn Printer> = OnceLock::new();

/// Makes PDF and PNG known to everything in this program that draws. The first one stays.
pub fn install(printer: &'static dyn Printer) {
    let _ = PRINTER.set(printer);
}

/// A width on paper or on a screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Length {
    value: f64,
    unit: Unit,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Unit {
    Mm,
    Cm,
    Inch,
    Pt,
    Px,
}

/// Units by their names in SVG, with their number in an inch.
const UNITS: [(&str, Unit, f64); 5] = [
    ("mm", Unit::Mm, MM_PER_INCH),
    ("cm", Unit::Cm, MM_PER_INCH / 10.0),
    ("in", Unit::Inch, 1.0),
    ("pt", Unit::Pt, PT_PER_INCH),
    ("px", Unit::Px, PX_PER_INCH),
];

impl Length {
    fn named(self) -> (&'static str, f64) {
        let place = UNITS.iter().find(|(_, unit, _)| *unit == self.unit);
        place.map_or(("px", PX_PER_INCH), |(name, _, per_inch)| (name, *per_inch))
    }

    fn inches(self) -> f64 {
        self.value / self.named().1
    }

    /// The same unit with another value (px).
    fn written(self, px: f64) -> String {
        let (name, per_inch) = self.named();
        format!("{}{name}", tidy(px / PX_PER_INCH * per_inch))
    }
}

/// A length for SVG: no more digits than a printer resolves.
fn tidy(value: f64) -> f64 {
    (1e3 * value).round() / 1e3
}

impl FromStr for Length {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refused =
            || "give a length with its unit, such as 89mm, 3.5in, 252pt or 800px".to_owned();
        let text = text.trim();
        let (unit, number) = UNITS
            .iter()
            .find_map(|(name, unit, _)| Some((*unit, text.strip_suffix(name)?)))
            .ok_or_else(refused)?;
        let value: f64 = number.trim().parse().map_err(|_| refused())?;
        if value.is_finite() && value > 0.0 {
            Ok(Self { value, unit })
        } else {
            Err(refused())
        }
    }
}

/// Which colours curves have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Colours {
    /// Those of the screen, told apart by their hue.
    #[default]
    Screen,
    /// The same hues in steps of lightness, told apart in grey too.
    Print,
}

impl FromStr for Colours {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "screen" => Ok(Self::Screen),
            "print" => Ok(Self::Print),
            _ => Err("give screen, or print for colours that survive grey".to_owned()),
        }
    }
}

/// What somebody asks of a picture beside its content.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Look {
    /// Its width; that of the screen if absent.
    pub width: Option<Length>,
    /// Size of the labels (pt).
    pub font_pt: Option<f64>,
    /// Whether it has a heading; a PDF has none unless asked for.
    pub headline: Option<bool>,
    /// Its panels by number, or by a word of their headings and labels; all if none are named.
    pub panels: Vec<String>,
    /// Its colours; those of print in a PDF.
    pub colours: Option<Colours>,
}

impl Look {
    /// Reads a size of type (pt).
    ///
    /// # Errors
    ///
    /// Refuses sizes that nobody reads.
    pub fn font_size(text: &str) -> Result<f64, String> {
        let number: Option<f64> = text.trim_end_matches("pt").trim().parse().ok();
        number.filter(|it| FONTS_PT.contains(it)).ok_or_else(|| {
            let (low, high) = (FONTS_PT.start(), FONTS_PT.end());
            format!("give a size in points from {low} to {high}, such as 8")
        })
    }

    /// Whether nothing is asked for.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// The figure as asked for, and its size on paper.
    fn of(&self, figure: &Figure, format: Format) -> Result<(Figure, Option<Size>), InputError> {
        let mut figure = self.chosen(figure)?;
        if !self.headline.unwrap_or(format != Format::Pdf) {
            figure.title.clear();
            figure.subtitle.clear();
        }
        if self.width.is_none() && self.font_pt.is_none() {
            return Ok((figure, None));
        }
        let usual_pt = LABEL_PX / PX_PER_INCH * PT_PER_INCH;
        let font = self.font_pt.unwrap_or(FONT_PT);
        let scale = font / usual_pt;
        let asked = self.width.unwrap_or(Length {
            value: figure.width_px,
            unit: Unit::Px,
        });
        let width = asked.inches() * PX_PER_INCH / scale;
        let (low, high) = WIDTHS_PX;
        if !(low..=high).contains(&width) {
            let (is, end) = if width < low {
                ("narrow", low)
            } else {
                ("wide", high)
            };
            let limit = asked.written((end * scale).ceil());
            return Err(InputError::new(
                format!(
                    "a picture of {} is too {is} for type of {} pt",
                    asked.written(asked.inches() * PX_PER_INCH),
                    short(font)
                ),
                format!("with this type the limit is {limit}; change --width or --font-size"),
            ));
        }
        Ok((resized(figure, width), Some(Size { asked })))
    }

    /// The figure with the panels that were asked for.
    fn chosen(&self, figure: &Figure) -> Result<Figure, InputError> {
        if self.panels.is_empty() {
            return Ok(figure.clone());
        }
        let mut kept: Vec<usize> = Vec::new();
        for name in &self.panels {
            let named: Vec<usize> = (0..figure.panels.len())
                .filter(|&place| is_named(&figure.panels[place], place, name.trim()))
                .collect();
            if named.is_empty() {
                let panels = figure.panels.iter().enumerate();
                let list: Vec<String> = panels.map(|(i, it)| described(i, it)).collect();
                return Err(InputError::new(
                    format!("the picture has no panel {name}"),
                    format!("give numbers or words of these: {}", list.join("; ")),
                ));
            }
            kept.extend(named);
        }
        kept.sort_unstable();
        kept.dedup();
        let columns = figure.columns.clamp(1, figure.panels.len().max(1));
        let mut used: Vec<usize> = kept.iter().map(|place| place % columns).collect();
        used.sort_unstable();
        used.dedup();
        // A row with a hole in it would shift what follows.
        let is_whole = kept.chunks(used.len()).all(|row| {
            row.iter()
                .zip(&used)
                .all(|(place, column)| place % columns == *column)
        });
        let mut chosen = figure.clone();
        chosen.panels = kept.iter().map(|&it| figure.panels[it].clone()).collect();
        chosen.columns = if is_whole { used.len() } else { 1 };
        if !is_whole {
            chosen.shared_x = false;
        }
        // The panels stay as wide as they were.
        chosen.width_px *= chosen.columns as f64 / columns as f64;
        Ok(chosen)
    }
}

/// Whether a panel is meant by a number from 1, or by words of its heading or labels.
fn is_named(panel: &Panel, place: usize, name: &str) -> bool {
    if let Ok(number) = name.parse::<usize>() {
        return number == place + 1;
    }
    let name = name.to_lowercase();
    let has = |text: &String| text.to_lowercase().contains(&name);
    !name.is_empty() && (has(&panel.title) || has(&panel.y_label))
}

/// A panel in the list of those to choose from.
fn described(place: usize, panel: &Panel) -> String {
    let texts = [panel.y_label.as_str(), panel.title.as_str()];
    let texts: Vec<&str> = texts.into_iter().filter(|it| !it.is_empty()).collect();
    format!("{} {}", place + 1, texts.join(", "))
}

/// The figure laid out for another width (px): panels that would be too narrow go one below the
/// other, and rows get lower with their panels.
fn resized(mut figure: Figure, width: f64) -> Figure {
    let columns = figure.columns.clamp(1, figure.panels.len().max(1));
    let before = figure.width_px / columns as f64;
    if columns > 1 && width / (columns as f64) < COLUMN_PX {
        if figure.shared_x {
            // What stood below one another stays together, such as the panels of a run.
            let panels = std::mem::take(&mut figure.panels);
            for column in 0..columns {
                figure
                    .panels
                    .extend(panels.iter().skip(column).step_by(columns).cloned());
            }
            figure.shared_x = false;
        }
        figure.columns = 1;
    }
    let after = width / figure.columns.max(1) as f64;
    figure.row_height_px *= (after / before).clamp(LOWEST_ROW, 1.0);
    figure.width_px = width;
    for panel in &mut figure.panels {
        // A word of the label beside it is not broken.
        let words = panel.y_label.split_whitespace();
        let longest = words
            .map(|word| text_width(word, LABEL_PX, Weight::Regular))
            .fold(0.0, f64::max);
        panel.weight = panel.weight.max(longest / figure.row_height_px);
    }
    figure
}

/// Draws a figure and writes it in the format of its extension, replacing an existing file only when
/// the new one is complete. Returns its height on paper (mm) if that is more than a page holds.
///
/// # Errors
///
/// If the extension is none of a picture, if the program has no such format, if the figure has no such
/// panels, or if the folder is missing or not writable.
pub fn write(path: &Path, figure: &Figure, look: &Look) -> Result<Option<f64>, InputError> {
    let format = Format::of(path)?;
    format.check(path)?;
    let (figure, size) = look.of(figure, format)?;
    let is_screen = format == Format::Svg && look.is_default();
    let colours = look.colours.unwrap_or(if format == Format::Pdf {
        Colours::Print
    } else {
        Colours::Screen
    });
    let medium = if is_screen {
        Medium::File
    } else {
        Medium::Print(colours)
    };
    let svg = drawn(&figure, medium, &figure.title, size);
    let printed = match (format, PRINTER.get()) {
        (Format::Pdf, Some(printer)) => printer.pdf(&svg),
        (Format::Png, Some(printer)) => {
            let (width, density) = pixels(look.width, figure.width_px);
            printer.png(&svg, width, density)
        }
        _ => Ok(svg.into_bytes()),
    };
    write_atomically(path, &printed.map_err(|error| error.in_file(path))?)?;
    let height_mm = size.filter(|it| it.asked.unit != Unit::Px).map(|size| {
        let aspect = Layout::of(&figure).aspect();
        size.asked.inches() * MM_PER_INCH * aspect
    });
    Ok(height_mm.filter(|height| *height > PAGE_MM))
}

/// Pixels across a PNG, and how many an inch.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // saturates
fn pixels(asked: Option<Length>, figure_px: f64) -> (u32, f64) {
    let (inches, density) = match asked {
        Some(length) if length.unit == Unit::Px => (length.inches(), PX_PER_INCH),
        Some(length) => (length.inches(), DOTS_PER_INCH),
        None => (figure_px / PX_PER_INCH, DOTS_PER_INCH),
    };
    ((inches * density).round().max(1.0) as u32, density)
}

impl Size {
    /// Width and height of a drawing of so many pixels, for the attributes of SVG.
    pub(super) fn written(&self, (width, height): (f64, f64)) -> [String; 2] {
        let asked = self.asked.inches() * PX_PER_INCH;
        [asked, asked * height / width].map(|px| self.asked.written(px))
    }
}
