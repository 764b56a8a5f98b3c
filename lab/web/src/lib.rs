//! softrig in a browser: what the page of `lab/web/page/` asks, answered by the libraries.
//!
//! The page has neither a port nor a file system. It hands over files as they are, and asks for
//! pictures of recordings, a first model, a diagnosis. [`desk`] answers; `boundary` is how
//! question and answer pass between JavaScript and WebAssembly. Everything else is in `softrig`,
//! `softrig_formats` and `softrig_report`, and so the same as in the command `softrig`.
#![deny(unsafe_code)]
// A room's first page names its modules, also those that no other crate sees.
#![allow(rustdoc::private_intra_doc_links)]

#[cfg(all(target_family = "wasm", target_os = "unknown"))]
mod boundary;
pub mod desk;
