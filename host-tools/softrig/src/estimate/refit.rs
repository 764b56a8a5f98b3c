//! Fits the free parameters of a model file to recordings: `softrig fit`.

use super::assemble::assemble;
use super::dataset::Dataset;
use super::fit::Fit;
use super::fitter::Fitter;
use super::identify::{EXPONENTS, far_zeros, identify};
use super::placement::with_tip_load;
use crate::estimate::unit_errors;
use crate::estimate::usable::Concern;
use softrig_formats::error::InputError;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::Recording;

/// The message about a fit that did not converge.
pub const NOT_CONVERGED: &str =
    "the fit stopped before it met its tolerance; a parameter may be at its limit or undetermined";

/// A fit, beside the nominal model.
#[derive(Clone, Debug)]
pub struct Refit {
    /// The sessions and their segments, as they were used.
    pub data: Dataset,
    /// Concerns about the recordings.
    pub concerns: Vec<Concern>,
    /// The nominal model against the recordings.
    pub nominal: Fit,
    /// The model with its free parameters fitted.
    pub fitted: Fit,
}

/// Fits the parameters that `[fit] free` in the model file lists.
///
/// # Errors
///
/// Refuses recordings that cannot be used, and columns in implausible units.
pub fn refit(file: &ModelFile, recordings: &[Recording]) -> Result<Refit, InputError> {
    let file = &with_tip_load(file.clone(), recordings);
    unit_errors::refuse(file, recordings)?;
    let mut assembled = assemble(recordings, &[])?;
    assembled.data = assembled.data.knowing(&file.within);
    let fitter = Fitter::new(&file.model, &assembled.data);
    let nominal = fitter.compare(&file.model);
    let mut concerns = assembled.concerns;
    let fitted = match identify(&file.model, &file.free, &EXPONENTS, &assembled.data) {
        Some(identified) => {
            concerns.extend(identified.remarks(&file.model, &assembled.data));
            concerns.extend(far_zeros(&identified.fit, &assembled.data));
            identified.fit
        }
        None => nominal.clone(),
    };
    Ok(Refit {
        data: assembled.data,
        concerns,
        nominal,
        fitted,
    })
}
