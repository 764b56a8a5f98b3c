//! A diagnosis for people: the summary on the terminal, the picture and the
//! page.
//!
//! What is said is decided once, in [`content`]: sentences and rounded numbers.
//! [`terminal`] sets them in lines, [`html`] on a page with [`pictures`]; how
//! the page was made, down to the hashes of its files, stands in
//! [`provenance`].

pub mod content;
pub mod html;
pub mod pictures;
pub mod provenance;
pub mod runs;
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
