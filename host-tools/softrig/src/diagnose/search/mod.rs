//! The search: which structures are fitted, and how they are selected.

pub(crate) mod baseline;
pub(crate) mod grade;
pub mod selection;
pub(crate) mod singles;
pub(crate) mod terms;

use model_core::actuator::MAX_EFFECTS;
use model_core::catalogue::Kind;
use rayon::prelude::*;

use crate::diagnose::decide::Remains;
use crate::diagnose::evidence::measure::MeasuredStructure;
use crate::diagnose::evidence::validation::CrossValidator;
use crate::diagnose::fit::candidates::{
    Candidate, FitContext, SkippedEffect, applicable, finished,
};
use crate::diagnose::score::Guesses;
use crate::diagnose::score::scales::Scales;
use crate::diagnose::search::baseline::{Baseline, in_step};
use crate::diagnose::search::grade::{Grades, grade};
use crate::diagnose::search::selection::{FittedStructures, Rows, Selection};
use crate::diagnose::search::singles::{Singles, is_settled, most_of_rivals, singles};
use crate::diagnose::search::terms::Terms;
use crate::diagnose::work::budget::SearchPart;
use crate::diagnose::work::executor::Executor;
use crate::diagnose::work::job::Job;
use crate::diagnose::work::progress::Stage;
use crate::estimate::Dataset;
use crate::estimate::checkpoint::Checkpoint;
use crate::estimate::fitter::Fitter;
use crate::estimate::subsample::{ENOUGH_TO_FIT, ENOUGH_TO_RANK, short_segments, subsample};
use softrig_formats::model_file::ModelFile;

/// The best single effects that others are tried in place of.
const LEADERS: usize = 2;

/// Options of a search.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// Kept fits, also of an interrupted run.
    pub checkpoint: &'a Checkpoint,
    /// Counts the fits.
    pub job: &'a Job,
    /// Random seed.
    pub seed: u64,
    /// Effects to try beside those of the catalogue.
    pub own: &'a [Kind],
    /// Whether terms of the grammar are tried where no effect leaves only noise.
    pub formulas: bool,
    /// Effects of the catalogue that are not tried.
    pub without: &'a [String],
}

/// The result of a search.
pub struct SearchResult {
    /// What the refit leaves without any effect.
    pub remains: Remains,
    /// What is left for the answer.
    pub found: Selection,
    /// Effects that do not apply to the recordings.
    pub untried: Vec<SkippedEffect>,
    /// The baseline.
    pub baseline: Baseline,
}

impl SearchResult {
    /// Where only noise is left.
    fn nothing(remains: Remains, untried: Vec<SkippedEffect>, baseline: Baseline) -> Self {
        Self {
            remains,
            found: Selection::nothing(Rows::default(), &baseline.refit),
            untried,
            baseline,
        }
    }
}

/// What is left for the answer of these structures, and what the refit leaves without them.
fn left_of(
    rows: Rows,
    baseline: &Baseline,
    context: &FitContext<'_>,
    validator: &CrossValidator<'_>,
) -> (Remains, Selection) {
    let ranking = rows.ranking(context);
    if ranking.rivals.is_empty()
        && let Some(little) = baseline.immaterial(validator)
    {
        return (little, Selection::nothing(rows, &baseline.refit));
    }
    let found = rows.selection(ranking, context, validator);
    (Remains::More, found)
}

/// Searches the structures that add effects to the refit, and selects among them.
///
/// Single effects are fitted by output error. If none leaves only noise, the error of the
/// best one shows how much no formula explains: zeros are weighed against that, and
/// structures are fitted at several horizons, and combined. If the budget ends the search,
/// the answer claims no more than the finished parts support.
pub fn search(mut baseline: Baseline, options: Options<'_>) -> SearchResult {
    let (file, data) = (baseline.file.clone(), baseline.data.clone());
    let fitter = Fitter::new(&file.model, &data);
    let mut validator =
        CrossValidator::new(&file, &fitter, baseline.floor.input).beside(baseline.nominal.model);
    if let Some(quiet) = baseline.find_quiet(&validator) {
        return SearchResult::nothing(quiet, Vec::new(), baseline);
    }
    let (kinds, untried) = applicable(&file.model, options.own, options.without, &fitter);
    let material = Material::of(&fitter, &baseline.refit, ENOUGH_TO_FIT);
    let guesses = material.guesses(&fitter, &baseline, &kinds);
    let fitters = material.fitters(&fitter);
    let context = fitters.context(&file, &material, &guesses, options);
    let singles = singles(&context, &baseline.floor, &kinds, &baseline.refit);
    let terms = Terms::of(&context, &baseline, &kinds, &singles, options);
    let is_open = !is_settled(&singles.pool, &baseline.floor) && !terms.settle;
    let Singles { coarse, mut pool } = singles;
    let graded = (is_open && options.job.may_begin(SearchPart::Horizons))
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
        baseline.floor = baseline
            .floor
            .with_repeats(&best.fit.residuals)
            .at_most(best.fit.rmse());
        validator.raise_floor(baseline.floor.rms);
    }
    options.job.progress.stage(Stage::Selection, 0);
    if let Some(quiet) = baseline.find_quiet(&validator) {
        return SearchResult::nothing(quiet, untried, baseline);
    }
    if pool.len() == 1 && graded.is_none() {
        // The search ended early: the nearest single effect is what there is.
        pool.extend(coarse.first().map(|nearest| finished(&context, nearest)));
    }
    validator.refitting_up_to(most_of_rivals(pool[1..].iter(), &baseline.floor));
    let mut in_pool = rows(&validator, &pool);
    in_pool.rows.extend(measured(&validator, &terms.fitted));
    let Some(Grading {
        graded,
        baseline: weighed,
        guesses,
    }) = graded
    else {
        let rows = Rows::of(in_pool, None, &validator, &baseline.floor, options.seed);
        let (remains, found) = left_of(rows, &baseline, &context, &validator);
        return SearchResult {
            remains,
            found,
            untried,
            baseline,
        };
    };
    let baseline = Baseline {
        floor: baseline.floor,
        ..weighed
    };
    let (remains, found) = {
        let file = &baseline.file;
        let fitter = Fitter::new(&file.model, &baseline.data);
        let validator = baseline.validator(&fitter);
        let material = Material::of(&fitter, &baseline.refit, ENOUGH_TO_RANK);
        let fitters = material.fitters(&fitter);
        let context = fitters.context(file, &material, &guesses, options);
        let measured = FittedStructures {
            refit: MeasuredStructure::of(&validator, baseline.refit.clone()),
            rows: graded.measured.into_iter().map(|it| it.row).collect(),
        };
        let rows = Rows::of(
            measured,
            Some(in_pool),
            &validator,
            &baseline.floor,
            options.seed,
        );
        left_of(rows, &baseline, &context, &validator)
    };
    SearchResult {
        remains,
        found,
        untried,
        baseline,
    }
}

/// The refit and the best final fits, measured: fits that leave far more than the best are not
/// worth a cross-validation.
fn rows(validator: &CrossValidator<'_>, pool: &[Candidate]) -> FittedStructures {
    /// Number of structures of each size.
    const MEASURED: usize = 6;
    let mut chosen = Vec::new();
    for size in 1..=MAX_EFFECTS {
        let of_size = pool.iter().filter(|it| it.added.len() == size);
        let mut of_size: Vec<&Candidate> = of_size.collect();
        of_size.sort_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()));
        chosen.extend(of_size.into_iter().take(MEASURED));
    }
    FittedStructures {
        refit: MeasuredStructure::of(validator, pool[0].clone()),
        rows: measured(validator, chosen),
    }
}

fn measured<'a>(
    validator: &CrossValidator<'_>,
    candidates: impl IntoParallelIterator<Item = &'a Candidate>,
) -> Vec<MeasuredStructure> {
    let candidates = candidates.into_par_iter();
    candidates
        .map(|candidate| MeasuredStructure::of(validator, candidate.clone()))
        .collect()
}

/// The graded structures, and what they were graded from.
struct Grading {
    graded: Grades,
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
            let material = Material::of(&fitter, &baseline.refit, ENOUGH_TO_RANK);
            let fitters = material.fitters(&fitter);
            grade(
                &fitters.context(file, &material, &guesses, options),
                &validator,
                &baseline.floor,
                kinds,
                &baseline.refit,
                &singles,
            )?
        };
        Some(Self {
            graded,
            baseline,
            guesses,
        })
    }
}

/// The parts of the data for coarse fits.
struct Material {
    short_segments: Option<Dataset>,
    subsample: Dataset,
    scales: Scales,
}

impl Material {
    fn of(fitter: &Fitter<'_>, refit: &Candidate, enough: usize) -> Self {
        Self {
            short_segments: (!in_step(fitter.data, &refit.fit))
                .then(|| short_segments(fitter.data, fitter.nominal)),
            subsample: subsample(fitter.data, &refit.fit.model, enough),
            scales: Scales::of(fitter, &refit.fit),
        }
    }

    /// What the missing force of the refit suggests.
    fn guesses(&self, fitter: &Fitter<'_>, baseline: &Baseline, kinds: &[Kind]) -> Guesses {
        let noise = baseline.floor.white;
        let fits = [&baseline.refit.fit, &baseline.nominal];
        Guesses::of(fitter, fits, noise, kinds, &self.scales)
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
            executor: Executor::new(options.job, options.checkpoint),
        }
    }
}
