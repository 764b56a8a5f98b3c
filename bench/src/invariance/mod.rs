//! Invariance: the same question, asked otherwise, should get the same answer.
//!
//! A benchmark with known answers needs labels, and labels of real rigs are rare and are
//! opinions. Whether an answer depends on the random seed, on the order of the files or on
//! the first guess can be seen on any recording. `cargo xtask bench invariance` asks every
//! case as it is, then in the other [`ways`], and counts how often the answer stays.
//!
//! On the same cases [`calibration`] counts how often what is stated with a probability is
//! right; [`choice`] is what both let one choose.

pub mod answer;
pub mod ask;
pub mod calibration;
pub mod cases;
pub mod choice;
pub mod counts;
pub mod dirt;
pub mod known;
pub mod pose;
pub mod run;
pub mod ways;
