//! Simulated recordings with a known answer.

pub mod example;
