//! Parameter estimation from sessions of recorded samples.
//!
//! A session is simulated whole, from its first sample to its last: hysteresis, creep,
//! drift and the largest angle so far carry over within it, and cutting it would lose
//! them.
//!
//! - [`assemble`] makes sessions from files; [`impossible`] takes out the samples that no motion
//!   can reach, [`usable`] finds what can be used of the rest, [`let_go`] where a hand let go of
//!   the actuator.
//! - [`dataset`] holds sessions and their segments, which are used for repeats, plots and
//!   cross-validation.
//! - [`nuisance`]: the unknowns of each session that every fit estimates beside the model,
//!   the zeros of both sensors and the initial state.
//! - [`fit`] estimates the parameters: a least-squares `problem` in coordinates of
//!   `transform`, by the `normal` equations where there are many sessions.
//! - [`filter`] fits at shorter prediction horizons, [`horizon`] measures errors there.
//! - [`identify`] fits the base model from every start that recordings suggest.
//! - [`information`] is the covariance of the parameters, [`band`] that of the simulated
//!   curves.
//! - [`subsample`] takes parts of the data that are enough to rank candidates.
//! - [`profile`] says how far one parameter can go while the others follow.
//! - [`unit_errors`] refuses columns in implausible units.
//! - [`mod@refit`] fits a model file, [`simulation`] simulates one over a recording.
//! - [`start_from`] simulates one over a test recording, from its first samples only.

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
