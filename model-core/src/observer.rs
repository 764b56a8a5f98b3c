//! The recurrence by which a board predicts the angle while it measures.
//!
//! The board steps the model beside the rig and compares. A computer that reads
//! the log must be able to repeat that to the bit, so the recurrence is here,
//! once, for both. It sees nothing but what telemetry says:
//!
//! ```text
//! pₖ  pressure of line k, whole hundredths of a kPa;  Pa = 10 · hundredths
//! aₖ  angle of line k, whole hundredths of a degree;  rad = hundredths · π/18000
//! x₀  = at rest behind the reading a₀, under p₀
//! xₖ  = RK4 of length 0.01 s from xₖ₋₁, pressure linear from pₖ₋₁ to pₖ
//! mₖ  = reading of xₖ through the sensor's effects
//! ```
//!
//! A line whose pressure is missing counts as the pressure before it. All of it
//! is `f32` and basic operations, which every IEEE machine rounds alike.
//!
//! Runge–Kutta at 100 Hz costs a fifth of an ATmega2560; half the rate would
//! save a tenth, but then only every second line could be checked, and the fast
//! effects (friction near standstill) would lose their margin of stability.

use core::fmt;

use crate::actuator::{Model, State};
use crate::effects::Mechanism;
use crate::input::Input;
use crate::integrate::{Scheme, step};
use crate::power::{Minimax, Power};

/// Steps a second: one for each line of telemetry.
pub const RATE_HZ: f32 = 100.0;

/// Length of a step (s).
pub const STEP_S: f32 = 0.01;

/// The longest dead time (s) that the board's memory of pressures bridges.
pub const MAX_DELAY_S: f32 = 0.6;

/// Remembered pressures: the dead time, the two ends of the step.
const MEMORY: usize = 62;

/// Pressures are kept as hundredths of a kPa above this one, in 16 bits: from
/// −50 to 605 kPa, more than a sensor of 80 psi can show.
const LOWEST: i32 = -5_000;

/// Radians in a hundredth of a degree.
const RAD_PER_CENTIDEGREE: f32 = 1.745_329_3e-4;

/// The limits of stability of the Runge–Kutta method are 2.78 on the negative
/// real axis and 2.83 on the imaginary one; both with a margin.
const STABLE: f32 = 2.5;

/// Why a model cannot be stepped beside the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Unobservable {
    /// Its dead times exceed [`MAX_DELAY_S`].
    TooMuchDelay,
    /// It moves too fast for steps of [`STEP_S`], which would diverge.
    TooFast,
}

impl fmt::Display for Unobservable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TooMuchDelay => "has more dead time than the board's 0.6 s of memory",
            Self::TooFast => "moves too fast for the board's steps of 10 ms",
        })
    }
}

impl core::error::Error for Unobservable {}

/// A model that can be stepped at [`RATE_HZ`]: the configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observer<P = Minimax> {
    model: Model<f32, P>,
}

/// Where the prediction is: the state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    state: State<f32>,
    steps: u32,
    history: History,
}

/// Pressures of the past, and the line through the last two.
#[derive(Clone, Copy, Debug, PartialEq)]
struct History {
    samples: [u16; MEMORY],
    newest: u8,
    /// Pressure at the start of the step (Pa).
    start: f32,
    /// Its slope within the step (Pa/s).
    slope: f32,
}

/// The pressure (Pa) of a reading in hundredths of a kPa, as the observer sees
/// it: 10 Pa each, saturating at −50 and at 605.35 kPa.
pub fn pressure_pa(hundredths_kpa: i32) -> f32 {
    unpacked(packed(hundredths_kpa))
}

/// The angle (rad) of a reading in hundredths of a degree.
pub fn angle_rad(hundredths_deg: i32) -> f32 {
    hundredths_deg as f32 * RAD_PER_CENTIDEGREE
}

fn packed(hundredths_kpa: i32) -> u16 {
    let above = hundredths_kpa.saturating_sub(LOWEST);
    u16::try_from(above).unwrap_or(if above < 0 { 0 } else { u16::MAX })
}

fn unpacked(sample: u16) -> f32 {
    (i32::from(sample) + LOWEST) as f32 * 10.0
}

impl History {
    fn at_rest(sample: u16) -> Self {
        Self {
            samples: [sample; MEMORY],
            newest: 0,
            start: unpacked(sample),
            slope: 0.0,
        }
    }

    fn push(&mut self, sample: u16) {
        self.start = self.back(0);
        self.newest = if usize::from(self.newest) + 1 < MEMORY {
            self.newest + 1
        } else {
            0
        };
        if let Some(place) = self.samples.get_mut(usize::from(self.newest)) {
            *place = sample;
        }
        self.slope = (unpacked(sample) - self.start) * RATE_HZ;
    }

    /// The pressure (Pa) so many samples ago.
    fn back(&self, samples: usize) -> f32 {
        let newest = usize::from(self.newest);
        let back = samples.min(MEMORY - 1);
        let index = if newest >= back {
            newest - back
        } else {
            newest + MEMORY - back
        };
        self.samples
            .get(index)
            .map_or(0.0, |&sample| unpacked(sample))
    }
}

impl Input<f32> for History {
    fn pressure(&self, offset: f32) -> f32 {
        if offset >= 0.0 {
            return self.start + self.slope * offset;
        }
        // The newest sample is the pressure at the end of the step.
        let samples = (STEP_S - offset) * RATE_HZ;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // Saturates.
        let whole = samples as u8;
        let newer = self.back(usize::from(whole));
        let older = self.back(usize::from(whole) + 1);
        newer + (older - newer) * (samples - f32::from(whole))
    }
}

impl<P: Power<f32>> Observer<P> {
    /// Checks that a model can be stepped at this rate, for angles up to
    /// `farthest` (rad).
    ///
    /// # Errors
    ///
    /// [`Unobservable`].
    pub fn new(model: Model<f32, P>, farthest: f32) -> Result<Self, Unobservable> {
        let mut delay = 0.0;
        for effect in model.occupied() {
            delay += effect.delay();
        }
        if !(0.0..=MAX_DELAY_S).contains(&delay) {
            return Err(Unobservable::TooMuchDelay);
        }
        let rates = model.fastest_rate(farthest);
        let bound = STABLE * RATE_HZ;
        if rates.relaxation <= bound && rates.stiffness <= bound * bound {
            Ok(Self { model })
        } else {
            Err(Unobservable::TooFast)
        }
    }

    /// The model that is stepped.
    pub fn model(&self) -> &Model<f32, P> {
        &self.model
    }

    /// Starts at rest, from a line of telemetry: angle in hundredths of a
    /// degree, pressure in hundredths of a kPa.
    pub fn start(&self, hundredths_deg: i32, hundredths_kpa: i32) -> Estimate {
        let sample = packed(hundredths_kpa);
        let angle = self.model.angle_behind(angle_rad(hundredths_deg));
        Estimate {
            state: self.model.at_rest(angle, unpacked(sample)),
            steps: 0,
            history: History::at_rest(sample),
        }
    }

    /// Goes on to the next line, whose pressure is in hundredths of a kPa; none
    /// when its sensor had no reading.
    pub fn step(&self, estimate: &mut Estimate, hundredths_kpa: Option<i32>) {
        let history = &mut estimate.history;
        let sample = match hundredths_kpa {
            Some(hundredths) => packed(hundredths),
            None => history
                .samples
                .get(usize::from(history.newest))
                .copied()
                .unwrap_or(0),
        };
        history.push(sample);
        step(
            Scheme::Rk4,
            &self.model,
            &mut estimate.state,
            &estimate.history,
            STEP_S,
        );
        estimate.steps = estimate.steps.wrapping_add(1);
    }

    /// What the angle sensor should show (rad); not finite if the model
    /// diverged.
    pub fn prediction(&self, estimate: &Estimate) -> f32 {
        self.model.reading(&estimate.state)
    }
}

impl Estimate {
    /// Steps since the start.
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// Angle, rate and hidden states.
    pub fn state(&self) -> &State<f32> {
        &self.state
    }

    /// The newest pressure (Pa).
    pub fn pressure(&self) -> f32 {
        self.history.back(0)
    }
}

#[cfg(test)]
#[allow(clippy::cast_possible_truncation)]
mod tests {
    use super::*;
    use crate::actuator::Dynamics;
    use crate::catalogue::{Effect, Kind};
    use crate::input::FromFn;

    const DYNAMICS: Dynamics<f32> = Dynamics {
        inertia: 0.36,
        damping: 1.8,
        stiffness: 5.0,
        exponent: 2.365,
        input_gain: 1.45e-4,
    };

    fn observer(effects: &[Effect<f32>]) -> Observer {
        Observer::new(Model::new(DYNAMICS, effects).unwrap(), 2.3).unwrap()
    }

    /// Hundredths of a kPa: up to 40 kPa and down, with whole values at 100 Hz.
    fn pressure(k: i32) -> i32 {
        if k < 0 { 0 } else { 4_000.min(k * 20) }
    }

    #[test]
    fn follows_a_fine_simulation_of_the_same_pressure() {
        for delay in [None, Some(0.0), Some(0.137), Some(0.6)] {
            let effect = delay.map(|delay| Kind::DeadTime.build(&[delay]).unwrap());
            let effects: Vec<_> = effect.into_iter().collect();
            let observer = observer(&effects);
            let mut estimate = observer.start(0, 0);
            // In f64, with steps fifty times shorter, no delay but a shifted input.
            let fine: Model<f64> = Model::new(DYNAMICS.map(f64::from), &[]).unwrap();
            let mut state = fine.at_rest(0.0, 0.0);
            let shift = f64::from(delay.unwrap_or(0.0));
            for k in 0..600 {
                observer.step(&mut estimate, Some(pressure(k + 1)));
                for part in 0..50 {
                    let start = f64::from(k) + f64::from(part) / 50.0;
                    let input = FromFn(|offset: f64| {
                        let at = start + (offset - shift) * 100.0;
                        let (from, to) = (
                            f64::from(pressure(at.floor() as i32)),
                            f64::from(pressure(at.floor() as i32 + 1)),
                        );
                        10.0 * (from + (to - from) * (at - at.floor()))
                    });
                    step(Scheme::Rk4, &fine, &mut state, &input, 2e-4);
                }
                let gap = f64::from(observer.prediction(&estimate)) - state.angle;
                assert!(gap.abs() < 2e-4, "{delay:?} {k}: {gap}");
            }
            assert!(state.angle > 0.9, "{}", state.angle);
            assert_eq!(estimate.steps(), 600);
        }
    }

    #[test]
    fn starts_at_rest_behind_what_the_sensor_shows() {
        let offset = Kind::SensorOffset.build(&[0.05]).unwrap();
        let observer = observer(&[offset]);
        let estimate = observer.start(1_000, 250);
        assert!((observer.prediction(&estimate) - 10.0_f32.to_radians()).abs() < 1e-6);
        assert!((estimate.state().angle - 10.0_f32.to_radians()).abs() > 0.04);
        assert!((estimate.pressure() - 2_500.0).abs() < f32::EPSILON);
    }

    #[test]
    fn a_missing_pressure_is_the_one_before() {
        let observer = observer(&[]);
        let mut with = observer.start(0, 0);
        let mut without = with;
        for k in 0..50 {
            observer.step(&mut with, Some(if k < 20 { 1_000 } else { 3_000 }));
            observer.step(
                &mut without,
                if k == 7 {
                    None
                } else {
                    Some(if k < 20 { 1_000 } else { 3_000 })
                },
            );
        }
        assert_eq!(with, without);
    }

    #[test]
    fn readings_saturate_beyond_any_sensor() {
        assert!((pressure_pa(3_842) - 38_420.0).abs() < f32::EPSILON);
        assert!((pressure_pa(-1) + 10.0).abs() < f32::EPSILON);
        assert!((pressure_pa(i32::MAX) - 605_350.0).abs() < f32::EPSILON);
        assert!((pressure_pa(i32::MIN) + 50_000.0).abs() < f32::EPSILON);
        assert!((angle_rad(9_000) - core::f32::consts::FRAC_PI_2).abs() < 1e-6);
    }

    #[test]
    fn models_that_would_diverge_or_reach_too_far_back_are_refused() {
        let build = |dynamics, effects: &[Effect<f32>]| {
            Observer::<Minimax>::new(Model::new(dynamics, effects).unwrap(), 2.3).map(|_| ())
        };
        assert_eq!(build(DYNAMICS, &[]), Ok(()));
        let late = Kind::DeadTime.build(&[0.61]).unwrap();
        assert_eq!(build(DYNAMICS, &[late]), Err(Unobservable::TooMuchDelay));
        let stiff = Dynamics {
            damping: 100.0,
            ..DYNAMICS
        };
        assert_eq!(build(stiff, &[]), Err(Unobservable::TooFast));
    }
}
