//! Terms of the grammar, fitted where no effect of the catalogue leaves only noise.
//!
//! The score ranks them as it ranks effects; the first of each view are fitted, the best of these to
//! their ends. Where the best one leads by far and leaves more than noise, effects are scored beside
//! it, and the first of them fitted with it. Whether one is offered is the decision's
//! ([`mod@crate::diagnose::decide`]).

use model_core::catalogue::Kind;
use rayon::prelude::*;

use crate::diagnose::evidence::measure::excess;
use crate::diagnose::fit::candidates::{
    Candidate, FitContext, Starts, added, coarse_fit, final_fit, predicted, release,
};
use crate::diagnose::recordings::noise::NoiseFloor;
use crate::diagnose::score::Guesses;
use crate::diagnose::score::grammar::terms;
use crate::diagnose::search::Options;
use crate::diagnose::search::baseline::Baseline;
use crate::diagnose::search::singles::{Singles, is_done, leaves_noise, most_of_rivals};
use crate::diagnose::work::budget::SearchPart;
use crate::diagnose::work::policy::Policy;
use crate::diagnose::work::progress::Stage;
use crate::estimate::fit::Effort;

/// Terms that are fitted: the first eight of each view of the score.
const LEADING: usize = 16;

/// Terms with a final fit.
const FINISHED: usize = 6;

/// Effects that are fitted beside the best term.
const BESIDE: usize = 4;

/// What the grammar has for what no effect explains.
#[derive(Default)]
pub struct Terms {
    /// The best terms, fitted to their ends, the best first.
    pub fitted: Vec<Candidate>,
    /// Whether they end the search.
    pub settle: bool,
}

impl Terms {
    /// Beside single effects that leave more than noise; none where they do not, or where none are
    /// asked for, or the time is up.
    pub fn of(
        context: &FitContext<'_>,
        baseline: &Baseline,
        tried: &[Kind],
        singles: &Singles,
        options: Options<'_>,
    ) -> Self {
        let floor = &baseline.floor;
        let job = context.executor.job();
        let mut effects = singles.pool.iter().skip(1);
        let is_explained = effects.any(|effect| leaves_noise(effect, floor));
        if !options.formulas || is_explained || !job.may_begin(SearchPart::Terms) {
            return Self::default();
        }
        let mut fitted = fitted_terms(context, baseline, tried, options.without);
        let settle = settle(&fitted, singles, floor);
        if let Some(term) = fitted.first()
            && !settle
            && leads(term, singles)
        {
            let both = with_effects(context, baseline, tried, term);
            fitted.extend(both);
        }
        Self { fitted, settle }
    }
}

/// Whether a term leaves less than every single effect: then it is the first step.
fn leads(term: &Candidate, singles: &Singles) -> bool {
    let mut effects = singles.pool.iter().skip(1).chain(&singles.coarse);
    effects.all(|effect| effect.fit.sse() >= term.fit.sse())
}

/// A term with each of the effects that the innovations beside it ask for first.
fn with_effects(
    context: &FitContext<'_>,
    baseline: &Baseline,
    tried: &[Kind],
    term: &Candidate,
) -> Vec<Candidate> {
    let noise = baseline.floor.white;
    let guesses = Guesses::beside(context.fitter, &term.fit, noise, tried, context.scales);
    let context = FitContext {
        guesses: &guesses,
        ..*context
    };
    let leading: Vec<Kind> = guesses.ranked().into_iter().take(BESIDE).collect();
    leading
        .par_iter()
        .filter_map(|&kind| {
            let both = added(&context, term, kind);
            context.executor.reached(SearchPart::Terms, both)
        })
        .collect()
}

/// Whether the best of the terms leaves nothing for another effect to explain, where no single
/// effect comes near: then it will take part, and combinations would have to leave less than nothing.
fn settle(terms: &[Candidate], singles: &Singles, floor: &NoiseFloor) -> bool {
    let policy = &Policy::STANDARD;
    let Some(term) = terms.first() else {
        return false;
    };
    let beyond = |candidate: &Candidate| excess(candidate.fit.rmse(), floor.total(), policy);
    let mut effects = singles.pool.iter().skip(1).chain(&singles.coarse);
    is_done(term, floor) && effects.all(|effect| beyond(effect) >= policy.comparable * beyond(term))
}

/// A term with what is held until the end, as the sharpness of a sign, if it leaves only noise with
/// it: what that leaves is no reason to doubt the term, or to search on.
fn sharpened(context: &FitContext<'_>, term: Candidate, floor: &NoiseFloor) -> Candidate {
    match release(context, &term) {
        Ok(released) if leaves_noise(&released, floor) && released.fit.sse() < term.fit.sse() => {
            released
        }
        _ => term,
    }
}

/// The best terms beside the refit, to their ends, the best first. `tried` are the effects of the
/// catalogue, which need no term; those of `without` are not asked for.
fn fitted_terms(
    context: &FitContext<'_>,
    baseline: &Baseline,
    tried: &[Kind],
    without: &[String],
) -> Vec<Candidate> {
    let executor = &context.executor;
    let progress = &executor.job().progress;
    let is_in_model = |kind: &Kind| {
        let mut effects = context.file.model.effects();
        effects.any(|effect| effect.kind().name() == kind.name())
    };
    let mut all = terms(context.scales, tried);
    all.retain(|kind| !is_in_model(kind) && !without.iter().any(|name| name == kind.name()));
    progress.stage(Stage::Terms, LEADING + FINISHED);
    let fits = [&baseline.refit.fit, &baseline.nominal];
    let noise = baseline.floor.white;
    let guesses = Guesses::of(context.fitter, fits, noise, &all, context.scales);
    let context = FitContext {
        guesses: &guesses,
        ..*context
    };
    let leading: Vec<Kind> = guesses.ranked().into_iter().take(LEADING).collect();
    let mut coarse: Vec<Candidate> = leading
        .par_iter()
        .filter_map(|&kind| {
            let fitted = predicted(&context, &baseline.refit, kind, Starts::Scored)
                .and_then(|predicted| coarse_fit(&context, &predicted));
            executor.reached(SearchPart::Terms, fitted)
        })
        .collect();
    coarse.sort_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()));
    coarse.truncate(FINISHED);
    let most = most_of_rivals(coarse.iter(), &baseline.floor);
    coarse.retain(|candidate| candidate.fit.rmse() <= most);
    let mut fitted: Vec<Candidate> = coarse
        .par_iter()
        .filter_map(|candidate| {
            let fitted = final_fit(&context, candidate, Effort::Full);
            let fitted = executor.reached(SearchPart::Terms, fitted)?;
            Some(sharpened(&context, fitted, &baseline.floor))
        })
        .collect();
    fitted.sort_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()));
    fitted
}
