//! What the tests of the lab share.
#![forbid(unsafe_code)]

pub mod browser;
pub mod person;
pub mod reports;
