// SPDX-License-Identifier: GPL-3.0-or-later
//! The voltages of the two sensors at the converter's inputs.
//!
//! White noise is added by the converter, anew for each conversion: 0.25 kPa and 0.4° rms, before
//! any filter. Both sensors have a zero error, none by default.

/// Pascal in a pound per square inch.
pub const PASCAL_PER_PSI: f64 = 6_894.757_293;

const SUPPLY_MILLIVOLTS: f64 = 5000.0;

/// A voltage with its white noise.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Voltage {
    /// Mean (mV).
    pub millivolts: f64,
    /// Noise (mV rms).
    pub noise_rms_millivolts: f64,
}

/// A fault of a sensor or its wiring.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum SensorFault {
    /// Nothing.
    #[default]
    None,
    /// The wire is broken: the input is pulled to ground.
    Open,
    /// The wire touches the supply.
    Shorted,
    /// The sensor repeats its last voltage, without noise.
    Stuck,
    /// It has come off what it senses: it shows zero, with five times the noise.
    Detached,
    /// Its voltage is off by so much (mV).
    Drifted(f64),
}

impl SensorFault {
    pub(crate) fn apply(self, last: Voltage, healthy: Voltage, at_zero: Voltage) -> Voltage {
        let quiet = |millivolts| Voltage {
            millivolts,
            noise_rms_millivolts: 0.0,
        };
        match self {
            Self::None => healthy,
            Self::Open => quiet(0.0),
            Self::Shorted => quiet(SUPPLY_MILLIVOLTS),
            Self::Stuck => quiet(last.millivolts),
            Self::Detached => Voltage {
                noise_rms_millivolts: 5.0 * at_zero.noise_rms_millivolts,
                ..at_zero
            },
            Self::Drifted(millivolts) => Voltage {
                millivolts: (healthy.millivolts + millivolts).clamp(0.0, SUPPLY_MILLIVOLTS),
                ..healthy
            },
        }
    }
}

/// The pressure sensor.
///
/// Ratiometric, 0.5–4.5 V of 5 V for 0–80 psi:
///
/// ```text
/// U = 5000 mV · (0.1 + 0.8 p/80 psi), between 0 and 5000 mV
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PressureSensor {
    /// White noise (Pa rms).
    pub noise_rms_pa: f64,
    /// Zero error (mV).
    pub offset_millivolts: f64,
}

impl Default for PressureSensor {
    fn default() -> Self {
        Self {
            noise_rms_pa: 250.0,
            offset_millivolts: 0.0,
        }
    }
}

impl PressureSensor {
    /// Span of the sensor (mV/Pa).
    pub const MILLIVOLTS_PER_PA: f64 = SUPPLY_MILLIVOLTS * 0.8 / 80.0 / PASCAL_PER_PSI;

    /// The voltage at a gauge pressure (Pa).
    pub fn voltage(&self, gauge_pa: f64) -> Voltage {
        let millivolts =
            0.1 * SUPPLY_MILLIVOLTS + Self::MILLIVOLTS_PER_PA * gauge_pa + self.offset_millivolts;
        Voltage {
            millivolts: millivolts.clamp(0.0, SUPPLY_MILLIVOLTS),
            noise_rms_millivolts: Self::MILLIVOLTS_PER_PA * self.noise_rms_pa,
        }
    }
}

/// The flex sensor and its divider.
///
/// From 5 V, with 47 kΩ to ground; θ_0 is the bend that the strip was glued on with:
///
/// ```text
/// R(θ) = 25 kΩ · (70/25)^((θ + θ_0)/90°),  θ + θ_0 between −20° and 140°
/// U = 5 V · 47/(47 + R)            668 counts flat, 411 at 90°
/// θ_s = θ − c·q,  τ q̇ = θ − q      creep of the sensor, off by default
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlexSensor {
    /// Resistance when straight (Ω).
    pub flat_ohm: f64,
    /// Resistance at 90° (Ω).
    pub bent_ohm: f64,
    /// Resistor to ground (Ω).
    pub divider_ohm: f64,
    /// White noise, as an angle (rad rms).
    pub noise_rms_rad: f64,
    /// Zero error: what it is bent when the actuator is straight (rad).
    pub offset_rad: f64,
    /// Share c of a lasting bend that the sensor forgets.
    pub creep_share: f64,
    /// Time constant of that creep (s).
    pub creep_s: f64,
}

impl Default for FlexSensor {
    fn default() -> Self {
        Self {
            flat_ohm: 25e3,
            bent_ohm: 70e3,
            divider_ohm: 47e3,
            noise_rms_rad: 0.4f64.to_radians(),
            offset_rad: 0.0,
            creep_share: 0.0,
            creep_s: 20.0,
        }
    }
}

impl FlexSensor {
    /// The voltage at a bend (rad).
    pub fn voltage(&self, angle: f64) -> Voltage {
        let (least, most) = (-20f64.to_radians(), 140f64.to_radians());
        let bend = (angle + self.offset_rad).clamp(least, most);
        let right_angles = bend / std::f64::consts::FRAC_PI_2;
        let ratio = self.bent_ohm / self.flat_ohm;
        let resistance = self.flat_ohm * ratio.powf(right_angles);
        let sum = self.divider_ohm + resistance;
        let slope = SUPPLY_MILLIVOLTS * self.divider_ohm / (sum * sum) * resistance * ratio.ln()
            / std::f64::consts::FRAC_PI_2;
        Voltage {
            millivolts: SUPPLY_MILLIVOLTS * self.divider_ohm / sum,
            noise_rms_millivolts: slope * self.noise_rms_rad,
        }
    }
}

/// The state of the flex sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlexState {
    forgotten: f64,
    shown: f64,
}

impl FlexState {
    /// A sensor that has been straight for long; it may be fixed at `angle`.
    pub(crate) fn at_rest(angle: f64) -> Self {
        Self {
            forgotten: 0.0,
            shown: angle,
        }
    }

    pub(crate) fn step(&mut self, sensor: &FlexSensor, angle: f64, dt: f64) {
        self.forgotten += (angle - self.forgotten) * -(-dt / sensor.creep_s).exp_m1();
        self.shown = angle - sensor.creep_share * self.forgotten;
    }

    /// The angle that the resistance corresponds to (rad).
    pub(crate) fn shown_rad(&self) -> f64 {
        self.shown
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(voltage: Voltage) -> f64 {
        voltage.millivolts / 5000.0 * 1024.0
    }

    #[test]
    fn end_values_are_those_of_the_data_sheets() {
        let flex = FlexSensor::default();
        assert!((counts(flex.voltage(0.0)) - 668.4).abs() < 0.1);
        assert!((counts(flex.voltage(90f64.to_radians())) - 411.4).abs() < 0.1);
        let pressure = PressureSensor::default();
        assert!((counts(pressure.voltage(0.0)) - 102.4).abs() < 1e-9);
        assert!((counts(pressure.voltage(80.0 * PASCAL_PER_PSI)) - 921.6).abs() < 1e-9);
        assert!(counts(pressure.voltage(-100e3)) >= 0.0);
    }

    #[test]
    fn noise_is_stated_in_what_is_sensed() {
        let flex = FlexSensor::default();
        let (a, b) = (flex.voltage(1.0), flex.voltage(1.0 + 1e-6));
        let slope = (a.millivolts - b.millivolts) / 1e-6;
        assert!((a.noise_rms_millivolts / slope - 0.4f64.to_radians()).abs() < 1e-7);
        let noise = PressureSensor::default().voltage(0.0).noise_rms_millivolts;
        let step = PressureSensor::default().voltage(250.0).millivolts - 500.0;
        assert!((noise - step).abs() < 1e-9);
    }

    #[test]
    fn a_zero_error_is_the_same_at_every_angle() {
        let off = FlexSensor {
            offset_rad: 0.03,
            ..FlexSensor::default()
        };
        for angle in [-0.1, 0.0, 1.2] {
            assert_eq!(
                off.voltage(angle),
                FlexSensor::default().voltage(angle + 0.03)
            );
        }
    }

    #[test]
    fn creep_forgets_its_share() {
        let sensor = FlexSensor {
            creep_share: 0.1,
            ..FlexSensor::default()
        };
        let mut state = FlexState::at_rest(0.0);
        for _ in 0..40_000 {
            state.step(&sensor, 1.0, 5e-4);
        }
        let expected = 1.0 - 0.1 * (1.0 - (-1.0f64).exp());
        assert!((state.shown_rad() - expected).abs() < 1e-9);
    }
}
