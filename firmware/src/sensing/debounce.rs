//! Debounces sensor faults: a single bad sample is no broken wire.
//!
//! A motor that starts or a plug that is touched spoils a sample now and then.
//! A fault counts after [`SAMPLES`] bad samples in a row, and is gone after as
//! many good ones; until then the last good reading stands in.

use super::SensorFault;

/// Samples in a row that make or end a fault: 50 ms at the control rate. At the
/// fastest flow of the shipped settings 0.25 ml enter some 40 ml of air in that
/// time, and the pressure rises unseen by less than 2 kPa.
pub const SAMPLES: u8 = 5;

/// The fault debounce of one sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FaultDebounce {
    good: Option<f32>,
    fault: Option<SensorFault>,
    /// Samples in a row that contradict the present state.
    contradictions: u8,
}

impl FaultDebounce {
    /// Takes a sample; returns the debounced value and fault.
    ///
    /// Before the first good sample there is no value to hold: a bad sample is a
    /// fault at once, and the value is zero.
    pub fn update(&mut self, sample: Result<f32, SensorFault>) -> (f32, Option<SensorFault>) {
        let contradicts = sample.is_ok() == self.fault.is_some();
        self.contradictions = if contradicts {
            self.contradictions + 1
        } else {
            0
        };
        let decided = self.contradictions >= SAMPLES || self.good.is_none();
        match sample {
            Ok(value) => {
                self.good = Some(value);
                if decided {
                    self.fault = None;
                }
            }
            Err(fault) if decided || self.fault.is_some() => self.fault = Some(fault),
            Err(_) => {}
        }
        if decided {
            self.contradictions = 0;
        }
        (self.good.unwrap_or(0.0), self.fault)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BAD: Result<f32, SensorFault> = Err(SensorFault::Low);

    #[test]
    fn up_to_four_bad_samples_are_skipped_and_the_fifth_counts() {
        let mut debounce = FaultDebounce::default();
        assert_eq!(debounce.update(Ok(7.0)), (7.0, None));
        for _ in 0..3 {
            for _ in 0..4 {
                assert_eq!(debounce.update(BAD), (7.0, None));
            }
            assert_eq!(debounce.update(Ok(7.0)), (7.0, None));
        }
        for _ in 0..4 {
            debounce.update(BAD);
        }
        assert_eq!(debounce.update(BAD), (7.0, Some(SensorFault::Low)));
        // The last reason is the one that is told.
        let high = Err(SensorFault::High);
        assert_eq!(debounce.update(high), (7.0, Some(SensorFault::High)));
    }

    #[test]
    fn a_loose_contact_stays_a_fault() {
        let mut debounce = FaultDebounce::default();
        debounce.update(Ok(7.0));
        for _ in 0..5 {
            debounce.update(BAD);
        }
        for _ in 0..10 {
            for _ in 0..4 {
                assert!(debounce.update(Ok(7.5)).1.is_some());
            }
            debounce.update(BAD);
        }
        for _ in 0..4 {
            debounce.update(Ok(8.0));
        }
        assert_eq!(debounce.update(Ok(8.0)), (8.0, None));
    }

    #[test]
    fn before_the_first_reading_there_is_no_value_to_hold() {
        let mut debounce = FaultDebounce::default();
        assert_eq!(debounce.update(BAD), (0.0, Some(SensorFault::Low)));
        assert_eq!(FaultDebounce::default().update(Ok(1.0)), (1.0, None));
    }
}
