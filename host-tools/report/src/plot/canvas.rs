//! The canvas, and its SVG.
//!
//! Other code of the module uses fractional pixels, which would make a long SVG. So the SVG uses
//! integer tenths of a pixel, finer than a screen resolves, and its view box scales them. The
//! script of a report reads values off the drawing from the same numbers.

use std::fmt::Display;

use super::look::{Colours, Length};
use super::rectangle::Rectangle;
use super::style::Colour;
use super::{Mark, Role, Style};
use softrig_formats::terminal::printable_line;

const FONT: &str = "Helvetica, Arial, Liberation Sans, sans-serif";
const INK: Colour = Colour(0x22, 0x22, 0x22);
const SOFT_INK: Colour = Colour(0x55, 0x55, 0x55);

/// Width of an ordinary line in pixels.
pub const LINE_PX: f64 = LINE_TENTHS as f64 / 10.0;
const LINE_TENTHS: u32 = 16;
const THIN_TENTHS: u32 = 9;
const WIDE_TENTHS: u32 = 42;
const HAIR_TENTHS: u32 = 8;
const DOT_RADIUS_TENTHS: u32 = 17;
const DISC_RADIUS_TENTHS: u32 = 38;
/// So much larger than a disc that this is seen within.
const RING_RADIUS_TENTHS: u32 = 60;

#[allow(clippy::cast_possible_truncation)] // saturates, and callers pass clipped pixels
pub(super) fn tenths(pixels: f64) -> i32 {
    (pixels * 10.0).round() as i32
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stroke {
    width_tenths: u32,
    dashed: bool,
}

impl Stroke {
    /// Axes and their grid.
    pub(super) const HAIR: Self = Self {
        width_tenths: HAIR_TENTHS,
        dashed: false,
    };

    pub(super) fn of(mark: Mark) -> Self {
        let width_tenths = match mark {
            Mark::Thin => THIN_TENTHS,
            Mark::Wide => WIDE_TENTHS,
            Mark::Line | Mark::Dashed | Mark::Points | Mark::Discs | Mark::Rings | Mark::Band => {
                LINE_TENTHS
            }
        };
        Self {
            width_tenths,
            dashed: mark == Mark::Dashed,
        }
    }
}

/// The medium of a drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Medium {
    /// A file of its own: a white page of a fixed size.
    File,
    /// The same for paper, or whatever else was asked for.
    Print(Colours),
    /// Part of an HTML page: as wide as there is room, without a ground, and
    /// with groups that say what is in them.
    Page,
}

/// The size of a picture on paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Size {
    /// Its width.
    pub(super) asked: Length,
}

/// A page that is being drawn on.
pub(super) struct Canvas {
    body: String,
    pub(super) medium: Medium,
}

#[derive(Clone, Copy)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

impl Anchor {
    /// Its name in SVG.
    fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Middle => "middle",
            Self::End => "end",
        }
    }
}

pub(super) fn pixel((x, y): (f64, f64)) -> (i32, i32) {
    (tenths(x), tenths(y))
}

/// Corners as the attribute `points` lists them.
fn listed(points: &[(f64, f64)]) -> String {
    let corners: Vec<String> = points
        .iter()
        .map(|point| {
            let (x, y) = pixel(*point);
            format!("{x},{y}")
        })
        .collect();
    corners.join(" ")
}

impl Canvas {
    /// The colour of a curve on this medium.
    pub(super) fn colour(&self, style: Style) -> Colour {
        match (self.medium, style.mark) {
            // A curve of its own, which the light grey behind others would lose.
            (Medium::Print(Colours::Print), Mark::Line | Mark::Thin)
                if style.role == Role::Measured =>
            {
                Role::Reference.colour_in_print()
            }
            (Medium::Print(Colours::Print), _) => style.role.colour_in_print(),
            _ => style.role.colour(),
        }
    }

    /// The attribute that makes a shape translucent. In print it is that of its fill: the other makes
    /// a group of every dot.
    fn opacity(&self) -> &'static str {
        match self.medium {
            Medium::Print(_) => "fill-opacity",
            _ => "opacity",
        }
    }

    /// Writes one element: its name, and its attributes.
    fn element(&mut self, name: &str, attributes: &[(&str, &dyn Display)]) {
        self.open(name, attributes);
        self.body.push_str("/>\n");
    }

    /// Writes a tag as far as its last attribute.
    fn open(&mut self, name: &str, attributes: &[(&str, &dyn Display)]) {
        self.body.push('<');
        self.body.push_str(name);
        for (name, value) in attributes {
            let value = escaped(&value.to_string());
            self.body.push_str(&format!(" {name}=\"{value}\""));
        }
    }

    /// Draws what belongs together; on a page, in a group with attributes that
    /// a script can read.
    pub(super) fn group(&mut self, attributes: &[(&str, String)], draw: impl FnOnce(&mut Self)) {
        if self.medium != Medium::Page {
            return draw(self);
        }
        let attributes: Vec<(&str, &dyn Display)> = attributes
            .iter()
            .map(|(name, value)| (*name, value as &dyn Display))
            .collect();
        self.open("g", &attributes);
        self.body.push_str(">\n");
        draw(self);
        self.body.push_str("</g>\n");
    }

    pub(super) fn fill(&mut self, area: &Rectangle, colour: Colour) {
        let (left, top) = pixel((area.left, area.top));
        let (right, bottom) = pixel((area.right, area.bottom));
        self.element(
            "rect",
            &[
                ("x", &left),
                ("y", &top),
                ("width", &(right - left)),
                ("height", &(bottom - top)),
                ("fill", &colour),
            ],
        );
    }

    pub(super) fn polygon(&mut self, corners: &[(f64, f64)], colour: Colour) {
        let opacity = self.opacity();
        // Print loses the faintest greys.
        let share = match self.medium {
            Medium::Print(Colours::Print) => 0.4,
            _ => 0.22,
        };
        self.element(
            "polygon",
            &[
                ("fill", &colour),
                (opacity, &share),
                ("points", &listed(corners)),
            ],
        );
    }

    pub(super) fn path(&mut self, points: &[(f64, f64)], colour: Colour, stroke: Stroke) {
        let points = listed(points);
        let mut attributes: Vec<(&str, &dyn Display)> = vec![
            ("fill", &"none"),
            ("stroke", &colour),
            ("stroke-width", &stroke.width_tenths),
            ("points", &points),
        ];
        if stroke.dashed {
            attributes.insert(3, ("stroke-dasharray", &"55 40"));
        }
        self.element("polyline", &attributes);
    }

    pub(super) fn dot(&mut self, centre: (f64, f64), colour: Colour) {
        let opacity = self.opacity();
        let (x, y) = pixel(centre);
        self.element(
            "circle",
            &[
                ("cx", &x),
                ("cy", &y),
                ("r", &DOT_RADIUS_TENTHS),
                ("fill", &colour),
                (opacity, &0.7),
            ],
        );
    }

    /// Draws a disc, or a ring.
    pub(super) fn disc(&mut self, centre: (f64, f64), colour: Colour, is_ring: bool) {
        let (x, y) = pixel(centre);
        let place: [(&str, &dyn Display); 2] = [("cx", &x), ("cy", &y)];
        let look: &[(&str, &dyn Display)] = if is_ring {
            &[
                ("r", &RING_RADIUS_TENTHS),
                ("fill", &"none"),
                ("stroke", &colour),
                ("stroke-width", &LINE_TENTHS),
            ]
        } else {
            &[("r", &DISC_RADIUS_TENTHS), ("fill", &colour)]
        };
        self.element("circle", &[&place, look].concat());
    }

    /// Writes a text whose baseline box is centred on `at` vertically.
    pub(super) fn text(
        &mut self,
        text: &str,
        at: (f64, f64),
        size_px: f64,
        anchor: Anchor,
        look: TextLook,
    ) {
        // Control characters are not allowed in XML, even escaped.
        let clean: String = text
            .chars()
            .map(|c| if c.is_control() { ' ' } else { c })
            .collect();
        let (x, y) = pixel(at);
        let size = tenths(size_px);
        let turned = format!("rotate(270, {x}, {y})");
        let mut attributes: Vec<(&str, &dyn Display)> = vec![
            ("x", &x),
            ("y", &y),
            ("dy", &"0.5ex"),
            ("font-size", &size),
            ("fill", &look.colour),
        ];
        let anchor = anchor.name();
        if anchor != "start" {
            attributes.push(("text-anchor", &anchor));
        }
        if look.bold {
            attributes.push(("font-weight", &"bold"));
        }
        if look.upwards {
            attributes.push(("transform", &turned));
        }
        self.open("text", &attributes);
        self.body
            .push_str(&format!(">{}</text>\n", escaped(&clean)));
    }
}

#[derive(Clone, Copy)]
pub(super) struct TextLook {
    colour: Colour,
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
    printable_line(text)
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// A whole document of the given size in pixels, with what `draw` puts on it;
/// `name` is what someone hears who does not see it, and `size` is that on paper.
pub(super) fn document(
    (width, height): (f64, f64),
    medium: Medium,
    name: &str,
    size: Option<Size>,
    draw: impl FnOnce(&mut Canvas),
) -> String {
    let [printed_width, printed_height] = size.map_or_else(
        || [width, height].map(|px| (tenths(px) / 10).to_string()),
        |size| size.written((width, height)),
    );
    let (width, height) = (tenths(width), tenths(height));
    let mut canvas = Canvas {
        body: String::new(),
        medium,
    };
    let mut attributes: Vec<(&str, String)> = match medium {
        Medium::File | Medium::Print(_) => vec![
            ("xmlns", "http://www.w3.org/2000/svg".to_owned()),
            ("width", printed_width),
            ("height", printed_height),
            ("font-family", FONT.to_owned()),
        ],
        Medium::Page => vec![
            ("class", "picture".to_owned()),
            ("aria-label", name.to_owned()),
        ],
    };
    attributes.extend([
        ("viewBox", format!("0 0 {width} {height}")),
        ("stroke-linejoin", "round".to_owned()),
        ("stroke-linecap", "butt".to_owned()),
        ("role", "img".to_owned()),
    ]);
    let attributes: Vec<(&str, &dyn Display)> = attributes
        .iter()
        .map(|(name, value)| (*name, value as &dyn Display))
        .collect();
    canvas.open("svg", &attributes);
    canvas.body.push_str(">\n");
    draw(&mut canvas);
    canvas.body.push_str("</svg>\n");
    canvas.body
}
