//! Fits, and what they are made to: sessions with their zeros, cut into segments.
//!
//! A recording session is simulated whole, from its first sample to its last: a
//! hysteresis, a creep, a drift and the largest angle so far belong to the
//! session, and cutting it throws them away. [`assemble`] makes sessions of
//! files; [`dataset`] holds them with their segments, which are used for
//! repeats, for pictures and for leaving out; [`nuisance`] is what is estimated
//! beside the model in every fit: the zeros of both sensors and how the session
//! starts; [`subsample`] takes parts that are enough to rank candidates. [`fit`] finds
//! the parameters, by way of a least-squares `problem` in the `coordinate`s of the
//! solver, with the `normal` equations of many sessions, and [`information`] is what the recordings say about them; [`band`] is what
//! that leaves open of the simulated curves. [`mod@refit`] does it for a model file.

pub mod assemble;
pub(crate) mod band;
pub mod checkpoint;
mod coordinate;
pub(crate) mod dataset;
pub(crate) mod denoise;
pub(crate) mod filter;
pub mod fit;
pub(crate) mod horizon;
pub(crate) mod information;
mod normal;
pub(crate) mod nuisance;
mod problem;
pub mod refit;
pub(crate) mod smooth;
pub mod statistics;
pub(crate) mod subsample;
pub(crate) mod usable;

pub use dataset::{Dataset, Segment, Session};
pub use nuisance::Nuisance;
