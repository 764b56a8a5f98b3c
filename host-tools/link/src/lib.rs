//! The serial link to a board, real or simulated.
//!
//! It has three layers. A [`Connector`] opens the port, again after a pulled cable. A worker turns
//! bytes into [lines](mod@line) with their time of arrival, and keeps an armed board alive. [`Link`] handles requests, with numbers, time limits and retries, and
//! counts lost lines. Code above sees samples, remarks and replies, never bytes. [`record`] writes
//! what comes over it, row by row.
#![forbid(unsafe_code)]
// Its first page names its modules, also those that no other crate sees.
#![allow(rustdoc::private_intra_doc_links)]
#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

mod board;
pub mod calibrate;
mod client;
mod clock;
pub mod commission;
mod error;
pub mod flash;
mod heart;
mod history;
#[cfg(not(target_family = "wasm"))]
mod holders;
pub mod line;
#[cfg(not(target_family = "wasm"))]
mod port;
pub mod record;
pub mod rig_file;
mod transport;
pub mod usb;
#[cfg(not(target_family = "wasm"))]
mod virtual_rigs;
mod worker;

pub use board::Board;
pub use client::{Counters, Event, Link, Received, Timing};
pub use clock::{Break, Clock};
pub use error::LinkError;
#[cfg(not(target_family = "wasm"))]
pub use port::{PERMISSION_ADVICE, PortFound, SerialConnector, is_pseudo_terminal, ports};
pub use transport::{BAUD, Channel, Connector};

/// The example of the README is one that works.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;
