// SPDX-License-Identifier: GPL-3.0-or-later
//! Small errors of a bench without any fault.
//!
//! Real sensors have zero errors, and nobody waits until silicone is straight again. A
//! diagnosis that was tested on ideal benches only could take such errors for an effect
//! of the actuator, so a drawn actuator gets a drawn bench.

use std::fmt;

use model_core::actuator::Model;
use rand::{Rng, RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

use crate::plant::{LetGo, PASCAL_PER_KPA, PlantConfig, gas::Gas, sensors::PressureSensor};

/// Standard deviation and limit of the pressure's zero (kPa).
///
/// An 80 psi sensor of 0.15 % of its span.
const PRESSURE_ZERO_KPA: (f64, f64) = (0.3, 0.8);
/// Standard deviation and limit of the angle's zero (°).
///
/// A strip that is glued on by hand.
const ANGLE_ZERO_DEG: (f64, f64) = (0.7, 2.0);
/// Angles (°) at which the actuator may have been let go before power-on.
///
/// The last of a creep back to straight.
const LET_GO_DEG: std::ops::Range<f64> = 0.3..2.0;
/// How long (s) before power-on that may have been.
const LET_GO_S: std::ops::Range<f64> = 0.5..3.0;

/// Volume of tube and actuator (m³).
const DEAD_M3: std::ops::Range<f64> = 3e-6..15e-6;
/// The weather at sea level (Pa).
const ATMOSPHERE_PA: std::ops::Range<f64> = 98e3..104e3;
/// Time constants (s) of the leak, evenly in their logarithm, of the cooling and of the tube.
const LEAK_S: std::ops::Range<f64> = 2_500.0..20_000.0;
const COOLS_S: std::ops::Range<f64> = 0.3..2.0;
const TUBE_S: std::ops::Range<f64> = 0.01..0.1;
/// What an actuator swells by (m³/Pa): up to 2 ml at 100 kPa.
const SWELLS_M3_PER_PA: std::ops::Range<f64> = 0.0..2e-11;

/// Draws what a healthy rig's air may be. The same seed gives the same.
pub fn draw_gas(seed: u64) -> Gas {
    let mut random = Pcg64Mcg::seed_from_u64(seed.wrapping_add(AIR));
    let leak = random.random_range(LEAK_S.start.ln()..LEAK_S.end.ln());
    Gas {
        dead_volume_m3: random.random_range(DEAD_M3),
        atmosphere_pa: random.random_range(ATMOSPHERE_PA),
        leak_s: leak.exp(),
        cools_s: random.random_range(COOLS_S),
        tube_s: random.random_range(TUBE_S),
        swells_m3_per_pa: random.random_range(SWELLS_M3_PER_PA),
        ..Gas::default()
    }
}

/// The letters of "air", as [`STREAM`].
const AIR: u64 = 0x61_6972;

/// Added to a seed, so that the bench of a seed has random numbers of its own:
/// neither the actuator nor the noise of that seed changes when something is
/// drawn here. The letters of "bench".
const STREAM: u64 = 0x62_656e_6368;

/// The errors of a bench. The default is an ideal one.
///
/// They are constant while the rig has power, except that the actuator continues to creep back by
/// its own dynamics. Both zeros are normal, cut off at a limit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bench {
    /// The zero of the pressure sensor (kPa).
    pub pressure_zero_kpa: f64,
    /// The reading of the flex sensor when the actuator is straight (°).
    pub angle_zero_deg: f64,
    /// The angle (°) at which the actuator was let go before power-on.
    pub let_go_deg: f64,
    /// How long before power-on it was let go (s).
    pub let_go_s: f64,
}

impl Bench {
    /// Draws the errors of a bench. The same seed gives the same.
    pub fn draw(seed: u64) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(seed.wrapping_add(STREAM));
        Self {
            pressure_zero_kpa: within(PRESSURE_ZERO_KPA, &mut random),
            angle_zero_deg: within(ANGLE_ZERO_DEG, &mut random),
            let_go_deg: hundredths(random.random_range(LET_GO_DEG)),
            let_go_s: hundredths(random.random_range(LET_GO_S)),
        }
    }

    /// Gives a plant these errors, in place of those that it had.
    pub fn apply(&self, plant: &mut PlantConfig) {
        plant.pressure_sensor.offset_millivolts =
            self.pressure_zero_kpa * PASCAL_PER_KPA * PressureSensor::MILLIVOLTS_PER_PA;
        plant.flex_sensor.offset_rad = self.angle_zero_deg.to_radians();
        plant.let_go = LetGo {
            angle_rad: self.let_go_deg.to_radians(),
            before_s: self.let_go_s,
        };
    }

    /// The errors as comments of a model file, one a line, beside an actuator
    /// whose state at power-on they tell too.
    pub fn comments(&self, actuator: &Model<f64>) -> String {
        let mut plant = PlantConfig::new(*actuator);
        self.apply(&mut plant);
        let (angle, rate) = plant.let_go.at_power_on(actuator);
        format!(
            "\n# The bench: what its sensors show at zero, and how the actuator starts.\n{self}\
             # angle at power-on: {:+.2} deg\n# rate at power-on: {:+.3} deg/s\n",
            angle.to_degrees(),
            rate.to_degrees()
        )
    }
}

impl fmt::Display for Bench {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "# pressure zero: {:+.2} kPa", self.pressure_zero_kpa)?;
        writeln!(f, "# angle zero: {:+.2} deg", self.angle_zero_deg)?;
        writeln!(
            f,
            "# let go: {:+.2} deg, {:.2} s before power-on",
            self.let_go_deg, self.let_go_s
        )
    }
}

/// A normal number of a standard deviation, drawn again beyond a limit, as a
/// sensor beyond its data sheet would be sent back.
fn within((deviation, limit): (f64, f64), random: &mut impl Rng) -> f64 {
    loop {
        let normal: f64 = StandardNormal.sample(random);
        let drawn = hundredths(deviation * normal);
        if drawn.abs() <= limit {
            return drawn;
        }
    }
}

/// A file that tells two decimals then tells all of it.
fn hundredths(value: f64) -> f64 {
    (value * 100.0).round() / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn benches_are_spread_as_stated_and_never_beyond_their_limits() {
        let benches: Vec<Bench> = (0..2000).map(Bench::draw).collect();
        assert_eq!(benches[7], Bench::draw(7));
        let spread = |of: fn(&Bench) -> f64| {
            let squares: f64 = benches.iter().map(|bench| of(bench).powi(2)).sum();
            (squares / benches.len() as f64).sqrt()
        };
        // What a limit cuts off makes the spread a few percent smaller.
        assert!((spread(|bench| bench.pressure_zero_kpa) - 0.29).abs() < 0.02);
        assert!((spread(|bench| bench.angle_zero_deg) - 0.68).abs() < 0.04);
        for bench in &benches {
            assert!(bench.pressure_zero_kpa.abs() <= 0.8 && bench.angle_zero_deg.abs() <= 2.0);
            assert!((0.3..=2.0).contains(&bench.let_go_deg), "{bench:?}");
            assert!((0.5..=3.0).contains(&bench.let_go_s), "{bench:?}");
        }
    }

    #[test]
    fn an_ideal_bench_changes_nothing() {
        let actuator = crate::default_actuator();
        let ideal = PlantConfig::new(actuator);
        let mut plant = PlantConfig::new(actuator);
        Bench::draw(3).apply(&mut plant);
        assert_ne!(plant.pressure_sensor, ideal.pressure_sensor);
        assert_ne!(plant.flex_sensor, ideal.flex_sensor);
        Bench::default().apply(&mut plant);
        assert_eq!(plant.pressure_sensor, ideal.pressure_sensor);
        assert_eq!(plant.flex_sensor, ideal.flex_sensor);
        assert_eq!(plant.let_go, ideal.let_go);
    }

    #[test]
    fn a_zero_error_is_what_the_sensor_shows_at_zero() {
        let mut plant = PlantConfig::new(crate::default_actuator());
        let bench = Bench {
            pressure_zero_kpa: 0.31,
            angle_zero_deg: -0.9,
            ..Bench::default()
        };
        let healthy = plant.clone();
        bench.apply(&mut plant);
        let off = plant.pressure_sensor.voltage(20e3).millivolts;
        let right = healthy.pressure_sensor.voltage(20_310.0).millivolts;
        assert!((off - right).abs() < 1e-9);
        let off = plant.flex_sensor.voltage(0.5).millivolts;
        let right = healthy.flex_sensor.voltage(0.5 - 0.9f64.to_radians());
        assert!((off - right.millivolts).abs() < 1e-9);
    }
}
