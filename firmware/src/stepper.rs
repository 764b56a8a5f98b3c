//! From a rate of the pump to intervals between step pulses.
//!
//! A stepper motor that is to jump to a rate stalls and hums. So the rate ramps, in
//! [`SLOTS`] small changes per control period, and a change of direction passes through a
//! standstill. All of it is computed here, in floating point, once per period; the
//! interrupts only count down the intervals.

use crate::design::{CPU_HZ, PERIOD_S};

/// Changes of the rate in a control period.
pub const SLOTS: usize = 8;

/// How long a pulse is high (cycles of the pulse timer): 25 µs, ten times what
/// the slowest common driver asks for.
pub const HIGH_CYCLES: u16 = 400;

/// The shortest time between pulses (cycles): what the interrupts need.
pub const SHORTEST_GAP: u32 = 400;

/// The fastest rate (microsteps/s).
#[allow(clippy::cast_precision_loss)] // 800.
pub const FASTEST: f32 = CPU_HZ as f32 / (HIGH_CYCLES as f32 + SHORTEST_GAP as f32);

/// The slowest rate that is not a standstill (microsteps/s).
pub const SLOWEST: f32 = 0.5;

/// The pulse timer's work in the next control period.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    /// The pulses push the plunger in.
    pub compress: bool,
    /// Cycles between pulses in each slot; zero is a standstill.
    pub gaps: [u32; SLOTS],
}

/// Follows the pump's rate with a limited acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Planner {
    /// Rate at the end of the period that was planned last (microsteps/s).
    rate: f32,
}

impl Planner {
    /// Creates a planner for a motor that stands still.
    pub const fn new() -> Self {
        Self { rate: 0.0 }
    }

    /// The rate at the end of what is planned (microsteps/s).
    pub const fn rate(&self) -> f32 {
        self.rate
    }

    /// The motor was stopped without a ramp.
    pub fn halt(&mut self) {
        self.rate = 0.0;
    }

    /// Plans a period towards `target` (microsteps/s, positive compresses) with
    /// at most `acceleration` (microsteps/s²).
    ///
    /// A target of NaN is a standstill.
    pub fn plan(&mut self, target: f32, acceleration: f32) -> Plan {
        let from = self.rate;
        // Reversing means to stop first; the next period goes on from there.
        // Written so that not-a-number is a standstill too.
        let goal = if target * from >= 0.0 {
            bounded(target, -FASTEST, FASTEST)
        } else {
            0.0
        };
        let goal = if goal.abs() < SLOWEST { 0.0 } else { goal };
        let change = if acceleration > 0.0 {
            acceleration * PERIOD_S
        } else {
            0.0
        };
        let to = bounded(goal, from - change, from + change);
        self.rate = to;

        let compress = from + to > 0.0;
        let mut gaps = [gap(to); SLOTS];
        #[allow(clippy::float_cmp)] // A copy of the same number.
        if to != from {
            // Each slot has the rate of its middle.
            let step = (to - from) / SLOTS as f32;
            let mut rate = from + 0.5 * step;
            for gap_of_slot in &mut gaps {
                *gap_of_slot = gap(rate);
                rate += step;
            }
            // The last slot of a stop has no pulses: when the next period
            // begins, perhaps in the other direction, the last one is over.
            if to == 0.0
                && let Some(last) = gaps.last_mut()
            {
                *last = 0;
            }
        }
        Plan { compress, gaps }
    }
}

/// `value` between two bounds that are numbers; `f32::clamp` can panic.
fn bounded(value: f32, lower: f32, upper: f32) -> f32 {
    value.max(lower).min(upper)
}

/// Cycles between two pulses at a rate.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // Saturates.
fn gap(rate: f32) -> u32 {
    let rate = rate.abs();
    if rate < SLOWEST {
        return 0;
    }
    let between_pulses = (CPU_HZ as f32 / rate) as u32;
    between_pulses
        .saturating_sub(u32::from(HIGH_CYCLES))
        .max(SHORTEST_GAP)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    const ACCELERATION: f32 = 114_000.0;

    /// The rates of the slots (microsteps/s, signed).
    fn rates(plan: &Plan) -> Vec<f64> {
        plan.gaps
            .iter()
            .map(|&gap| match gap {
                0 => 0.0,
                gap => {
                    let rate = 16e6 / f64::from(gap + u32::from(HIGH_CYCLES));
                    if plan.compress { rate } else { -rate }
                }
            })
            .collect()
    }

    #[test]
    fn a_ramp_has_the_asked_acceleration_and_ends_at_the_target() {
        let mut planner = Planner::new();
        let mut all = Vec::new();
        for _ in 0..20 {
            all.extend(rates(&planner.plan(14_000.0, ACCELERATION)));
        }
        let slot_s = f64::from(PERIOD_S) / SLOTS as f64;
        for pair in all.windows(2) {
            assert!(pair[1] >= pair[0] * 0.999, "{pair:?}");
            let change = pair[1] - pair[0];
            assert!(
                change <= f64::from(ACCELERATION) * slot_s * 1.05 + 1.0,
                "{pair:?}"
            );
        }
        assert!((all.last().unwrap() - 14_000.0).abs() < 14_000.0 * 2e-3);
        // As far as an ideal ramp goes, to a step a slot.
        let steps: f64 = all.iter().map(|rate| rate * slot_s).sum();
        let ramp_s = 14_000.0 / f64::from(ACCELERATION);
        let ideal = 14_000.0 * (20.0 * f64::from(PERIOD_S) - ramp_s / 2.0);
        assert!((steps - ideal).abs() < 20.0, "{steps} of {ideal}");
    }

    #[test]
    fn a_reversal_stands_still_between_the_directions() {
        let mut planner = Planner::new();
        for _ in 0..20 {
            planner.plan(5_000.0, ACCELERATION);
        }
        let mut plans = Vec::new();
        for _ in 0..20 {
            plans.push(planner.plan(-5_000.0, ACCELERATION));
        }
        for pair in plans.windows(2) {
            if pair[0].compress && !pair[1].compress {
                assert_eq!(pair[0].gaps[SLOTS - 1], 0);
            }
        }
        assert!(plans.first().unwrap().compress);
        assert!(!plans.last().unwrap().compress);
        assert!((planner.rate() + 5_000.0).abs() < 1e-3);
    }

    #[test]
    fn nonsense_stands_still_and_the_fastest_rate_is_kept() {
        for target in [f32::NAN, 0.0, 0.1, -0.1] {
            let mut planner = Planner::new();
            assert_eq!(planner.plan(target, ACCELERATION).gaps, [0; SLOTS]);
            assert_eq!(planner.rate().to_bits() << 1, 0);
        }
        let mut planner = Planner::new();
        for acceleration in [f32::NAN, -1.0, 0.0] {
            assert_eq!(planner.plan(1_000.0, acceleration).gaps, [0; SLOTS]);
        }
        for _ in 0..100 {
            let plan = planner.plan(1e9, ACCELERATION);
            assert!(plan.gaps.iter().all(|&gap| gap >= SHORTEST_GAP));
        }
        assert!((planner.rate() - FASTEST).abs() < 1e-3);
        const { assert!(FASTEST >= 16_000.0) };
        planner.plan(f32::NAN, ACCELERATION);
        assert!(planner.rate() < FASTEST);
    }

    #[test]
    fn a_steady_rate_is_steady() {
        let mut planner = Planner::new();
        for _ in 0..10 {
            planner.plan(3.0, 1e6);
        }
        let plan = planner.plan(3.0, 1e6);
        assert_eq!(plan.gaps, [16_000_000 / 3 - 400; SLOTS]);
        planner.halt();
        assert_eq!(planner.plan(0.0, 1e6).gaps, [0; SLOTS]);
    }
}
