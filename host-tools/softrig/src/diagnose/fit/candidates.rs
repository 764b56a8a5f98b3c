//! Candidates: the nominal structure with effects added, and fitted.
//!
//! A candidate is fitted from several initial guesses. An effect and the base parameters
//! trade off against each other, so that a single guess often ends in the wrong local
//! minimum.

use model_core::actuator::{MAX_EFFECTS, Model, ParameterId};
use model_core::catalogue::{Effect, Kind};
use model_core::effects::{Mechanism, Place};

use crate::diagnose::recordings::needs::{Shown, unmet};
use crate::diagnose::score::scales::{Scales, combinations, held_value};
use crate::diagnose::score::{Guess, Guesses};
use crate::diagnose::work::executor::{Executor, FIRST_STEPS, NoFit};
use crate::diagnose::work::policy::Policy;
use crate::diagnose::work::progress::Best;
use crate::estimate::filter::Level;
use crate::estimate::fit::{Effort, Fit};
use crate::estimate::fitter::Fitter;
use softrig_formats::model_file::{ModelFile, parameter_name, parameters};

/// A structure (the effects added) with its fit.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Effects added to the nominal model, in the order of the model.
    pub added: Vec<Kind>,
    /// The fit.
    pub fit: Fit,
    /// The prediction horizon of the fit; none for output error.
    pub level: Option<Level>,
}

impl Candidate {
    /// A structure fitted by output error whose last `count` effects were added. Their names are
    /// those of the fitted model, so that none carries another's parameters.
    pub fn of(count: usize, fit: Fit) -> Self {
        let kinds: Vec<Kind> = fit.model.effects().map(|effect| effect.kind()).collect();
        Self {
            added: kinds[kinds.len().saturating_sub(count)..].to_vec(),
            fit,
            level: None,
        }
    }

    /// Names of the parameters that ended at a bound of their search range.
    pub fn at_bound(&self) -> Vec<String> {
        let fit = &self.fit;
        fit.free
            .iter()
            .enumerate()
            .filter(|(index, _)| fit.at_bound(*index))
            .map(|(_, &id)| parameter_name(&fit.model, id))
            .collect()
    }

    /// Whether an added effect ended as its special case: a parameter that the special
    /// case lacks cannot be distinguished from a bound of its range. Example: Stribeck
    /// friction without a peak at low rates is Coulomb friction.
    pub fn is_degenerate(&self) -> bool {
        let fit = &self.fit;
        let first = fit.model.effects().count() - self.added.len();
        fit.free.iter().enumerate().any(|(index, &id)| {
            let ParameterId::Effect { slot, parameter } = id else {
                return false;
            };
            let Some(kind) = slot.checked_sub(first).and_then(|it| self.added.get(it)) else {
                return false;
            };
            let own = kind.parameters().get(parameter).map(|row| row.key);
            kind.info()
                .special_case
                .is_some_and(|special| special.parameters().iter().all(|row| Some(row.key) != own))
                && fit.reaches_bound(index)
        })
    }

    /// The added effects in the order of the catalogue: structures that differ only in
    /// order are the same.
    pub fn set(&self) -> Vec<Kind> {
        let mut set = self.added.clone();
        set.sort_unstable();
        set
    }

    /// As it is shown while the search goes on.
    pub fn so_far(&self) -> Best {
        Best {
            kinds: self.set(),
            leaves: self.fit.rmse(),
            of: None,
            explains: None,
        }
    }
}

/// An effect of typical size, at which fits start.
pub fn typical(kind: Kind, scales: &Scales) -> Option<Effect<f64>> {
    let values: Vec<f64> = kind
        .parameters()
        .iter()
        .map(|row| match (row.held, row.starts.last()) {
            (Some(held), _) => held_value(row, held, scales),
            (None, Some(start)) => f64::from(*start) * scales.size(row),
            (None, None) => 1.0,
        })
        .collect();
    kind.build(&values)
}

/// A structure with one effect added, by a final fit.
///
/// # Errors
///
/// Like [`coarse_fit`] and [`final_fit`].
pub fn added(context: &FitContext<'_>, base: &Candidate, kind: Kind) -> Result<Candidate, NoFit> {
    let predicted = predicted(context, base, kind, Starts::Scored)?;
    final_fit(context, &coarse_fit(context, &predicted)?, Effort::Full)
}

/// Why an effect was not tried.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkippedEffect {
    /// The effect.
    pub kind: Kind,
    /// The reason, as a clause.
    pub reason: &'static str,
}

/// The applicable effects of the catalogue, but `without` some, and of the user's `own`, and the others with
/// the reason why they are not.
pub fn applicable(
    nominal: &Model<f64>,
    own: &[Kind],
    without: &[String],
    fitter: &Fitter<'_>,
) -> (Vec<Kind>, Vec<SkippedEffect>) {
    let shown = Shown::by(fitter.data);
    let mut tried = Vec::new();
    let mut untried = Vec::new();
    for &kind in Kind::NAMES.iter().chain(own) {
        let is_this = |effect: Effect<f64>| effect.kind().name() == kind.name();
        if nominal.effects().any(is_this) {
            untried.push(SkippedEffect {
                kind,
                reason: "the model has it already",
            });
        } else if without.iter().any(|name| name == kind.name()) {
            untried.push(SkippedEffect {
                kind,
                reason: "it was asked for without it",
            });
        } else if let Some(need) = shown.unmet(kind) {
            untried.push(SkippedEffect {
                kind,
                reason: unmet(need),
            });
        } else {
            tried.push(kind);
        }
    }
    (tried, untried)
}

/// The free parameters of a structure: those of the nominal model, and those
/// of the added effects that are not held.
pub fn free_parameters(file: &ModelFile, added: &[Kind]) -> Vec<ParameterId> {
    let first = file.model.effects().count();
    let mut free = file.free.clone();
    for (offset, kind) in added.iter().enumerate() {
        for (parameter, row) in kind.parameters().iter().enumerate() {
            if row.held.is_none() {
                free.push(ParameterId::Effect {
                    slot: first + offset,
                    parameter,
                });
            }
        }
    }
    free
}

/// The context of candidate fits: data, scales and progress.
#[derive(Clone, Copy, Debug)]
pub struct FitContext<'a> {
    /// The nominal model.
    pub file: &'a ModelFile,
    /// The recordings.
    pub fitter: &'a Fitter<'a>,
    /// The same recordings in short segments, for initial guesses; none if the
    /// refitted model stays in phase with the recordings.
    pub short_segments: Option<&'a Fitter<'a>>,
    /// A subsample of the recordings, to rank initial guesses and candidates.
    pub subsample: &'a Fitter<'a>,
    /// Scales of forces, angles and rates.
    pub scales: &'a Scales,
    /// What the missing force suggests.
    pub guesses: &'a Guesses,
    /// What runs the fits.
    pub executor: Executor<'a>,
}

/// An effect added to a fitted structure, where its fit begins.
#[derive(Clone, Debug)]
pub struct Extension {
    /// The effects, the new one last.
    pub added: Vec<Kind>,
    /// The best initial guesses.
    starts: Vec<Model<f64>>,
    /// Whether they come from the score, which expects zeros where they are without any fit.
    is_scored: bool,
}

impl Extension {
    /// Two effects beside those of `base`, from one initial guess.
    pub fn of_start(base: &Candidate, pair: [Kind; 2], start: Model<f64>) -> Self {
        Self {
            added: base.added.iter().copied().chain(pair).collect(),
            starts: vec![start],
            is_scored: false,
        }
    }

    /// The effects in the order of the catalogue.
    pub fn set(&self) -> Vec<Kind> {
        let mut set = self.added.clone();
        set.sort_unstable();
        set
    }
}

/// Where the fit of a further effect begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Starts {
    /// Where the views say that rank it, if they say anything.
    Scored,
    /// At the best of what all views say, and of all combinations of the catalogue's values.
    Everywhere,
}

/// One further effect at the best of its initial guesses, by a score test of each.
///
/// # Errors
///
/// If the model is full or cannot be simulated with the effect, or the time was up.
pub fn predicted(
    context: &FitContext<'_>,
    base: &Candidate,
    kind: Kind,
    from: Starts,
) -> Result<Extension, NoFit> {
    /// Number of initial guesses to keep.
    const BEST: usize = 2;
    context.executor.check()?;
    let file = context.file;
    if file.model.effects().count() + base.added.len() >= MAX_EFFECTS {
        return Err(NoFit::Diverged);
    }
    let mut added = base.added.clone();
    added.push(kind);
    let free = free_parameters(file, &added);
    if from == Starts::Scored {
        let starts = guessed(context, base, kind, from);
        if !starts.is_empty() {
            return Ok(Extension {
                added,
                starts,
                is_scored: true,
            });
        }
    }
    let starts = starts(context, base, kind);
    let best = context
        .subsample
        .least_predicted(&starts.as_fitted, &free, BEST);
    if best.is_empty() {
        return Err(NoFit::Diverged);
    }
    let mut starts_on: Vec<Model<f64>> = best.into_iter().map(|(_, model)| model).collect();
    let swinging = context
        .subsample
        .least_predicted(&starts.swinging, &free, 1);
    starts_on.extend(swinging.into_iter().map(|(_, model)| model));
    // Where simulation and measurement are out of phase, whole runs have too many
    // local minima: short segments give the initial guesses.
    if let Some(short_segments) = context.short_segments
        && !added.iter().any(|kind| remembers(*kind))
    {
        let from = &starts.as_fitted;
        match context
            .executor
            .best_of(short_segments, from, &free, Effort::Coarse)
        {
            Ok(fit) => starts_on.push(fit.model),
            Err(NoFit::Diverged) => {}
            Err(NoFit::NotReached) => return Err(NoFit::NotReached),
        }
    }
    Ok(Extension {
        added,
        starts: starts_on,
        is_scored: false,
    })
}

/// A coarse fit to the subsample.
///
/// # Errors
///
/// If the structure cannot be simulated, or the time was up.
pub fn coarse_fit(context: &FitContext<'_>, predicted: &Extension) -> Result<Candidate, NoFit> {
    coarse_fit_below(context, predicted, f64::INFINITY)
}

/// A coarse fit to the subsample, which ends after its first steps if it leaves more than that
/// (rad²) then.
///
/// # Errors
///
/// If the structure cannot be simulated, or the time was up.
pub fn coarse_fit_below(
    context: &FitContext<'_>,
    predicted: &Extension,
    most: f64,
) -> Result<Candidate, NoFit> {
    let _job = context.executor.begin()?;
    let free = free_parameters(context.file, &predicted.added);
    let starts = &predicted.starts;
    let part = context.subsample.data;
    let expecting = predicted.is_scored.then(|| part.guessing(&part.expected()));
    let fitter = Fitter {
        data: expecting.as_ref().unwrap_or(part),
        ..*context.subsample
    };
    let executor = &context.executor;
    let count = predicted.added.len();
    if most.is_finite() {
        let nearest = executor.best_of(&fitter, starts, &free, FIRST_STEPS)?;
        if nearest.sse() > most {
            return Ok(Candidate::of(count, nearest));
        }
        let fit = executor.fit(&fitter, &nearest.model, &free, Effort::Coarse)?;
        return Ok(Candidate::of(count, fit));
    }
    let fit = executor.best_of(&fitter, starts, &free, Effort::Coarse)?;
    Ok(Candidate::of(count, fit))
}

/// Whether an effect has a memory.
fn remembers(kind: Kind) -> bool {
    kind.info().place == Place::Input
        || kind
            .build(&vec![1.0; kind.parameters().len()])
            .is_some_and(|effect| {
                Mechanism::<f64>::integrates(&effect) || Mechanism::<f64>::has_memory(&effect)
            })
}

/// The final fit of a candidate, from its coarse fit.
///
/// # Errors
///
/// If the time was up.
pub fn final_fit(
    context: &FitContext<'_>,
    candidate: &Candidate,
    effort: Effort,
) -> Result<Candidate, NoFit> {
    let _job = context.executor.begin()?;
    let free = free_parameters(context.file, &candidate.added);
    let all = context.fitter.data;
    // Zeros go with the parameters, if the subsample holds every session.
    let guessed = (candidate.fit.nuisances.len() == all.sessions().len())
        .then(|| all.guessing(&candidate.fit.nuisances));
    let fitter = Fitter {
        data: guessed.as_ref().unwrap_or(all),
        ..*context.fitter
    };
    let fit = |model: &Model<f64>| context.executor.fit(&fitter, model, &free, effort);
    let best = in_best_shape(context, fit(&candidate.fit.model)?, |it| {
        let executor = &context.executor;
        let few = executor.fit(&fitter, &it.model, &free, SHAPED)?;
        // Its residuals are those of the simple shape.
        let is_ahead = few.cost() < it.cost();
        if is_ahead { fit(&few.model) } else { Ok(few) }
    })?;
    Ok(Candidate::of(candidate.added.len(), best))
}

/// Steps after which another shape has to be ahead.
const SHAPED: Effort = Effort::Steps(4);

/// A fit, or what `fit` makes of it with an added effect in its other shape, if that has a
/// smaller error: the simple shape needs no reason.
///
/// # Errors
///
/// Those of `fit`.
pub fn in_best_shape(
    context: &FitContext<'_>,
    mut best: Fit,
    fit: impl Fn(&Fit) -> Result<Fit, NoFit>,
) -> Result<Fit, NoFit> {
    let added = context.file.model.effects().count()..best.model.effects().count();
    for slot in added {
        let Some(model) = with_other_shape(&best.model, slot) else {
            continue;
        };
        let mut start = best.clone();
        start.model = model;
        let other = fit(&start)?;
        if other.cost().sqrt() <= Policy::STANDARD.sure_leaves * best.cost().sqrt() {
            best = other;
        }
    }
    Ok(best)
}

/// The final fit of a candidate; where there is no time for it, the candidate simulated over
/// everything, as it is.
pub fn finished(context: &FitContext<'_>, candidate: &Candidate) -> Candidate {
    final_fit(context, candidate, Effort::Full).unwrap_or_else(|_| {
        let as_it_is = simulated(context, candidate);
        Candidate {
            fit: context.fitter.informed(&as_it_is.fit),
            ..as_it_is
        }
    })
}

/// A candidate as it is fitted, with the residuals of a simulation over everything.
pub fn simulated(context: &FitContext<'_>, candidate: &Candidate) -> Candidate {
    let simulated = context.fitter.compare(&candidate.fit.model);
    let mut candidate = candidate.clone();
    candidate.fit.residuals = simulated.residuals;
    candidate.fit.nuisances = simulated.nuisances;
    candidate
}

/// The model with the effect in `slot` in its other shape; none if it has but one.
fn with_other_shape(model: &Model<f64>, slot: usize) -> Option<Model<f64>> {
    let mut effects: Vec<Effect<f64>> = model.effects().collect();
    let effect = effects.get_mut(slot)?;
    *effect = effect.other_shape()?;
    Model::new(*model.dynamics(), &effects).ok()
}

/// Initial guesses of the fitted `base` with `kind` added; `beside` are those of what is
/// missing beside that base, where they are known.
pub fn starts_from(
    context: &FitContext<'_>,
    base: &Candidate,
    kind: Kind,
    beside: &Guesses,
) -> Vec<Model<f64>> {
    let mut starts = starts(context, base, kind).as_fitted;
    starts.extend(beside.of_kind(kind).iter().filter_map(|guess| {
        let effects: Vec<_> = base.fit.model.effects().chain([guess.effect]).collect();
        Model::new(guess.base, &effects).ok()
    }));
    starts
}

/// Initial guesses of `base` with `kind` added: every combination of the catalogue's
/// values, with the base parameters as fitted without the effect, and what the score suggests.
fn starts(context: &FitContext<'_>, base: &Candidate, kind: Kind) -> Combinations {
    let values = combinations(kind, |row| context.scales.starts_of(kind, row));
    let fitted = *base.fit.model.dynamics();
    let swinging = context.scales.swinging(&fitted);
    let mut starts = Combinations::default();
    for values in &values {
        let Some(effect) = kind.build(values) else {
            continue;
        };
        let effects: Vec<_> = base.fit.model.effects().chain([effect]).collect();
        starts.as_fitted.extend(Model::new(fitted, &effects));
        starts.swinging.extend(swinging.and_then(|dynamics| {
            // All forces count in proportion to the stiffness.
            let times = dynamics.stiffness / fitted.stiffness;
            let values: Vec<f64> = kind
                .parameters()
                .iter()
                .zip(values)
                .map(|(row, value)| value * if row.unit.is_force() { times } else { 1.0 })
                .collect();
            let added = kind.build(&values)?;
            let effects: Vec<_> = base.fit.model.effects().chain([added]).collect();
            Model::new(dynamics, &effects).ok()
        }));
    }
    let guessed = guessed(context, base, kind, Starts::Everywhere);
    starts.as_fitted.extend(guessed);
    starts
}

/// What the score suggests.
fn guessed(
    context: &FitContext<'_>,
    base: &Candidate,
    kind: Kind,
    from: Starts,
) -> Vec<Model<f64>> {
    let is_alone = base.added.is_empty();
    let of_guess = |guess: &Guess| {
        let effects: Vec<_> = base.fit.model.effects().chain([guess.effect]).collect();
        let dynamics = if is_alone {
            guess.base
        } else {
            *base.fit.model.dynamics()
        };
        Model::new(dynamics, &effects).ok()
    };
    let guesses = context.guesses.of_kind(kind).iter();
    let mut starts: Vec<Model<f64>> = Vec::new();
    for start in guesses
        .filter(|guess| guess.is_ranked() || from == Starts::Everywhere)
        .filter_map(of_guess)
    {
        if !starts.iter().any(|known| is_alike(known, &start)) {
            starts.push(start);
        }
    }
    starts
}

/// Whether fits from two starts of one structure end in one minimum: no parameter differs by more
/// than a fit moves it in a step.
fn is_alike(a: &Model<f64>, b: &Model<f64>) -> bool {
    /// Largest difference, as a share of the larger.
    const ALIKE: f64 = 0.2;
    parameters(a).into_iter().all(|(id, _)| {
        let [a, b] = [a, b].map(|model| model.value(id).unwrap_or(0.0));
        (a - b).abs() <= ALIKE * a.abs().max(b.abs())
    })
}

/// Initial guesses of a fit.
#[derive(Clone, Debug, Default)]
struct Combinations {
    /// With the base parameters as fitted without the effect.
    as_fitted: Vec<Model<f64>>,
    /// With base parameters beside which the inertia shows, where it does not as fitted.
    swinging: Vec<Model<f64>>,
}

/// Frees the held parameters of the added effects that have initial guesses in the
/// catalogue (the tilt of gravity), one variant per guess.
///
/// # Errors
///
/// If none is held, the structure cannot be simulated, or the time was up.
pub fn release(context: &FitContext<'_>, candidate: &Candidate) -> Result<Candidate, NoFit> {
    let first = context.file.model.effects().count();
    let mut free = candidate.fit.free.clone();
    let mut models = Vec::new();
    for (offset, kind) in candidate.added.iter().enumerate() {
        for (parameter, row) in kind.parameters().iter().enumerate() {
            if row.held.is_some() && !row.starts.is_empty() {
                let id = ParameterId::Effect {
                    slot: first + offset,
                    parameter,
                };
                free.push(id);
                models.push(candidate.fit.model);
                models.extend(
                    row.starts
                        .iter()
                        .map(|start| candidate.fit.model.with_value(id, f64::from(*start))),
                );
            }
        }
    }
    let executor = &context.executor;
    let fit = executor.best_of(context.fitter, &models, &free, Effort::Full)?;
    Ok(Candidate::of(candidate.added.len(), fit))
}
