//! The whole loop on simulated data, for someone who has no rig yet.
use crate::shell::Outcome;
/// Simulates a rig with a hidden effect, diagnoses it and repairs the model.
pub fn demo() -> Outcome {
    Err("soon".into())
}
