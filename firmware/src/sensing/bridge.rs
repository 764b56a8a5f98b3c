//! A single bad sample is no broken wire.
//!
//! A motor that starts or a plug that is touched spoils a sample now and then.
//! A fault counts after [`SAMPLES`] bad samples in a row, and is gone after as
//! many good ones; until then the last good reading stands in.

use super::SensorFault;

/// Samples in a row that make or end a fault: 50 ms at the control rate. At the
/// fastest flow of the shipped settings 0.25 ml enter some 40 ml of air in that
/// time, and the pressure rises unseen by less than 2 kPa.
pub const SAMPLES: u8 = 5;

/// The memory of one sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bridge {
    good: Option<f32>,
    fault: Option<SensorFault>,
    /// Samples in a row that contradict what is believed.
    doubts: u8,
}

impl Bridge {
    /// Takes a sample; returns the value to go on with and the fault that counts.
    ///
    /// Before the first good sample there is nothing to go on with: a bad one
    /// is a fault at once, and the value is zero.
    pub fn update(&mut self, sample: Result<f32, SensorFault>) -> (f32, Option<SensorFault>) {
        let doubtful = sample.is_ok() == self.fault.is_some();
        self.doubts = if doubtful { self.doubts + 1 } else { 0 };
        let convinced = self.doubts >= SAMPLES || self.good.is_none();
        match sample {
            Ok(value) => {
                self.good = Some(value);
                if convinced {
                    self.fault = None;
                }
            }
            Err(fault) if convinced || self.fault.is_some() => self.fault = Some(fault),
            Err(_) => {}
        }
        if convinced {
            self.doubts = 0;
        }
        (self.good.unwrap_or(0.0), self.fault)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BAD: Result<f32, SensorFault> = Err(SensorFault::Low);

    #[test]
    fn up_to_four_bad_samples_are_bridged_and_the_fifth_counts() {
        let mut bridge = Bridge::default();
        assert_eq!(bridge.update(Ok(7.0)), (7.0, None));
        for _ in 0..3 {
            for _ in 0..4 {
                assert_eq!(bridge.update(BAD), (7.0, None));
            }
            assert_eq!(bridge.update(Ok(7.0)), (7.0, None));
        }
        for _ in 0..4 {
            bridge.update(BAD);
        }
        assert_eq!(bridge.update(BAD), (7.0, Some(SensorFault::Low)));
        // The last reason is the one that is told.
        let high = Err(SensorFault::High);
        assert_eq!(bridge.update(high), (7.0, Some(SensorFault::High)));
    }

    #[test]
    fn a_loose_contact_stays_a_fault() {
        let mut bridge = Bridge::default();
        bridge.update(Ok(7.0));
        for _ in 0..5 {
            bridge.update(BAD);
        }
        for _ in 0..10 {
            for _ in 0..4 {
                assert!(bridge.update(Ok(7.5)).1.is_some());
            }
            bridge.update(BAD);
        }
        for _ in 0..4 {
            bridge.update(Ok(8.0));
        }
        assert_eq!(bridge.update(Ok(8.0)), (8.0, None));
    }

    #[test]
    fn before_the_first_reading_there_is_nothing_to_bridge_with() {
        let mut bridge = Bridge::default();
        assert_eq!(bridge.update(BAD), (0.0, Some(SensorFault::Low)));
        assert_eq!(Bridge::default().update(Ok(1.0)), (1.0, None));
    }
}
