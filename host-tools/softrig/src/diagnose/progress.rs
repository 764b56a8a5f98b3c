//! Progress of a diagnosis.
//!
//! A [`Progress`] only counts; a caller who shows nothing passes `&Progress::default()`. The
//! number of further fits is known for the present step only, because the outcome of single
//! effects decides whether combinations are tried; how much of the whole is done is said by what
//! each [`Stage`] usually takes. With a [`Budget`], it also tracks when that is spent and which parts
//! were not done.
//!
//! A diagnosis can be asked to stop by [`Progress::stop`], which throws its answer away, or by
//! [`Progress::enough`], which keeps it: to the search ([`super::executor`]) both are a budget that
//! has been spent.

use std::collections::BTreeSet;
use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use model_core::catalogue::Kind;

use super::budget::{Budget, Ended, SearchPart};
use super::candidates::Candidate;
use super::finding::names;
use super::measure::Measured;
use super::policy::Policy;
use crate::clock::Instant;
use softrig_formats::family::{of_all, title};
use softrig_formats::numbers::duration;
use softrig_formats::numbers::{degrees, percent};

/// Counts the work of a diagnosis, or the cases of a batch of them. Any thread may report.
#[derive(Debug)]
pub struct Progress {
    started: Instant,
    budget: Option<Budget>,
    now: Mutex<Now>,
    /// Shared with the diagnoses of a batch.
    stop: Arc<AtomicBool>,
    /// The time after which it was enough.
    enough: OnceLock<Duration>,
    watcher: Option<Watcher>,
}

/// What is told that the work goes on.
struct Watcher(Box<dyn Fn(&Progress) + Send + Sync>);

impl fmt::Debug for Watcher {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Watcher")
    }
}

/// What a progress counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Counts {
    /// The fits of a diagnosis.
    #[default]
    Fits,
    /// The cases of a batch.
    Cases,
}

/// A stage of a diagnosis, in the order in which they come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Reading.
    Reading,
    /// How many samples a budget is enough for.
    Affordable,
    /// Quality of the recordings.
    Quality,
    /// Refit of the nominal structure.
    Refit,
    /// Fits of the effects that the score puts first.
    Leading,
    /// Final fits of the best of them.
    Final,
    /// Coarse fits of all effects.
    Everywhere,
    /// The nominal structure at several horizons.
    Horizons,
    /// Single effects at several horizons.
    Effects,
    /// Combinations at several horizons.
    Combinations,
    /// Final fits of the best of them.
    FinalCombinations,
    /// Selection by validation.
    Selection,
    /// Validation of the model with a table.
    Augmented,
    /// Where the gap lives.
    Gap,
    /// Validation as the board predicts.
    Board,
}

impl Stage {
    /// What is done.
    const fn title(self) -> &'static str {
        match self {
            Self::Reading => "reading the recordings",
            Self::Affordable => "how many samples the time is enough for",
            Self::Quality => "quality of the recordings",
            Self::Refit => "refit of the nominal structure",
            Self::Leading => "fits of the effects that the score puts first",
            Self::Final => "final fits of the best single effects",
            Self::Everywhere => "coarse fits of all effects, one at a time",
            Self::Horizons => "nominal structure at several horizons",
            Self::Effects => "single effects at several horizons",
            Self::Combinations => "combinations of 2 effects at several horizons",
            Self::FinalCombinations => "final fits of the best combinations",
            Self::Selection => "selection by validation",
            Self::Augmented => "validation of the augmented model",
            Self::Gap => "where the gap lives",
            Self::Board => "validation as the board predicts",
        }
    }

    /// The share of the whole that is done at its end. It steers nothing but a bar. Whether a
    /// diagnosis ends with single effects is not known before: one that does not has what is left
    /// then for its horizons, and a bar never goes back.
    const fn ends_at(self) -> f64 {
        match self {
            Self::Reading | Self::Affordable | Self::Quality => 0.01,
            Self::Refit => 0.3,
            Self::Leading => 0.5,
            Self::Final => 0.6,
            Self::Everywhere => 0.66,
            Self::Horizons => 0.68,
            Self::Effects => 0.78,
            Self::Combinations => 0.95,
            Self::FinalCombinations => 0.96,
            Self::Selection => 0.97,
            Self::Augmented | Self::Gap => 0.99,
            Self::Board => 1.0,
        }
    }
}

/// The present stage and step.
#[derive(Debug)]
struct Now {
    counts: Counts,
    /// Why the diagnosis is repeated; empty the first time.
    again: &'static str,
    /// What a case of a batch found; empty in a diagnosis.
    case: String,
    stage: Stage,
    step: &'static str,
    /// Share of the whole that was done when the step began.
    done_before: f64,
    /// When the step began, or the stage if it has none.
    since: Instant,
    planned: usize,
    done: usize,
    fits: usize,
    known: Known,
    best: Option<Best>,
    /// The parts that were not done.
    undone: BTreeSet<SearchPart>,
}

/// What is known before a fit explains anything.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Known {
    /// RMS residual (rad) of the model as supplied.
    pub supplied: Option<f64>,
    /// RMS residual (rad) of the refit of the nominal structure.
    pub refit: Option<f64>,
    /// The effect that the score puts first.
    pub leads: Option<Kind>,
}

/// The best explanation so far.
#[derive(Clone, Debug, PartialEq)]
pub struct Best {
    /// The effects that it adds.
    pub kinds: Vec<Kind>,
    /// Its RMS error (rad).
    pub leaves: f64,
    /// RMS error of the refit (rad), if known.
    pub of: Option<f64>,
    /// Share of the error that it explains on held-out segments; none before its validation.
    pub explains: Option<f64>,
}

/// A snapshot of the progress.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    /// What is counted.
    pub counts: Counts,
    /// The present stage; of a batch, what its last case found.
    pub stage: String,
    /// Finished fits of the present step, or cases.
    pub done: usize,
    /// Planned fits of the present step, or cases; 0 if unknown.
    pub planned: usize,
    /// Finished fits of all steps.
    pub fits: usize,
    /// Time since the beginning.
    pub elapsed: Duration,
    /// Time since the beginning of the present step.
    pub in_step: Duration,
    /// Share of the whole that is done, by what stages usually take: it never falls but where a
    /// diagnosis begins again.
    pub share: f64,
    /// What is known before that.
    pub known: Known,
    /// The best explanation so far.
    pub best: Option<Best>,
}

impl Default for Progress {
    fn default() -> Self {
        let started = Instant::now();
        Self {
            started,
            budget: None,
            now: Mutex::new(Now {
                counts: Counts::Fits,
                again: "",
                case: String::new(),
                stage: Stage::Reading,
                step: "",
                done_before: 0.0,
                since: started,
                planned: 0,
                done: 0,
                fits: 0,
                known: Known::default(),
                best: None,
                undone: BTreeSet::new(),
            }),
            stop: Arc::default(),
            enough: OnceLock::new(),
            watcher: None,
        }
    }
}

impl Progress {
    /// The progress of a search with this budget, from now on; without limit if none.
    pub fn within(budget: Option<Budget>) -> Self {
        Self {
            budget,
            ..Self::default()
        }
    }

    /// The progress of one diagnosis of this batch: if the batch is stopped, so is the diagnosis.
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
            self.leave_out(part);
        }
        may_begin
    }

    /// Notes a part of the search as not done.
    pub fn leave_out(&self, part: SearchPart) {
        self.now().undone.insert(part);
    }

    /// Whether nothing may begin any more: the budget is spent, or the work was asked to stop.
    pub fn is_over(&self) -> bool {
        match self.budget {
            Some(Budget::Fits(fits)) if self.now().fits >= fits => true,
            _ => self.is_interrupted(),
        }
    }

    /// Whether work under way is to end: the time is up, or it was asked to stop. A budget of
    /// fits lets those that have begun end.
    pub fn is_interrupted(&self) -> bool {
        if let Some(Watcher(watcher)) = &self.watcher {
            watcher(self);
        }
        let is_late = self
            .time()
            .is_some_and(|time| self.started.elapsed() >= time);
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
        self.now().undone.clone()
    }

    /// The parts that were not done, if the budget has ended the search.
    pub fn ended(&self) -> Option<Ended> {
        let undone = self.undone();
        let enough = self.enough.get().copied().map(Budget::Time);
        let budget = enough.or(self.budget).filter(|_| !undone.is_empty())?;
        Some(Ended { budget, undone })
    }

    /// Asks the work to stop: it ends soon, with an answer that nobody waits for.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Ends the search now, as a budget of the time until now does: with a verdict on what was
    /// tried.
    pub fn enough(&self) {
        // In whole seconds, as somebody would give it.
        let whole = self.started.elapsed().as_secs().max(1);
        let _ = self.enough.set(Duration::from_secs(whole));
    }

    /// Announces a stage of `planned` fits; 0 if unknown.
    pub fn stage(&self, stage: Stage, planned: usize) {
        let mut now = self.now();
        let ended = now.stage.ends_at();
        now.begin("", planned);
        now.done_before = now.done_before.max(ended);
        now.stage = stage;
        drop(now);
        self.tell();
    }

    fn tell(&self) {
        if let Some(Watcher(watcher)) = &self.watcher {
            watcher(self);
        }
    }

    /// Announces a step of the stage, of `planned` fits.
    pub fn step(&self, what: &'static str, planned: usize) {
        self.now().begin(what, planned);
    }

    /// Announces a batch of `planned` cases.
    pub fn cases(&self, planned: usize) {
        let mut now = self.now();
        now.begin("", planned);
        now.counts = Counts::Cases;
        now.case = "diagnosing".into();
    }

    /// Counts a case of a batch, with what it found in a few words.
    pub fn case(&self, found: String) {
        let mut now = self.now();
        now.done += 1;
        now.case = found;
    }

    /// Announces that the diagnosis is repeated, on other data. The best explanation so far
    /// is dropped.
    pub fn again(&self, why: &'static str) {
        let mut now = self.now();
        now.again = why;
        now.best = None;
        now.known = Known::default();
        now.begin("", 0);
        now.done_before = 0.0;
        now.stage = Stage::Reading;
    }

    /// Notes what is known before a fit explains anything.
    pub fn knows(&self, note: impl FnOnce(&mut Known)) {
        note(&mut self.now().known);
        self.tell();
    }

    /// Counts a fit once the returned value is dropped, also if the fit fails.
    pub fn fit(&self) -> Counted<'_> {
        Counted(self)
    }

    /// Offers a fit as the best so far.
    pub fn fitted(&self, candidate: &Candidate) {
        let mut now = self.now();
        let best = Best {
            kinds: candidate.set(),
            leaves: candidate.fit.rmse(),
            of: now.known.refit,
            explains: None,
        };
        now.offer(best);
    }

    /// Offers a measured structure as the best so far, with the RMS error (rad) of the refit
    /// on held-out segments.
    pub fn measured(&self, row: &Measured, refit: f64) {
        self.now().offer(Best {
            kinds: row.estimate.set(),
            leaves: row.row.held_out.full,
            of: Some(refit),
            explains: Some(row.closure.overall),
        });
    }

    /// A snapshot of the progress.
    pub fn state(&self) -> State {
        let now = self.now();
        let mut stage = String::new();
        let title = match now.counts {
            Counts::Fits => now.stage.title(),
            Counts::Cases => &now.case,
        };
        for part in [now.again, title, now.step] {
            if !part.is_empty() {
                stage += if stage.is_empty() { "" } else { ": " };
                stage += part;
            }
        }
        State {
            counts: now.counts,
            stage,
            done: now.done,
            planned: now.planned,
            fits: now.fits,
            elapsed: self.started.elapsed(),
            in_step: now.since.elapsed(),
            share: now.share(),
            known: now.known,
            best: now.best.clone(),
        }
    }

    fn now(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Now {
    fn begin(&mut self, step: &'static str, planned: usize) {
        self.done_before = self.share();
        self.step = step;
        self.since = Instant::now();
        self.planned = planned;
        self.done = 0;
    }

    fn share(&self) -> f64 {
        let done = self.done as f64 / self.planned.max(1) as f64;
        if self.counts == Counts::Cases {
            return done;
        }
        // Further steps may follow in the stage.
        let step = if self.step.is_empty() { 1.0 } else { 0.5 };
        let left = (self.stage.ends_at() - self.done_before).max(0.0);
        self.done_before + step * done.min(1.0) * left
    }

    fn offer(&mut self, best: Best) {
        let helps = best.leaves < best.of.unwrap_or(f64::INFINITY);
        if helps && self.best.as_ref().is_none_or(|before| best.beats(before)) {
            self.best = Some(best);
        }
    }
}

/// A running fit, which counts as finished once this is dropped.
#[derive(Debug)]
#[must_use = "the fit counts as finished once this is dropped"]
pub struct Counted<'a>(&'a Progress);

impl Drop for Counted<'_> {
    fn drop(&mut self) {
        let mut now = self.0.now();
        now.done += 1;
        now.fits += 1;
    }
}

impl Best {
    /// Whether it replaces `other`: a measured structure goes before one that was only
    /// fitted, and a larger one counts only if the decision would take it.
    fn beats(&self, other: &Self) -> bool {
        let left = match (self.explains, other.explains) {
            (Some(explains), Some(other)) => [1.0 - explains, 1.0 - other],
            (None, None) => [self.leaves, other.leaves],
            (measured, _) => return measured.is_some(),
        };
        let further = Policy::STANDARD.further_leaves;
        match self.kinds.len().cmp(&other.kinds.len()) {
            std::cmp::Ordering::Greater => left[0] <= further * left[1],
            std::cmp::Ordering::Equal => left[0] < left[1],
            std::cmp::Ordering::Less => further * left[0] < left[1],
        }
    }
}

impl fmt::Display for Best {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let families = title(&of_all(&self.kinds));
        let effects = names(&self.kinds).join(" + ");
        write!(f, "{families} ({effects}), leaves {}", degrees(self.leaves))?;
        if let Some(of) = self.of {
            write!(f, " of {}", degrees(of))?;
        }
        match self.explains {
            Some(share) => write!(
                f,
                " on validation runs, explains {}",
                percent(share.max(0.0))
            ),
            None => f.write_str(" on fitted runs, not yet validated"),
        }
    }
}

impl State {
    /// Remaining time of the present step, from its finished fits; none before a tenth of
    /// them are finished, and in the first second.
    pub fn remaining(&self) -> Option<Duration> {
        let enough = self.done >= 2
            && 10 * self.done >= self.planned
            && self.in_step >= Duration::from_secs(1);
        let left = self.planned.checked_sub(self.done).filter(|_| enough)?;
        (left > 0).then(|| self.in_step.mul_f64(left as f64 / self.done as f64))
    }

    /// Fits, time and the estimate for the present step, in words.
    pub fn how_far(&self) -> String {
        let mut text = match (self.planned, self.fits) {
            (planned, _) if self.counts == Counts::Cases => {
                format!("{} of {planned} cases, ", self.done)
            }
            (0, 0) => String::new(),
            (0, fits) => format!("{fits} fits, "),
            (planned, fits) if fits == self.done => {
                format!("{} of {planned} fits, ", self.done)
            }
            (planned, fits) => {
                format!("{} of {planned} fits ({fits} in all), ", self.done)
            }
        };
        text += &format!("{} so far", duration(self.elapsed));
        if let Some(remaining) = self.remaining() {
            let step = match self.counts {
                Counts::Fits => "this step ",
                Counts::Cases => "",
            };
            text += &format!(", {step}about {} more", about(remaining));
        }
        text
    }

    /// The best explanation so far, or what is known before there is one.
    pub fn best_so_far(&self) -> String {
        if let Some(best) = &self.best {
            return format!("best so far: {best}");
        }
        let mut text = match (self.known.refit, self.known.supplied) {
            (Some(refit), _) => format!("so far: refitted, the model misses by {}", degrees(refit)),
            (None, Some(supplied)) => {
                format!(
                    "so far: as supplied, the model misses by {}",
                    degrees(supplied)
                )
            }
            (None, None) => return "no explanation so far".into(),
        };
        if let Some(kind) = self.known.leads {
            let family = title(&of_all(&[kind]));
            text += &format!(
                "; that looks most like {family} ({})",
                names(&[kind]).join(" + ")
            );
        }
        text
    }
}

/// All of it in one line.
impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; {}", self.stage, self.how_far())?;
        match self.counts {
            Counts::Fits => write!(f, "; {}", self.best_so_far()),
            Counts::Cases => Ok(()),
        }
    }
}

/// A rounded estimate: 7 s, 40 s, 3 min.
fn about(time: Duration) -> String {
    let in_units = |unit: u64| Duration::from_secs((time.as_secs() + unit / 2) / unit * unit);
    match time.as_secs() {
        0..10 => duration(in_units(1).max(Duration::from_secs(1))),
        10..90 => format!("{} s", in_units(10).as_secs()),
        _ => duration(in_units(60)).trim_end_matches(" 0 s").to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Kind::{CoulombFriction, Gravity, MaxwellBranch};

    /// An explanation that was measured if it says how much it explains.
    fn found(kinds: &[Kind], leaves: f64, explains: Option<f64>) -> Best {
        Best {
            kinds: kinds.to_vec(),
            leaves,
            of: Some(1.0),
            explains,
        }
    }

    #[test]
    fn fits_count_for_their_step_and_for_all() {
        let progress = Progress::default();
        progress.stage(Stage::Effects, 2);
        drop(progress.fit());
        let unfinished = progress.fit();
        let counts = |state: &State| (state.done, state.planned, state.fits);
        assert_eq!(counts(&progress.state()), (1, 2, 1));
        drop(unfinished);
        progress.step("screening", 100);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| (0..20).for_each(|_| drop(progress.fit())));
            }
        });
        let state = progress.state();
        assert_eq!(counts(&state), (80, 100, 82));
        assert_eq!(state.stage, "single effects at several horizons: screening");
        progress.again("once more");
        progress.stage(Stage::Quality, 0);
        let state = progress.state();
        assert_eq!(counts(&state), (0, 0, 82));
        assert_eq!(state.stage, "once more: quality of the recordings");
    }

    /// Whatever stages come, in whatever steps, the bar goes on and ends at the whole; and once
    /// more is from the beginning.
    #[test]
    fn a_bar_never_goes_back() {
        use Stage::*;
        let paths = [
            vec![
                Quality, Refit, Leading, Final, Selection, Augmented, Gap, Board,
            ],
            vec![
                Quality,
                Refit,
                Leading,
                Final,
                Everywhere,
                Final,
                Horizons,
                Effects,
                Combinations,
                FinalCombinations,
                Selection,
                Augmented,
                Gap,
                Board,
            ],
        ];
        for path in paths {
            let progress = Progress::default();
            let mut last = 0.0;
            let mut goes_on = |progress: &Progress| {
                let share = progress.state().share;
                assert!((last..=1.0).contains(&share), "{share} after {last}");
                last = share;
            };
            for stage in path {
                progress.stage(stage, 3);
                goes_on(&progress);
                for step in ["", "fits", "validation"] {
                    progress.step(step, 2);
                    for _ in 0..3 {
                        drop(progress.fit());
                        goes_on(&progress);
                    }
                }
            }
            assert!(last > 0.99, "{last}");
            progress.again("once more");
            assert!(progress.state().share < 0.01);
            // What a stage without any fit has taken is done after it.
            progress.stage(Refit, 0);
            progress.stage(Leading, 8);
            assert!(progress.state().share >= Refit.ends_at());
        }
    }

    #[test]
    fn a_batch_counts_its_cases_and_stops_their_diagnoses() {
        let batch = Progress::default();
        batch.cases(3);
        let case = batch.of_a_case(None);
        drop(case.fit());
        batch.case("a  no_discrepancy".into());
        let said = batch.state().to_string();
        assert!(
            said.starts_with("a  no_discrepancy; 1 of 3 cases, ") && said.ends_with(" so far"),
            "{said}"
        );
        assert!(!case.is_over());
        batch.stop();
        assert!(case.is_over() && case.is_stopped());
    }

    #[test]
    fn work_that_is_asked_to_stop_is_over() {
        let progress = Progress::default();
        assert!(!progress.is_over());
        progress.stop();
        assert!(progress.is_interrupted() && !progress.may_begin(SearchPart::Table));
    }

    /// With one thread, whoever is told of the progress is all who can end the work.
    #[test]
    fn whoever_watches_can_end_the_search_as_a_budget_does() {
        let progress = Progress::default().watched_by(|progress| {
            if progress.state().fits > 1 {
                progress.enough();
            }
        });
        drop(progress.fit());
        assert!(progress.may_begin(SearchPart::Table));
        drop(progress.fit());
        assert!(!progress.may_begin(SearchPart::Table));
        let ended = progress.ended().unwrap();
        assert_eq!(ended.budget, Budget::Time(Duration::from_secs(1)));
        assert!(ended.lacks(SearchPart::Table));
    }

    #[test]
    fn what_there_is_no_time_for_is_noted() {
        let progress = Progress::within(Some(Budget::Fits(2)));
        assert!(progress.may_begin(SearchPart::Alone(Gravity)));
        assert_eq!(progress.ended(), None);
        (0..2).for_each(|_| drop(progress.fit()));
        assert!(!progress.may_begin(SearchPart::Alone(MaxwellBranch)));
        assert!(!progress.may_begin(SearchPart::Combinations));
        let undone = progress.ended().unwrap().undone;
        let expected = [SearchPart::Alone(MaxwellBranch), SearchPart::Combinations];
        assert_eq!(undone, expected.into_iter().collect());
        let hours = Progress::within(Some(Budget::Time(Duration::from_secs(7200))));
        assert!(hours.may_begin(SearchPart::Table));
        let none = Progress::within(Some(Budget::Time(Duration::ZERO)));
        assert!(!none.may_begin(SearchPart::Table));
        assert!(Progress::within(None).may_begin(SearchPart::Table));
    }

    #[test]
    fn a_larger_structure_has_to_leave_much_less_to_be_best() {
        let pair = [CoulombFriction, Gravity];
        let progress = Progress::default();
        let best_after = |kinds: &[Kind], closes: f64| {
            progress
                .now()
                .offer(found(kinds, 1.0 - closes, Some(closes)));
            progress.state().best.unwrap().kinds
        };
        assert_eq!(best_after(&[Gravity], 0.6), [Gravity]);
        assert_eq!(best_after(&[MaxwellBranch], 0.5), [Gravity]);
        assert_eq!(best_after(&pair, 0.75), [Gravity]);
        assert_eq!(best_after(&pair, 0.77), pair);
        assert_eq!(best_after(&[MaxwellBranch], 0.61), pair);
        assert_eq!(best_after(&[MaxwellBranch], 0.63), [MaxwellBranch]);
        progress.again("once more");
        assert_eq!(progress.state().best, None);
    }

    #[test]
    fn a_fit_gives_way_to_a_measurement_and_must_help() {
        let progress = Progress::default();
        let left_after = |leaves, explains| {
            progress.now().offer(found(&[Gravity], leaves, explains));
            progress.state().best.map(|best| best.leaves)
        };
        assert_eq!(left_after(1.2, None), None);
        assert_eq!(left_after(f64::NAN, None), None);
        assert_eq!(left_after(0.5, None), Some(0.5));
        assert_eq!(left_after(0.6, None), Some(0.5));
        assert_eq!(left_after(0.7, Some(0.3)), Some(0.7));
        assert_eq!(left_after(0.1, None), Some(0.7));
    }

    #[test]
    fn a_line_says_where_how_far_and_what() {
        let state = State {
            counts: Counts::Fits,
            stage: "27 effects at several horizons: screening".into(),
            done: 12,
            planned: 54,
            fits: 63,
            elapsed: Duration::from_secs(200),
            in_step: Duration::from_secs(24),
            share: 0.7,
            known: Known::default(),
            best: Some(Best {
                kinds: vec![CoulombFriction, Gravity],
                leaves: 0.39_f64.to_radians(),
                of: Some(1.214_f64.to_radians()),
                explains: Some(0.712),
            }),
        };
        assert_eq!(
            state.to_string(),
            "27 effects at several horizons: screening; 12 of 54 fits (63 in all), \
             3 min 20 s so far, this step about 80 s more; \
             best so far: dry friction + stiffness shape (coulomb_friction + gravity), \
             leaves 0.390° of 1.21° on validation runs, explains 71 %"
        );
        let begun = State {
            stage: "refit of the nominal structure".into(),
            ..State::default()
        };
        assert_eq!(
            begun.to_string(),
            "refit of the nominal structure; 0 s so far; no explanation so far"
        );
        let known = |refit, leads| State {
            known: Known {
                supplied: Some(0.1),
                refit,
                leads,
            },
            ..State::default()
        };
        for (refit, leads, said) in [
            (None, None, "so far: as supplied, the model misses by 5.73°"),
            (
                Some(0.01),
                None,
                "so far: refitted, the model misses by 0.573°",
            ),
            (
                Some(0.01),
                Some(Gravity),
                "so far: refitted, the model misses by 0.573°; that looks most like stiffness shape (gravity)",
            ),
        ] {
            assert_eq!(known(refit, leads).best_so_far(), said);
        }
        let coarse = Best {
            kinds: vec![Gravity],
            leaves: 0.01,
            of: None,
            explains: None,
        };
        assert_eq!(
            coarse.to_string(),
            "stiffness shape (gravity), leaves 0.573° on fitted runs, not yet validated"
        );
    }

    #[test]
    fn an_estimate_waits_for_a_tenth_and_is_no_finer_than_it_deserves() {
        let state = |done, planned, seconds| State {
            done,
            planned,
            in_step: Duration::from_secs(seconds),
            ..State::default()
        };
        let none = [(0, 0), (1, 4), (5, 54), (4, 4), (7, 4), (3, 0)];
        for (done, planned) in none {
            assert_eq!(
                state(done, planned, 60).remaining(),
                None,
                "{done}/{planned}"
            );
        }
        assert_eq!(state(27, 54, 0).remaining(), None);
        let remaining = state(6, 54, 60).remaining().unwrap();
        assert_eq!(remaining, Duration::from_secs(480));
        for (seconds, text) in [
            (0.2, "1 s"),
            (7.4, "7 s"),
            (44.0, "40 s"),
            (89.0, "90 s"),
            (100.0, "2 min"),
            (3600.0, "1 h 0 min"),
        ] {
            assert_eq!(about(Duration::from_secs_f64(seconds)), text);
        }
    }
}
