//! Pressure threshold: F = g max(p − p₀, 0).
//!
//! Below the pressure p₀ (Pa) nothing happens: a chamber that has to unfold or to lift off its
//! core, a valve with a cracking pressure. F = g p is the force of the input (N). Even with p₀ = 0,
//! a pressure below zero has no effect. The force has a corner at p₀.

use super::table::Variable;
use super::{Family, Hidden, Info, Mechanism, Parameter, Place, Unit, parameters};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Mapped, Preparation};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "pressure_threshold",
    title: "pressure threshold",
    place: Place::Input,
    equation: "F = g max(p − p₀, 0)",
    text: "Nothing happens below a certain pressure: the chamber first has to unfold or to lift \
           off its core, or a valve opens only then. Above it the actuator lacks that pressure at \
           every angle.",
    signature: "small pressures",
    look_alikes: &["linear_stiffness", "sensor_offset"],
    family: Family::Offset,
    needs: &[],
    own_variable: Some(Variable::Pressure),
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: true,
    states: &[],
};

parameters! {
    /// Pressure threshold.
    PressureThreshold {
        /// Threshold p₀ (Pa).
        pressure: Parameter {
            key: "pressure_kpa",
            symbol: "p₀",
            unit: Unit::KiloPascal,
            lower: 0.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[0.05, 0.2],
        },
    }
}

impl<R: Real> Mechanism<R> for PressureThreshold<R> {
    fn input(&self, pressure: R, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        (pressure - self.pressure).max(R::zero())
    }

    fn pressure_behind(&self, pressure: R) -> R {
        pressure + self.pressure
    }
}

impl Preparation for PressureThreshold<f32> {
    const CYCLES: u16 = 1_000;
    type Part = Mapped<Self>;
    #[cfg(test)]
    const TRIAL: Trial = Trial::with_corner(&[9_000.0], 0.02);

    fn prepare(&self, _base: &Base) -> Self::Part {
        Mapped(*self)
    }
}

#[cfg(test)]
mod tests {
    use crate::actuator::Model;
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    #[test]
    fn nothing_below_the_threshold_and_the_rest_above_it() {
        let threshold = Kind::PressureThreshold.build(&[0.4]).unwrap();
        let model: Model<f64> = spring(0.4, 0.3, 2.0, &[threshold]);
        let plain = spring(0.4, 0.3, 2.0, &[]);
        for (pressure, left) in [(0.3, 0.0), (-1.0, 0.0), (1.4, 1.0)] {
            let end = |model: &Model<f64>, pressure| {
                let start = model.at_rest(0.1, 0.0);
                run(model, start, &Held(pressure), 1.0, 300).angle
            };
            assert!((end(&model, pressure) - end(&plain, left)).abs() < 1e-13);
        }
    }

    #[test]
    fn holding_pressure_has_the_threshold_on_top() {
        let threshold = Kind::PressureThreshold.build(&[0.4]).unwrap();
        let model: Model<f64> = spring(0.4, 0.3, 2.0, &[threshold]);
        assert!((model.holding_pressure(0.8) - 2.0).abs() < 1e-12);
    }
}
