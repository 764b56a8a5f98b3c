//! What a reader sees of a diagnosis: the summary on the terminal, pictures, and the HTML page.
//!
//! [`content`] makes all sentences and rounded numbers once. [`terminal`] prints them,
//! [`html`] puts them on a page with [`pictures`], and [`provenance`] adds how the page was
//! made, with the hashes of its files. [`residuals`] analyses the residual by its
//! [`correlation`], [`confidence`] gives the band of a curve, [`shares`] the explained share
//! of the error, and [`equation`] sets equations. [`plot`] draws all pictures, also those that
//! belong to no report.
#![forbid(unsafe_code)]
// A room's first page names its modules, also those that no other crate sees.
#![allow(rustdoc::private_intra_doc_links)]
#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

pub(crate) mod confidence;
pub mod content;
pub mod correlation;
pub(crate) mod equation;
pub mod gap;
pub mod html;
pub mod pictures;
pub mod plot;
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
    /// Whether that model holds no effect since none is named.
    pub named_only: bool,
}

/// The example of the README is one that works.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;
