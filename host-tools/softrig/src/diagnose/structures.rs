//! Fits of structures that are asked for by name, outside of a search.

use model_core::catalogue::Kind;

use super::Progress;
use super::candidates::{Candidate, FitContext, Scales, added};
use super::executor::{Executor, Unfitted};
use super::missing_force::Guesses;
use crate::estimate::Dataset;
use crate::estimate::checkpoint::Checkpoint;
use crate::estimate::fit::Fitter;
use crate::estimate::subsample::subsample;
use softrig_formats::model_file::ModelFile;

/// The refitted structure with these effects added, one after the other, each by a final fit.
///
/// # Errors
///
/// [`Unfitted::Diverged`] where a structure on the way cannot be simulated.
pub fn fit(
    file: &ModelFile,
    data: &Dataset,
    refit: &Candidate,
    kinds: &[Kind],
) -> Result<Candidate, Unfitted> {
    let fitter = Fitter::new(&file.model, data);
    let subsample = subsample(&data.guessing(&refit.fit.nuisances), &refit.fit.model);
    let (progress, checkpoint) = (Progress::default(), Checkpoint::default());
    let context = FitContext {
        file,
        fitter: &fitter,
        short_segments: None,
        subsample: &Fitter::new(&file.model, &subsample),
        scales: &Scales::of(&fitter, &refit.fit),
        guesses: &Guesses::default(),
        executor: Executor::new(&progress, &checkpoint),
    };
    kinds
        .iter()
        .try_fold(refit.clone(), |base, &kind| added(&context, &base, kind))
}
