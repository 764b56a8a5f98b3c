//! Fits structures at several prediction horizons.
//!
//! Output error shows slow effects, but has many local minima where small disturbances
//! add up; short horizons show fast effects. So a structure is fitted at four levels of
//! one filter ([`crate::estimate::filter`]). Each level may start from the result of the
//! next shorter one, whose minimum is wider.
//!
//! Screening makes two steps from the best initial guess of every effect at three levels.
//! The best few of each level are fitted at all levels.

use std::collections::BTreeSet;

use model_core::actuator::{MAX_EFFECTS, Model};
use model_core::catalogue::{Effect, Kind};
use rayon::prelude::*;

use crate::diagnose::fit::candidates::{
    Candidate, FitContext, free_parameters, in_best_shape, starts_from,
};
use crate::diagnose::score::Guesses;
use crate::diagnose::work::budget::SearchPart;
use crate::diagnose::work::executor::{Executor, NoFit};
use crate::estimate::filter::{Level, Pace, levels};
use crate::estimate::fit::{Effort, Fit};
use crate::estimate::fitter::Fitter;

/// Number of structures per screened level that are fitted at all levels.
const KEPT: usize = 5;

/// Steps of a screening fit.
const SCREENED: Effort = Effort::Steps(2);

/// Steps of a fit at a level.
const FITTED: Effort = Effort::Steps(8);

/// Two fits have found one minimum if their costs differ by at most this share.
const AGREES: f64 = 0.01;

/// Steps by output error, whose residual gives the evidence.
const FITTED_BY_OUTPUT_ERROR: Effort = Effort::Steps(25);

/// A structure as fitted at every level.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// Effects added to the nominal model, in the order of the model.
    pub added: Vec<Kind>,
    /// Its fits, from the shortest horizon to output error.
    pub fits: Vec<Fit>,
}

impl Estimate {
    /// The effects in the order of the catalogue.
    pub fn set(&self) -> Vec<Kind> {
        sorted(&self.added)
    }
}

/// A structure that further effects are added to.
pub struct Base<'a> {
    /// The structure.
    pub estimate: &'a Estimate,
    /// The levels at which further effects are screened.
    pub at: Vec<usize>,
    /// What is missing beside it suggests these.
    pub beside: Guesses,
}

/// A structure to screen: the base it extends, and the effect.
struct Task<'a> {
    base: &'a Base<'a>,
    kind: Kind,
    level: usize,
}

/// A structure to fit at all levels.
struct Structure<'a> {
    added: Vec<Kind>,
    /// The base that it extends, if any.
    base: Option<&'a Base<'a>>,
    /// Its initial guess at each level at which it was screened.
    starts: Vec<Option<Model<f64>>>,
}

/// Fits structures at every level, on the subsample of a fit context.
pub struct Levels<'a> {
    pub(super) context: FitContext<'a>,
    /// From the shortest horizon to output error (none).
    horizons: Vec<Option<Level>>,
    /// The pace of the recorded motion.
    pub pace: Pace,
    /// Noise of the angle (rad).
    noise: f64,
}

impl<'a> Levels<'a> {
    /// Chooses the levels by the refit of the nominal structure; `noise` is that of the
    /// angle (rad).
    pub fn of(context: FitContext<'a>, refit: &Candidate, noise: f64) -> Self {
        let data = context.subsample.data;
        let pace = Pace::of(context.fitter.data);
        let compared = context.subsample.compare(&refit.fit.model);
        let chosen = levels(&refit.fit.model, data, &compared.nuisances, noise, pace);
        Self {
            context,
            horizons: chosen.into_iter().map(Some).chain([None]).collect(),
            pace,
            noise,
        }
    }

    /// The place of output error among the levels.
    pub fn output_error(&self) -> usize {
        self.horizons.len() - 1
    }

    /// The level at a place.
    pub fn level(&self, place: usize) -> Option<Level> {
        self.horizons.get(place).copied().flatten()
    }

    /// What runs the fits.
    pub const fn executor(&self) -> &Executor<'a> {
        &self.context.executor
    }

    fn fitter(&self, level: usize) -> Fitter<'_> {
        self.context.subsample.at(self.horizons[level].as_ref())
    }

    /// A structure, and what is missing beside it.
    pub fn lead<'b>(&self, estimate: &'b Estimate, at: Vec<usize>, kinds: &[Kind]) -> Base<'b> {
        let context = &self.context;
        let by_output_error = estimate.fits.last();
        let beside = by_output_error
            .map(|fit| Guesses::beside(context.subsample, fit, self.noise, kinds, context.scales));
        Base {
            estimate,
            at,
            beside: beside.unwrap_or_default(),
        }
    }

    /// The nominal structure at every level.
    ///
    /// # Errors
    ///
    /// If it cannot be simulated at a level, or the time was up.
    pub fn base(&self, refit: &Candidate) -> Result<Estimate, NoFit> {
        let free = &self.context.file.free;
        let mut fits: Vec<Fit> = Vec::new();
        self.executor()
            .job()
            .progress
            .step("fits", self.horizons.len());
        for level in 0..self.horizons.len() {
            let _job = self.executor().begin()?;
            let mut starts = vec![self.context.file.model, refit.fit.model];
            starts.extend(fits.last().map(|shorter| shorter.model));
            // The reference of the evidence must be converged.
            let fitter = self.fitter(level);
            let fit = self
                .executor()
                .best_of(&fitter, &starts, free, Effort::Full)?;
            fits.push(fit);
        }
        Ok(Estimate {
            added: Vec::new(),
            fits,
        })
    }

    /// Extends bases by one effect: screened at the levels `at`, the best fitted at all
    /// levels. Coarse fits by output error replace a screening at that level. Structures
    /// in `known` are skipped.
    pub fn extended<'b>(
        &self,
        bases: &'b [Base<'b>],
        kinds: &[Kind],
        coarse: &[Candidate],
        known: &BTreeSet<Vec<Kind>>,
    ) -> Vec<Estimate> {
        let room = MAX_EFFECTS - self.context.file.model.effects().count();
        let tasks: Vec<Task<'b>> = bases
            .iter()
            .filter(|base| base.estimate.added.len() < room)
            .flat_map(|base| {
                let further = |kind: &&Kind| !base.estimate.added.contains(kind);
                kinds.iter().filter(further).flat_map(move |&kind| {
                    let at = base.at.iter();
                    at.map(move |&level| Task { base, kind, level })
                })
            })
            .filter(|task| !known.contains(&task.set()))
            .collect();
        self.executor()
            .job()
            .progress
            .step("screening", tasks.len());
        let screened: Vec<(&Task<'b>, f64, Model<f64>)> = tasks
            .par_iter()
            .filter_map(|task| {
                let part = SearchPart::of(&task.added());
                let (sse, model) = self.executor().reached(part, self.screened(task))?;
                Some((task, sse, model))
            })
            .collect();
        let mut shortlist = Shortlist {
            levels: self.horizons.len(),
            chosen: Vec::new(),
        };
        for level in 0..self.horizons.len() {
            let mut here: Vec<_> = screened
                .iter()
                .filter(|(task, ..)| task.level == level)
                .collect();
            here.sort_by(|a, b| a.1.total_cmp(&b.1));
            for (task, _, model) in here.into_iter().take(KEPT) {
                let added = task.added();
                shortlist.keep(added, Some(task.base), level, model);
            }
        }
        for candidate in coarse.iter().take(KEPT) {
            let model = &candidate.fit.model;
            let extends = |base: &&Base<'_>| {
                candidate.added.len() == base.estimate.added.len() + 1
                    && candidate.added.starts_with(&base.estimate.added)
            };
            let base = bases.iter().find(extends);
            shortlist.keep(candidate.added.clone(), base, self.output_error(), model);
        }
        let chosen = shortlist.chosen;
        let fits = chosen.len() * self.horizons.len();
        self.executor().job().progress.step("fits", fits);
        chosen
            .par_iter()
            .filter(|it| !known.contains(&sorted(&it.added)))
            .filter_map(|it| {
                let part = SearchPart::of(&it.added);
                self.executor().reached(part, self.through_levels(it))
            })
            .collect()
    }

    /// The best initial guess of an effect at a level, after two steps.
    fn screened(&self, task: &Task<'_>) -> Result<(f64, Model<f64>), NoFit> {
        let _job = self.executor().begin()?;
        let free = free_parameters(self.context.file, &task.added());
        let fitter = self.fitter(task.level);
        let start = self
            .initial_guess(&fitter, task.base, task.kind, task.level)
            .ok_or(NoFit::Diverged)?;
        let fit = self
            .executor()
            .best_of(&fitter, &[start], &free, SCREENED)?;
        Ok((fit.sse(), fit.model))
    }

    fn initial_guess(
        &self,
        fitter: &Fitter<'_>,
        base: &Base<'_>,
        kind: Kind,
        level: usize,
    ) -> Option<Model<f64>> {
        let Base {
            estimate, beside, ..
        } = base;
        let added = appended(&estimate.added, kind);
        let free = free_parameters(self.context.file, &added);
        let from = Candidate::of(estimate.added.len(), estimate.fits[level].clone());
        let starts = starts_from(&self.context, &from, kind, beside);
        let best = fitter.least_predicted(&starts, &free, 1);
        best.into_iter().next().map(|(_, model)| model)
    }

    /// Fits a structure at every level, from its own initial guess there and from the
    /// result of the next shorter level.
    fn through_levels(&self, chosen: &Structure<'_>) -> Result<Estimate, NoFit> {
        let Structure {
            added,
            base,
            starts,
        } = chosen;
        let free = free_parameters(self.context.file, added);
        let mut fits: Vec<Fit> = Vec::new();
        for (level, start) in starts.iter().enumerate() {
            let _job = self.executor().begin()?;
            let fitter = self.fitter(level);
            let mut from: Vec<Model<f64>> = start.iter().copied().collect();
            from.extend(fits.last().map(|shorter| shorter.model));
            // A start from the base as fitted here: no structure may end above what it extends.
            if let (Some(base), Some(&kind)) = (base, added.last()) {
                from.extend(self.initial_guess(&fitter, base, kind, level));
            }
            if from.is_empty() {
                from.extend(starts.iter().flatten().next());
            }
            let effort = if level == self.output_error() {
                FITTED_BY_OUTPUT_ERROR
            } else {
                FITTED
            };
            fits.push(self.executor().best_of(&fitter, &from, &free, effort)?);
        }
        Ok(Estimate {
            added: added.clone(),
            fits,
        })
    }

    /// A structure fitted to everything at one level, with the information about its
    /// parameters: from its fit to the subsample there and, until two starts agree, from
    /// those at the other levels.
    ///
    /// # Errors
    ///
    /// If the time was up.
    pub fn candidate(&self, estimate: &Estimate, level: usize) -> Result<Candidate, NoFit> {
        let _job = self.executor().begin()?;
        let mut nearest: Vec<usize> = (0..estimate.fits.len()).collect();
        nearest.sort_by_key(|other| other.abs_diff(level));
        // What is added to nothing was converged before.
        let most = if estimate.added.is_empty() {
            1
        } else {
            nearest.len()
        };
        let mut fits: Vec<Fit> = Vec::new();
        for other in nearest.into_iter().take(most) {
            let fit = self.finished(&estimate.fits[other], level)?;
            let agrees = |known: &Fit| {
                (known.cost() - fit.cost()).abs() <= AGREES * known.cost().min(fit.cost())
            };
            let is_settled = fits.iter().any(agrees);
            fits.push(fit);
            if is_settled {
                break;
            }
        }
        let best = fits
            .into_iter()
            .min_by(|a, b| a.cost().total_cmp(&b.cost()))
            .unwrap_or_else(|| estimate.fits[level].clone());
        let best = in_best_shape(&self.context, best, |it| self.finished(it, level))?;
        let chosen = self.level(level);
        Ok(Candidate {
            level: chosen,
            ..Candidate::of(
                estimate.added.len(),
                self.context.fitter.at(chosen.as_ref()).informed(&best),
            )
        })
    }

    /// A fit to everything at one level, from a fit to the subsample.
    fn finished(&self, start: &Fit, level: usize) -> Result<Fit, NoFit> {
        let chosen = self.level(level);
        let data = self.context.fitter.data;
        let guessed = (start.nuisances.len() == data.sessions().len())
            .then(|| data.guessing(&start.nuisances));
        let fitter = Fitter {
            data: guessed.as_ref().unwrap_or(data),
            ..self.context.fitter.at(chosen.as_ref())
        };
        let fit = self
            .executor()
            .fit(&fitter, &start.model, &start.free, FITTED)?;
        let whole = self.context.fitter;
        let thinned = self.context.subsample.data.samples() < data.samples();
        // At a short horizon thinned samples are different data: the better simulation counts.
        if chosen.is_some()
            && thinned
            && whole.compare(&start.model).sse() < whole.compare(&fit.model).sse()
        {
            return Ok(fitter.fit(&start.model, &start.free, Effort::Steps(0)));
        }
        Ok(fit)
    }
}

/// The structures to fit at all levels: a set of effects once, however often and in whatever
/// order the screening found it.
struct Shortlist<'a> {
    /// Number of levels.
    levels: usize,
    chosen: Vec<Structure<'a>>,
}

impl<'a> Shortlist<'a> {
    /// Keeps a start of a structure at a level, its effects in the order in which the structure
    /// was found first: free parameters are numbered by it.
    fn keep(
        &mut self,
        added: Vec<Kind>,
        base: Option<&'a Base<'a>>,
        level: usize,
        model: &Model<f64>,
    ) {
        let set = sorted(&added);
        let place = self.chosen.iter().position(|it| sorted(&it.added) == set);
        let place = place.unwrap_or_else(|| {
            self.chosen.push(Structure {
                added,
                base,
                starts: vec![None; self.levels],
            });
            self.chosen.len() - 1
        });
        let chosen = &mut self.chosen[place];
        chosen.starts[level] = in_order(model, &chosen.added);
    }
}

/// A model with its last effects in the order `added`; none if it does not have exactly these.
fn in_order(model: &Model<f64>, added: &[Kind]) -> Option<Model<f64>> {
    let mut effects: Vec<Effect<f64>> = model.effects().collect();
    let last = effects.split_off(effects.len().checked_sub(added.len())?);
    for kind in added {
        effects.push(*last.iter().find(|effect| effect.kind() == *kind)?);
    }
    Model::new(*model.dynamics(), &effects).ok()
}

impl Task<'_> {
    fn added(&self) -> Vec<Kind> {
        appended(&self.base.estimate.added, self.kind)
    }

    fn set(&self) -> Vec<Kind> {
        sorted(&self.added())
    }
}

fn appended(added: &[Kind], kind: Kind) -> Vec<Kind> {
    added.iter().copied().chain([kind]).collect()
}

fn sorted(kinds: &[Kind]) -> Vec<Kind> {
    let mut set = kinds.to_vec();
    set.sort_unstable();
    set
}

#[cfg(test)]
mod tests {
    use model_core::dynamics::Dynamics;

    use super::*;

    /// An effect whose parameters are told apart from those of every other.
    fn effect(kind: Kind, first: f32) -> Option<Effect<f64>> {
        let starts = kind.parameters().iter().map(|row| {
            let start = row.held.or_else(|| row.starts.first().copied());
            f64::from(first * start.unwrap_or(1.0))
        });
        kind.build(&starts.collect::<Vec<f64>>())
    }

    /// The screening finds a set of effects in both orders, each at another level. Every start
    /// has them in the order of the structure, with their own values.
    #[test]
    fn names_travel_with_values_for_every_two_effects_in_every_order() {
        let dynamics = *Model::<f64>::inert().dynamics();
        let model = |effects: &[Effect<f64>]| {
            Model::<f64>::new(
                Dynamics {
                    stiffness: 1.0,
                    damping: 1.0,
                    input_gain: 1.0,
                    ..dynamics
                },
                effects,
            )
        };
        let mut pairs = 0;
        for &a in Kind::NAMES {
            for &b in Kind::NAMES {
                let (Some(first), Some(second)) = (effect(a, 1.0), effect(b, 1.0)) else {
                    continue;
                };
                let (Ok(forth), Ok(back)) = (model(&[first, second]), model(&[second, first]))
                else {
                    continue;
                };
                if a == b {
                    continue;
                }
                pairs += 1;
                let mut shortlist = Shortlist {
                    levels: 2,
                    chosen: Vec::new(),
                };
                shortlist.keep(vec![a, b], None, 0, &forth);
                shortlist.keep(vec![b, a], None, 1, &back);
                let [only] = shortlist.chosen.as_slice() else {
                    panic!("{a:?} and {b:?} are kept twice");
                };
                for start in &only.starts {
                    let effects: Vec<_> = start.unwrap().effects().collect();
                    assert_eq!(effects, [first, second], "{a:?} and {b:?}");
                    let kinds: Vec<Kind> = effects.iter().map(Effect::kind).collect();
                    assert_eq!(kinds, only.added);
                }
            }
        }
        assert!(pairs > 300, "{pairs}");
    }
}
