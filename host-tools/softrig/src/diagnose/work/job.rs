//! A diagnosis at work, as its caller sees it: how long it may go on ([`Allowance`]), how far it is
//! ([`Progress`]), and who is told.
//!
//! A caller who shows nothing and sets no limit passes `&Job::default()`.

use std::fmt;

use crate::diagnose::work::allowance::Allowance;
use crate::diagnose::work::budget::{Budget, SearchPart};
use crate::diagnose::work::progress::{Progress, State};
use softrig_formats::instant::Instant;

/// A diagnosis at work, or a batch of them.
#[derive(Debug)]
pub struct Job {
    /// How long it may go on.
    pub allowance: Allowance,
    /// How far it is.
    pub progress: Progress,
    watcher: Option<Watcher>,
}

/// What is told that the work goes on.
struct Watcher(Box<dyn Fn(&Job) + Send + Sync>);

impl fmt::Debug for Watcher {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Watcher")
    }
}

impl Default for Job {
    fn default() -> Self {
        Self::within(None)
    }
}

impl From<Allowance> for Job {
    fn from(allowance: Allowance) -> Self {
        Self {
            allowance,
            progress: Progress::default(),
            watcher: None,
        }
    }
}

impl Job {
    /// A job with this budget, from now on; without limit if none.
    pub fn within(budget: Option<Budget>) -> Self {
        Allowance::within(budget).into()
    }

    /// One diagnosis of this batch: if the batch is stopped, so is the diagnosis.
    pub fn of_a_case(&self, budget: Option<Budget>) -> Self {
        self.allowance.of_a_case(budget).into()
    }

    /// The same for work that has begun before.
    pub fn since(self, started: Instant) -> Self {
        Self {
            allowance: self.allowance.since(started),
            ..self
        }
    }

    /// Tells `watcher` whenever the work asks whether to go on, many times a second: where there
    /// is one thread only, nothing else can look at the progress or end the work.
    pub fn watched_by(self, watcher: impl Fn(&Self) + Send + Sync + 'static) -> Self {
        Self {
            watcher: Some(Watcher(Box::new(watcher))),
            ..self
        }
    }

    /// Whether a part of the search may still begin. If not, it is noted as not done.
    pub fn may_begin(&self, part: SearchPart) -> bool {
        let may_begin = !self.is_over();
        if !may_begin {
            self.allowance.leave_out(part);
        }
        may_begin
    }

    /// See [`Allowance::is_over`].
    pub fn is_over(&self) -> bool {
        self.tell();
        self.allowance.is_over()
    }

    /// See [`Allowance::is_interrupted`].
    pub fn is_interrupted(&self) -> bool {
        self.tell();
        self.allowance.is_interrupted()
    }

    /// Counts a fit once the returned value is dropped, also if the fit fails.
    pub fn fit(&self) -> RunningFit<'_> {
        RunningFit(self)
    }

    /// A snapshot.
    pub fn state(&self) -> State {
        State {
            fits: self.allowance.fits(),
            elapsed: self.allowance.elapsed(),
            ..self.progress.state()
        }
    }

    fn tell(&self) {
        if let Some(Watcher(watcher)) = &self.watcher {
            watcher(self);
        }
    }
}

/// A running fit, which counts as finished once this is dropped.
#[derive(Debug)]
#[must_use = "the fit counts as finished once this is dropped"]
pub struct RunningFit<'a>(&'a Job);

impl Drop for RunningFit<'_> {
    fn drop(&mut self) {
        self.0.allowance.count();
        self.0.progress.count();
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use model_core::catalogue::Kind::{Gravity, MaxwellBranch};

    use super::*;
    use crate::diagnose::work::progress::Stage;

    #[test]
    fn fits_count_for_their_step_and_for_all() {
        let job = Job::default();
        job.progress.stage(Stage::Effects, 2);
        drop(job.fit());
        let unfinished = job.fit();
        let counts = |state: &State| (state.done, state.planned, state.fits);
        assert_eq!(counts(&job.state()), (1, 2, 1));
        drop(unfinished);
        job.progress.step("screening", 100);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| (0..20).for_each(|_| drop(job.fit())));
            }
        });
        let state = job.state();
        assert_eq!(counts(&state), (80, 100, 82));
        assert_eq!(state.stage, "single effects at several horizons: screening");
        job.progress.again("once more");
        job.progress.stage(Stage::Quality, 0);
        let state = job.state();
        assert_eq!(counts(&state), (0, 0, 82));
        assert_eq!(state.stage, "once more: quality of the recordings");
    }

    #[test]
    fn a_batch_counts_its_cases_and_stops_their_diagnoses() {
        let batch = Job::default();
        batch.progress.cases(3);
        let case = batch.of_a_case(None);
        drop(case.fit());
        batch.progress.case("a  no_discrepancy".into());
        let said = batch.state().to_string();
        assert!(
            said.starts_with("a  no_discrepancy; 1 of 3 cases, ") && said.ends_with(" so far"),
            "{said}"
        );
        assert!(!case.is_over());
        batch.allowance.stop();
        assert!(case.is_over() && case.allowance.is_stopped());
    }

    #[test]
    fn work_that_is_asked_to_stop_is_over() {
        let job = Job::default();
        assert!(!job.is_over());
        job.allowance.stop();
        assert!(job.is_interrupted() && !job.may_begin(SearchPart::Table));
    }

    /// With one thread, whoever is told of the work is all who can end it.
    #[test]
    fn whoever_watches_can_end_the_search_as_a_budget_does() {
        let job = Job::default().watched_by(|job| {
            if job.state().fits > 1 {
                job.allowance.enough();
            }
        });
        drop(job.fit());
        assert!(job.may_begin(SearchPart::Table));
        drop(job.fit());
        assert!(!job.may_begin(SearchPart::Table));
        let ended = job.allowance.ended().unwrap();
        assert_eq!(ended.budget, Budget::Time(Duration::from_secs(1)));
        assert!(ended.lacks(SearchPart::Table));
    }

    #[test]
    fn what_there_is_no_time_for_is_noted() {
        let job = Job::within(Some(Budget::Fits(2)));
        assert!(job.may_begin(SearchPart::Alone(Gravity)));
        assert_eq!(job.allowance.ended(), None);
        (0..2).for_each(|_| drop(job.fit()));
        assert!(!job.may_begin(SearchPart::Alone(MaxwellBranch)));
        assert!(!job.may_begin(SearchPart::Combinations));
        let undone = job.allowance.ended().unwrap().undone;
        let expected = [SearchPart::Alone(MaxwellBranch), SearchPart::Combinations];
        assert_eq!(undone, expected.into_iter().collect());
        let hours = Job::within(Some(Budget::Time(Duration::from_secs(7200))));
        assert!(hours.may_begin(SearchPart::Table));
        let none = Job::within(Some(Budget::Time(Duration::ZERO)));
        assert!(!none.may_begin(SearchPart::Table));
        assert!(Job::within(None).may_begin(SearchPart::Table));
    }
}
