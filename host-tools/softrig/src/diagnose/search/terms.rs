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
    Candidate, FitContext, Starts, added, coarse_fit_below, final_fit, predicted, release,
};
use crate::diagnose::recordings::noise::NoiseFloor;
use crate::diagnose::score::Guesses;
use crate::diagnose::score::grammar::terms;
use crate::diagnose::search::Options;
use crate::diagnose::search::baseline::Baseline;
use crate::diagnose::search::singles::{HOPELESS, Singles, is_done, leaves_noise, most_of_rivals};
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
        let mut fitted = fitted_terms(context, baseline, tried, singles, options.without);
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

/// The terms that the score puts first. Of those that it does not tell apart, as a factor of a
/// pressure that stays what it is, the simplest, which the grammar writes first.
fn leading(guesses: &Guesses, all: &[Kind]) -> Vec<Kind> {
    let place = |kind: Kind| all.iter().position(|&it| it == kind);
    let mut distinct: Vec<Kind> = Vec::new();
    for kind in guesses.ranked() {
        match distinct
            .iter_mut()
            .find(|it| guesses.worth_the_same(**it, kind))
        {
            Some(known) if place(kind) < place(*known) => *known = kind,
            Some(_) => {}
            None => distinct.push(kind),
        }
    }
    distinct.truncate(LEADING);
    distinct
}

/// The best terms beside the refit, to their ends, the best first. `tried` are the effects of the
/// catalogue, which need no term; those of `without` are not asked for, and those whose coarse fit
/// leaves more than that of an effect are not fitted to their ends: they would have to leave less than
/// any effect to be offered.
fn fitted_terms(
    context: &FitContext<'_>,
    baseline: &Baseline,
    tried: &[Kind],
    singles: &Singles,
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
    let leading = leading(&guesses, &all);
    let best_effect = singles
        .coarse
        .first()
        .map_or(f64::INFINITY, |effect| effect.fit.sse());
    let hopeless = HOPELESS * best_effect;
    let mut coarse: Vec<Candidate> = leading
        .par_iter()
        .filter_map(|&kind| {
            let fitted = predicted(&context, &baseline.refit, kind, Starts::Scored)
                .and_then(|predicted| coarse_fit_below(&context, &predicted, hopeless));
            executor.reached(SearchPart::Terms, fitted)
        })
        .collect();
    coarse.sort_by(|a, b| a.fit.sse().total_cmp(&b.fit.sse()));
    coarse.truncate(FINISHED);
    let most = most_of_rivals(coarse.iter(), &baseline.floor);
    coarse.retain(|candidate| candidate.fit.rmse() <= most && candidate.fit.sse() <= best_effect);
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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use softrig_formats::model_file::ModelFile;
    use softrig_formats::recording::Recording;

    use super::*;
    use crate::diagnose::score::scales::Scales;
    use crate::estimate::Dataset;
    use crate::estimate::fitter::Fitter;
    use crate::synth::example::{Hidden, make};

    /// Factors of a pressure that stays what it is are no factors: such terms would be fitted several
    /// times over, and are not asked for.
    #[test]
    fn what_the_score_does_not_tell_apart_is_asked_for_once() {
        let example = make(Hidden::named(Some("cubic_stiffness")).unwrap(), 0.2, 5).unwrap();
        let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
        let leading_of = |is_held: bool| {
            let mut recordings: Vec<Recording> =
                example.recordings.iter().map(|it| it.1.clone()).collect();
            if is_held {
                for recording in &mut recordings {
                    recording.pressure.fill(30_000.0);
                }
            }
            let data = Dataset::of(&recordings);
            let fitter = Fitter::new(&file.model, &data);
            let fit = fitter.compare(&file.model);
            let scales = Scales::of(&fitter, &fit);
            let all = terms(&scales, &[]);
            let guesses = Guesses::beside(&fitter, &fit, 0.2_f64.to_radians(), &all, &scales);
            leading(&guesses, &all)
        };
        let curves = |kinds: &[Kind]| {
            let names: Vec<&str> = kinds.iter().map(|kind| kind.name()).collect();
            let plain: std::collections::BTreeSet<&str> = names
                .iter()
                .map(|name| name.split("_by_").next().unwrap_or(name))
                .collect();
            (plain.len(), names.len())
        };
        let held = leading_of(true);
        let (plain, all) = curves(&held);
        assert!(plain == all && all > 4, "{held:?}");
        let (plain, all) = curves(&leading_of(false));
        assert!(plain < all, "products count where the pressure moves");
    }
}
