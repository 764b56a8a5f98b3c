//! The rig at the other end of the cable: the link, what is recorded, what is watched.

pub mod link;
pub(crate) mod monitor;
pub(crate) mod record;
