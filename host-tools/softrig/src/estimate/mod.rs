//! Parameter estimation from sessions of recorded samples.
//!
//! A session is simulated whole, from its first sample to its last: hysteresis, creep,
//! drift and the largest angle so far carry over within it, and cutting it would lose
//! them.
//!
//! [`assemble`] makes sessions from files, [`dataset`] holds them, [`fit`] estimates the
//! parameters, with the unknowns of each session ([`nuisance`]) beside the model, and
//! [`identify`] fits the base model from every start that recordings suggest.

pub mod assemble;
pub mod band;
pub mod checkpoint;
pub(crate) mod dataset;
pub(crate) mod denoise;
mod descent;
pub mod filter;
pub mod fit;
pub mod fitter;
pub(crate) mod horizon;
pub mod identify;
pub mod impossible;
pub(crate) mod information;
pub(crate) mod let_go;
mod normal;
pub(crate) mod nuisance;
pub mod placement;
mod problem;
pub mod profile;
pub mod refit;
pub mod simulation;
pub(crate) mod smooth;
pub mod start_from;
pub mod subsample;
mod transform;
pub mod unit_errors;
pub(crate) mod usable;

pub use dataset::{Dataset, Segment, Session};
pub use nuisance::Nuisance;
pub use placement::Placement;
pub use usable::usable;
