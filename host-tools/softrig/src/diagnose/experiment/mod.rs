//! What to record next, and whether the rig stood as it is said.

pub mod plan;
pub(crate) mod turns;
