//! From recordings to a verdict: which effect does the model lack?
//!
//! The steps, each a module whose output is data that reports can show:
//!
//! 1. [`noise`]: how small a residual can get.
//! 2. Refit: a wrong parameter is not a missing effect.
//! 3. Adequate? If what is left cannot be told from noise, stop and say so.
//! 4. [`mod@localise`]: where the gap lives.
//! 5. [`candidates`]: simulate and fit every effect of the catalogue.
//! 6. [`select`]: which structure the recordings ask for, alone and in
//!    combination, with rivals that cannot be rejected kept.
//! 7. [`holdout`]: does it also hold on runs that were not fitted?
//! 8. Judge, in this module; the answer is written as a [`verdict`].
//!
//! A false name is worse than "cannot tell".

pub mod candidates;
pub mod holdout;
pub mod identify;
pub mod localise;
pub mod noise;
pub mod select;
pub mod smoother;
pub mod verdict;

use std::collections::BTreeSet;

use model_core::actuator::{MAX_EFFECTS, ParameterId};
use model_core::catalogue::Kind;
use rayon::prelude::*;

use crate::error::InputError;
use crate::fit::{Excerpt, Fit, Fitter, Pieces, Run};
use crate::model_file::{ModelFile, tidy, to_file_units};
use crate::recording::Recording;
use crate::statistics::{correlated_rms, noise_by_differences};
use candidates::{Candidate, Ground, Scales, Untried, applicable, extend, finish, released};
use holdout::{HeldOut, Judge};
use identify::Identifiability;
use localise::{Gap, localise};
use noise::NoiseFloor;
use select::{REJECTED, better_held_out, independent_samples, rank, required_evidence, score};
use verdict::{
    Adequacy, Alternative, Answer, FittedError, HeldOutError, NamedEffect, Place, SCHEMA, Verdict,
};

/// A residual counts as noise if its correlated part stays below this share of
/// the noise floor …
const CORRELATED_SHARE: f64 = 0.15;

/// … and its RMS below this factor of the floor, …
const RMS_FACTOR: f64 = 1.08;

/// … each with as many times what the noise of the measured pressure leaves.
const INPUT_FACTOR: f64 = 1.5;

/// A repair that removes less than this share of the held-out gap explains
/// nothing. In the trials that the design rests on, known effects removed 78 %
/// and more, unknown ones 26 % at most.
const GAP_CUT: f64 = 0.75;

/// Structures that are expanded at the first, second and third effect.
const BEAM: [usize; MAX_EFFECTS] = [1, 3, 3];

/// Single effects that are fitted to the end, and combinations at each size.
const FINISHED: [usize; MAX_EFFECTS] = [6, 4, 4];

/// Candidates whose squared error at a glance is this many times that of the
/// best are not fitted to the end …
const HOPELESS: f64 = 4.0;

/// … except for as many as are shown as rivals.
const RIVALS_SHOWN: usize = 3;

/// What to diagnose.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// The nominal model.
    pub file: &'a ModelFile,
    /// Recordings to fit.
    pub recordings: &'a [Recording],
    /// Recordings to judge by; if empty, each recording is left out in turn.
    pub holdout: &'a [Recording],
    /// Seed of everything random.
    pub seed: u64,
}

/// Everything that a diagnosis found.
#[derive(Clone, Debug)]
pub struct Diagnosis {
    /// The answer.
    pub answer: Answer,
    /// Noise floor of the fitted recordings.
    pub floor: NoiseFloor,
    /// The nominal model against the recordings.
    pub nominal: Fit,
    /// The nominal structure, refitted.
    pub refit: Fit,
    /// The repaired model; the refit where nothing is named.
    pub repaired: Candidate,
    /// Probability of each named effect, in the order of `repaired.added`.
    pub probability: Vec<f64>,
    /// Which parameters of the refit, and of the repaired model, the
    /// recordings determine.
    pub identifiability: [Identifiability; 2],
    /// Held-out errors.
    pub held_out: HeldOut,
    /// Rivals, best first.
    pub alternatives: Vec<Alternative>,
    /// The second axis.
    pub adequacy: Adequacy,
    /// Where the gap of the refit lives.
    pub gap: Gap,
    /// Effects that the recordings cannot speak about.
    pub untried: Vec<Untried>,
}

/// Tells a person what is going on during long work.
pub type Progress<'a> = &'a (dyn Fn(&str) + Sync);

/// Diagnoses a model against recordings.
///
/// # Errors
///
/// Refuses a single recording without others to judge by, and a model that
/// cannot be simulated.
pub fn diagnose(request: &Request<'_>, progress: Progress<'_>) -> Result<Diagnosis, InputError> {
    let Request {
        file,
        recordings,
        holdout,
        ..
    } = *request;
    if recordings.is_empty() || (recordings.len() < 2 && holdout.is_empty()) {
        return Err(InputError::new(
            format!(
                "a diagnosis needs two recordings or more, and {} was given",
                recordings.len()
            ),
            "give more recordings, or name some with --holdout: a cause that was fitted and tested on the same run proves nothing",
        ));
    }
    for recording in recordings.iter().chain(holdout) {
        refuse_without_motion(recording)?;
    }
    let runs = Run::all(recordings);
    let fitter = Fitter {
        nominal: &file.model,
        runs: &runs,
    };
    let held_out_runs = Run::all(holdout);

    progress("noise floor");
    let floor = NoiseFloor::of(recordings);
    let nominal = fitter.compare(&file.model);
    progress("refit of the nominal structure");
    let (refit, determined, identified) = identify::refit(file, &fitter);
    let file = &determined;
    let judge = Judge::new(file, &fitter, &held_out_runs);
    if !refit.fit.sse().is_finite() {
        return Err(InputError::new(
            "the model cannot be simulated over these recordings: it diverges",
            "check units and signs of its parameters",
        )
        .in_file(&file.path));
    }
    let floor = floor.with_input(&fitter, &refit.fit.model, request.seed);
    let gap = localise(&refit.fit.model, recordings, floor.white);

    let mut untried = Vec::new();
    let found = if adequate(&nominal, &floor) {
        Findings::nothing(Answer::NoDiscrepancy, &refit)
    } else if adequate(&refit.fit, &floor) {
        Findings::nothing(Answer::ParametersOnly, &refit)
    } else {
        let (kinds, skipped) = applicable(&file.model, &fitter);
        untried = skipped;
        search(file, &fitter, &judge, &floor, kinds, &refit, progress)
    };

    progress("held-out runs in the board's arithmetic");
    let held_out = judge.errors(&refit, &found.repaired);
    let closed = held_out.gap_closed();
    let is_adequate = adequate(&found.repaired.fit, &floor);
    let adequacy = Adequacy {
        adequate: is_adequate,
        holdout_gap_closed: if found.repaired.added.is_empty() {
            0.0
        } else {
            closed
        },
        exact_form: is_adequate && held_out.at_noise(),
    };
    let identifiability = [
        Identifiability::of(&found.repaired.fit, &identified.held),
        identified,
    ];
    Ok(Diagnosis {
        answer: found.answer,
        identifiability,
        floor,
        nominal,
        refit: refit.fit,
        repaired: found.repaired,
        probability: found.probability,
        held_out,
        alternatives: found.alternatives,
        adequacy,
        gap,
        untried,
    })
}

/// Refuses a recording that says nothing: every model agrees with it.
fn refuse_without_motion(recording: &Recording) -> Result<(), InputError> {
    /// Fewer samples hold no motion.
    const FEWEST: usize = 20;
    let low = recording
        .angle
        .iter()
        .copied()
        .fold(f64::INFINITY, f64::min);
    let high = recording
        .angle
        .iter()
        .copied()
        .fold(f64::NEG_INFINITY, f64::max);
    // White noise alone spans eight of its standard deviations.
    let moves = high - low > 10.0 * noise_by_differences(&recording.angle);
    if recording.len() >= FEWEST && moves {
        return Ok(());
    }
    Err(InputError::new(
        format!(
            "holds no motion: {} samples between {:.2}° and {:.2}°",
            recording.len(),
            low.to_degrees(),
            high.to_degrees()
        ),
        "leave it out, and record a step, a staircase or a swing",
    )
    .in_file(&recording.path))
}

/// Searches the structures that add effects to a fitted nominal model.
fn search(
    file: &ModelFile,
    fitter: &Fitter<'_, '_>,
    judge: &Judge<'_, '_>,
    floor: &NoiseFloor,
    kinds: Vec<Kind>,
    refit: &Candidate,
    progress: Progress<'_>,
) -> Findings {
    let pieces = Pieces::of(fitter);
    let excerpt = Excerpt::of(fitter);
    let nominal = &file.model;
    let search = Search {
        ground: Ground {
            file,
            fitter,
            pieces: &Fitter {
                nominal,
                runs: &pieces.runs(),
            },
            excerpt: &Fitter {
                nominal,
                runs: &excerpt.runs(),
            },
            scales: Scales::of(fitter),
        },
        judge,
        floor,
        kinds,
        progress,
    };
    search.run(refit)
}

/// Whether a residual cannot be told from noise.
fn adequate(fit: &Fit, floor: &NoiseFloor) -> bool {
    let correlated = correlated_rms(&fit.residuals);
    let input = INPUT_FACTOR * floor.input;
    correlated <= (CORRELATED_SHARE * floor.rms).hypot(input)
        && fit.rmse() <= (RMS_FACTOR * floor.rms).hypot(input)
}

/// What a search came to.
struct Findings {
    answer: Answer,
    repaired: Candidate,
    probability: Vec<f64>,
    alternatives: Vec<Alternative>,
}

impl Findings {
    /// An answer that names nothing.
    fn nothing(answer: Answer, refit: &Candidate) -> Self {
        Self {
            answer,
            repaired: refit.clone(),
            probability: Vec::new(),
            alternatives: Vec::new(),
        }
    }
}

fn names(kinds: &[Kind]) -> Vec<String> {
    kinds.iter().map(|kind| kind.name().to_owned()).collect()
}

/// The search over structures.
struct Search<'a, 'r> {
    ground: Ground<'a, 'r>,
    judge: &'a Judge<'a, 'r>,
    floor: &'a NoiseFloor,
    kinds: Vec<Kind>,
    progress: Progress<'a>,
}

impl Search<'_, '_> {
    fn run(&self, refit: &Candidate) -> Findings {
        let pool = self.pool(refit);
        let independent = independent_samples(&pool);
        let chosen = self.choose(&pool, independent);
        let size = pool[chosen].added.len();
        let ranked = rank(&pool, &self.ground.scales, independent, size.max(1));
        let best_score = ranked.first().map_or(0.0, |first| first.score);
        let alternative = |entry: &select::Ranked| Alternative {
            kinds: names(&pool[entry.index].added),
            probability: entry.probability,
            delta_bic: entry.score - best_score,
        };
        if size == 0 && refit.fit.rmse() <= RMS_FACTOR * self.floor.white.hypot(self.floor.input) {
            // A trace of correlation that no effect accounts for, within the
            // noise of the sensors.
            return Findings::nothing(Answer::ParametersOnly, refit);
        }
        if size == 0 || self.judge.gap_closed(refit, &pool[chosen]) < GAP_CUT {
            return Findings {
                alternatives: ranked.iter().take(RIVALS_SHOWN).map(alternative).collect(),
                ..Findings::nothing(Answer::Unexplained, refit)
            };
        }
        let surviving: Vec<_> = ranked
            .iter()
            .filter(|entry| entry.probability >= REJECTED)
            .collect();
        let probability_of = |kind: Kind| {
            ranked
                .iter()
                .filter(|entry| pool[entry.index].added.contains(&kind))
                .map(|entry| entry.probability)
                .sum::<f64>()
        };
        let named = if surviving.len() == 1 {
            Some(pool[chosen].clone())
        } else {
            self.common_core(&pool, &surviving, independent)
                .filter(|core| self.judge.gap_closed(refit, core) >= GAP_CUT)
        };
        let Some(named) = named else {
            return Findings {
                alternatives: surviving.iter().map(|entry| alternative(entry)).collect(),
                ..Findings::nothing(Answer::CannotTell, refit)
            };
        };
        let repaired = self.with_released(named, independent);
        Findings {
            answer: Answer::EffectFound,
            probability: repaired
                .added
                .iter()
                .map(|&kind| probability_of(kind))
                .collect(),
            alternatives: ranked
                .iter()
                .filter(|entry| pool[entry.index].set() != repaired.set())
                .take(RIVALS_SHOWN)
                .map(alternative)
                .collect(),
            repaired,
        }
    }

    /// Fits the refit with each effect alone, then the best of them with each
    /// other effect, up to three, until the residual is noise.
    fn pool(&self, refit: &Candidate) -> Vec<Candidate> {
        let mut pool = vec![refit.clone()];
        let room = MAX_EFFECTS - self.ground.file.model.effects().count();
        for size in 1..=room {
            let best = Self::smallest(&pool, size - 1, BEAM[size - 1]);
            if size > 1 && (best.is_empty() || best.iter().any(|&k| self.is_done(&pool[k].fit))) {
                break;
            }
            (self.progress)(&match size {
                1 => format!("{} effects, one at a time", self.kinds.len()),
                _ => format!("combinations of {size} effects"),
            });
            let bases: Vec<&Candidate> = best.iter().map(|&k| &pool[k]).collect();
            let mut glances = self.extensions(&bases);
            glances.sort_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()));
            let mut seen = BTreeSet::new();
            glances.retain(|candidate| seen.insert(candidate.set()));
            glances.truncate(FINISHED[size - 1]);
            let hopeless = HOPELESS * glances.first().map_or(0.0, |best| best.fit.sse());
            let least = glances.len().min(RIVALS_SHOWN);
            let keep = glances.partition_point(|candidate| candidate.fit.sse() <= hopeless);
            glances.truncate(keep.max(least));
            let finished: Vec<Candidate> = glances
                .par_iter()
                .map(|candidate| finish(&self.ground, candidate))
                .collect();
            pool.extend(finished);
        }
        pool
    }

    /// Whether nothing is left that another effect could explain.
    fn is_done(&self, fit: &Fit) -> bool {
        adequate(fit, self.floor) || fit.rmse() <= self.floor.rms
    }

    /// Every structure in `bases` with every effect that it lacks, at a glance.
    fn extensions(&self, bases: &[&Candidate]) -> Vec<Candidate> {
        let pairs: Vec<(&Candidate, Kind)> = bases
            .iter()
            .flat_map(|&base| {
                self.kinds
                    .iter()
                    .filter(move |kind| !base.added.contains(kind))
                    .map(move |&kind| (base, kind))
            })
            .collect();
        pairs
            .par_iter()
            .filter_map(|(base, kind)| extend(&self.ground, base, *kind))
            .collect()
    }

    /// The `count` structures of `size` effects with the smallest residual.
    fn smallest(pool: &[Candidate], size: usize, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..pool.len())
            .filter(|&k| pool[k].added.len() == size)
            .collect();
        order.sort_by(|&a, &b| pool[a].fit.sse().total_cmp(&pool[b].fit.sse()));
        order.truncate(count);
        order
    }

    /// The structure that the evidence asks for: from none upwards, a larger
    /// one replaces a smaller one if it brings what its effects cost and is
    /// better on runs that were not fitted.
    fn choose(&self, pool: &[Candidate], independent: f64) -> usize {
        let mut chosen = 0;
        let mut chosen_error = None;
        for size in 1..=MAX_EFFECTS {
            let Some(best) = rank(pool, &self.ground.scales, independent, size)
                .first()
                .map(|first| first.index)
            else {
                break;
            };
            let more = size - pool[chosen].added.len();
            let evidence = score(&pool[chosen], &self.ground.scales, independent)
                - score(&pool[best], &self.ground.scales, independent);
            if evidence < required_evidence(more, self.kinds.len()) {
                continue;
            }
            let before = *chosen_error.get_or_insert_with(|| self.judge.error_of(&pool[chosen]));
            let after = self.judge.error_of(&pool[best]);
            if better_held_out(before, after, pool[chosen].added.len()) {
                chosen = best;
                chosen_error = Some(after);
            }
        }
        chosen
    }

    /// What all surviving structures have in common, if that alone explains
    /// most of the gap.
    fn common_core(
        &self,
        pool: &[Candidate],
        surviving: &[&select::Ranked],
        independent: f64,
    ) -> Option<Candidate> {
        let mut core: BTreeSet<Kind> = pool[surviving.first()?.index].set().into_iter().collect();
        for entry in surviving {
            let set = pool[entry.index].set();
            core.retain(|kind| set.contains(kind));
        }
        let core: Vec<Kind> = core.into_iter().collect();
        let candidate = pool
            .iter()
            .find(|candidate| !core.is_empty() && candidate.set() == core)?;
        let evidence = score(pool.first()?, &self.ground.scales, independent)
            - score(candidate, &self.ground.scales, independent);
        (evidence >= required_evidence(core.len(), self.kinds.len())).then(|| candidate.clone())
    }

    /// Frees parameters that are held at first, where the evidence asks for it.
    fn with_released(&self, candidate: Candidate, independent: f64) -> Candidate {
        let Some(freed) = released(&self.ground, &candidate) else {
            return candidate;
        };
        let evidence = score(&candidate, &self.ground.scales, independent)
            - score(&freed, &self.ground.scales, independent);
        let before = self.judge.error_of(&candidate);
        if evidence >= required_evidence(1, 1)
            && better_held_out(before, self.judge.error_of(&freed), candidate.added.len())
        {
            freed
        } else {
            candidate
        }
    }
}

impl Diagnosis {
    /// The verdict as it is written to JSON.
    pub fn verdict(&self, request: &Request<'_>, seconds: f64) -> Verdict {
        let degrees = |radians: f64| tidy(radians.to_degrees());
        let files = request.recordings.iter().chain(request.holdout);
        Verdict {
            schema: SCHEMA,
            verdict: self.answer,
            effects: self.named_effects(),
            alternatives: self.alternatives.clone(),
            adequacy: self.adequacy,
            places: self
                .gap
                .features
                .iter()
                .map(|feature| Place {
                    feature: feature.name.to_owned(),
                    share_of_gap: tidy(feature.share),
                    text: feature.text.clone(),
                })
                .collect(),
            rmse_deg: FittedError {
                nominal: degrees(self.nominal.rmse()),
                refit: degrees(self.refit.rmse()),
                repaired: degrees(self.repaired.fit.rmse()),
                noise_floor: degrees(self.floor.rms),
            },
            holdout_rmse_deg: HeldOutError {
                nominal: degrees(self.held_out.nominal),
                refit: degrees(self.held_out.refit),
                repaired: degrees(self.held_out.repaired_on_board),
            },
            next_experiment: Vec::new(),
            recordings: files.map(|file| file.path.display().to_string()).collect(),
            seed: request.seed,
            tool_version: env!("CARGO_PKG_VERSION").to_owned(),
            seconds,
        }
    }

    fn named_effects(&self) -> Vec<NamedEffect> {
        let fit = &self.repaired.fit;
        let first = fit.model.effects().count() - self.repaired.added.len();
        self.repaired
            .added
            .iter()
            .enumerate()
            .map(|(offset, kind)| {
                let slot = first + offset;
                let mut parameters = serde_json::Map::new();
                let mut interval95 = serde_json::Map::new();
                for (parameter, row) in kind.parameters().iter().enumerate() {
                    let id = ParameterId::Effect { slot, parameter };
                    let shown = |value: f64| tidy(to_file_units(&fit.model, id, value));
                    if let Some(value) = fit.model.value(id) {
                        parameters.insert(row.key.to_owned(), shown(value).into());
                    }
                    let interval = fit
                        .free
                        .iter()
                        .position(|&free| free == id)
                        .and_then(|index| fit.interval95(index));
                    if let Some((low, high)) = interval {
                        interval95.insert(
                            row.key.to_owned(),
                            serde_json::json!([shown(low), shown(high)]),
                        );
                    }
                }
                NamedEffect {
                    kind: kind.name().to_owned(),
                    parameters,
                    interval95,
                    probability: self.probability.get(offset).copied().unwrap_or(0.0),
                }
            })
            .collect()
    }
}
