//! Detects a stuck sensor.
//!
//! A frozen converter or a sensor torn off its actuator gives a plausible voltage, but repeats it
//! *exactly* while the rig moves. The sum of sixteen conversions of a working sensor contains its
//! noise and that of the converter, and one count of the sum is 0.02° of a flex sensor.
//!
//! At rest a quiet sensor may repeat for seconds, so exact repetition alone is no fault. It counts
//! only while the pressure differs by [`MOTION_PA`] or more from its value when the reading last
//! changed, and only after [`SAMPLES`].

/// Change of the pressure (Pa) under which an actuator must have moved.
///
/// Below a pressure threshold of the actuator only noise distinguishes a working sensor from a
/// stuck one; this is above the thresholds of soft actuators, a few kPa.
pub const MOTION_PA: f32 = 20_000.0;

/// Samples of repetition under that change that are a fault: a second.
///
/// Tubes and actuators respond 0.1–0.6 s late.
pub const SAMPLES: u8 = 100;

/// The memory of one sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stuck {
    sum: u16,
    /// Pressure (Pa) when the sum was first seen; none while there is none.
    pressure: Option<f32>,
    repeats: u8,
}

impl Stuck {
    /// Takes a sum of conversions and the pressure (Pa), none while its sensor
    /// is at fault: then nothing can be told. Returns whether the sum is stuck.
    pub fn update(&mut self, sum: u16, pressure: Option<f32>) -> bool {
        match (self.pressure, pressure) {
            (Some(before), Some(now)) if sum == self.sum => {
                if (now - before).abs() > MOTION_PA && self.repeats < SAMPLES {
                    self.repeats += 1;
                }
            }
            _ => {
                *self = Self {
                    sum,
                    pressure,
                    repeats: 0,
                }
            }
        }
        self.repeats >= SAMPLES
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repetition_at_rest_is_no_fault_however_long() {
        let mut stuck = Stuck::default();
        for n in 0..100_000_u32 {
            // The pressure sensor is noisy all the while.
            let pressure = if n % 2 == 0 { 60_000.0 } else { 60_700.0 };
            assert!(!stuck.update(9_000, Some(pressure)));
        }
    }

    #[test]
    fn an_actuator_may_answer_late() {
        let mut stuck = Stuck::default();
        for _ in 0..1_000 {
            stuck.update(9_000, Some(0.0));
        }
        for _ in 0..90 {
            assert!(!stuck.update(9_000, Some(60_000.0)));
        }
        assert!(!stuck.update(8_999, Some(60_000.0)));
        for _ in 0..1_000 {
            assert!(!stuck.update(8_999, Some(60_000.0)), "it has answered");
        }
    }

    #[test]
    fn repetition_under_motion_is_a_fault_within_a_second_or_so() {
        let mut stuck = Stuck::default();
        stuck.update(9_000, Some(0.0));
        let mut samples = 0_u16;
        while !stuck.update(9_000, Some(f32::from(samples) * 1_000.0)) {
            samples += 1;
        }
        assert!((100..=125).contains(&samples), "{samples}");
        assert!(stuck.update(9_000, Some(20_000.0)), "it stays");
        assert!(!stuck.update(9_001, Some(60_000.0)), "until it moves");
    }

    #[test]
    fn without_a_pressure_nothing_is_told() {
        let mut stuck = Stuck::default();
        for n in 0..1_000_u16 {
            let pressure = (n % 50 != 0).then(|| f32::from(n) * 100.0);
            assert!(!stuck.update(9_000, pressure));
        }
    }
}
