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
/// Width of an ordinary line in pixels.
pub const LINE_PX: f64 = LINE_TENTHS as f64 / 10.0;
const DASHED_TENTHS: u32 = 17;
const THIN_TENTHS: u32 = 9;
const WIDE_TENTHS: u32 = 42;
pub(super) const HAIR_TENTHS: u32 = 8;
const DOT_RADIUS_TENTHS: u32 = 17;
const DISC_RADIUS_TENTHS: u32 = 38;
/// So much larger than a disc that this is seen within.
const RING_RADIUS_TENTHS: u32 = 60;

#[allow(clippy::cast_possible_truncation)] // saturates, and callers pass clipped pixels
pub(super) fn tenths(pixels: f64) -> i32 {
    (pixels * 10.0).round() as i32
}

pub(super) fn stroke(mark: Mark) -> u32 {
    match mark {
        Mark::Dashed => DASHED_TENTHS,
        Mark::Thin => THIN_TENTHS,
        Mark::Wide => WIDE_TENTHS,
        Mark::Line | Mark::Points | Mark::Discs | Mark::Rings | Mark::Band => LINE_TENTHS,
    }
}

/// What a drawing is made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Medium {
    /// A file of its own: a white page of a fixed size.
    File,
    /// Part of an HTML page: as wide as there is room, without a ground, and
    /// with groups that say what is in them.
    Page,
}

/// A page that is being drawn on.
pub(super) struct Canvas {
    body: String,
    size: (u32, u32),
    pub(super) medium: Medium,
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

impl Canvas {
    /// Lets the backend draw one element.
    fn draw<E: std::fmt::Display>(
        &mut self,
        element: impl FnOnce(&mut SVGBackend) -> Result<(), E>,
    ) -> Result<(), PlotError> {
        let mut text = String::new();
        {
            let mut backend = SVGBackend::with_string(&mut text, self.size);
            element(&mut backend).map_err(refused)?;
            backend.present().map_err(refused)?;
        }
        // A whole document, of which the middle is the element.
        let element = text.split_once('\n').map_or("", |(_, rest)| rest);
        self.body
            .push_str(element.trim_end().trim_end_matches("</svg>"));
        Ok(())
    }

    /// Draws what belongs together; on a page, in a group with attributes that
    /// a script can read.
    pub(super) fn group(
        &mut self,
        attributes: &[(&str, String)],
        draw: impl FnOnce(&mut Self) -> Result<(), PlotError>,
    ) -> Result<(), PlotError> {
        if self.medium == Medium::File {
            return draw(self);
        }
        self.body.push_str("<g");
        for (name, value) in attributes {
            self.body
                .push_str(&format!(" {name}=\"{}\"", escaped(value)));
        }
        self.body.push_str(">\n");
        draw(self)?;
        self.body.push_str("</g>\n");
        Ok(())
    }

    pub(super) fn fill(&mut self, area: &Rectangle, colour: RGBColor) -> Result<(), PlotError> {
        self.draw(|backend| {
            backend.draw_rect(
                pixel((area.left, area.top)),
                pixel((area.right, area.bottom)),
                &ShapeStyle::from(colour).filled(),
                true,
            )
        })
    }

    pub(super) fn polygon(
        &mut self,
        corners: &[(f64, f64)],
        colour: RGBColor,
    ) -> Result<(), PlotError> {
        use plotters::style::Color as _;
        self.draw(|backend| {
            backend.fill_polygon(
                corners.iter().map(|corner| pixel(*corner)),
                &colour.mix(0.22),
            )
        })
    }

    pub(super) fn path(
        &mut self,
        points: &[(f64, f64)],
        colour: RGBColor,
        width_tenths: u32,
    ) -> Result<(), PlotError> {
        self.draw(|backend| {
            backend.draw_path(
                points.iter().map(|point| pixel(*point)),
                &ShapeStyle::from(colour).stroke_width(width_tenths),
            )
        })
    }

    pub(super) fn dot(&mut self, centre: (f64, f64), colour: RGBColor) -> Result<(), PlotError> {
        use plotters::style::Color as _;
        self.draw(|backend| {
            backend.draw_circle(
                pixel(centre),
                DOT_RADIUS_TENTHS,
                &ShapeStyle::from(&colour.mix(0.7)).filled(),
                true,
            )
        })
    }

    /// Draws a disc, or a ring.
    pub(super) fn disc(
        &mut self,
        centre: (f64, f64),
        colour: RGBColor,
        is_ring: bool,
    ) -> Result<(), PlotError> {
        let style = ShapeStyle::from(colour);
        let (radius, style) = if is_ring {
            (RING_RADIUS_TENTHS, style.stroke_width(LINE_TENTHS))
        } else {
            (DISC_RADIUS_TENTHS, style.filled())
        };
        self.draw(|backend| backend.draw_circle(pixel(centre), radius, &style, !is_ring))
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
        self.draw(|backend| backend.draw_text(&clean, &style, pixel(at)))
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

/// Text as the value of an attribute.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// A whole document of the given size in pixels, with what `draw` puts on it;
/// `name` is what someone hears who does not see it.
pub(super) fn document(
    (width, height): (f64, f64),
    medium: Medium,
    name: &str,
    draw: impl FnOnce(&mut Canvas) -> Result<(), PlotError>,
) -> Result<String, PlotError> {
    // The backend writes whole pixels and knows neither dashes nor joins. So it
    // is given tenths of a pixel, and the head of the document scales them.
    let size = (tenths(width), tenths(height));
    let mut canvas = Canvas {
        body: String::new(),
        size: (size.0.unsigned_abs(), size.1.unsigned_abs()),
        medium,
    };
    draw(&mut canvas)?;
    let dashed = format!("stroke-width=\"{DASHED_TENTHS}\"");
    let with_dashes = canvas.body.replace(
        &dashed,
        &format!("stroke-width=\"{LINE_TENTHS}\" stroke-dasharray=\"55 40\""),
    );
    let place = match medium {
        Medium::File => format!(
            "xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\"",
            size.0 / 10,
            size.1 / 10
        ),
        Medium::Page => format!("class=\"picture\" aria-label=\"{}\"", escaped(name)),
    };
    Ok(format!(
        "<svg {place} viewBox=\"0 0 {} {}\" \
         stroke-linejoin=\"round\" stroke-linecap=\"butt\" role=\"img\">\n{with_dashes}</svg>\n",
        size.0, size.1,
    ))
}
