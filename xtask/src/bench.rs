//! Benchmarks.
use crate::shell::Outcome;
/// Host.
pub fn host() -> Outcome {
    Err("soon".into())
}
/// Board.
pub fn board() -> Outcome {
    Err("soon".into())
}
