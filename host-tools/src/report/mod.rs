//! A diagnosis for people: the summary on the terminal, the picture and the
//! page.
//!
//! What is said is decided once, in [`content`]: sentences and rounded numbers.
//! [`terminal`] sets them in lines, [`html`] on a page with [`pictures`]; how
//! the page was made, down to the hashes of its files, stands in
//! [`provenance`]. What is left is analysed in [`residuals`] by its [`correlation`], what
//! the parameters leave open of a curve in [`confidence`]. Shares of the error are set in
//! [`shares`], equations in [`equation`].

pub(crate) mod confidence;
pub mod content;
pub(crate) mod correlation;
pub(crate) mod equation;
pub mod html;
pub(crate) mod numbers;
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
