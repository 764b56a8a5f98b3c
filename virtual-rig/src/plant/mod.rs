// SPDX-License-Identifier: GPL-3.0-or-later
//! Everything that is not the board: syringe pump, air, actuator, sensors.
//!
//! One file for each part, each with its equation, symbols and units. Parts are
//! an immutable configuration and a small state; [`Plant::step`] advances all of
//! them in the order in which the air flows.

pub mod actuator;
pub mod gas;
pub mod sensors;
pub mod syringe;

use model_core::actuator::Model;
use softrig::estimate::Placement;

use actuator::Actuator;
pub use actuator::LetGo;
use gas::{Air, Gas};
use sensors::{FlexSensor, PressureSensor, SensorFault, Voltage};
use syringe::Syringe;

/// Pascal in a kilopascal.
pub const PASCAL_PER_KPA: f64 = 1e3;

/// The configuration of everything that is not the board.
#[derive(Clone, Debug)]
pub struct PlantConfig {
    /// The actuator as it is, hidden effects included, in SI units.
    pub actuator: Model<f64>,
    /// Plunger and spindle.
    pub syringe: Syringe,
    /// The air and where it escapes.
    pub gas: Gas,
    /// The pressure sensor.
    pub pressure_sensor: PressureSensor,
    /// The flex sensor.
    pub flex_sensor: FlexSensor,
    /// The actuator's history before power-on.
    pub let_go: LetGo,
}

/// The board's outputs to the plant, and the active faults, during one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inputs {
    /// Where the plunger stands, in mm from the retracted switch.
    pub plunger_mm: f64,
    /// Whether the vent valve is energised and so closed.
    pub valve_closed: bool,
    /// Whether there is a leak beyond that of the gas configuration.
    pub leaking: bool,
    /// Time constant of the way to the pressure sensor (s), if it is clogged.
    pub late_s: Option<f64>,
    /// Whether sensor and vent, on one branch, are cut off by a kink.
    pub kinked: bool,
    /// The flex sensor's wiring.
    pub flex: SensorFault,
    /// The pressure sensor's wiring.
    pub pressure: SensorFault,
}

/// The state of everything that is not the board.
#[derive(Clone, Debug)]
pub struct Plant {
    config: PlantConfig,
    air: Air,
    /// Gauge pressure at the sensor (Pa).
    sensed_pa: f64,
    actuator: Actuator,
    flex: sensors::FlexState,
    flex_voltage: Voltage,
    pressure_voltage: Voltage,
}

impl Plant {
    /// Creates a plant under atmospheric pressure, at rest unless the actuator
    /// was [let go](PlantConfig::let_go) a moment ago, with the plunger at
    /// `plunger_mm`, for steps of `interval` seconds.
    pub fn new(config: PlantConfig, plunger_mm: f64, interval: f64) -> Self {
        let air = Air::at_rest(&config.gas, config.volume_m3(plunger_mm));
        let actuator = Actuator::let_go(&config.actuator, &config.let_go, interval);
        let flex = sensors::FlexState::at_rest(actuator.reading());
        let mut plant = Self {
            sensed_pa: air.line_pa(),
            air,
            flex_voltage: Voltage::default(),
            pressure_voltage: Voltage::default(),
            actuator,
            flex,
            config,
        };
        plant.sense(SensorFault::None, SensorFault::None);
        plant
    }

    /// Advances everything by one interval.
    pub fn step(&mut self, inputs: &Inputs) {
        let dt = self.actuator.interval();
        let volume = self.config.volume_m3(inputs.plunger_mm);
        self.air.step(
            &self.config.gas,
            volume,
            !inputs.valve_closed && !inputs.kinked,
            inputs.leaking,
            dt,
        );
        // Beyond a kink is what was there, until the vent lets it out.
        let (target, time_s) = match (inputs.kinked, inputs.valve_closed) {
            (false, _) => (self.air.line_pa(), inputs.late_s.unwrap_or(0.0)),
            (true, true) => (self.sensed_pa, 0.0),
            (true, false) => (0.0, self.config.gas.vent_s),
        };
        // With a time of zero it is there at once.
        self.sensed_pa += (target - self.sensed_pa) * -(-dt / time_s).exp_m1();
        self.actuator.step(self.air.line_pa());
        self.flex
            .step(&self.config.flex_sensor, self.actuator.reading(), dt);
        self.sense(inputs.flex, inputs.pressure);
    }

    fn sense(&mut self, flex: SensorFault, pressure: SensorFault) {
        let shown = self.flex.shown_rad();
        let flex_at = |angle| self.config.flex_sensor.voltage(angle);
        self.flex_voltage = flex.apply(self.flex_voltage, flex_at(shown), flex_at(0.0));
        let pressure_at = |gauge_pa| self.config.pressure_sensor.voltage(gauge_pa);
        self.pressure_voltage = pressure.apply(
            self.pressure_voltage,
            pressure_at(self.sensed_pa),
            pressure_at(0.0),
        );
    }

    /// The bending angle, without any sensor (°).
    pub fn angle_deg(&self) -> f64 {
        self.actuator.angle().to_degrees()
    }

    /// A hand bends the actuator to an angle (°) and holds it there, or lets go.
    pub fn bend(&mut self, angle_deg: Option<f64>) {
        self.actuator.hold(angle_deg.map(f64::to_radians));
    }

    /// The rig is changed to stand like this, against how it stood at power-on.
    pub fn stand(&mut self, placement: &Placement) {
        self.actuator.stand(placement);
    }

    /// It is left alone without pressure for so many seconds.
    pub fn rest(&mut self, seconds: f64) {
        self.actuator.rest(seconds);
    }

    /// Another actuator of the same make takes the place of this one.
    pub fn replace_actuator(&mut self) {
        self.actuator.replace();
        self.actuator.restart_clock();
    }

    /// Drifts begin anew: the bench has been off and has cooled down.
    pub fn restart_clock(&mut self) {
        self.actuator.restart_clock();
    }

    /// Gauge pressure at sensor and actuator, without noise (kPa).
    pub fn pressure_kpa(&self) -> f64 {
        self.air.line_pa() / PASCAL_PER_KPA
    }

    /// Gauge pressure in the syringe, ahead of the tube (kPa).
    pub fn syringe_kpa(&self) -> f64 {
        self.air.syringe_pa() / PASCAL_PER_KPA
    }

    /// Voltage and noise of the flex sensor.
    pub fn flex_voltage(&self) -> Voltage {
        self.flex_voltage
    }

    /// Voltage and noise of the pressure sensor.
    pub fn pressure_voltage(&self) -> Voltage {
        self.pressure_voltage
    }

    /// The configuration.
    pub fn config(&self) -> &PlantConfig {
        &self.config
    }
}

impl PlantConfig {
    /// The default rig around `actuator`.
    pub fn new(actuator: Model<f64>) -> Self {
        Self {
            actuator,
            syringe: Syringe::default(),
            gas: Gas::default(),
            pressure_sensor: PressureSensor::default(),
            flex_sensor: FlexSensor::default(),
            let_go: LetGo::default(),
        }
    }

    /// The closed volume of air with the plunger at `plunger_mm` (m³).
    pub fn volume_m3(&self, plunger_mm: f64) -> f64 {
        self.gas.dead_volume_m3 + self.syringe.volume_m3(plunger_mm)
    }
}
