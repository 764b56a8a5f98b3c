//! How long a diagnosis may go on: its clock, its [`Budget`], and whether somebody asked it to end.
//!
//! A diagnosis can be asked to stop, which throws its answer away, or be told that it is enough,
//! which keeps it: to the search ([`crate::diagnose::work::executor`]) both are a budget that has been spent. What
//! was not done is noted here, and the answer claims no more than the rest allows.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use crate::diagnose::work::budget::{Budget, BudgetEnd, SearchPart};
use softrig_formats::instant::Instant;

/// What a diagnosis may still do. Any thread may ask.
#[derive(Debug)]
pub struct Allowance {
    started: Instant,
    budget: Option<Budget>,
    /// Finished fits.
    fits: AtomicUsize,
    /// Shared with the diagnoses of a batch.
    stop: Arc<AtomicBool>,
    /// The time after which it was enough.
    enough: OnceLock<Duration>,
    /// The parts that were not done.
    undone: Mutex<BTreeSet<SearchPart>>,
}

impl Allowance {
    /// With this budget, from now on; without limit if none.
    pub fn within(budget: Option<Budget>) -> Self {
        Self {
            started: Instant::now(),
            budget,
            fits: AtomicUsize::new(0),
            stop: Arc::default(),
            enough: OnceLock::new(),
            undone: Mutex::default(),
        }
    }

    /// For one diagnosis of a batch with this allowance: if that is stopped, so is the diagnosis.
    pub fn of_a_case(&self, budget: Option<Budget>) -> Self {
        Self {
            stop: Arc::clone(&self.stop),
            ..Self::within(budget)
        }
    }

    /// The same for work that has begun before.
    pub fn since(self, started: Instant) -> Self {
        Self { started, ..self }
    }

    /// Time since the beginning.
    pub fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }

    /// Number of finished fits.
    pub fn fits(&self) -> usize {
        self.fits.load(Ordering::Relaxed)
    }

    /// Counts a fit.
    pub fn count(&self) {
        self.fits.fetch_add(1, Ordering::Relaxed);
    }

    /// Notes a part of the search as not done.
    pub fn leave_out(&self, part: SearchPart) {
        self.noted().insert(part);
    }

    /// Whether nothing may begin any more: the budget is spent, or the work was asked to stop.
    pub fn is_over(&self) -> bool {
        match self.budget {
            Some(Budget::Fits(fits)) if self.fits() >= fits => true,
            _ => self.is_interrupted(),
        }
    }

    /// Whether work under way is to end: the time is up, or it was asked to stop. A budget of
    /// fits lets those that have begun end.
    pub fn is_interrupted(&self) -> bool {
        let is_late = self.time().is_some_and(|time| self.elapsed() >= time);
        is_late || self.enough.get().is_some() || self.is_stopped()
    }

    /// Whether the work was asked to stop, so that nobody waits for its answer.
    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// The time of the budget, if it is one.
    pub fn time(&self) -> Option<Duration> {
        match self.budget? {
            Budget::Time(time) => Some(time),
            Budget::Fits(_) => None,
        }
    }

    /// The parts that were not done.
    pub fn undone(&self) -> BTreeSet<SearchPart> {
        self.noted().clone()
    }

    /// The parts that were not done, if the budget has ended the search.
    pub fn ended(&self) -> Option<BudgetEnd> {
        let undone = self.undone();
        let enough = self.enough.get().copied().map(Budget::Time);
        let budget = enough.or(self.budget).filter(|_| !undone.is_empty())?;
        Some(BudgetEnd { budget, undone })
    }

    /// Asks the work to stop: it ends soon, with an answer that nobody waits for.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Ends the search now, as a budget of the time until now does: with a verdict on what was
    /// tried.
    pub fn enough(&self) {
        // In whole seconds, as somebody would give it.
        let whole = self.elapsed().as_secs().max(1);
        let _ = self.enough.set(Duration::from_secs(whole));
    }

    fn noted(&self) -> MutexGuard<'_, BTreeSet<SearchPart>> {
        self.undone.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
