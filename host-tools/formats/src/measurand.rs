//! What the output of a rig is: a bending angle in degrees, or whatever its column says.
//!
//! All code works in degrees and radians. Where the output is a length or a voltage, its numbers are
//! taken as degrees, and results show them under the name and in the unit of the column.

use serde::{Deserialize, Serialize};

use crate::columns::{AngleUnit, Quantity};
use crate::numbers::short;

/// Name of an output that is not an angle, in a column that is named as an angle.
const UNNAMED: &str = "output";

/// Name and unit of the output, as results show it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Measurand {
    name: String,
    /// Degrees for every angle.
    unit: AngleUnit,
}

impl Default for Measurand {
    /// The bending angle.
    fn default() -> Self {
        Self {
            name: Quantity::Angle.key().to_owned(),
            unit: AngleUnit::Deg,
        }
    }
}

impl Measurand {
    /// What a column of this name holds, in the unit that was said of it. An angle is one whatever
    /// its column is called.
    pub fn of(column: &str, unit: Option<AngleUnit>) -> Self {
        let Some(unit) = unit.filter(|unit| !unit.is_of_angle()) else {
            return Self::default();
        };
        let word: &str = unit.into();
        let name = column.trim().trim_end_matches([')', ']']);
        let has_unit = name.to_lowercase().ends_with(word);
        let stem = match name.len().checked_sub(word.len()).filter(|_| has_unit) {
            Some(end) => name[..end].trim_end_matches(|it: char| !it.is_alphanumeric()),
            None => name,
        };
        let is_none = stem.is_empty() || column == Quantity::Angle.column();
        let name = if is_none { UNNAMED } else { stem };
        Self {
            name: name.to_owned(),
            unit,
        }
    }

    /// What [`Self::column`] names.
    pub fn of_column(column: &str) -> Self {
        let unit = column.rsplit('_').next();
        Self::of(column, unit.and_then(|it| it.parse().ok()))
    }

    /// Whether it is an angle.
    pub fn is_angle(&self) -> bool {
        self.unit.is_of_angle()
    }

    /// Its name, such as `position`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The symbol of its unit: `°`, `mm`.
    pub fn symbol(&self) -> &'static str {
        self.unit().trim_start()
    }

    /// The unit as it is written behind a number: `°` at once, others after a blank.
    pub fn unit(&self) -> &'static str {
        match self.unit {
            AngleUnit::Deg | AngleUnit::Rad => "°",
            AngleUnit::Mm => " mm",
            AngleUnit::Cm => " cm",
            AngleUnit::Um => " µm",
            AngleUnit::Mv => " mV",
        }
    }

    /// The unit as it ends the name of a column: `deg`, `mm`.
    pub fn suffix(&self) -> &'static str {
        self.unit.into()
    }

    /// The name of a column with it: `angle_deg`, `position_mm`.
    pub fn column(&self) -> String {
        format!("{}_{}", self.name, self.suffix())
    }

    /// A label: `angle (°)`, `position (mm)`.
    pub fn label(&self) -> String {
        self.with_unit(&self.name)
    }

    /// Something in its unit: `RMS error (mm)`.
    pub fn with_unit(&self, what: &str) -> String {
        format!("{what} ({})", self.symbol())
    }

    /// Name and unit of a quantity that is derived of the angle, as it is called where the output is
    /// this: `largest angle so far` in `°`, `angular velocity` in `°/s`.
    pub fn named(&self, quantity: &str, unit: &str) -> (String, String) {
        if self.is_angle() {
            return (quantity.to_owned(), unit.to_owned());
        }
        let rate = format!("rate of the {}", self.name);
        let quantity = quantity.replace("angular velocity", &rate);
        (
            quantity.replace("angle", &self.name),
            unit.replace('°', self.symbol()),
        )
    }

    /// A value (rad) with three digits and its unit: `0.52°`, `0.52 mm`.
    pub fn value(&self, radians: f64) -> String {
        format!("{}{}", short(radians.to_degrees()), self.unit())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_keeps_the_name_and_the_unit_of_its_column() {
        for (column, unit, label, of_column) in [
            ("position_mm", AngleUnit::Mm, "position (mm)", "position_mm"),
            ("Height (cm)", AngleUnit::Cm, "Height (cm)", "Height_cm"),
            ("y", AngleUnit::Um, "y (µm)", "y_um"),
            ("mV", AngleUnit::Mv, "output (mV)", "output_mv"),
            ("angle_deg", AngleUnit::Mm, "output (mm)", "output_mm"),
            ("theta_rad", AngleUnit::Rad, "angle (°)", "angle_deg"),
        ] {
            let measurand = Measurand::of(column, Some(unit));
            assert_eq!(measurand.label(), label);
            assert_eq!(measurand.column(), of_column);
            assert_eq!(Measurand::of_column(of_column), measurand);
        }
        assert_eq!(Measurand::of("position_mm", None), Measurand::default());
        let position = Measurand::of("position_mm", Some(AngleUnit::Mm));
        assert_eq!(position.value(2.5f64.to_radians()), "2.50 mm");
        assert_eq!(Measurand::default().value(2.5f64.to_radians()), "2.50°");
        let (name, unit) = position.named("sign of angular velocity", "°/s");
        assert_eq!((&*name, &*unit), ("sign of rate of the position", "mm/s"));
    }
}
