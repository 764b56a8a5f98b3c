//! Runs the fits of a search.
//!
//! The [`Executor`] alone asks whether there is time, knows which fits an
//! interrupted run has kept, and who counts. The search only hears why there is no result:
//! the structure cannot be simulated, or it was not reached. A fit that is running when the
//! time is up ends at its next step.

use model_core::actuator::{Model, ParameterId};
use rayon::prelude::*;

use crate::diagnose::work::budget::SearchPart;
use crate::diagnose::work::job::{Job, RunningFit};
use crate::estimate::checkpoint::Checkpoint;
use crate::estimate::fit::{Effort, Fit};
use crate::estimate::fitter::Fitter;

/// The steps after which the local minimum is chosen, and after which a fit that leads nowhere ends.
pub const FIRST_STEPS: Effort = Effort::Steps(4);

/// Why a structure has no fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoFit {
    /// It cannot be simulated from where it would start, or has no place to start.
    Diverged,
    /// The budget was spent or the work was asked to stop, before its fit or in it.
    NotReached,
}

/// Runs fits as long as there is time for them.
#[derive(Clone, Copy, Debug)]
pub struct Executor<'a> {
    job: &'a Job,
    checkpoint: &'a Checkpoint,
}

impl<'a> Executor<'a> {
    /// An executor that reports to `job`, has its allowance, and keeps fits in `checkpoint`.
    pub const fn new(job: &'a Job, checkpoint: &'a Checkpoint) -> Self {
        Self { job, checkpoint }
    }

    /// What it works for.
    pub const fn job(&self) -> &'a Job {
        self.job
    }

    /// Begins a job of one or more fits, which counts once the returned value is dropped.
    ///
    /// # Errors
    ///
    /// [`NoFit::NotReached`] if there is no time for it.
    pub fn begin(&self) -> Result<RunningFit<'a>, NoFit> {
        self.check()?;
        Ok(self.job.fit())
    }

    /// Whether there is time for more.
    ///
    /// # Errors
    ///
    /// [`NoFit::NotReached`] if there is not.
    pub fn check(&self) -> Result<(), NoFit> {
        if self.job.is_over() {
            Err(NoFit::NotReached)
        } else {
            Ok(())
        }
    }

    /// The result of a part of the search, which is noted as not done where it was not reached.
    pub fn reached<T>(&self, part: SearchPart, result: Result<T, NoFit>) -> Option<T> {
        if matches!(result, Err(NoFit::NotReached)) {
            self.job.allowance.leave_out(part);
        }
        result.ok()
    }

    /// Fits the parameters in `free`, from their values in `start`.
    ///
    /// # Errors
    ///
    /// [`NoFit::NotReached`] if the time was up before it ended.
    pub fn fit(
        &self,
        fitter: &Fitter<'_>,
        start: &Model<f64>,
        free: &[ParameterId],
        effort: Effort,
    ) -> Result<Fit, NoFit> {
        let is_interrupted = || self.job.is_interrupted();
        fitter
            .fit_unless(start, free, effort, self.checkpoint, &is_interrupted)
            .ok_or(NoFit::NotReached)
    }

    /// Fits from each initial guess and returns the best fit; a long fit goes on from the one
    /// that is best after a few steps.
    ///
    /// # Errors
    ///
    /// If the model cannot be simulated from any, or the time was up before all had ended.
    pub fn best_of(
        &self,
        fitter: &Fitter<'_>,
        starts: &[Model<f64>],
        free: &[ParameterId],
        effort: Effort,
    ) -> Result<Fit, NoFit> {
        if starts.len() > 1 && effort.is_long() {
            let nearest = self.best_of(fitter, starts, free, FIRST_STEPS)?;
            let data = fitter.data.guessing(&nearest.nuisances);
            let fitter = Fitter {
                data: &data,
                ..*fitter
            };
            return self.fit(&fitter, &nearest.model, free, effort);
        }
        starts
            .par_iter()
            .map(|start| self.fit(fitter, start, free, effort))
            .collect::<Result<Vec<Fit>, NoFit>>()?
            .into_iter()
            .filter(|fit| fit.sse().is_finite())
            .min_by(|a, b| a.cost().total_cmp(&b.cost()))
            .ok_or(NoFit::Diverged)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use softrig_formats::model_file::ModelFile;

    use super::*;
    use crate::diagnose::work::budget::Budget;
    use crate::estimate::Dataset;
    use crate::synth::example::{Hidden, make};

    fn example() -> (ModelFile, Dataset) {
        let example = make(Hidden::Nothing, 0.05, 3).unwrap();
        let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
        let recordings: Vec<_> = example.recordings.into_iter().map(|it| it.1).collect();
        let data = Dataset::of(&recordings);
        (file, data)
    }

    #[test]
    fn without_a_budget_it_fits_as_the_fitter_does() {
        let (file, data) = example();
        let fitter = Fitter::new(&file.model, &data);
        let (job, checkpoint) = (Job::default(), Checkpoint::default());
        let executor = Executor::new(&job, &checkpoint);
        let alone = fitter.fit(&file.model, &file.free, Effort::Full);
        let fit = executor
            .fit(&fitter, &file.model, &file.free, Effort::Full)
            .unwrap();
        assert_eq!(fit.model, alone.model);
        let cannot = executor.best_of(&fitter, &[], &file.free, Effort::Full);
        assert_eq!(cannot.unwrap_err(), NoFit::Diverged);
        assert_eq!(job.allowance.ended(), None);
    }

    #[test]
    fn what_was_not_reached_is_noted_and_what_diverged_is_not() {
        let (file, data) = example();
        let fitter = Fitter::new(&file.model, &data);
        let checkpoint = Checkpoint::default();
        let part = SearchPart::Combinations;
        let asked_to_stop = Job::default();
        asked_to_stop.allowance.stop();
        let late = Job::within(Some(Budget::Time(std::time::Duration::ZERO)));
        for job in [asked_to_stop, late] {
            let executor = Executor::new(&job, &checkpoint);
            assert_eq!(executor.begin().err(), Some(NoFit::NotReached));
            let fit = executor.fit(&fitter, &file.model, &file.free, Effort::Full);
            assert_eq!(executor.reached(part, fit.map(drop)), None);
            assert!(job.allowance.undone().contains(&part));
        }
        let job = Job::default();
        let executor = Executor::new(&job, &checkpoint);
        assert_eq!(executor.reached::<()>(part, Err(NoFit::Diverged)), None);
        assert!(job.allowance.undone().is_empty());
    }

    /// Fits side by side do not interrupt each other where their number is the budget.
    #[test]
    fn a_budget_of_fits_lets_what_has_begun_end() {
        let (file, data) = example();
        let fitter = Fitter::new(&file.model, &data);
        let job = Job::within(Some(Budget::Fits(1)));
        let checkpoint = Checkpoint::default();
        let executor = Executor::new(&job, &checkpoint);
        let first = executor.begin().unwrap();
        drop(executor.begin().unwrap());
        assert!(executor.check().is_err());
        let fit = executor.fit(&fitter, &file.model, &file.free, Effort::Coarse);
        assert!(fit.is_ok());
        drop(first);
    }
}
