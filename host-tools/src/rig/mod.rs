//! The connection to a rig: link, recording and monitor.

pub mod link;
pub mod monitor;
pub mod record;
