//! The open-loop predictor of the board: the recurrence that predicts the angle.
//!
//! The board steps the model beside the rig and compares. A computer must be able to repeat that
//! bit by bit from the log, so both use this recurrence: its only inputs are the values of the
//! telemetry, and all operations are basic operations in `f32`, which every IEEE machine rounds
//! alike. [`crate::prepared`] steps a period; this module handles the lines, the memory of
//! pressures for a dead time, and the start.
//!
//! After the start the angle sensor never corrects it, so its error is that of the model.

use core::ops::RangeInclusive;

use crate::actuator::{Model, State};
use crate::effects::Mechanism;
use crate::power::Minimax;
use crate::prepared::{Motion, Plan, Prepared, Unsteppable, plan};

/// Steps a second: one for each line of telemetry.
pub const RATE_HZ: f32 = 100.0;

/// Length of a step (s).
pub const STEP_S: f32 = 0.01;

/// The longest dead time (s) that the board's memory of pressures bridges.
pub const MAX_DELAY_S: f32 = 0.6;

/// Remembered pressures: the dead time, the two ends of the step and a part of a sample.
const MEMORY: usize = 63;

/// Pressures are kept as hundredths of a kPa above this one, in 16 bits: from
/// −50 to 605 kPa, more than a sensor of 80 psi can show.
const LOWEST: i32 = -5_000;

/// The pressures (Pa) that the predictor can tell apart; those beyond count as the ends.
pub const PRESSURES_PA: RangeInclusive<f32> = -50_000.0..=605_350.0;

/// Radians in a hundredth of a degree.
const RAD_PER_CENTIDEGREE: f32 = 1.745_329_3e-4;

/// A model that is predicted with: the configuration.
///
/// ```text
/// pₖ  pressure of line k, whole hundredths of a kPa;  Pa = 10 · hundredths
/// aₖ  angle of line k, whole hundredths of a degree;  rad = hundredths · π/18000
/// x₀  = at rest behind the reading a₀, under p₀
/// xₖ  = one period of 0.01 s from xₖ₋₁, pressure linear from pₖ₋₁ to pₖ
/// mₖ  = reading of xₖ through the sensor's effects
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Predictor {
    prepared: Prepared,
    /// Whole samples of the dead time, and what is left of it.
    late: u8,
    part: f32,
}

/// Where the prediction is: the state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    motion: Motion,
    steps: u32,
    history: History,
}

/// Pressures of the past.
#[derive(Clone, Copy, Debug, PartialEq)]
struct History {
    samples: [u16; MEMORY],
    newest: u8,
}

/// The pressure (Pa) of a reading in hundredths of a kPa, as the predictor sees
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
        }
    }

    fn push(&mut self, sample: u16) {
        self.newest = if usize::from(self.newest) + 1 < MEMORY {
            self.newest + 1
        } else {
            0
        };
        if let Some(place) = self.samples.get_mut(usize::from(self.newest)) {
            *place = sample;
        }
    }

    /// The pressure (Pa) `samples` ago.
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

/// The delay (s) of a model, as whole samples and a part of one.
fn delay(model: &Model<f32, Minimax>) -> Result<(u8, f32), Unsteppable> {
    let mut delay = 0.0;
    for effect in model.occupied() {
        delay += effect.delay();
    }
    if !(0.0..=MAX_DELAY_S).contains(&delay) {
        return Err(Unsteppable::TooMuchDelay);
    }
    let samples = delay * RATE_HZ;
    // At most 60, by the check above.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let whole = samples as u8;
    Ok((whole, samples - f32::from(whole)))
}

/// How a model would be stepped for angles up to `farthest` (rad).
///
/// # Errors
///
/// [`Unsteppable`], and then a board refuses the model too.
pub fn check(model: &Model<f32, Minimax>, farthest: f32) -> Result<Plan, Unsteppable> {
    delay(model)?;
    plan(model, farthest, STEP_S)
}

impl Predictor {
    /// Prepares a model that can be stepped at [`RATE_HZ`] for angles up to `farthest`
    /// (rad).
    ///
    /// # Errors
    ///
    /// [`Unsteppable`].
    pub fn new(model: &Model<f32, Minimax>, farthest: f32) -> Result<Self, Unsteppable> {
        let mut predictor = Self::empty();
        predictor.restart(model, farthest)?;
        while !predictor.prepare() {}
        Ok(predictor)
    }

    /// Room for a model: one that is never complete.
    #[inline(always)]
    pub fn empty() -> Self {
        Self {
            prepared: Prepared::empty(),
            late: 0,
            part: 0.0,
        }
    }

    /// Begins with another model in place, for a board that has no room for two, without
    /// its tables, which [`Predictor::prepare`] computes; the old one stays if the new one
    /// is refused.
    ///
    /// # Errors
    ///
    /// [`Unsteppable`].
    pub fn restart(
        &mut self,
        model: &Model<f32, Minimax>,
        farthest: f32,
    ) -> Result<(), Unsteppable> {
        let (late, part) = delay(model)?;
        let plan = plan(model, farthest, STEP_S)?;
        self.prepared.restart(model, plan, STEP_S);
        (self.late, self.part) = (late, part);
        Ok(())
    }

    /// Forgets the model: not complete until there is another.
    pub fn clear(&mut self) {
        self.prepared.clear();
    }

    /// Computes a little more of the tables; whether they are complete.
    pub fn prepare(&mut self) -> bool {
        self.prepared.prepare()
    }

    /// Whether the tables are complete: before, it must not be stepped.
    pub fn is_complete(&self) -> bool {
        self.prepared.is_complete()
    }

    /// The model that is stepped.
    pub fn model(&self) -> &Model<f32, Minimax> {
        self.prepared.model()
    }

    /// The model, prepared.
    pub fn prepared(&self) -> &Prepared {
        &self.prepared
    }

    /// Starts at rest, from a line of telemetry: angle in hundredths of a
    /// degree, pressure in hundredths of a kPa.
    #[inline(never)]
    pub fn start(&self, hundredths_deg: i32, hundredths_kpa: i32) -> Prediction {
        let sample = packed(hundredths_kpa);
        let angle = self.model().angle_behind(angle_rad(hundredths_deg));
        Prediction {
            motion: self.prepared.at_rest(angle, unpacked(sample)),
            steps: 0,
            history: History::at_rest(sample),
        }
    }

    /// Starts in a state of the model, its clock included, under a pressure in hundredths of a
    /// kPa: from there a computer repeats what the board would make of a recording that does
    /// not begin at rest.
    pub fn start_at(&self, state: &State<f32>, hundredths_kpa: i32) -> Prediction {
        let sample = packed(hundredths_kpa);
        // Saturates, after a year and more.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let steps = (state.time * RATE_HZ + 0.5) as u32;
        Prediction {
            motion: self.prepared.at(state, unpacked(sample)),
            steps,
            history: History::at_rest(sample),
        }
    }

    /// Goes on to the next line, whose pressure is in hundredths of a kPa; none
    /// when its sensor had no reading.
    ///
    /// A line without a pressure counts with the pressure before it.
    #[inline(never)]
    pub fn step(&self, prediction: &mut Prediction, hundredths_kpa: Option<i32>) {
        let history = &mut prediction.history;
        let sample = match hundredths_kpa {
            Some(hundredths) => packed(hundredths),
            None => history
                .samples
                .get(usize::from(history.newest))
                .copied()
                .unwrap_or(0),
        };
        history.push(sample);
        prediction.steps = prediction.steps.wrapping_add(1);
        let late = usize::from(self.late);
        let (mut before, mut after) = (history.back(late + 1), history.back(late));
        if self.part > 0.0 {
            let earlier = history.back(late + 2);
            after += (before - after) * self.part;
            before += (earlier - before) * self.part;
        }
        let time = prediction.steps as f32 * STEP_S;
        self.prepared
            .advance(&mut prediction.motion, before, after, time);
    }

    /// The dead time (s) by which the prediction is behind the pressure.
    pub fn delay_s(&self) -> f32 {
        (f32::from(self.late) + self.part) * STEP_S
    }

    /// The pressure (Pa) at the sensor that gives the actuator this acceleration (rad/s²):
    /// [`Prepared::pressure_for`]. A dead time is not inverted.
    pub fn pressure_for(&self, prediction: &Prediction, acceleration: f32) -> f32 {
        self.prepared.pressure_for(&prediction.motion, acceleration)
    }

    /// The angular rate (rad/s).
    pub fn rate(&self, prediction: &Prediction) -> f32 {
        self.prepared.rate(&prediction.motion)
    }
}

impl Prediction {
    /// Steps since its clock was at zero: since the start, except after [`Predictor::start_at`].
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// The bending angle (rad).
    pub fn angle(&self) -> f32 {
        self.motion.angle()
    }

    /// What the angle sensor should show (rad); not finite if the model diverged.
    pub fn reading(&self) -> f32 {
        self.motion.reading()
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
    use crate::catalogue::{Effect, Kind};
    use crate::dynamics::Dynamics;
    use crate::input::FromFn;
    use crate::integrate::{Scheme, step};

    const DYNAMICS: Dynamics<f32> = Dynamics {
        inertia: 0.36,
        damping: 1.8,
        stiffness: 5.0,
        exponent: 2.365,
        input_gain: 1.45e-4,
    };

    fn predictor(effects: &[Effect<f32>]) -> Predictor {
        Predictor::new(&Model::new(DYNAMICS, effects).unwrap(), 2.3).unwrap()
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
            let predictor = predictor(&effects);
            let mut prediction = predictor.start(0, 0);
            // In f64, with steps fifty times shorter, no delay but a shifted input.
            let fine: Model<f64> = Model::new(DYNAMICS.map(f64::from), &[]).unwrap();
            let mut state = fine.at_rest(0.0, 0.0);
            let shift = f64::from(delay.unwrap_or(0.0));
            for k in 0..600 {
                predictor.step(&mut prediction, Some(pressure(k + 1)));
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
                let gap = f64::from(prediction.reading()) - state.angle;
                assert!(gap.abs() < 2e-4, "{delay:?} {k}: {gap}");
            }
            assert!(state.angle > 0.9, "{}", state.angle);
            assert_eq!(prediction.steps(), 600);
        }
    }

    #[test]
    fn starts_at_rest_behind_what_the_sensor_shows() {
        let offset = Kind::SensorOffset.build(&[0.05]).unwrap();
        let predictor = predictor(&[offset]);
        let prediction = predictor.start(1_000, 250);
        assert!((prediction.reading() - 10.0_f32.to_radians()).abs() < 1e-6);
        assert!((prediction.angle() - 10.0_f32.to_radians()).abs() > 0.04);
        assert!((prediction.pressure() - 2_500.0).abs() < f32::EPSILON);
    }

    #[test]
    fn a_start_at_rest_is_that_of_the_state_at_rest() {
        for effect in [
            Kind::SensorOffset.build(&[0.05]).unwrap(),
            Kind::PneumaticLag.build(&[0.2]).unwrap(),
            Kind::DeadTime.build(&[0.137]).unwrap(),
        ] {
            let predictor = predictor(&[effect]);
            let model = predictor.model();
            let state = model.showing(angle_rad(1_000), 0.0, pressure_pa(250));
            assert_eq!(predictor.start_at(&state, 250), predictor.start(1_000, 250));
        }
    }

    #[test]
    fn a_missing_pressure_is_the_one_before() {
        let predictor = predictor(&[]);
        let mut with = predictor.start(0, 0);
        let mut without = with;
        for k in 0..50 {
            predictor.step(&mut with, Some(if k < 20 { 1_000 } else { 3_000 }));
            predictor.step(
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
        for end in [i32::MIN, i32::MAX] {
            assert!(PRESSURES_PA.contains(&pressure_pa(end)));
        }
        assert!((angle_rad(9_000) - core::f32::consts::FRAC_PI_2).abs() < 1e-6);
    }

    #[test]
    fn models_that_would_diverge_or_reach_too_far_back_are_refused() {
        let build = |dynamics, effects: &[Effect<f32>]| {
            Predictor::new(&Model::new(dynamics, effects).unwrap(), 2.3).map(|_| ())
        };
        assert_eq!(build(DYNAMICS, &[]), Ok(()));
        let late = Kind::DeadTime.build(&[0.61]).unwrap();
        assert_eq!(build(DYNAMICS, &[late]), Err(Unsteppable::TooMuchDelay));
        // Damping is exact however strong; a spring has to be resolved.
        let damped = Dynamics {
            damping: 1e4,
            ..DYNAMICS
        };
        assert_eq!(build(damped, &[]), Ok(()));
        let stiff = Dynamics {
            stiffness: 1e5,
            ..DYNAMICS
        };
        assert_eq!(build(stiff, &[]), Err(Unsteppable::TooFast));
        let steep = Dynamics {
            exponent: 5.5,
            ..DYNAMICS
        };
        assert_eq!(build(steep, &[]), Err(Unsteppable::Exponent));
        let shift = Kind::ExponentShift.build(&[-0.7]).unwrap();
        assert_eq!(build(steep, &[shift]), Ok(()));
    }
}
