//! The free parameters of a model from recordings: what `rig fit` does.

use super::assemble::assemble;
use super::dataset::Dataset;
use super::fit::{Effort, Fit, Fitter};
use crate::diagnose::quality::Concern;
use crate::diagnose::unit_errors;
use crate::io::error::InputError;
use crate::io::model_file::ModelFile;
use crate::io::recording::Recording;

/// What is said of a fit that did not converge.
pub const NOT_CONVERGED: &str =
    "the fit stopped before it met its tolerance; a parameter may be at its limit or undetermined";

/// A fit beside the model that it began with.
#[derive(Clone, Debug)]
pub struct Refit {
    /// The sessions and their segments, as they were used.
    pub data: Dataset,
    /// What is wrong with the recordings themselves.
    pub concerns: Vec<Concern>,
    /// The model as it was given, against the recordings.
    pub nominal: Fit,
    /// The model with its free parameters fitted.
    pub fitted: Fit,
}

/// Fits what `[fit] free` in the model file says may move.
///
/// # Errors
///
/// Refuses recordings that cannot be used, and units that cannot be meant.
pub fn refit(file: &ModelFile, recordings: &[Recording]) -> Result<Refit, InputError> {
    unit_errors::refuse(file, recordings)?;
    let assembled = assemble(recordings, &[])?;
    let fitter = Fitter::new(&file.model, &assembled.data);
    let nominal = fitter.compare(&file.model);
    let fitted = fitter.fit(&file.model, &file.free, Effort::Full);
    Ok(Refit {
        data: assembled.data,
        concerns: assembled.concerns,
        nominal,
        fitted,
    })
}
