//! How large an effect has to be to matter: what a refit leaves of it, against
//! what is there without it.
//!
//! The refit may move what a lab's refit may: the free base parameters, the
//! zeros of the sensors within what a calibration leaves, and the start where a
//! recording begins in motion. Its noise is the angle sensor's together with
//! what the same refit leaves of the coloured force.

use super::super::law::Effect;
use super::super::refit::least_squares;
use super::super::sizes::reach;
use super::super::world::{Base, Grid, Line, Outside, RATE_HZ, World};
use super::session::{Drive, Rig};

/// Samples per second that are compared.
const COMPARED_HZ: u32 = 50;
/// Integration steps per second of a base model, which has nothing fast.
const BASE_HZ: u32 = 200;

/// A pressure zero (Pa) beyond this is no error of a calibration.
const PRESSURE_ZERO: f64 = 1500.0;
/// An angle zero (rad) beyond this is no error of a calibration.
const ANGLE_ZERO: f64 = 6.0 * std::f64::consts::PI / 180.0;
/// Large moves of a start: rad, and rad/s.
const START: [f64; 2] = [0.1, 0.3];

/// Drives with what a perfect sensor shows of a world, at `COMPARED_HZ`.
#[derive(Clone, Debug)]
pub struct Seen<'a> {
    rig: Rig,
    drives: &'a [Drive],
    readings: Vec<Vec<f64>>,
}

impl<'a> Seen<'a> {
    /// Shows a world over drives, with a coloured force for each of them or
    /// without any.
    pub fn of(rig: Rig, world: &World, drives: &'a [Drive], forces: &[Line]) -> Self {
        let readings = drives
            .iter()
            .enumerate()
            .map(|(number, drive)| {
                let outside = Outside {
                    force: forces.get(number),
                    start: drive.start,
                    ..Outside::at_rest(&drive.line)
                };
                world.show(&outside, Grid::of_steps(RATE_HZ, RATE_HZ / COMPARED_HZ))
            })
            .collect();
        Self {
            rig,
            drives,
            readings,
        }
    }

    /// Largest angle (rad); infinite if the world left all bounds.
    pub fn reach(&self) -> f64 {
        reach(&self.readings)
    }

    /// RMS (rad) that a base model leaves, refitted; infinite where the world or
    /// the refit fails.
    pub fn base_misfit(&self, base: &Base) -> f64 {
        self.misfit(base, &[])
    }

    /// RMS (rad) that a base model with one effect leaves, everything refitted.
    pub fn misfit(&self, base: &Base, effects: &[Effect]) -> f64 {
        if !self.reach().is_finite() {
            return f64::INFINITY;
        }
        let layout = Layout {
            gain: self.rig != Rig::Swing,
            starts: if self.rig == Rig::Swing {
                self.drives.len()
            } else {
                0
            },
            effects,
        };
        let rate_hz = if effects.is_empty() { BASE_HZ } else { RATE_HZ };
        let residuals = |position: &[f64]| self.residuals(base, &layout, position, rate_hz);
        let fitted = least_squares(layout.count(), &residuals);
        let left = residuals(&fitted);
        let square = left.iter().map(|r| r * r).sum::<f64>() / left.len() as f64;
        if square.is_finite() {
            square.sqrt()
        } else {
            f64::INFINITY
        }
    }

    fn residuals(
        &self,
        base: &Base,
        layout: &Layout<'_>,
        position: &[f64],
        rate_hz: u32,
    ) -> Vec<f64> {
        let moved = layout.moved(base, position);
        self.drives
            .iter()
            .enumerate()
            .zip(&self.readings)
            .flat_map(|((number, drive), reading)| {
                let mut start = drive.start;
                for (k, value) in start.iter_mut().enumerate() {
                    *value += START[k] * moved.starts.get(2 * number + k).unwrap_or(&0.0);
                }
                let outside = Outside {
                    shift: moved.pressure_zero,
                    start,
                    ..Outside::at_rest(&drive.line)
                };
                moved
                    .world
                    .show(&outside, Grid::of_steps(rate_hz, rate_hz / COMPARED_HZ))
                    .into_iter()
                    .zip(reading)
                    .map(|(simulated, shown)| simulated + moved.angle_zero - shown)
                    .collect::<Vec<_>>()
            })
            .collect()
    }
}

/// Which numbers a refit moves, in this order: damping, stiffness, input gain,
/// both zeros, starts, numbers of effects.
struct Layout<'a> {
    gain: bool,
    /// Drives whose start is moved.
    starts: usize,
    effects: &'a [Effect],
}

struct Moved {
    world: World,
    pressure_zero: f64,
    angle_zero: f64,
    starts: Vec<f64>,
}

impl Layout<'_> {
    fn count(&self) -> usize {
        let numbers: usize = self.effects.iter().map(|effect| effect.law.numbers()).sum();
        4 + usize::from(self.gain) + 2 * self.starts + numbers
    }

    fn moved(&self, base: &Base, position: &[f64]) -> Moved {
        let mut position = position.iter().copied();
        let mut next = || position.next().unwrap_or(0.0);
        let mut base = *base;
        base.damping *= 1.0 + next();
        base.stiffness *= 1.0 + next();
        if self.gain {
            base.input_gain *= 1.0 + next();
        }
        let pressure_zero = PRESSURE_ZERO * next().tanh();
        let angle_zero = ANGLE_ZERO * next().tanh();
        let starts = (0..2 * self.starts).map(|_| next()).collect();
        let mut effects = self.effects.to_vec();
        for effect in &mut effects {
            let count = effect.law.numbers();
            for value in effect.values.iter_mut().take(count) {
                *value *= 1.0 + next();
            }
        }
        Moved {
            world: World { base, effects },
            pressure_zero,
            angle_zero,
            starts,
        }
    }
}
