// SPDX-License-Identifier: GPL-3.0-or-later
//! Plunger and spindle: x = s·ℓ/(N·m), V = A (L − x).
//!
//! Beyond each switch is a hard stop, where steps are lost.

/// Dimensions of the syringe pump.
///
/// | symbol | quantity | default |
/// |---|---|---|
/// | s | microsteps, counted by the simulator | – |
/// | N | full steps a revolution | 200 |
/// | m | microsteps a step | 16 |
/// | ℓ | lead of the spindle | 2 mm/rev |
/// | A | area of the bore of 26.7 mm | 560 mm² |
/// | L | stroke | 100 mm (56 ml) |
/// | x | plunger, from the retracted switch | −2 to 100 mm |
///
/// One microstep is 1/1600 mm or 0.35 µl.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Syringe {
    /// Microsteps for a millimetre of travel.
    pub microsteps_per_mm: f64,
    /// Diameter of the bore (mm).
    pub bore_mm: f64,
    /// Travel from the retracted switch to an empty syringe (mm).
    pub stroke_mm: f64,
    /// Where the switch at the pushed-in end closes (mm); the other is at 0.
    pub pushed_in_switch_mm: f64,
    /// The hard stop behind the retracted switch (mm).
    pub lower_stop_mm: f64,
}

impl Default for Syringe {
    fn default() -> Self {
        Self {
            microsteps_per_mm: 200.0 * 16.0 / 2.0,
            bore_mm: 26.7,
            stroke_mm: 100.0,
            pushed_in_switch_mm: 95.0,
            lower_stop_mm: -2.0,
        }
    }
}

impl Syringe {
    /// Area of the bore (m²).
    pub fn area_m2(&self) -> f64 {
        let bore = self.bore_mm * 1e-3;
        std::f64::consts::PI / 4.0 * bore * bore
    }

    /// Air left in the syringe (m³).
    pub fn volume_m3(&self, plunger_mm: f64) -> f64 {
        self.area_m2() * (self.stroke_mm - plunger_mm) * 1e-3
    }

    /// The position at a number of microsteps (mm).
    pub fn millimetres(&self, microsteps: i64) -> f64 {
        microsteps as f64 / self.microsteps_per_mm
    }

    /// The nearest microstep to a position.
    pub fn microsteps(&self, millimetres: f64) -> i64 {
        // A travel of metres is far within the range.
        #[allow(clippy::cast_possible_truncation)]
        let steps = (millimetres * self.microsteps_per_mm).round() as i64;
        steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_microstep_is_the_bore_times_the_lead_over_3200() {
        let syringe = Syringe::default();
        assert!((syringe.area_m2() - 560e-6).abs() < 0.2e-6);
        let step = syringe.volume_m3(0.0) - syringe.volume_m3(syringe.millimetres(1));
        assert!((step - 0.35e-9).abs() < 0.001e-9, "{step}");
        assert!((syringe.volume_m3(0.0) - 56e-6).abs() < 0.02e-6);
        assert_eq!(syringe.microsteps(95.0), 152_000);
    }

    #[test]
    fn the_simulated_slide_is_the_drawn_one() {
        let drawing = include_str!("../../../docs/hardware/slide.scad");
        let number = |name: &str| -> f64 {
            let line = drawing
                .lines()
                .find_map(|line| line.strip_prefix(name)?.strip_prefix(" = "))
                .unwrap_or_else(|| panic!("{name} is drawn"));
            line.split(';')
                .next()
                .and_then(|it| it.parse().ok())
                .unwrap()
        };
        let drawn = Syringe {
            microsteps_per_mm: number("steps_per_turn") * number("microsteps") / number("lead"),
            bore_mm: number("bore"),
            stroke_mm: number("stroke"),
            pushed_in_switch_mm: number("pushed_in_switch"),
            lower_stop_mm: -number("hard_stop_behind"),
        };
        assert_eq!(drawn, Syringe::default());
    }
}
