//! softrig in a browser: what the page of `lab/web/page/` asks, answered by the libraries.
//!
//! The page has no file system. It hands over files as they are, and asks for pictures of
//! recordings, a first model, a diagnosis: [`desk`] answers. It lends the port of a board, to flash,
//! check, record and upload: [`board`] does that. `boundary` is how question and answer, bytes and
//! files pass between JavaScript and WebAssembly. Everything else is in `softrig` and its crates
//! beside it, and so the same as in the command `softrig`.
#![deny(unsafe_code)]
// A room's first page names its modules, also those that no other crate sees.
#![allow(rustdoc::private_intra_doc_links)]

pub mod board;
#[cfg(all(target_family = "wasm", target_os = "unknown"))]
mod boundary;
pub mod desk;
