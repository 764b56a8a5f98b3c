//! How far a diagnosis is, for those who wait for it.
//!
//! A [`Progress`] only reports: nothing asks it whether to go on. The
//! number of further fits is known for the present step only, because the outcome of single
//! effects decides whether combinations are tried; how much of the whole is done is said by what
//! each [`Stage`] usually takes.

use std::fmt;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use model_core::catalogue::Kind;

use crate::diagnose::work::policy::Policy;
use softrig_formats::instant::Instant;
use softrig_formats::measurand::Measurand;
use softrig_formats::numbers::{duration, percent};

/// Reports on the work of a diagnosis, or on the cases of a batch of them. Any thread may report.
#[derive(Debug)]
pub struct Progress {
    now: Mutex<Now>,
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
    /// Terms of the grammar.
    Terms,
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
            Self::Affordable => "number of samples that fit the time",
            Self::Quality => "quality of the recordings",
            Self::Refit => "refit of the nominal structure",
            Self::Leading => "fits of the highest-ranked effects",
            Self::Final => "final fits of the best single effects",
            Self::Everywhere => "coarse fits of all effects, one at a time",
            Self::Terms => "formulas beyond the catalogue",
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
            Self::Terms => 0.7,
            Self::Horizons => 0.72,
            Self::Effects => 0.8,
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
    known: Known,
    best: Option<Best>,
    measurand: Measurand,
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
    /// RMS error of the refit (rad) there, if known; of fitted segments it is what is known.
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
    /// Share of the whole that is done, by what stages usually take: it never falls, except where a
    /// diagnosis begins again.
    pub share: f64,
    /// What is known before that.
    pub known: Known,
    /// The best explanation so far.
    pub best: Option<Best>,
    /// Name and unit of the output, in which errors are shown.
    pub measurand: Measurand,
}

impl Default for Progress {
    fn default() -> Self {
        Self {
            now: Mutex::new(Now {
                counts: Counts::Fits,
                again: "",
                case: String::new(),
                stage: Stage::Reading,
                step: "",
                done_before: 0.0,
                since: Instant::now(),
                planned: 0,
                done: 0,
                known: Known::default(),
                best: None,
                measurand: Measurand::default(),
            }),
        }
    }
}

impl Progress {
    /// Announces a stage of `planned` fits; 0 if unknown.
    pub fn stage(&self, stage: Stage, planned: usize) {
        let mut now = self.now();
        let ended = now.stage.ends_at();
        now.begin("", planned);
        now.done_before = now.done_before.max(ended);
        now.stage = stage;
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

    /// Says what the output is, in whose unit errors are shown.
    pub fn shows(&self, measurand: Measurand) {
        self.now().measurand = measurand;
    }

    /// Notes what is known before a fit explains anything.
    pub fn knows(&self, note: impl FnOnce(&mut Known)) {
        note(&mut self.now().known);
    }

    /// Counts a fit of the present step.
    pub fn count(&self) {
        self.now().done += 1;
    }

    /// Offers an explanation as the best so far.
    pub fn offer(&self, best: Best) {
        self.now().offer(best);
    }

    /// A snapshot, without time and fits since the beginning.
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
            fits: 0,
            elapsed: Duration::ZERO,
            in_step: now.since.elapsed(),
            share: now.share(),
            known: now.known,
            best: now.best.clone(),
            measurand: now.measurand.clone(),
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

    fn offer(&mut self, mut best: Best) {
        best.of = best.of.or(self.known.refit);
        let helps = best.leaves < best.of.unwrap_or(f64::INFINITY);
        if helps && self.best.as_ref().is_none_or(|before| best.beats(before)) {
            self.best = Some(best);
        }
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

    /// In words, with the effects as the verdict names them.
    fn said(&self, measurand: &Measurand) -> String {
        let effects: Vec<&str> = self.kinds.iter().map(|kind| kind.info().title).collect();
        let leaves = measurand.value(self.leaves);
        let mut text = format!("{}, leaves {leaves}", effects.join(" and "));
        if let Some(of) = self.of {
            text += &format!(" of {}", measurand.value(of));
        }
        text += &match self.explains {
            Some(share) => {
                let share = percent(share.max(0.0));
                format!(" on validation runs, explains {share}")
            }
            None => " on fitted runs, not yet validated".to_owned(),
        };
        text
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

    /// The best explanation so far, if there is one.
    pub fn best_explanation(&self) -> Option<String> {
        self.best.as_ref().map(|best| best.said(&self.measurand))
    }

    /// The best explanation so far, or what is known before there is one.
    pub fn best_so_far(&self) -> String {
        if let Some(best) = self.best_explanation() {
            return format!("best so far: {best}");
        }
        let value = |misses| self.measurand.value(misses);
        let mut text = match (self.known.refit, self.known.supplied) {
            (Some(refit), _) => format!("so far: refitted, the model misses by {}", value(refit)),
            (None, Some(supplied)) => {
                format!(
                    "so far: as supplied, the model misses by {}",
                    value(supplied)
                )
            }
            (None, None) => return "no explanation so far".into(),
        };
        if let Some(kind) = self.known.leads {
            text += &format!("; that looks most like {}", kind.info().title);
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
                        progress.count();
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
    fn a_larger_structure_has_to_leave_much_less_to_be_best() {
        let pair = [CoulombFriction, Gravity];
        let progress = Progress::default();
        let best_after = |kinds: &[Kind], closes: f64| {
            progress.offer(found(kinds, 1.0 - closes, Some(closes)));
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
            progress.offer(found(&[Gravity], leaves, explains));
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
            measurand: Measurand::default(),
        };
        assert_eq!(
            state.to_string(),
            "27 effects at several horizons: screening; 12 of 54 fits (63 in all), \
             3 min 20 s so far, this step about 80 s more; \
             best so far: Coulomb friction and gravity, \
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
                "so far: refitted, the model misses by 0.573°; that looks most like gravity",
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
            coarse.said(&Measurand::default()),
            "gravity, leaves 0.573° on fitted runs, not yet validated"
        );
        assert_eq!(
            coarse.said(&Measurand::of_column("position_mm")),
            "gravity, leaves 0.573 mm on fitted runs, not yet validated"
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
