//! The search: which structures are fitted, and by which route they are selected.

use std::collections::BTreeSet;

use model_core::catalogue::Kind;

use super::Progress;
use super::baseline::{Baseline, in_step};
use super::budget::{self, Part};
use super::candidates::{Candidate, FitContext, Scales, Untried, applicable, final_fit};
use super::grade::{Graded, graded};
use super::noise::NoiseFloor;
use super::policy::Policy;
use super::selection::{Selection, Selector, names};
use super::singles::{Singles, settles, singles};
use super::validation::CrossValidator;
use super::verdict::{Alternative, Answer};
use crate::estimate::Dataset;
use crate::estimate::checkpoint::Checkpoint;
use crate::estimate::fit::Fitter;
use crate::estimate::subsample::{excerpt, pieces};
use crate::io::model_file::ModelFile;

/// What a search is carried out with.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// Fits of an interrupted run, and where to keep further ones.
    pub checkpoint: &'a Checkpoint,
    /// Where fits are counted.
    pub progress: &'a Progress,
    /// Seed of the noise that is drawn.
    pub seed: u64,
    /// Effects that are tried beside those of the catalogue.
    pub own: &'a [Kind],
}

/// What a search came to.
pub struct Searched {
    /// What is selected.
    pub found: Selection,
    /// Effects that the recordings cannot speak about.
    pub untried: Vec<Untried>,
    /// What it is told from.
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
/// Single effects are fitted by output error. Where one leaves only noise, exact formulas
/// decide. Where none does, the best of them shows how much no formula explains: zeros
/// are weighed against that, and structures are graded. Where the budget ends that, what is
/// selected is claimed as far as what was tried allows.
pub fn search(baseline: Baseline, options: Options<'_>) -> Searched {
    let mut searched = selected(baseline, options);
    searched.found = as_far_as_tried(searched.found, &options.progress.undone());
    searched
}

fn selected(mut baseline: Baseline, options: Options<'_>) -> Searched {
    let (file, data) = (baseline.file.clone(), baseline.data.clone());
    let fitter = Fitter::new(&file.model, &data);
    let mut validator = CrossValidator::new(&file, &fitter, baseline.floor.input);
    if let Some(answer) = baseline.quiet(&validator) {
        return Searched::nothing(answer, Vec::new(), baseline);
    }
    let (kinds, untried) = applicable(&file.model, options.own, &fitter);
    let material = Material::of(&fitter, &baseline.refit);
    let fitters = material.fitters(&fitter);
    let context = fitters.context(&file, &material, options);
    let Singles { coarse, mut pool } = singles(
        &context,
        &baseline.floor,
        &kinds,
        &baseline.refit,
        options.progress,
    );
    let is_open = !settles(&pool, &baseline.floor);
    let mut graded = (is_open && options.progress.has_time_for(Part::Horizons))
        .then(|| Grading::of(&baseline, &kinds, &coarse, &pool, options))
        .flatten();
    if let Some(Grading { graded, .. }) = &graded
        && graded.may_leave_noise(&baseline.floor)
    {
        pool.extend(graded.finished(&context));
    }
    // What the best structure leaves is the nearest to what the rig itself does not
    // repeat.
    let simulated = graded.as_ref().and_then(|it| it.graded.simulated());
    let best = pool
        .iter()
        .chain(simulated)
        .min_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()));
    if let Some(best) = best {
        baseline.floor = baseline.floor.with_repeats(&best.fit.residuals);
        validator.with_scatter(baseline.floor.rms);
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

/// The single effect that leaves least, if it predicts better than the refit what was not
/// fitted: what a search that was ended early has to show.
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

/// What is left of a selection where this was left undone: what would have been named is the
/// best so far.
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

/// Structures as they were graded, and from what.
struct Grading {
    graded: Graded,
    baseline: Baseline,
}

impl Grading {
    fn of(
        baseline: &Baseline,
        kinds: &[Kind],
        coarse: &[Candidate],
        pool: &[Candidate],
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
                &fitters.context(file, &material, options),
                &validator,
                &baseline.floor,
                kinds,
                &baseline.refit,
                &singles,
                options.progress,
            )?
        };
        Some(Self { graded, baseline })
    }

    /// What is selected by grades, over this noise floor.
    fn searched(self, untried: Vec<Untried>, floor: NoiseFloor, options: Options<'_>) -> Searched {
        let baseline = Baseline {
            floor,
            ..self.baseline
        };
        let found = {
            let file = &baseline.file;
            let fitter = Fitter::new(&file.model, &baseline.data);
            let mut validator = CrossValidator::new(file, &fitter, baseline.floor.input);
            validator.with_scatter(baseline.floor.rms);
            let material = Material::of(&fitter, &baseline.refit);
            let fitters = material.fitters(&fitter);
            let context = fitters.context(file, &material, options);
            self.graded.selection(&context, &validator, &baseline.refit)
        };
        Searched {
            found,
            untried,
            baseline,
        }
    }
}

/// What candidates are fitted to, beside the whole data.
struct Material {
    pieces: Option<Dataset>,
    excerpt: Dataset,
    scales: Scales,
}

impl Material {
    fn of(fitter: &Fitter<'_>, refit: &Candidate) -> Self {
        Self {
            pieces: (!in_step(fitter.data, &refit.fit))
                .then(|| pieces(fitter.data, fitter.nominal)),
            excerpt: excerpt(fitter.data, &refit.fit.model),
            scales: Scales::of(fitter, &refit.fit),
        }
    }

    fn fitters<'a>(&'a self, whole: &'a Fitter<'a>) -> Fitters<'a> {
        Fitters {
            whole,
            pieces: self.pieces.as_ref().map(|data| Fitter { data, ..*whole }),
            excerpt: Fitter {
                data: &self.excerpt,
                ..*whole
            },
        }
    }
}

/// Fitters to the whole data and to parts of it.
struct Fitters<'a> {
    whole: &'a Fitter<'a>,
    pieces: Option<Fitter<'a>>,
    excerpt: Fitter<'a>,
}

impl<'a> Fitters<'a> {
    fn context(
        &'a self,
        file: &'a ModelFile,
        material: &'a Material,
        options: Options<'a>,
    ) -> FitContext<'a> {
        FitContext {
            file,
            fitter: self.whole,
            pieces: self.pieces.as_ref(),
            excerpt: &self.excerpt,
            scales: &material.scales,
            checkpoint: options.checkpoint,
            progress: options.progress,
        }
    }
}
