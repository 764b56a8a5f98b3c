//! The range of every number in a model file.
//!
//! A wrong unit or a typing error gives a number that no rig has. A computation with it
//! overflows, or never ends, far from the cause. So each number has a range: wide enough for a
//! pendulum, a hydraulic arm or a circuit with the same equation, and narrow enough for the sums
//! and powers of a simulation. `docs/formats.md` has the same table.

use std::fmt;

use model_core::effects::{Parameter, Unit};

use crate::numbers::bound;

/// The range of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// The key in a model file, or what the numbers of this unit in effects are.
    pub of: &'static str,
    /// The unit in the file.
    pub unit: &'static str,
    /// The smallest.
    pub least: f64,
    /// The largest.
    pub most: f64,
    /// The reason for the limits.
    pub because: &'static str,
}

/// The keys of `[actuator]` and `[dynamics]`.
pub const KEYS: [Range; 8] = [
    row(
        "length_m",
        "m",
        1e-5,
        1e3,
        "from the width of a hair to the length of a bridge",
    ),
    row("width_m", "m", 1e-5, 1e3, "the same"),
    row("height_m", "m", 1e-5, 1e3, "the same"),
    row(
        "inertia_kg_m",
        "kg·m",
        1e-9,
        1e9,
        "only ratios to it matter: to come into the range, scale all forces with it",
    ),
    row(
        "damping_n_s_per_rad",
        "N·s/rad",
        0.0,
        1e12,
        "10¹² times that of a silicone finger",
    ),
    row("stiffness_n_per_rad_n", "N/radⁿ", 0.0, 1e12, "the same"),
    row(
        "exponent",
        "",
        0.01,
        20.0,
        "θⁿ stays finite; metals, silicones and cords have 0.1 to 10",
    ),
    row(
        "input_gain_n_per_kpa",
        "N/kPa",
        -1e9,
        1e9,
        "that of a piston of a square kilometre; if negative, pressure straightens the actuator",
    ),
];

/// Numbers of effects by their unit. Where [the catalogue](model_core::catalogue) is narrower,
/// it counts.
const UNITS: [(Unit, Range); 15] = [
    by_unit(Unit::One, "factors", 1e6, "a factor of a million"),
    by_unit(
        Unit::Newton,
        "forces",
        1e12,
        "far beyond any machine, far below an overflow",
    ),
    by_unit(Unit::NewtonPerRad, "stiffnesses", 1e12, "the same"),
    by_unit(Unit::NewtonPerRad3, "cubic stiffnesses", 1e12, "the same"),
    by_unit(Unit::NewtonSecond2PerRad2, "drags", 1e12, "the same"),
    by_unit(Unit::Radian, "angles", 1e6, "160 000 turns of a motor"),
    by_unit(
        Unit::RadianPerSecond,
        "rates",
        1e6,
        "160 000 turns a second",
    ),
    by_unit(Unit::Second, "times", 1e9, "thirty years"),
    by_unit(
        Unit::PerSecond,
        "rates of change",
        1e6,
        "once per microsecond",
    ),
    by_unit(Unit::Hertz, "frequencies", 1e6, "the same"),
    by_unit(
        Unit::PerRadian,
        "changes with the angle",
        1e6,
        "a factor of a million per radian",
    ),
    by_unit(
        Unit::PerKiloPascal,
        "changes with the pressure",
        1e6,
        "a factor of a million per kilopascal",
    ),
    by_unit(
        Unit::KiloPascal,
        "pressures",
        1e6,
        "ten times that of a hydraulic pump",
    ),
    by_unit(
        Unit::NewtonPerKilogram,
        "forces by a load",
        1e6,
        "a hundred thousand times its weight",
    ),
    by_unit(Unit::Metre, "levers", 1e3, "the length of a bridge"),
];

const fn row(
    of: &'static str,
    unit: &'static str,
    least: f64,
    most: f64,
    because: &'static str,
) -> Range {
    Range {
        of,
        unit,
        least,
        most,
        because,
    }
}

/// A symmetric range of both signs.
const fn by_unit(unit: Unit, of: &'static str, most: f64, because: &'static str) -> (Unit, Range) {
    (unit, row(of, unit.symbol(), -most, most, because))
}

impl Range {
    /// The range of a key in `[actuator]` or `[dynamics]`; none for other keys.
    pub fn of_key(key: &str) -> Option<Self> {
        KEYS.into_iter().find(|range| range.of == key)
    }

    /// The range of effects' parameters in this unit.
    pub fn of_unit(unit: Unit) -> Self {
        UNITS
            .into_iter()
            .find(|(of, _)| *of == unit)
            // A test holds that every parameter of the catalogue has one.
            .map_or(row("", "", -1e6, 1e6, ""), |(_, range)| range)
    }

    /// The range of a parameter of an effect: its own bounds, where it has any.
    pub fn of_parameter(parameter: &Parameter) -> Self {
        let wide = Self::of_unit(parameter.unit);
        let bound = |si: f32| parameter.unit.from_si(f64::from(si));
        Self {
            least: bound(parameter.lower).max(wide.least),
            most: bound(parameter.upper).min(wide.most),
            ..wide
        }
    }

    /// Whether a number is within the range.
    pub fn contains(&self, number: f64) -> bool {
        (self.least..=self.most).contains(&number)
    }

    /// The advice for a number out of range.
    pub fn advice(&self) -> String {
        format!("give a value {self}")
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "from {} to {}", bound(self.least), bound(self.most))?;
        if self.unit.is_empty() {
            Ok(())
        } else {
            write!(f, " {}", self.unit)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use model_core::catalogue::Kind;

    use super::*;
    use crate::model_file::ModelFile;

    /// The table as `docs/formats.md` shows it.
    fn page() -> String {
        let mut text = String::from("| | unit | smallest | largest | |\n|---|---|---:|---:|---|\n");
        let keys = KEYS.map(|range| (format!("`{}`", range.of), range));
        let units = UNITS.map(|(_, range)| (format!("{} of effects", range.of), range));
        for (of, range) in keys.into_iter().chain(units) {
            let unit = if range.unit.is_empty() {
                "–"
            } else {
                range.unit
            };
            text += &format!(
                "| {of} | {unit} | {} | {} | {} |\n",
                bound(range.least).replace('-', "−"),
                bound(range.most).replace('-', "−"),
                range.because
            );
        }
        text
    }

    #[test]
    fn the_page_has_the_ranges_of_the_code() {
        let page_path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/formats.md");
        let written = std::fs::read_to_string(page_path).unwrap();
        assert!(
            written.contains(&page()),
            "docs/formats.md is out of date; its table of ranges should be\n{}",
            page()
        );
    }

    #[test]
    fn dimensions_and_what_follows_from_them_have_ranges() {
        let read = |length: &str, height: &str| {
            let text = format!(
                "schema = 1\n[actuator]\nmaterial = \"Dragon Skin 20\"\nlength_m = {length}\nwidth_m = 0.03\nheight_m = {height}\n[dynamics]\ninertia_kg_m = 1\ndamping_n_s_per_rad = 1\ninput_gain_n_per_kpa = 1\n"
            );
            ModelFile::parse(&text, Path::new("m.toml")).map_err(|error| error.to_string())
        };
        assert!(read("0.094", "0.024").is_ok());
        for wrong in ["0", "-1", "nan", "inf", "1e308"] {
            let said = read(wrong, "0.024").unwrap_err();
            assert!(
                said.starts_with("m.toml, line 4, column 12: length_m = "),
                "{said}"
            );
            assert!(said.contains("from 1e-5 to 1000 m"), "{said}");
        }
        // Each has a size that something has, and both together nothing.
        let said = read("1e-5", "1000").unwrap_err();
        assert!(
            said.contains("line 7, column 1: stiffness_n_per_rad_n = "),
            "{said}"
        );
    }

    #[test]
    fn every_parameter_of_the_catalogue_has_a_range() {
        for kind in Kind::ALL.iter().chain(Kind::ON_DESKTOP) {
            for row in kind.parameters() {
                let range = Range::of_parameter(row);
                assert_eq!(range.unit, row.unit.symbol());
                assert!(
                    !range.of.is_empty() && range.least < range.most,
                    "{kind:?} {range:?}"
                );
                assert!(range.most.abs() <= 1e12 && range.least.abs() <= 1e12);
            }
        }
    }
}
