//! The serial link to a board, real or simulated.
//!
//! Three layers, each with one worry. A [`Connector`] opens the port, as often
//! as the cable is pulled. A thread reads bytes and turns them into [lines](mod@line) with
//! the time of their arrival, and another keeps an armed board alive. [`Link`] asks and
//! answers: requests with numbers, time limits and retries, and counts of what
//! was lost. Everything above sees samples, remarks and replies, never bytes.

mod board;
mod client;
mod clock;
mod error;
mod heart;
mod holders;
pub mod line;
mod port;
mod worker;

pub(crate) use board::{Board, NotChanged, float, setting_bits};
pub(crate) use client::{Counters, Event, Link, Received, Timing};
pub(crate) use clock::{Break, Clock, Placed};
pub use error::LinkError;
pub(crate) use heart::Silence;
pub(crate) use port::{
    BAUD, Channel, Connector, PERMISSION_ADVICE, PortFound, SerialConnector, is_pseudo_terminal,
    ports,
};
