//! What recordings are worth: their quality and noise, what they show, and how many of their samples
//! a budget is enough for.

pub(crate) mod affordable;
pub(crate) mod needs;
pub mod noise;
pub(crate) mod quality;
