//! The connection to a rig: link, recording and monitor.

pub mod link;
pub(crate) mod monitor;
pub(crate) mod record;
