//! What fits are made to: sessions with their zeros, cut into segments.
//!
//! A recording session is simulated whole, from its first sample to its last: a
//! hysteresis, a creep, a drift and the largest angle so far belong to the
//! session, and cutting it throws them away. [`assemble`] makes sessions of
//! files; [`dataset`] holds them with their segments, which are used for
//! repeats, for pictures and for leaving out; [`nuisance`] is what is estimated
//! beside the model in every fit: the zeros of both sensors and how the session
//! starts; [`subsample`] takes parts that are enough to rank candidates.

pub mod assemble;
pub mod dataset;
pub mod nuisance;
pub mod subsample;

pub use dataset::{Dataset, Segment, Session};
pub use nuisance::Nuisance;
