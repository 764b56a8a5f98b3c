//! Properties of every reader for arbitrary bytes.
//!
//! Each function takes the input of a fuzzer and panics if a property is violated. The
//! properties are more than "it does not crash": data that is read and written reads back
//! the same, a message points into the file, a store holds the last settings or those
//! before. `tests/targets.rs` calls them with the corpora and with random edits of these
//! for a few seconds; `cargo xtask fuzz` runs for hours, guided by coverage.
#![forbid(unsafe_code)]

mod files;
mod lines;
mod store;

pub use files::{model, protocol, recording};
pub use lines::{replies, requests, telemetry};
pub use store::{cuts, image};

/// A target by its name.
pub type Target = fn(&[u8]);

/// Every target.
pub const TARGETS: [(&str, Target); 8] = [
    ("requests", requests),
    ("telemetry", telemetry),
    ("replies", replies),
    ("recording", recording),
    ("model", model),
    ("protocol", protocol),
    ("image", image),
    ("cuts", cuts),
];
