//! The drawing backend behind a few calls in pixels.
//!
//! The rest of the module thinks in pixels with fractions and in dashes. The
//! backend knows neither, and what it is told instead concerns nobody else, so
//! all that depends on it stands here.

use plotters::backend::{DrawingBackend, SVGBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontFamily, FontStyle, FontTransform, RGBColor, ShapeStyle, TextStyle};

use super::rectangle::Rectangle;
use super::{Mark, PlotError};

const FONT: &str = "Helvetica, Arial, Liberation Sans, sans-serif";
const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
const SOFT_INK: RGBColor = RGBColor(0x55, 0x55, 0x55);

/// Widths in tenths of a pixel. No other line may have the width that stands
/// for dashes.
const LINE_TENTHS: u32 = 16;
const DASHED_TENTHS: u32 = 17;
const THIN_TENTHS: u32 = 9;
const WIDE_TENTHS: u32 = 42;
pub(super) const HAIR_TENTHS: u32 = 8;
const DOT_RADIUS_TENTHS: u32 = 17;

#[allow(clippy::cast_possible_truncation)] // saturates, and callers pass clipped pixels
pub(super) fn tenths(pixels: f64) -> i32 {
    (pixels * 10.0).round() as i32
}

pub(super) fn stroke(mark: Mark) -> u32 {
    match mark {
        Mark::Dashed => DASHED_TENTHS,
        Mark::Thin => THIN_TENTHS,
        Mark::Wide => WIDE_TENTHS,
        Mark::Line | Mark::Points | Mark::Band => LINE_TENTHS,
    }
}

/// A page that is being drawn on.
pub(super) struct Canvas<'a> {
    backend: SVGBackend<'a>,
}

#[derive(Clone, Copy)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

#[allow(clippy::needless_pass_by_value)] // the signature that `map_err` wants
fn refused(error: impl std::fmt::Display) -> PlotError {
    PlotError::Draw(error.to_string())
}

pub(super) fn pixel((x, y): (f64, f64)) -> (i32, i32) {
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

    pub(super) fn fill(&mut self, area: &Rectangle, colour: RGBColor) -> Result<(), PlotError> {
        self.backend
            .draw_rect(
                pixel((area.left, area.top)),
                pixel((area.right, area.bottom)),
                &ShapeStyle::from(colour).filled(),
                true,
            )
            .map_err(refused)
    }

    pub(super) fn polygon(
        &mut self,
        corners: &[(f64, f64)],
        colour: RGBColor,
    ) -> Result<(), PlotError> {
        use plotters::style::Color as _;
        self.backend
            .fill_polygon(
                corners.iter().map(|corner| pixel(*corner)),
                &colour.mix(0.22),
            )
            .map_err(refused)
    }

    pub(super) fn path(
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

    pub(super) fn dot(&mut self, centre: (f64, f64), colour: RGBColor) -> Result<(), PlotError> {
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
    pub(super) fn text(
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
pub(super) struct TextLook {
    colour: RGBColor,
    bold: bool,
    upwards: bool,
}

impl TextLook {
    pub(super) const PLAIN: Self = Self {
        colour: INK,
        bold: false,
        upwards: false,
    };
    pub(super) const SOFT: Self = Self {
        colour: SOFT_INK,
        ..Self::PLAIN
    };
    pub(super) const BOLD: Self = Self {
        bold: true,
        ..Self::PLAIN
    };
    pub(super) const UPWARDS: Self = Self {
        upwards: true,
        ..Self::PLAIN
    };
}

/// A whole document of the given size in pixels, with what `draw` puts on it.
pub(super) fn document(
    width: f64,
    height: f64,
    draw: impl FnOnce(&mut Canvas) -> Result<(), PlotError>,
) -> Result<String, PlotError> {
    let mut body = String::new();
    {
        let mut canvas = Canvas::new(&mut body, width, height);
        draw(&mut canvas)?;
        canvas.finish()?;
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
        tenths(width) / 10,
        tenths(height) / 10,
        tenths(width),
        tenths(height),
    ))
}
