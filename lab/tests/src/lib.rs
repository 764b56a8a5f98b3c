//! What the tests of the lab share.
#![forbid(unsafe_code)]

#[cfg(feature = "browser")]
pub mod browser;
pub mod reports;
