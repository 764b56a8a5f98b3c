//! Roles and styles of curves.
//!
//! A colour has the same meaning in every figure, so callers name the role of a curve and
//! never a colour.

use std::fmt;

/// Red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Colour(pub(super) u8, pub(super) u8, pub(super) u8);

impl fmt::Display for Colour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(red, green, blue) = self;
        write!(f, "#{red:02X}{green:02X}{blue:02X}")
    }
}

/// The role of a curve; it decides the colour.
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
    pub(super) fn colour(self) -> Colour {
        match self {
            Self::Measured => Colour(0xA0, 0xA0, 0xA0),
            Self::Nominal => Colour(0x00, 0x72, 0xB2),
            Self::Before => Colour(0xD5, 0x5E, 0x00),
            Self::After => Colour(0x00, 0x9E, 0x73),
            Self::Emphasis => Colour(0xA0, 0x3C, 0x78),
            Self::Reference => Colour(0x33, 0x33, 0x33),
            Self::Other(index) => match index % 4 {
                0 => Colour(0x56, 0xB4, 0xE9),
                1 => Colour(0xE6, 0x9F, 0x00),
                2 => Colour(0xCC, 0x79, 0xA7),
                _ => Colour(0x8C, 0x6B, 0x3F),
            },
        }
    }
}

impl Role {
    /// The colour in print: about the same hue, in steps of lightness that a copy in grey keeps.
    pub(super) fn colour_in_print(self) -> Colour {
        match self {
            Self::Reference => Colour(0x10, 0x10, 0x10),
            Self::Emphasis => Colour(0x4A, 0x0E, 0x38),
            Self::After => Colour(0x00, 0x5A, 0x42),
            Self::Nominal => Colour(0x00, 0x72, 0xB2),
            Self::Before => Colour(0xE0, 0x70, 0x1A),
            Self::Measured => Colour(0xCC, 0xCC, 0xCC),
            Self::Other(index) => match index % 4 {
                0 => Colour(0x80, 0xCC, 0xF2),
                1 => Colour(0xE6, 0xA8, 0x10),
                2 => Colour(0xC8, 0x7C, 0xA8),
                _ => Colour(0x8A, 0x6A, 0x3E),
            },
        }
    }

    /// Colours of several of a kind before one comes again.
    pub const MANY: usize = 9;

    /// One of several of a kind, such as materials.
    pub fn of_many(index: usize) -> Self {
        const ROLES: [Role; Role::MANY] = [
            Role::Nominal,
            Role::Before,
            Role::After,
            Role::Emphasis,
            Role::Other(1),
            Role::Other(0),
            Role::Other(3),
            Role::Other(2),
            Role::Reference,
        ];
        ROLES[index % Self::MANY]
    }
}

/// The colour of a role as style sheets write it.
pub fn css_colour(role: Role) -> String {
    role.colour().to_string()
}

/// Red, green and blue of a value between −1 and 1 on a scale with a neutral
/// middle: the blue of [`Role::Nominal`] over near white to the vermilion of
/// [`Role::Before`]. Light and dark tell sign from size without the hue.
pub fn diverging(value: f64) -> (u8, u8, u8) {
    const MIDDLE: Colour = Colour(0xF4, 0xF2, 0xEF);
    let value = if value.is_finite() {
        value.clamp(-1.0, 1.0)
    } else {
        0.0
    };
    let Colour(red, green, blue) = if value < 0.0 {
        Role::Nominal.colour()
    } else {
        Role::Before.colour()
    };
    // Between two colours by construction.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let mix = |from: u8, to: u8| {
        (f64::from(from) + (f64::from(to) - f64::from(from)) * value.abs()).round() as u8
    };
    (
        mix(MIDDLE.0, red),
        mix(MIDDLE.1, green),
        mix(MIDDLE.2, blue),
    )
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
    /// A disc for each of a few points.
    Discs,
    /// A ring for each of a few points, which shows what it stands around.
    Rings,
    /// The area between two curves; see [`Series::band`](super::Series::band).
    Band,
}

/// Colour and mark of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Style {
    /// The role of the series.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Lightness of a copy in grey, 0 to 255.
    fn grey(Colour(red, green, blue): Colour) -> f64 {
        0.299 * f64::from(red) + 0.587 * f64::from(green) + 0.114 * f64::from(blue)
    }

    fn least_step(roles: &[Role]) -> f64 {
        let mut greys: Vec<f64> = roles.iter().map(|it| grey(it.colour_in_print())).collect();
        greys.sort_by(f64::total_cmp);
        greys
            .windows(2)
            .map(|pair| pair[1] - pair[0])
            .fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn curves_in_print_are_told_apart_in_grey() {
        let of_a_diagnosis = [
            Role::Measured,
            Role::Nominal,
            Role::Before,
            Role::After,
            Role::Emphasis,
            Role::Reference,
        ];
        let step = least_step(&of_a_diagnosis);
        assert!(step >= 20.0, "{step}");
        let many: Vec<Role> = (0..Role::MANY).map(Role::of_many).collect();
        let step = least_step(&many);
        assert!(step >= 15.0, "{step}");
    }
}
