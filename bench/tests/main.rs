//! What the benchmarks stand on, in one program.

mod blind_bench;
mod blind_examples;
mod blind_score;
mod blind_truth;
mod dirt;
mod invariance;
