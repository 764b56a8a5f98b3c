//! Reports of a diagnosis: the summary on the terminal, the picture and the HTML page.
//!
//! [`content`] makes all sentences and rounded numbers once. [`terminal`] prints them,
//! [`html`] puts them on a page with [`pictures`], and [`provenance`] adds how the page was
//! made, with the hashes of its files. [`residuals`] analyses the residual by its
//! [`correlation`], [`confidence`] gives the band of a curve, [`shares`] the explained share
//! of the error, and [`equation`] sets equations.

pub(crate) mod confidence;
pub mod content;
pub(crate) mod correlation;
pub(crate) mod equation;
pub mod html;
pub mod pictures;
pub mod provenance;
pub(crate) mod residuals;
pub mod runs;
pub(crate) mod shares;
pub mod terminal;

use std::path::Path;

/// Where results were written.
#[derive(Clone, Copy, Debug, Default)]
pub struct Outputs<'a> {
    /// The verdict as JSON.
    pub verdict: Option<&'a Path>,
    /// The picture.
    pub picture: Option<&'a Path>,
    /// The page.
    pub page: Option<&'a Path>,
    /// The repaired model.
    pub model: Option<&'a Path>,
}
