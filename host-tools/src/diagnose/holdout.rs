//! The test that counts: errors on runs that were not fitted.
//!
//! With `--holdout` recordings the fitted model is simulated over them as it
//! is. Without, the recordings are dealt into folds, and each fold is simulated
//! with a model that was fitted to the others. Either way a run that starts in
//! motion has its starting angle and rate estimated, and nothing else.

use model_core::actuator::Model;
use model_core::power::Minimax;

use super::candidates::{Candidate, free_parameters};
use super::noise::NoiseFloor;
use crate::fit::{Effort, Fitter, Run};
use crate::model_file::ModelFile;
use crate::recording::Recording;

/// Folds when recordings are left out in turn.
const FOLDS: usize = 4;

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
fn share_closed(before: f64, after: f64, floor: f64) -> f64 {
    let gap = before - floor;
    if gap <= 0.0 {
        return 0.0;
    }
    ((before - after) / gap).clamp(-1.0, 1.0)
}

/// Judges structures by runs that were not fitted.
pub struct Judge<'a, 'r> {
    file: &'a ModelFile,
    /// The fitted runs.
    fitter: &'a Fitter<'a, 'r>,
    /// The held-out runs; empty to leave the fitted ones out in turn.
    given: &'a [Run<'r>],
}

impl<'a, 'r> Judge<'a, 'r> {
    /// Creates a judge over `given` held-out runs, or over the fitted ones in
    /// turn if there are none.
    pub fn new(file: &'a ModelFile, fitter: &'a Fitter<'a, 'r>, given: &'a [Run<'r>]) -> Self {
        Self {
            file,
            fitter,
            given,
        }
    }

    /// RMS error (rad) of a fitted structure on runs that were not fitted.
    pub fn error_of(&self, candidate: &Candidate) -> f64 {
        self.collect(candidate, |fitter, model| fitter.compare(model).sse())
    }

    /// Share of the held-out gap between refit and noise floor that a structure
    /// removes.
    pub fn gap_closed(&self, refit: &Candidate, candidate: &Candidate) -> f64 {
        share_closed(self.error_of(refit), self.error_of(candidate), self.floor())
    }

    /// Noise floor of the held-out runs (rad).
    fn floor(&self) -> f64 {
        let recordings: Vec<Recording> = self
            .runs()
            .iter()
            .map(|run| run.recording.clone())
            .collect();
        NoiseFloor::of(&recordings).rms
    }

    /// Errors of the nominal model, its refit and the repaired one.
    pub fn errors(&self, refit: &Candidate, repaired: &Candidate) -> HeldOut {
        let runs = self.runs();
        let nominal = Fitter {
            nominal: &self.file.model,
            runs,
        }
        .compare(&self.file.model);
        let refit_error = self.error_of(refit);
        HeldOut {
            nominal: nominal.rmse(),
            refit: refit_error,
            repaired: if repaired.added.is_empty() {
                refit_error
            } else {
                self.error_of(repaired)
            },
            repaired_on_board: self.collect(repaired, board_sse),
            floor: self.floor(),
            in_turn: self.given.is_empty(),
        }
    }

    fn runs(&self) -> &[Run<'r>] {
        if self.given.is_empty() {
            self.fitter.runs
        } else {
            self.given
        }
    }

    /// Collects squared errors over the held-out runs and returns their RMS.
    fn collect(
        &self,
        candidate: &Candidate,
        sse: impl Fn(&Fitter<'_, '_>, &Model<f64>) -> f64,
    ) -> f64 {
        let samples: usize = self.runs().iter().map(|run| run.recording.len()).sum();
        let total: f64 = if self.given.is_empty() {
            let folds = FOLDS.min(self.fitter.runs.len());
            (0..folds)
                .map(|fold| self.fold_sse(candidate, fold, folds, &sse))
                .sum()
        } else {
            let fitter = Fitter {
                nominal: &self.file.model,
                runs: self.given,
            };
            sse(&fitter, &candidate.fit.model)
        };
        (total / samples.max(1) as f64).sqrt()
    }

    fn fold_sse(
        &self,
        candidate: &Candidate,
        fold: usize,
        folds: usize,
        sse: &impl Fn(&Fitter<'_, '_>, &Model<f64>) -> f64,
    ) -> f64 {
        let pick = |left_out: bool| -> Vec<Run<'r>> {
            self.fitter
                .runs
                .iter()
                .enumerate()
                .filter(|(index, _)| (index % folds == fold) == left_out)
                .map(|(_, run)| run.clone())
                .collect()
        };
        let (train, test) = (pick(false), pick(true));
        let nominal = &self.file.model;
        let free = if candidate.fit.free.is_empty() {
            free_parameters(self.file, &candidate.added)
        } else {
            candidate.fit.free.clone()
        };
        let fitted = Fitter {
            nominal,
            runs: &train,
        }
        .fit(&candidate.fit.model, &free, Effort::Full);
        sse(
            &Fitter {
                nominal,
                runs: &test,
            },
            &fitted.model,
        )
    }
}

/// Squared error of a model in the board's arithmetic, from starts estimated
/// in `f64`.
#[allow(clippy::cast_possible_truncation)]
fn board_sse(fitter: &Fitter<'_, '_>, model: &Model<f64>) -> f64 {
    let starts = fitter.compare(model).starts;
    let board: Model<f32, Minimax> = model.map(|value| value as f32);
    fitter
        .runs
        .iter()
        .zip(starts)
        .map(|(run, start)| {
            run.simulate(&board, start)
                .iter()
                .zip(&run.recording.angle)
                .map(|(simulated, measured)| (simulated - measured).powi(2))
                .sum::<f64>()
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::share_closed;

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
