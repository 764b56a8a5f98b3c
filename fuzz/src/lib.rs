//! What every reader promises for any bytes at all.
//!
//! Each function takes what a fuzzer made up and panics where a promise is broken. The
//! promises are more than "it does not crash": what was read and written reads back
//! the same, a message points into the file, a store holds the last settings or those
//! before. `tests/targets.rs` calls them with the corpora beside it and with random
//! edits of these for a few seconds; `cargo xtask fuzz` goes on for hours, guided by
//! coverage.
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
