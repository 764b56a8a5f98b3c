//! How large what is hidden is drawn, in every set.
//!
//! An effect that cannot be seen cannot be named, so its size is set by what it
//! does: it begins as it is seen in real actuators, and is moved until what a
//! refitted base model leaves, together with what is there without the effect, is
//! a drawn multiple of the latter between 1.5 and 8. Where an effect cannot reach
//! that within the largest size that is taken for real, the actuator is drawn
//! again. Of a pair each partner has to matter beside the other: without it, the
//! rest refitted, the misfit has to be 1.3 times what is there without both.

use std::ops::{Range, RangeInclusive};

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::law::{Effect, Law};
use super::world::Base;

/// The misfit of the refitted base model with the floor, over the floor.
const VISIBLE: RangeInclusive<f64> = 1.5..=8.0;
/// … for two effects together.
const VISIBLE_PAIR: RangeInclusive<f64> = 1.5..=12.0;
/// What leaving out one of a pair has to leave, likewise.
const PARTNER: RangeInclusive<f64> = 1.3..=f64::INFINITY;
/// Largest angle (rad) of an actuator.
pub(super) const REACH: f64 = 0.8;
/// … and no more than this, on any rig.
const MOST_REACH: f64 = 2.7;
/// Correlation time of coloured forces (s).
pub(super) const CORRELATION: Range<f64> = 0.3..5.0;

/// What sizes of effects are drawn in proportion to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    /// Elastic force at 90° (N), or what drives a rig without any.
    pub(super) force: f64,
    /// Pressure at 90° (Pa), or the largest.
    pub(super) pressure: f64,
    /// C (N·s/rad).
    pub(super) damping: f64,
    /// Elastic force at 60° (N), or what drives a rig without any.
    pub(super) reference: f64,
}

impl Scale {
    /// K (π/2)ⁿ and K (π/3)ⁿ of an actuator, and the pressure (Pa) at 90°.
    pub(super) fn of(base: &Base, pressure: f64) -> Self {
        Self {
            force: base.stiffness * std::f64::consts::FRAC_PI_2.powf(base.exponent),
            pressure,
            damping: base.damping,
            reference: base.stiffness * 60f64.to_radians().powf(base.exponent),
        }
    }
}

/// An effect of a typical size for an actuator.
pub fn typical_effect(law: Law, base: &Base, seed: u64) -> Effect {
    let pressure = base.holding_pressure(std::f64::consts::FRAC_PI_2);
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    typical(law, &Scale::of(base, pressure), &mut random)
}

/// Nominal parameters: damping, stiffness and input gain are off by 10 to 30 %.
pub(super) fn off(base: &Base, random: &mut Pcg64Mcg) -> Base {
    let mut off = |value: f64| {
        let by: f64 = random.random_range(0.1..0.3);
        value
            * if random.random_bool(0.5) {
                1.0 + by
            } else {
                1.0 - by
            }
    };
    Base {
        damping: off(base.damping),
        stiffness: off(base.stiffness),
        input_gain: off(base.input_gain),
        ..*base
    }
}

/// How many times the floor one of so many effects shall leave.
pub(super) fn wanted(effects: usize, random: &mut Pcg64Mcg) -> f64 {
    if effects == 1 {
        logarithmic(random, 1.7, 6.5)
    } else {
        logarithmic(random, 2.0, 5.0)
    }
}

/// √(misfit² + floor²)/floor; infinite where the refit failed, so that the
/// actuator is drawn again.
pub(super) fn over_floor(misfit: f64, floor: f64) -> f64 {
    if misfit.is_finite() && floor.is_finite() {
        misfit.hypot(floor) / floor
    } else {
        f64::INFINITY
    }
}

/// The effect in the size whose misfit with the floor is `wanted` times the floor,
/// as nearly as `most` allows, the factor by which it may be enlarged.
pub(super) fn sized(
    effect: Effect,
    most: f64,
    wanted: f64,
    floor: f64,
    misfit: impl Fn(Effect) -> f64,
) -> Effect {
    let aim = floor * (wanted * wanted - 1.0).sqrt();
    let mut factor = 1.0;
    for _ in 0..6 {
        let misfit = misfit(effect.scaled(factor));
        if (0.8..1.25).contains(&(misfit / aim)) {
            break;
        }
        let by = if misfit.is_finite() {
            aim / misfit
        } else {
            0.3
        };
        let next = (factor * by.clamp(0.2, 4.0)).min(most);
        if (next / factor - 1.0).abs() < 0.02 {
            break;
        }
        factor = next;
    }
    effect.scaled(factor)
}

/// How much of what is hidden shows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shows {
    /// Misfit of the refitted base model with the floor, over the floor.
    pub(super) ratio: f64,
    /// Of several effects: the least that leaving out one leaves, likewise.
    pub(super) partner: f64,
    /// Largest angle (rad).
    pub(super) reach: f64,
}

impl Shows {
    /// Nothing is hidden, and everything is as it should be.
    pub(super) const NOTHING: Self = Self {
        ratio: 1.0,
        partner: f64::INFINITY,
        reach: 1.5,
    };

    /// The partner's figure, where there are several effects.
    pub(super) fn known_partner(&self) -> Option<f64> {
        self.partner.is_finite().then_some(self.partner)
    }

    /// How far it is from what is asked for of so many effects whose size was
    /// searched, on a rig that has to reach `least` (rad); zero if it is that.
    pub(super) fn miss(&self, effects: usize, least: f64) -> f64 {
        let outside = |value: f64, range: &RangeInclusive<f64>| {
            if value < *range.start() {
                (range.start() / value).ln()
            } else {
                (value / range.end()).ln().max(0.0)
            }
        };
        let visible = match effects {
            0 => 0.0,
            1 => outside(self.ratio, &VISIBLE),
            _ => outside(self.ratio, &VISIBLE_PAIR) + outside(self.partner, &PARTNER),
        };
        visible + 10.0 * outside(self.reach, &(least..=MOST_REACH))
    }
}

/// Largest angle (rad) of readings; infinite if a world left all bounds.
pub(super) fn reach<'a>(readings: impl IntoIterator<Item = &'a Vec<f64>>) -> f64 {
    let angles = readings.into_iter().flatten();
    angles.fold(0.0, |reach: f64, angle| {
        if angle.is_finite() {
            reach.max(angle.abs())
        } else {
            f64::INFINITY
        }
    })
}

/// The first of so many draws that misses nothing, or the one that misses least;
/// with what it misses.
pub(super) fn best_of<D>(attempts: u32, mut draw: impl FnMut() -> (f64, D)) -> (f64, D) {
    let mut best = draw();
    for _ in 1..attempts {
        if best.0 <= 0.0 {
            break;
        }
        let next = draw();
        if next.0 < best.0 {
            best = next;
        }
    }
    best
}

pub(super) fn logarithmic(random: &mut Pcg64Mcg, low: f64, high: f64) -> f64 {
    random.random_range(low.ln()..high.ln()).exp()
}

/// Numbers of a law in a size that is seen in real actuators, before the
/// size is moved to where it matters.
// One arm for each law or for those that differ in their equation only.
#[allow(clippy::too_many_lines, clippy::match_same_arms)]
pub(super) fn typical(law: Law, scale: &Scale, random: &mut Pcg64Mcg) -> Effect {
    let Scale {
        force,
        pressure,
        damping,
        reference,
    } = *scale;
    let per_rad = force / 1.57;
    // Drawn for every law that all sets hide, also for one without a sign: a law
    // that got one would change the cases of the others.
    let positive = Law::OF_BENCHES.contains(&law) || random.random_bool(0.5);
    let sign = if positive { 1.0 } else { -1.0 };
    let mut within = |low: f64, high: f64| random.random_range(low..high);
    let values = match law {
        Law::CoulombTanh | Law::CoulombRoot => [0.06 * force, within(0.01, 0.03), 0.0, 0.0],
        Law::CoulombLugre => [0.06 * force, within(0.005, 0.012), 0.0, 0.0],
        Law::StribeckGauss | Law::StribeckExponential => [
            0.04 * force,
            0.04 * force * within(0.7, 1.8),
            within(0.1, 0.35),
            within(0.01, 0.03),
        ],
        Law::StribeckLugre => [
            0.04 * force,
            0.04 * force * within(0.7, 1.8),
            within(0.1, 0.35),
            within(0.006, 0.012),
        ],
        Law::QuadraticDrag | Law::QuadraticBlasius => [0.3 * damping, 0.0, 0.0, 0.0],
        Law::AngleDamping | Law::AngleDampingSquare => {
            [if sign > 0.0 { 1.0 } else { -0.3 }, 0.0, 0.0, 0.0]
        }
        Law::AsymmetricDamping => [if sign > 0.0 { 1.0 } else { -0.4 }, 0.0, 0.0, 0.0],
        Law::AsymmetricSmooth => [
            if sign > 0.0 { 1.0 } else { -0.4 },
            within(0.05, 0.2),
            0.0,
            0.0,
        ],
        Law::MaxwellOne => [0.15 * per_rad, within(0.8, 6.0), 0.0, 0.0],
        Law::MaxwellTwo => [
            0.1 * per_rad,
            within(0.5, 1.5),
            0.1 * per_rad,
            within(4.0, 9.0),
        ],
        Law::MaxwellPower => [0.06 * per_rad, within(1.0, 3.0), 0.0, 0.0],
        Law::BoucWen | Law::HysteresisDahl | Law::HysteresisStops => {
            [0.1 * force, within(0.1, 0.4), 0.0, 0.0]
        }
        Law::Gravity | Law::GravityArc => [sign * 0.2 * force, within(-0.6, 0.6), 0.0, 0.0],
        Law::ExponentShift => [sign * 0.2, 0.0, 0.0, 0.0],
        Law::Cubic => [sign * 0.1 * force / 3.9, 0.0, 0.0, 0.0],
        Law::CubicSinh => [0.3 * per_rad, within(1.2, 2.0), 0.0, 0.0],
        Law::LinearStiffness => [0.15 * per_rad, 0.0, 0.0, 0.0],
        Law::LinearSoftening => [0.15 * per_rad, within(1.2, 3.0), 0.0, 0.0],
        Law::EndStop | Law::EndStopProgressive => [3.0 * per_rad, within(1.05, 1.4), 0.0, 0.0],
        Law::StiffnessDrift => [sign * 0.015, 0.0, 0.0, 0.0],
        Law::StiffnessDriftLog => [sign * 0.03, within(2.0, 8.0), 0.0, 0.0],
        Law::Mullins | Law::MullinsSquare => [0.2, within(0.3, 1.0), 0.0, 0.0],
        Law::SecondMode | Law::SecondModePair => [within(2.5, 9.0), within(0.02, 0.08), 0.1, 0.0],
        Law::Lag | Law::LagDistributed => [0.15, 0.0, 0.0, 0.0],
        Law::LagSecondOrder => [0.15, within(0.6, 1.2), 0.0, 0.0],
        Law::DeadTime | Law::DeadTimeDispersed => [0.1, 0.0, 0.0, 0.0],
        Law::VentAsymmetry | Law::VentOrifice => [within(0.03, 0.1), 0.3, 0.0, 0.0],
        Law::Threshold => [0.08 * pressure, 0.0, 0.0, 0.0],
        Law::ThresholdSmooth => [0.08 * pressure, 0.02 * pressure, 0.0, 0.0],
        Law::PressureStiffening => [0.3 / pressure, 0.0, 0.0, 0.0],
        Law::PressureStiffeningSaturating => {
            [0.4 / pressure, pressure * within(0.8, 2.0), 0.0, 0.0]
        }
        Law::Backlash | Law::BacklashPlays => [0.04 * pressure, 0.0, 0.0, 0.0],
        Law::Leak | Law::LeakOrifice => [20.0, 0.0, 0.0, 0.0],
        Law::SensorLag => [0.1, 0.0, 0.0, 0.0],
        Law::SensorLagSecondOrder => [0.1, within(0.6, 1.2), 0.0, 0.0],
        Law::SensorOffset => [sign * 0.03, 0.0, 0.0, 0.0],
        Law::SensorNonlinearity => [sign * 0.06, 0.0, 0.0, 0.0],
        Law::SensorNonlinearitySaturating => [sign * 0.08, within(0.2, 0.6), 0.0, 0.0],
        Law::SensorDrift => [sign * 0.005, 0.0, 0.0, 0.0],
        Law::SensorDriftSettling => [sign * 0.01, within(4.0, 12.0), 0.0, 0.0],
        Law::Periodic | Law::PeriodicTriangle | Law::PeriodicUnsynchronised => {
            [0.05 * force, within(0.7, 4.0), within(-3.0, 3.0), 0.0]
        }
        Law::TwoStepStiffness => [0.2, within(0.8, 1.1), within(0.3, 0.6), 0.0],
        Law::ReliefValve => [0.9 * pressure, 0.0, 0.0, 0.0],
        Law::PressureDependentDelay => [0.2, pressure * within(0.2, 0.5), 0.0, 0.0],
        Law::Torsion => [sign * 0.05 * per_rad, within(5.0, 9.0), 0.0, 0.0],
        Law::PeriodicStiffness => [sign * 0.03 * force, within(0.3, 0.6), 0.0, 0.0],
        Law::StictionAgeing => [0.05 * force, within(1.5, 4.0), within(0.5, 2.0), 0.0],
        Law::WarmingDamping => [0.5, within(2.0, 8.0), 0.0, 0.0],
        Law::SnapThrough => [0.15 * force, within(0.6, 1.0), within(0.1, 0.25), 0.0],
        Law::AmplitudeLag => [0.15, 0.0, 0.0, 0.0],
        Law::SensorDeadZone => [0.03, within(0.5, 1.1), 0.0, 0.0],
        Law::RandomForce => [0.05 * force, within(0.0, 9.0), 0.0, 0.0],
        Law::BoucWenShape => [0.1 * force, within(0.1, 0.4), within(-0.4, 0.5), 0.0],
        Law::DwellStiction => [
            0.05 * force,
            0.05 * force * within(1.5, 4.0),
            within(0.3, 3.0),
            within(0.004, 0.012),
        ],
        Law::PulsatingStiffness => [0.2, within(0.2, 2.5), within(-3.0, 3.0), 0.0],
        Law::ColouredForce => [
            reference * within(0.1, 0.2),
            within(CORRELATION.start, CORRELATION.end),
            0.0,
            0.0,
        ],
    };
    Effect { law, values }
}

/// The largest factor by which an effect may be enlarged and still be of a
/// real actuator, and not change its nature (a damping that turns negative).
// Limits that happen to be equal have different reasons.
#[allow(clippy::match_same_arms)]
pub(super) fn largest(effect: &Effect) -> f64 {
    let [first, second, ..] = effect.values;
    let most = match effect.law {
        Law::AngleDamping | Law::AngleDampingSquare if first < 0.0 => 0.35,
        Law::AsymmetricDamping | Law::AsymmetricSmooth if first < 0.0 => 0.85,
        Law::AngleDamping
        | Law::AngleDampingSquare
        | Law::AsymmetricDamping
        | Law::AsymmetricSmooth => 6.0,
        Law::StiffnessDrift if first < 0.0 => 0.028,
        Law::StiffnessDriftLog if first < 0.0 => 0.6 / (second * (24.0 / second).ln_1p()),
        Law::Cubic if first < 0.0 => return 2.0,
        Law::ExponentShift | Law::Mullins | Law::MullinsSquare => 0.6,
        Law::WarmingDamping | Law::PulsatingStiffness => 0.9,
        Law::Lag | Law::LagSecondOrder | Law::LagDistributed => 0.6,
        Law::AmplitudeLag | Law::VentAsymmetry | Law::VentOrifice => {
            return if effect.law == Law::AmplitudeLag {
                5.0
            } else {
                4.0
            };
        }
        Law::DeadTime | Law::DeadTimeDispersed | Law::PressureDependentDelay => 0.5,
        Law::SensorLag | Law::SensorLagSecondOrder => 0.4,
        Law::PressureStiffening | Law::PressureStiffeningSaturating => return 6.0,
        Law::TwoStepStiffness => 2.0,
        _ => return 8.0,
    };
    most / first.abs()
}
