//! Structures with effects added, and fitted: one at a time, in pairs, at several horizons, with a
//! table.

pub mod candidates;
pub mod identifiability;
pub(crate) mod levels;
pub(crate) mod numbers;
pub(crate) mod outlier;
pub(crate) mod pairs;
pub(crate) mod slow;
pub mod structures;
pub(crate) mod tables;
