//! From counts of the converter to pressure and angle.
//!
//! Each reading goes through the same steps: a check of the voltage, the
//! calibration, the fault debounce, the tare. The loops get a smoothed value. The
//! plain one is recorded and compared with the prediction, because a filter would
//! show up in a diagnosis as a lag of the actuator.

pub mod debounce;
pub mod filter;
pub mod flex;
pub mod pressure;
pub mod standstill;
pub mod stuck;

use wire::reply::Refusal;

use crate::{
    design::{
        ANGLE_REST_RAD, LARGEST_ANGLE_TARE_RAD, LARGEST_PRESSURE_TARE_PA, OVERSAMPLING,
        PRESSURE_REST_PA,
    },
    io::{Inputs, Oversampled},
};
use debounce::FaultDebounce;
use filter::LowPass;
use flex::Flex;
use pressure::Pressure;
use standstill::Standstill;
use stuck::Stuck;

/// Full scale of the sum of conversions: 5 V.
const FULL_SCALE: u32 = 1024 * OVERSAMPLING as u32;

/// The smallest sum that is not a broken wire: 0.25 V of 5 V.
#[allow(clippy::cast_possible_truncation)] // 820.
pub const LOWEST_SUM: u16 = (FULL_SCALE * 25).div_ceil(500) as u16;

/// The largest sum that is not a broken wire: 4.75 V of 5 V.
#[allow(clippy::cast_possible_truncation)] // 15 564.
pub const HIGHEST_SUM: u16 = (FULL_SCALE * 475 / 500) as u16;

/// Why a sensor has no reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorFault {
    /// Below 0.25 V: an open flex sensor, a pressure sensor without supply, a
    /// signal wire that touches ground.
    Low,
    /// Above 4.75 V: a shorted flex sensor, a signal wire that touches 5 V.
    High,
    /// Farther beyond the calibration table than can be extrapolated.
    BeyondTable,
    /// A conversion was missed: interrupts were off for too long.
    NotMeasured,
    /// The same to the last bit while the rig moves; see [`stuck`].
    Stuck,
}

/// The sum of conversions, if no broken wire gives it.
fn within_wires(reading: Oversampled) -> Result<u16, SensorFault> {
    match reading.0 {
        _ if !reading.is_measured() => Err(SensorFault::NotMeasured),
        ..LOWEST_SUM => Err(SensorFault::Low),
        sum if sum > HIGHEST_SUM => Err(SensorFault::High),
        sum => Ok(sum),
    }
}

/// A sensor's reading, in its SI unit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reading {
    /// The reading as it is; during a bad sample or a fault the last good
    /// one, and zero before there was any.
    pub value: f32,
    /// The reading through the filter, [`filter::DELAY_S`] late.
    pub filtered: f32,
    /// The fault that counts.
    pub fault: Option<SensorFault>,
    /// Whether the value was read in this period, not carried on from before.
    pub fresh: bool,
}

impl Reading {
    /// The value unless a fault counts.
    pub fn valid(&self) -> Option<f32> {
        match self.fault {
            None => Some(self.value),
            Some(_) => None,
        }
    }
}

/// The readings of both sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Readings {
    /// Gauge pressure (Pa).
    pub pressure: Reading,
    /// Bending angle (rad).
    pub angle: Reading,
}

/// The calibration of the sensors' counts; see [`crate::settings::calibration`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// The pressure sensor's calibration.
    pub pressure: Pressure,
    /// The flex sensor's calibration.
    pub flex: Flex,
}

/// The state of one sensor; its values are those before the tare.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Channel {
    debounce: FaultDebounce,
    low_pass: LowPass,
    standstill: Standstill,
    read: bool,
    tare: f32,
}

impl Channel {
    fn update(&mut self, sample: Result<f32, SensorFault>) -> Reading {
        let fresh = sample.is_ok();
        let (value, fault) = self.debounce.update(sample);
        if fault.is_some() {
            self.read = false;
        }
        if !self.read {
            // The first value, or the first after a fault: the filter and the
            // standstill detector start anew.
            self.low_pass = LowPass::settled(value);
            self.standstill = Standstill::default();
        }
        let filtered = self.low_pass.update(value);
        if fault.is_none() {
            self.read = true;
            self.standstill.update(filtered);
        }
        Reading {
            value: value - self.tare,
            filtered: filtered - self.tare,
            fault,
            fresh,
        }
    }

    /// Where the sensor rests, if a tare may call that zero.
    fn new_tare(&self, spread: f32, largest: f32) -> Result<f32, Refusal> {
        if !self.read {
            return Err(Refusal::NoReading);
        }
        let level = self.standstill.level(spread).ok_or(Refusal::NotAtRest)?;
        if level.abs() > largest {
            return Err(Refusal::OutOfBounds);
        }
        Ok(level)
    }
}

/// The sensors' state from sample to sample.
///
/// A new calibration voids all of it, the tare too: start with a new one then.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sensors {
    pressure: Channel,
    angle: Channel,
    stuck: Stuck,
}

impl Sensors {
    /// Sensors that have not been read yet, without a tare.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes the samples of a control period.
    pub fn update(&mut self, calibration: &Calibration, inputs: &Inputs) -> Readings {
        let pressure = self
            .pressure
            .update(calibration.pressure.pressure(inputs.pressure));
        let mut angle = calibration.flex.angle(inputs.flex);
        if inputs.flex.is_measured()
            && self.stuck.update(inputs.flex.0, pressure.valid())
            && angle.is_ok()
        {
            angle = Err(SensorFault::Stuck);
        }
        Readings {
            pressure,
            angle: self.angle.update(angle),
        }
    }

    /// Whether both sensors have rested for a second.
    pub fn at_rest(&self) -> bool {
        self.pressure.standstill.level(PRESSURE_REST_PA).is_some()
            && self.angle.standstill.level(ANGLE_REST_RAD).is_some()
    }

    /// Makes the present readings of both sensors zero, until a reset. The caller ensures
    /// that the valve is open.
    ///
    /// # Errors
    ///
    /// The tare is unchanged then.
    ///
    /// - [`Refusal::NoReading`]: a sensor is at fault.
    /// - [`Refusal::NotAtRest`]: a reading moved within the last second.
    /// - [`Refusal::OutOfBounds`]: the readings are farther from the
    ///   calibrated zero than [`LARGEST_PRESSURE_TARE_PA`] or
    ///   [`LARGEST_ANGLE_TARE_RAD`].
    pub fn tare(&mut self) -> Result<(), Refusal> {
        let pressure = self
            .pressure
            .new_tare(PRESSURE_REST_PA, LARGEST_PRESSURE_TARE_PA)?;
        let angle = self
            .angle
            .new_tare(ANGLE_REST_RAD, LARGEST_ANGLE_TARE_RAD)?;
        self.pressure.tare = pressure;
        self.angle.tare = angle;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn calibration() -> Calibration {
        Calibration {
            pressure: Pressure::new(100.0, 0.625),
            // 4 counts a degree.
            flex: Flex::new(2, |index| {
                [(700.0, 0.0), (300.0, 100.0)][usize::from(index)]
            })
            .unwrap(),
        }
    }

    /// A rig at a pressure (kPa) and an angle (°), with some noise.
    fn inputs(kpa: f32, degrees: f32, n: u32) -> Inputs {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let sum = |counts: f32, n: u32| Oversampled((counts * 16.0) as u16 + (n % 5) as u16);
        Inputs {
            pressure: sum(100.0 + kpa / 0.625, n),
            flex: sum(700.0 - 4.0 * degrees, n / 2),
            ..Inputs::default()
        }
    }

    #[test]
    fn readings_are_in_si_units_and_the_plain_ones_are_not_late() {
        let mut sensors = Sensors::new();
        let mut readings = Readings::default();
        for n in 0..100 {
            readings = sensors.update(&calibration(), &inputs(0.0, 0.0, n));
        }
        assert!(readings.pressure.valid().unwrap().abs() < 200.0);
        let after = sensors.update(&calibration(), &inputs(50.0, 60.0, 0));
        assert!((after.pressure.value - 50_000.0).abs() < 50.0);
        assert!((after.angle.value.to_degrees() - 60.0).abs() < 0.1);
        assert!(after.angle.filtered < 0.3 * after.angle.value);
    }

    #[test]
    fn the_first_reading_needs_no_settling() {
        let mut sensors = Sensors::new();
        let first = sensors.update(&calibration(), &inputs(50.0, 60.0, 0));
        for reading in [first.pressure, first.angle] {
            assert_eq!(reading.value.to_bits(), reading.filtered.to_bits());
        }
    }

    #[test]
    fn tare_moves_zero_and_nothing_else() {
        let mut sensors = Sensors::new();
        assert_eq!(sensors.tare(), Err(Refusal::NoReading));
        for n in 0..99 {
            sensors.update(&calibration(), &inputs(3.0, -8.0, n));
            assert_eq!(sensors.tare(), Err(Refusal::NotAtRest));
        }
        sensors.update(&calibration(), &inputs(3.0, -8.0, 99));
        assert!(sensors.at_rest());
        assert_eq!(sensors.tare(), Ok(()));
        let zero = sensors.update(&calibration(), &inputs(3.0, -8.0, 100));
        // A fifth of the noise at most, its mean being zero now.
        assert!(zero.pressure.filtered.abs() < 80.0 && zero.angle.filtered.abs() < 0.001);
        // And a second tare at the same place gives the same zero.
        let before = sensors;
        assert_eq!(sensors.tare(), Ok(()));
        assert_eq!(sensors, before);
        let later = sensors.update(&calibration(), &inputs(53.0, 52.0, 102));
        assert!((later.pressure.value - 50_000.0).abs() < 100.0);
        assert!((later.angle.value.to_degrees() - 60.0).abs() < 0.1);
    }

    #[test]
    fn an_implausible_tare_is_refused() {
        for (kpa, degrees) in [(6.0, 0.0), (0.0, 35.0), (60.0, 50.0)] {
            let mut sensors = Sensors::new();
            for n in 0..200 {
                sensors.update(&calibration(), &inputs(kpa, degrees, n));
            }
            let before = sensors;
            assert_eq!(sensors.tare(), Err(Refusal::OutOfBounds));
            assert_eq!(sensors, before);
        }
    }

    #[test]
    fn motion_and_faults_end_rest() {
        let mut sensors = Sensors::new();
        for n in 0..200 {
            sensors.update(&calibration(), &inputs(0.0, 0.0, n));
        }
        assert!(sensors.at_rest());
        for n in 0..5 {
            sensors.update(&calibration(), &inputs(0.0, 15.0, n));
        }
        assert_eq!(sensors.tare(), Err(Refusal::NotAtRest));
        for _ in 0..5 {
            let mut broken = inputs(0.0, 0.0, 0);
            broken.flex = Oversampled(3);
            sensors.update(&calibration(), &broken);
        }
        assert_eq!(sensors.tare(), Err(Refusal::NoReading));
    }

    #[test]
    fn a_broken_wire_holds_the_last_reading_and_is_told_after_50_ms() {
        let mut sensors = Sensors::new();
        sensors.update(&calibration(), &inputs(0.0, 30.0, 0));
        let mut broken = inputs(0.0, 0.0, 0);
        broken.flex = Oversampled(16_368);
        for sample in 1..10 {
            let reading = sensors.update(&calibration(), &broken).angle;
            assert!((reading.value.to_degrees() - 30.0).abs() < 0.1);
            assert_eq!(reading.fault.is_some(), sample >= 5, "{sample}");
        }
        for _ in 0..5 {
            broken = inputs(0.0, 80.0, 0);
            sensors.update(&calibration(), &broken);
        }
        let back = sensors.update(&calibration(), &broken).angle;
        assert_eq!(back.fault, None);
        assert!((back.filtered.to_degrees() - 80.0).abs() < 0.1, "no ramp");
    }

    /// What lacks conversions is no reading, and a single one of it no fault.
    #[test]
    fn an_incomplete_period_carries_the_last_reading_on() {
        let mut sensors = Sensors::new();
        sensors.update(&calibration(), &inputs(10.0, 30.0, 0));
        let lost = Inputs {
            pressure: Oversampled::NOT_MEASURED,
            flex: Oversampled::NOT_MEASURED,
            ..Inputs::default()
        };
        let readings = sensors.update(&calibration(), &lost);
        assert!((readings.pressure.value - 10_000.0).abs() < 100.0);
        assert!((readings.angle.value.to_degrees() - 30.0).abs() < 0.1);
        assert!(!readings.pressure.fresh && readings.pressure.fault.is_none());
        for _ in 0..10 {
            sensors.update(&calibration(), &lost);
        }
        let readings = sensors.update(&calibration(), &lost);
        assert_eq!(readings.pressure.fault, Some(SensorFault::NotMeasured));
    }

    #[test]
    fn a_frozen_flex_sensor_is_found_once_the_pressure_moves() {
        let mut sensors = Sensors::new();
        let frozen = |kpa: f32, n: u32| Inputs {
            flex: Oversampled(10_000),
            ..inputs(kpa, 0.0, n)
        };
        for n in 0..1_000 {
            let readings = sensors.update(&calibration(), &frozen(0.0, n));
            assert_eq!(readings.angle.fault, None);
        }
        let mut samples = 0;
        while sensors
            .update(&calibration(), &frozen(40.0, samples))
            .angle
            .fault
            != Some(SensorFault::Stuck)
        {
            samples += 1;
            assert!(samples < 120);
        }
        assert!(samples >= 100);
    }
}
