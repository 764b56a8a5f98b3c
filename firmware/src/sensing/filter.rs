//! The low-pass filter between the sensors and the loops.
//!
//! A loop with a derivative makes noise audible in the motor, so it gets a smoothed reading. The
//! readings that are recorded and compared with the prediction are *not* filtered.

/// Delay (s) at low frequencies.
pub const DELAY_S: f32 = 0.02;

/// A low-pass filter for samples at the control rate.
///
/// ```text
/// y₁ ← y₁ + (x − y₁)/2        y₂ ← y₂ + (y₁ − y₂)/2
/// ```
///
/// Two exponential stages are enough: they have no overshoot, no coefficients beyond a half, and
/// cost two multiplications. At 100 Hz: a delay of 20 ms (each stage one sample) for everything
/// slow, −3 dB at 7.3 Hz, and 43 % of the standard deviation of white noise.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LowPass {
    first: f32,
    second: f32,
}

impl LowPass {
    /// A filter that has seen nothing but `value`.
    pub fn settled(value: f32) -> Self {
        Self {
            first: value,
            second: value,
        }
    }

    /// Takes a sample and returns the smoothed one.
    pub fn update(&mut self, sample: f32) -> f32 {
        self.first += (sample - self.first) * 0.5;
        self.second += (self.first - self.second) * 0.5;
        self.second
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::design::PERIOD_S;
    use std::vec::Vec;

    #[test]
    fn a_ramp_comes_out_late_by_the_stated_delay() {
        let mut filter = LowPass::default();
        let mut gap = 0.0;
        for n in 0..100_u8 {
            let ramp = f32::from(n) * PERIOD_S;
            gap = ramp - filter.update(ramp);
        }
        assert!((gap - DELAY_S).abs() < 1e-6, "{gap}");
    }

    #[test]
    fn a_step_settles_without_overshoot() {
        let mut filter = LowPass::default();
        let mut before = 0.0;
        for _ in 0..30 {
            let now = filter.update(1.0);
            assert!(now >= before && now <= 1.0);
            before = now;
        }
        assert!(before > 0.999_9);
        assert!((LowPass::settled(3.0).update(3.0) - 3.0).abs() < f32::EPSILON);
    }

    #[test]
    fn the_corner_is_where_it_is_said_to_be() {
        let gain = |hertz: f64| {
            let mut filter = LowPass::default();
            let out: Vec<f64> = (0..2000)
                .map(|n| {
                    let phase = std::f64::consts::TAU * hertz * f64::from(n) * 0.01;
                    #[allow(clippy::cast_possible_truncation)]
                    f64::from(filter.update(phase.sin() as f32))
                })
                .skip(1000)
                .collect();
            (2.0 * out.iter().map(|y| y * y).sum::<f64>() / 1000.0).sqrt()
        };
        assert!((gain(7.3) - 0.5_f64.sqrt()).abs() < 0.01, "{}", gain(7.3));
        assert!(gain(1.0) > 0.98);
        assert!(gain(40.0) < 0.13);
    }

    #[test]
    fn noise_is_halved_and_more() {
        // The sum of squares of the impulse response.
        let mut filter = LowPass::default();
        let power: f32 = (0..50)
            .map(|n| filter.update(if n == 0 { 1.0 } else { 0.0 }))
            .map(|y| y * y)
            .sum();
        assert!((power.sqrt() - 0.43).abs() < 0.005, "{}", power.sqrt());
    }
}
