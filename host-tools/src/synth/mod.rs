//! Recordings that were never measured, with a known answer.

pub mod example;
