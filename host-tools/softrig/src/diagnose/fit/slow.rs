//! Time constants that no recording is long enough for.

use model_core::actuator::ParameterId;
use model_core::effects::Unit;

use crate::diagnose::fit::candidates::Candidate;
use crate::diagnose::recordings::quality::{Concern, Matter};
use crate::estimate::Dataset;

/// Concerns about time constants of named effects that are too long for the runs.
pub fn slow_effects(candidate: &Candidate, data: &Dataset) -> Vec<Concern> {
    /// Longest time constant that a run shows, as a share of its length.
    const SHARE: f64 = 0.7;
    let longest = data
        .sessions()
        .iter()
        .map(|session| session.recording().duration())
        .fold(0.0, f64::max);
    let model = &candidate.fit.model;
    let first = model.effects().count() - candidate.added.len();
    let mut concerns = Vec::new();
    for (offset, kind) in candidate.added.iter().enumerate() {
        for (parameter, row) in kind.parameters().iter().enumerate() {
            let id = ParameterId::Effect {
                slot: first + offset,
                parameter,
            };
            let Some(value) = model.value(id) else {
                continue;
            };
            if row.unit == Unit::Second && value > SHARE * longest {
                concerns.push(Concern {
                    matter: Matter::TimeConstant,
                    recording: None,
                    text: format!(
                        "{} of {} is {value:.0} s, longer than these runs of up to {longest:.0} s can show",
                        row.key,
                        kind.name()
                    ),
                    advice: format!("hold a step for {:.0} s and record its release", 3.0 * value),
                });
            }
        }
    }
    concerns
}
