//! What a diagnosis works under: what is asked, how long it may go on, who is told, and the
//! constants of its decisions.

pub mod allowance;
pub mod budget;
pub mod executor;
pub mod job;
pub mod policy;
pub mod progress;
pub mod request;
