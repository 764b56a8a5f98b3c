//! Refits of the truth's own equations: how large a misfit the base model is
//! left with, and how well a model could do that has the right structure.
//!
//! The solver is a library's (MINPACK's algorithm); simulations and
//! derivatives, by finite differences, are the truth simulator's.

use std::cell::OnceCell;

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};

use super::world::{Base, Line, World};

/// One number that a refit may move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Free {
    /// C.
    Damping,
    /// K.
    Stiffness,
    /// g.
    InputGain,
    /// A number of an effect.
    Value {
        /// Which effect.
        slot: usize,
        /// Which of its numbers.
        index: usize,
    },
}

/// What every refit may move.
pub const BASE: [Free; 3] = [Free::Damping, Free::Stiffness, Free::InputGain];

/// The base parameters and every number of the effects.
pub fn everything(truth: &World) -> Vec<Free> {
    let mut free = BASE.to_vec();
    for (slot, effect) in truth.effects.iter().enumerate() {
        free.extend((0..effect.law.numbers()).map(|index| Free::Value { slot, index }));
    }
    free
}

impl Free {
    fn of(self, truth: &mut World) -> &mut f64 {
        let Base {
            damping,
            stiffness,
            input_gain,
            ..
        } = &mut truth.base;
        match self {
            Self::Damping => damping,
            Self::Stiffness => stiffness,
            Self::InputGain => input_gain,
            Self::Value { slot, index } => &mut truth.effects[slot].values[index],
        }
    }
}

/// A run to fit: pressure, number of the run, and what was shown (rad).
#[derive(Clone, Debug)]
pub struct Fitted {
    /// Pressure that drives the simulation.
    pub line: Line,
    /// Number of the run within its case.
    pub run: u32,
    /// Angle to fit (rad).
    pub angle: Vec<f64>,
}

/// RMS of simulated minus shown (rad) over all runs.
pub fn misfit(truth: &World, runs: &[Fitted], steps: u32) -> f64 {
    let residuals = residuals(truth, runs, steps);
    (residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64).sqrt()
}

fn residuals(truth: &World, runs: &[Fitted], steps: u32) -> Vec<f64> {
    runs.iter()
        .flat_map(|run| {
            truth
                .simulate(&run.line, run.run, steps)
                .into_iter()
                .zip(&run.angle)
                .map(|(simulated, shown)| simulated - shown)
                .collect::<Vec<_>>()
        })
        .collect()
}

/// Moves the numbers in `free` from where `start` has them to the least sum of
/// squares nearby.
pub fn refit(start: &World, free: &[Free], runs: &[Fitted], steps: u32) -> World {
    let mut from = start.clone();
    let origin: Vec<f64> = free.iter().map(|free| *free.of(&mut from)).collect();
    let scale: Vec<f64> = origin
        .iter()
        .map(|value| if *value == 0.0 { 1e-3 } else { value.abs() })
        .collect();
    let truth = |position: &[f64]| {
        let mut truth = start.clone();
        for (k, free) in free.iter().enumerate() {
            *free.of(&mut truth) = origin[k] + scale[k] * position[k];
        }
        truth
    };
    truth(&least_squares(free.len(), &|position| {
        residuals(&truth(position), runs, steps)
    }))
}

/// Where the squares of residuals are least, near zero; numbers are scaled so
/// that one is a large move. Residuals that are not finite end the search.
pub(super) fn least_squares(count: usize, residuals: &dyn Fn(&[f64]) -> Vec<f64>) -> Vec<f64> {
    let problem = Problem {
        residuals,
        position: DVector::zeros(count),
        here: OnceCell::new(),
    };
    let (solved, _) = LevenbergMarquardt::new()
        .with_ftol(1e-5)
        .with_xtol(1e-4)
        .with_gtol(0.0)
        .with_stepbound(0.5)
        .with_patience(6)
        .minimize(problem);
    solved.position.as_slice().to_vec()
}

struct Problem<'a> {
    residuals: &'a dyn Fn(&[f64]) -> Vec<f64>,
    position: DVector<f64>,
    /// The residuals there, once they are asked for: the solver asks for them and for the
    /// derivatives.
    here: OnceCell<Option<DVector<f64>>>,
}

impl Problem<'_> {
    fn at(&self, position: &DVector<f64>) -> Option<DVector<f64>> {
        let residuals = (self.residuals)(position.as_slice());
        residuals
            .iter()
            .all(|r| r.is_finite())
            .then(|| DVector::from_vec(residuals))
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, position: &DVector<f64>) {
        self.position.copy_from(position);
        self.here.take();
    }

    fn params(&self) -> DVector<f64> {
        self.position.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        self.here.get_or_init(|| self.at(&self.position)).clone()
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        /// Large enough to step over the rounding of hysteresis to whole steps.
        const STEP: f64 = 1e-3;
        let here = self.residuals()?;
        let mut jacobian = DMatrix::zeros(here.len(), self.position.len());
        for column in 0..self.position.len() {
            let mut moved = self.position.clone();
            moved[column] += STEP;
            let there = self.at(&moved)?;
            jacobian.set_column(column, &((there - &here) / STEP));
        }
        Some(jacobian)
    }
}
