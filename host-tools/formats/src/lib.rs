//! Files and the terminal: input is checked and converted to SI, output is written atomically
//! and without control characters.
//!
//! Recordings ([`recording`], in many [`formats`] and [`columns`]), other [`table`]s of text,
//! models, protocols, settings and effects of the user's own are read within limits ([`bounded`]) and refused with file, line,
//! column and what to do ([`error`]). [`numbers`] writes numbers as people read them, [`family`]
//! the names of families of effects.
#![forbid(unsafe_code)]
// A room's first page names its modules, also those that no other crate sees.
#![allow(rustdoc::private_intra_doc_links)]
// All output goes through `terminal`, which makes foreign text harmless.
#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

pub mod bounded;
mod clock;
pub mod columns;
pub mod error;
pub mod family;
pub mod formats;
pub mod formula;
pub mod instant;
pub mod left_out;
pub mod material_name;
pub mod measurand;
pub mod model_file;
pub mod model_schema;
pub mod numbers;
pub mod own_effects;
pub mod protocol_file;
pub mod protocol_schema;
pub mod ranges;
pub mod recording;
pub mod removed;
pub mod settings_file;
pub mod setup;
pub mod table;
pub mod terminal;
mod toml_reader;

/// The example of the README is one that works.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;
