//! Files and the terminal: input is checked and converted to SI, output is written atomically
//! and without control characters.
//!
//! Recordings ([`recording`], in many [`formats`] and [`columns`]), models, protocols, settings
//! and effects of the user's own are read within limits ([`bounded`]) and refused with file, line,
//! column and what to do ([`error`]).

pub(crate) mod bounded;
pub mod columns;
pub mod error;
pub(crate) mod formats;
pub(crate) mod formula;
pub(crate) mod material_name;
pub mod model_file;
pub mod own_effects;
pub mod protocol_file;
pub(crate) mod ranges;
pub mod recording;
pub(crate) mod settings_file;
pub mod terminal;
mod toml_reader;
