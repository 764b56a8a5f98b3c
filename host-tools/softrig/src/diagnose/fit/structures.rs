//! Fits of structures that are asked for by name, outside of a search.

use model_core::catalogue::Kind;

use crate::diagnose::fit::candidates::{Candidate, FitContext, added};
use crate::diagnose::score::Guesses;
use crate::diagnose::score::scales::Scales;
use crate::diagnose::work::executor::{Executor, NoFit};
use crate::estimate::Dataset;
use crate::estimate::fitter::Fitter;
use crate::estimate::subsample::{ENOUGH_TO_FIT, subsample};
use crate::statistics::mean;
use softrig_formats::model_file::ModelFile;

/// The refitted structure with these effects added, one after the other, each by a final fit.
///
/// # Errors
///
/// [`NoFit`] where a structure on the way cannot be simulated, or is not reached.
pub fn fit(
    file: &ModelFile,
    data: &Dataset,
    refit: &Candidate,
    kinds: &[Kind],
    executor: Executor<'_>,
) -> Result<Candidate, NoFit> {
    let fitter = Fitter::new(&file.model, data);
    let subsample = subsample(
        &data.guessing(&refit.fit.nuisances),
        &refit.fit.model,
        ENOUGH_TO_FIT,
    );
    let scales = Scales::of(&fitter, &refit.fit);
    let noises = data.sessions().iter().map(|session| session.prior().noise);
    let noise = mean(&noises.collect::<Vec<f64>>());
    let fits = [&refit.fit, &fitter.compare(&file.model)];
    let guesses = Guesses::of(&fitter, fits, noise, kinds, &scales);
    let context = FitContext {
        file,
        fitter: &fitter,
        short_segments: None,
        subsample: &Fitter::new(&file.model, &subsample),
        scales: &scales,
        guesses: &guesses,
        executor,
    };
    kinds
        .iter()
        .try_fold(refit.clone(), |base, &kind| added(&context, &base, kind))
}
