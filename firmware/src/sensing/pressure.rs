//! From counts to gauge pressure.
//!
//! A ratiometric sensor is linear between 0.5 V and 4.5 V of 5 V:
//! `p = (counts − zero)·span`. Its zero drifts and is corrected by a tare; its span is
//! from the data sheet.

use super::{SensorFault, within_wires};
use crate::{design::OVERSAMPLING, io::Oversampled};

/// The calibration of the pressure sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pressure {
    /// Sum of conversions at gauge zero.
    zero: f32,
    /// Pressure (Pa) of one in the sum.
    span: f32,
}

impl Pressure {
    /// Creates the line from its zero (counts of ten bits) and its span
    /// (kPa/count).
    pub fn new(zero_counts: f32, span_kpa_per_count: f32) -> Self {
        let sums = f32::from(OVERSAMPLING);
        Self {
            zero: zero_counts * sums,
            span: span_kpa_per_count * (1_000.0 / sums),
        }
    }

    /// The gauge pressure (Pa) behind a reading.
    ///
    /// # Errors
    ///
    /// [`SensorFault::Low`] or [`SensorFault::High`] for a voltage that the
    /// sensor does not give.
    pub fn pressure(self, reading: Oversampled) -> Result<f32, SensorFault> {
        Ok(self.line(within_wires(reading)?))
    }

    fn line(self, sum: u16) -> f32 {
        (f32::from(sum) - self.zero) * self.span
    }

    /// The smallest gauge pressure (Pa) that is told from a broken wire.
    pub fn smallest(self) -> f32 {
        self.line(super::LOWEST_SUM)
    }

    /// The largest gauge pressure (Pa) that is told from a broken wire.
    pub fn largest(self) -> f32 {
        self.line(super::HIGHEST_SUM)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 0–80 psi on 0.5–4.5 V.
    #[test]
    fn the_data_sheets_points_come_out() {
        let sensor = Pressure::new(102.4, 0.673_316);
        for (volts, psi) in [(0.5, 0.0), (1.0, 10.0), (2.5, 40.0), (4.5, 80.0)] {
            let sum = (volts / 5.0 * 1024.0 * 16.0_f32).round();
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let pressure = sensor.pressure(Oversampled(sum as u16)).unwrap();
            // Half of one in the sum is 21 Pa.
            assert!(
                (pressure - psi * 6_894.757).abs() < 30.0,
                "{volts} V: {pressure}"
            );
        }
    }

    #[test]
    fn voltages_of_broken_wires_are_no_pressure() {
        let sensor = Pressure::new(102.4, 0.673_316);
        // 0.25 V is a sum of 819.2, 4.75 V one of 15 564.8.
        assert_eq!(sensor.pressure(Oversampled(819)), Err(SensorFault::Low));
        assert!(sensor.pressure(Oversampled(820)).is_ok());
        assert!(sensor.pressure(Oversampled(15_564)).is_ok());
        assert_eq!(sensor.pressure(Oversampled(15_565)), Err(SensorFault::High));
        assert_eq!(sensor.pressure(Oversampled(0)), Err(SensorFault::Low));
    }
}
