//! The search: which structures are fitted, and how they are selected.

use std::collections::BTreeSet;

use model_core::catalogue::Kind;

use super::Progress;
use super::baseline::{Baseline, in_step};
use super::budget::{self, Part};
use super::candidates::{Candidate, FitContext, Scales, Untried, applicable, final_fit};
use super::grade::{Graded, graded};
use super::missing_force::Guesses;
use super::noise::NoiseFloor;
use super::policy::Policy;
use super::selection::{Selection, Selector, names};
use super::singles::{Singles, settles, singles};
use super::validation::CrossValidator;
use super::verdict::{Alternative, Answer};
use crate::estimate::Dataset;
use crate::estimate::checkpoint::Checkpoint;
use crate::estimate::fit::Fitter;
use crate::estimate::subsample::{short_segments, subsample};
use crate::io::model_file::ModelFile;

/// The best single effects that others are tried in place of.
const LEADERS: usize = 2;

/// Options of a search.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// Kept fits, also of an interrupted run.
    pub checkpoint: &'a Checkpoint,
    /// Counts the fits.
    pub progress: &'a Progress,
    /// Random seed.
    pub seed: u64,
    /// Effects to try beside those of the catalogue.
    pub own: &'a [Kind],
}

/// The result of a search.
pub struct Searched {
    /// The selection.
    pub found: Selection,
    /// Effects that do not apply to the recordings.
    pub untried: Vec<Untried>,
    /// The baseline.
    pub baseline: Baseline,
}

impl Searched {
    fn nothing(answer: Answer, untried: Vec<Untried>, baseline: Baseline) -> Self {
        Self {
            found: Selection::nothing(answer, &baseline.refit),
            untried,
            baseline,
        }
    }
}

/// Searches the structures that add effects to the refit, and selects among them.
///
/// Single effects are fitted by output error. If one leaves only noise, exact formulas
/// decide. If none does, the error of the best one shows how much no formula explains:
/// zeros are weighed against that, and structures are graded. If the budget ends the
/// search, the answer claims no more than the finished parts support.
pub fn search(baseline: Baseline, options: Options<'_>) -> Searched {
    let mut searched = selected(baseline, options);
    searched.found = as_far_as_tried(searched.found, &options.progress.undone());
    searched
}

fn selected(mut baseline: Baseline, options: Options<'_>) -> Searched {
    let (file, data) = (baseline.file.clone(), baseline.data.clone());
    let fitter = Fitter::new(&file.model, &data);
    let mut validator =
        CrossValidator::new(&file, &fitter, baseline.floor.input).beside(baseline.nominal.model);
    if let Some(answer) = baseline.quiet(&validator) {
        return Searched::nothing(answer, Vec::new(), baseline);
    }
    let (kinds, untried) = applicable(&file.model, options.own, &fitter);
    let material = Material::of(&fitter, &baseline.refit);
    let guesses = material.guesses(&fitter, &baseline, &kinds);
    let fitters = material.fitters(&fitter);
    let context = fitters.context(&file, &material, &guesses, options);
    let Singles { coarse, mut pool } = singles(
        &context,
        &baseline.floor,
        &kinds,
        &baseline.refit,
        options.progress,
    );
    let is_open = !settles(&pool, &baseline.floor);
    let mut graded = (is_open && options.progress.has_time_for(Part::Horizons))
        .then(|| {
            let leaders = coarse.iter().take(LEADERS).map(|it| &it.fit);
            let noise = baseline.floor.white;
            let guesses =
                guesses
                    .clone()
                    .standing_in(context.subsample, leaders, noise, context.scales);
            Grading::of(&baseline, &kinds, &coarse, &pool, guesses, options)
        })
        .flatten();
    if let Some(Grading { graded, .. }) = &graded
        && graded.may_leave_noise(&baseline.floor)
    {
        pool.extend(graded.finished(&context));
    }
    // The residual of the best structure is the best estimate of the rig's repeatability.
    let simulated = graded.as_ref().and_then(|it| it.graded.simulated());
    let best = pool
        .iter()
        .chain(simulated)
        .min_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()));
    if let Some(best) = best {
        baseline.floor = baseline.floor.with_repeats(&best.fit.residuals);
        validator.raise_floor(baseline.floor.rms);
    }
    options.progress.stage("selection by validation", 0);
    if let Some(answer) = baseline.quiet(&validator) {
        return Searched::nothing(answer, untried, baseline);
    }
    let hopeless = |it: &Grading| !it.graded.may_leave_noise(&baseline.floor);
    if let Some(graded) = graded.take_if(|it| hopeless(it)) {
        return graded.searched(untried, baseline.floor, options);
    }
    let mut found = Selector {
        context,
        validator: &validator,
        floor: &baseline.floor,
        kinds: &kinds,
        seed: options.seed,
    }
    .selection(&baseline.refit, &pool);
    let settled = match found.answer {
        Answer::CannotTell => settles(&pool, &baseline.floor),
        answer => answer != Answer::Unexplained,
    };
    match graded {
        Some(graded) if !settled => graded.searched(untried, baseline.floor, options),
        _ => {
            if !settled && !options.progress.undone().is_empty() {
                let best = best_so_far(&context, &validator, &baseline.refit, &pool, &coarse);
                found.repaired = best.unwrap_or(found.repaired);
            }
            Searched {
                found,
                untried,
                baseline,
            }
        }
    }
}

/// The single effect with the least error, if it predicts held-out segments better than the
/// refit: the result of a search that ended early.
fn best_so_far(
    context: &FitContext<'_>,
    validator: &CrossValidator<'_>,
    refit: &Candidate,
    pool: &[Candidate],
    coarse: &[Candidate],
) -> Option<Candidate> {
    let finished = pool.iter().skip(1);
    let best = match finished.min_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse())) {
        Some(best) => best.clone(),
        None => final_fit(context, coarse.first()?),
    };
    let most = Policy::STANDARD.worth_writing * validator.error_of(refit);
    (validator.error_of(&best) <= most).then_some(best)
}

/// Limits a selection to what the finished parts support: an effect that would have been
/// named becomes the best so far.
fn as_far_as_tried(found: Selection, undone: &BTreeSet<Part>) -> Selection {
    let answer = budget::as_far_as_tried(found.answer, found.named.len(), undone);
    if answer == found.answer {
        return found;
    }
    let named = (!found.named.is_empty()).then(|| Alternative {
        kinds: names(&found.named),
        probability: found.probability.iter().copied().fold(1.0, f64::min),
        delta_bic: 0.0,
    });
    Selection {
        alternatives: named.into_iter().collect(),
        tried: found.tried,
        best: found.best,
        ..Selection::nothing(answer, &found.repaired)
    }
}

/// The graded structures, and what they were graded from.
struct Grading {
    graded: Graded,
    baseline: Baseline,
    guesses: Guesses,
}

impl Grading {
    fn of(
        baseline: &Baseline,
        kinds: &[Kind],
        coarse: &[Candidate],
        pool: &[Candidate],
        guesses: Guesses,
        options: Options<'_>,
    ) -> Option<Self> {
        let mut singles = if pool.len() > 1 { &pool[1..] } else { coarse }.to_vec();
        singles.sort_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()));
        let best = singles.first().unwrap_or(&baseline.refit);
        let baseline = baseline
            .weighing_zeros(&best.fit.model)
            .unwrap_or_else(|| baseline.clone());
        let graded = {
            let file = &baseline.file;
            let fitter = Fitter::new(&file.model, &baseline.data);
            let validator = CrossValidator::new(file, &fitter, baseline.floor.input);
            let material = Material::of(&fitter, &baseline.refit);
            let fitters = material.fitters(&fitter);
            graded(
                &fitters.context(file, &material, &guesses, options),
                &validator,
                &baseline.floor,
                kinds,
                &baseline.refit,
                &singles,
                options.progress,
            )?
        };
        Some(Self {
            graded,
            baseline,
            guesses,
        })
    }

    /// The selection by grades, over this noise floor.
    fn searched(self, untried: Vec<Untried>, floor: NoiseFloor, options: Options<'_>) -> Searched {
        let baseline = Baseline {
            floor,
            ..self.baseline
        };
        let found = {
            let file = &baseline.file;
            let fitter = Fitter::new(&file.model, &baseline.data);
            let mut validator = CrossValidator::new(file, &fitter, baseline.floor.input);
            validator.raise_floor(baseline.floor.rms);
            let material = Material::of(&fitter, &baseline.refit);
            let fitters = material.fitters(&fitter);
            let context = fitters.context(file, &material, &self.guesses, options);
            self.graded.selection(&context, &validator, &baseline.refit)
        };
        Searched {
            found,
            untried,
            baseline,
        }
    }
}

/// The parts of the data for coarse fits.
struct Material {
    short_segments: Option<Dataset>,
    subsample: Dataset,
    scales: Scales,
}

impl Material {
    fn of(fitter: &Fitter<'_>, refit: &Candidate) -> Self {
        Self {
            short_segments: (!in_step(fitter.data, &refit.fit))
                .then(|| short_segments(fitter.data, fitter.nominal)),
            subsample: subsample(fitter.data, &refit.fit.model),
            scales: Scales::of(fitter, &refit.fit),
        }
    }

    /// What the missing force of the refit suggests.
    fn guesses(&self, fitter: &Fitter<'_>, baseline: &Baseline, kinds: &[Kind]) -> Guesses {
        let noise = baseline.floor.white;
        Guesses::of(fitter, &baseline.refit.fit, noise, kinds, &self.scales)
    }

    fn fitters<'a>(&'a self, whole: &'a Fitter<'a>) -> Fitters<'a> {
        Fitters {
            whole,
            short_segments: self
                .short_segments
                .as_ref()
                .map(|data| Fitter { data, ..*whole }),
            subsample: Fitter {
                data: &self.subsample,
                ..*whole
            },
        }
    }
}

/// Fitters to the whole data and to parts of it.
struct Fitters<'a> {
    whole: &'a Fitter<'a>,
    short_segments: Option<Fitter<'a>>,
    subsample: Fitter<'a>,
}

impl<'a> Fitters<'a> {
    fn context(
        &'a self,
        file: &'a ModelFile,
        material: &'a Material,
        guesses: &'a Guesses,
        options: Options<'a>,
    ) -> FitContext<'a> {
        FitContext {
            file,
            fitter: self.whole,
            short_segments: self.short_segments.as_ref(),
            subsample: &self.subsample,
            scales: &material.scales,
            guesses,
            checkpoint: options.checkpoint,
            progress: options.progress,
        }
    }
}
