//! The test that counts: errors on runs that were not fitted.
//!
//! With `--holdout` recordings the fitted model is simulated over them as it
//! is. Without, recordings are left out in turn, repeats of one run together:
//! a repeat that stays in the fit would give the answer away. Either way a run
//! that starts in motion has its starting angle and rate estimated, and nothing
//! else.
//!
//! What a fit would have been without some recordings follows from the
//! curvature of its sum of squares ([`crate::information`]); it is refitted
//! only where that cannot be trusted.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use model_core::actuator::{Model, ParameterId};
use model_core::catalogue::Kind;
use model_core::power::Minimax;

use super::candidates::{Candidate, free_parameters};
use super::noise::{NoiseFloor, repeats};
use crate::fit::{Effort, Fitter, Run};
use crate::model_file::ModelFile;
use crate::recording::Recording;
use crate::statistics::rms;

/// Fewer different runs than this, and leaving one out would ask for
/// extrapolation: repeats are then left out one by one.
const FEWEST_UNITS: usize = 4;

/// Folds into which repeats are dealt where they are not kept together.
const FOLDS: usize = 4;

/// A fit without some recordings is found by one step, unless they are missed by so
/// many times the squares with which the fit to all of them misses them.
const TRUSTED: f64 = 1.2;

/// Held-out errors (rad).
#[derive(Clone, Debug, PartialEq)]
pub struct HeldOut {
    /// The model as supplied.
    pub nominal: f64,
    /// The nominal structure, refitted.
    pub refit: f64,
    /// The repaired model.
    pub repaired: f64,
    /// The repaired model in `f32` with the board's power function.
    pub repaired_on_board: f64,
    /// Noise floor of the held-out runs.
    pub floor: f64,
    /// Whether they were left out in turn rather than given.
    pub in_turn: bool,
    /// Whether all of them are repeats of runs that were fitted.
    pub only_repeats: bool,
    /// The same for each held-out run.
    pub runs: Vec<HeldOutRun>,
}

/// Errors (rad) on one run that was not fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldOutRun {
    /// The model as supplied.
    pub nominal: f64,
    /// The nominal structure, refitted.
    pub refit: f64,
    /// The repaired model in the board's arithmetic.
    pub repaired_on_board: f64,
}

impl HeldOut {
    /// Share of the gap between refit and noise floor that the repair removes.
    pub fn gap_closed(&self) -> f64 {
        share_closed(self.refit, self.repaired, self.floor)
    }

    /// Whether the repaired model leaves nothing but noise.
    pub fn at_noise(&self) -> bool {
        self.repaired <= super::RMS_FACTOR * self.floor
    }
}

/// Share of the gap between `before` and `floor` that `after` removes, at most
/// 1; negative for a repair that makes it worse.
pub fn share_closed(before: f64, after: f64, floor: f64) -> f64 {
    let gap = before - floor;
    if gap <= 0.0 {
        return 0.0;
    }
    ((before - after) / gap).clamp(-1.0, 1.0)
}

/// A structure as fitted: what identifies a held-out error.
type Key = (Vec<Kind>, Vec<ParameterId>);

/// Judges structures by runs that were not fitted.
pub struct Judge<'a, 'r> {
    file: &'a ModelFile,
    /// The fitted runs.
    fitter: &'a Fitter<'a, 'r>,
    /// The held-out runs; empty to leave the fitted ones out in turn.
    given: &'a [Run<'r>],
    /// Fitted runs that are left out together.
    folds: Vec<Vec<usize>>,
    /// Noise floor of the held-out runs (rad).
    floor: f64,
    /// Whether every held-out run repeats one that was fitted.
    only_repeats: bool,
    /// Squared errors of each run that were found before: several steps ask for
    /// the same ones.
    memo: Mutex<BTreeMap<Key, Vec<f64>>>,
}

impl<'a, 'r> Judge<'a, 'r> {
    /// Creates a judge over `given` held-out runs, or over the fitted ones in
    /// turn if there are none. The noise of the measured pressure leaves an error
    /// of `input` (rad) that no model removes.
    pub fn new(
        file: &'a ModelFile,
        fitter: &'a Fitter<'a, 'r>,
        given: &'a [Run<'r>],
        input: f64,
    ) -> Self {
        let recordings = |runs: &[Run<'_>]| -> Vec<Recording> {
            runs.iter().map(|run| run.recording.clone()).collect()
        };
        let (floor, folds, only_repeats) = if given.is_empty() {
            let floor = NoiseFloor::of(&recordings(fitter.runs));
            let folds = folds(fitter.runs.len(), &floor.groups);
            let only_repeats = folds.iter().all(|fold| {
                let fitted = |other: &usize| !fold.contains(other);
                fold.iter()
                    .all(|&run| repeats_one(run, &floor.groups, fitted))
            });
            (floor, folds, only_repeats)
        } else {
            let floor = NoiseFloor::of(&recordings(given));
            let all = [recordings(fitter.runs), recordings(given)].concat();
            let count = fitter.runs.len();
            let groups = repeats(&all);
            let only_repeats =
                (count..all.len()).all(|run| repeats_one(run, &groups, |&other| other < count));
            (floor, Vec::new(), only_repeats)
        };
        Self {
            file,
            fitter,
            given,
            folds,
            floor: floor.rms.hypot(input),
            only_repeats,
            memo: Mutex::default(),
        }
    }

    /// RMS error (rad) of a fitted structure on runs that were not fitted.
    pub fn error_of(&self, candidate: &Candidate) -> f64 {
        self.rms(&self.squares_of(candidate))
    }

    /// Sum of squared errors of a fitted structure on each run.
    fn squares_of(&self, candidate: &Candidate) -> Vec<f64> {
        let key = (candidate.added.clone(), candidate.fit.free.clone());
        let memo = || self.memo.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = memo().get(&key) {
            return known.clone();
        }
        let found = self.collect(candidate, |fitter, model| {
            squares(&fitter.compare(model).residuals)
        });
        memo().insert(key, found.clone());
        found
    }

    /// What nothing can remove from the error on the held-out runs (rad).
    pub fn floor(&self) -> f64 {
        self.floor
    }

    /// Whether every held-out run repeats one that was fitted.
    pub fn has_only_repeats(&self) -> bool {
        self.only_repeats
    }

    /// RMS error (rad) over all runs from the sums of each.
    fn rms(&self, squares: &[f64]) -> f64 {
        let samples: usize = self.runs().iter().map(|run| run.recording.len()).sum();
        (squares.iter().sum::<f64>() / samples.max(1) as f64).sqrt()
    }

    /// Share of the held-out gap between refit and noise floor that a structure
    /// removes.
    pub fn gap_closed(&self, refit: &Candidate, candidate: &Candidate) -> f64 {
        share_closed(self.error_of(refit), self.error_of(candidate), self.floor)
    }

    /// Errors of the nominal model, its refit and the repaired one.
    pub fn errors(&self, refit: &Candidate, repaired: &Candidate) -> HeldOut {
        let runs = self.runs();
        let nominal = Fitter {
            nominal: &self.file.model,
            runs,
        }
        .compare(&self.file.model);
        let before = self.squares_of(refit);
        let after = self.collect(repaired, board_squares);
        let each = |run: usize, squares: &[f64]| {
            let samples = runs[run].recording.len().max(1) as f64;
            (squares.get(run).copied().unwrap_or(0.0) / samples).sqrt()
        };
        HeldOut {
            nominal: nominal.rmse(),
            refit: self.rms(&before),
            repaired: if repaired.added.is_empty() {
                self.rms(&before)
            } else {
                self.error_of(repaired)
            },
            repaired_on_board: self.rms(&after),
            floor: self.floor,
            in_turn: self.given.is_empty(),
            only_repeats: self.only_repeats,
            runs: nominal
                .residuals
                .iter()
                .enumerate()
                .map(|(run, residual)| HeldOutRun {
                    nominal: rms(residual),
                    refit: each(run, &before),
                    repaired_on_board: each(run, &after),
                })
                .collect(),
        }
    }

    fn runs(&self) -> &[Run<'r>] {
        if self.given.is_empty() {
            self.fitter.runs
        } else {
            self.given
        }
    }

    /// Collects the squared errors of each held-out run.
    fn collect(
        &self,
        candidate: &Candidate,
        squares: impl Fn(&Fitter<'_, '_>, &Model<f64>) -> Vec<f64>,
    ) -> Vec<f64> {
        if self.given.is_empty() {
            let mut each = vec![0.0; self.fitter.runs.len()];
            for fold in &self.folds {
                let found = self.fold_squares(candidate, fold, &squares);
                for (run, sum) in self.left_out(fold).zip(found) {
                    each[run] = sum;
                }
            }
            each
        } else {
            let fitter = Fitter {
                nominal: &self.file.model,
                runs: self.given,
            };
            squares(&fitter, &candidate.fit.model)
        }
    }

    /// The runs of a fold in their own order.
    fn left_out<'f>(&self, fold: &'f [usize]) -> impl Iterator<Item = usize> + use<'f> {
        (0..self.fitter.runs.len()).filter(move |index| fold.contains(index))
    }

    fn fold_squares(
        &self,
        candidate: &Candidate,
        fold: &[usize],
        squares: &impl Fn(&Fitter<'_, '_>, &Model<f64>) -> Vec<f64>,
    ) -> Vec<f64> {
        let pick = |left_out: bool| -> Vec<Run<'r>> {
            self.fitter
                .runs
                .iter()
                .enumerate()
                .filter(|(index, _)| fold.contains(index) == left_out)
                .map(|(_, run)| run.clone())
                .collect()
        };
        let nominal = &self.file.model;
        let left_out = pick(true);
        let squares_of = |model: &Model<f64>| {
            let fitter = Fitter {
                nominal,
                runs: &left_out,
            };
            squares(&fitter, model)
        };
        // A step that leads far worse may have left the parabola it was taken on.
        let by_step = candidate
            .fit
            .without(fold)
            .map(|model| squares_of(&model))
            .filter(|found| {
                let fitted: f64 = self
                    .left_out(fold)
                    .filter_map(|run| candidate.fit.residuals.get(run))
                    .flatten()
                    .map(|residual| residual * residual)
                    .sum();
                found.iter().sum::<f64>() <= TRUSTED * fitted
            });
        by_step.unwrap_or_else(|| {
            let free = if candidate.fit.free.is_empty() {
                free_parameters(self.file, &candidate.added)
            } else {
                candidate.fit.free.clone()
            };
            let refitted = Fitter {
                nominal,
                runs: &pick(false),
            }
            // From the whole fit it is not far, and a thousandth of the error
            // decides nothing.
            .fit(&candidate.fit.model, &free, Effort::Glance);
            squares_of(&refitted.model)
        })
    }
}

/// Deals runs into folds: repeats together, or one by one where that leaves
/// too few different runs.
fn folds(runs: usize, repeats: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut units: Vec<Vec<usize>> = Vec::new();
    for index in 0..runs {
        match repeats.iter().find(|group| group.contains(&index)) {
            Some(group) if group.first() == Some(&index) => units.push(group.clone()),
            Some(_) => {}
            None => units.push(vec![index]),
        }
    }
    if units.len() >= FEWEST_UNITS {
        return units;
    }
    let count = FOLDS.min(runs);
    (0..count)
        .map(|fold| (fold..runs).step_by(count).collect())
        .collect()
}

/// Whether a run repeats one of those for which `fitted` holds.
fn repeats_one(run: usize, repeats: &[Vec<usize>], fitted: impl Fn(&usize) -> bool) -> bool {
    repeats
        .iter()
        .any(|group| group.contains(&run) && group.iter().any(&fitted))
}

/// Sum of squares of each run.
fn squares(residuals: &[Vec<f64>]) -> Vec<f64> {
    residuals
        .iter()
        .map(|residual| residual.iter().map(|r| r * r).sum())
        .collect()
}

/// Squared errors of a model in the board's arithmetic, from starts estimated
/// in `f64`.
#[allow(clippy::cast_possible_truncation)]
fn board_squares(fitter: &Fitter<'_, '_>, model: &Model<f64>) -> Vec<f64> {
    let starts = fitter.compare(model).starts;
    let board: Model<f32, Minimax> = model.map(|value| value as f32);
    fitter
        .runs
        .iter()
        .zip(starts)
        .map(|(run, start)| {
            run.residual_of(&run.simulate(&board, start))
                .iter()
                .map(|residual| residual * residual)
                .sum::<f64>()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::{folds, share_closed};

    #[test]
    fn repeats_are_left_out_together_unless_too_few_runs_differ() {
        let together = folds(6, &[vec![0, 2], vec![1, 5]]);
        assert_eq!(together, [vec![0, 2], vec![1, 5], vec![3], vec![4]]);
        let apart = folds(6, &[vec![0, 1, 2], vec![3, 4, 5]]);
        assert_eq!(apart, [vec![0, 4], vec![1, 5], vec![2], vec![3]]);
    }

    #[test]
    fn share_closed_of_all_none_and_worse() {
        assert!((share_closed(2.0, 0.5, 0.5) - 1.0).abs() < 1e-12);
        assert!((share_closed(2.0, 1.25, 0.5) - 0.5).abs() < 1e-12);
        assert!(share_closed(2.0, 2.0, 0.5).abs() < 1e-12);
        assert!(share_closed(2.0, 2.3, 0.5) < 0.0);
        // Below the floor there is no gap to close.
        assert!(share_closed(0.4, 0.3, 0.5).abs() < 1e-12);
    }
}
