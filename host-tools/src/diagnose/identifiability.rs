//! Which parameters the recordings determine, and which they do not.
//!
//! The Jacobian of the simulated angle by *relative* changes of the parameters
//! has a small singular value for every combination that can move unnoticed.
//! Such a direction is named. Where nothing at all determines it (the scale of
//! the inertia, if everything is free), one of its parameters is held at its
//! nominal value, which is said as well: a fit would only return its start.
//!
//! Never seen at all, and not tried: the sensor's gain, which stiffness,
//! damping and input gain absorb, and the scale of the inertia.

use model_core::actuator::ParameterId;

use super::candidates::Candidate;
use crate::estimate::fit::{Effort, Fit, Fitter, FlatDirection};
use crate::io::model_file::{ModelFile, parameter_name};

/// Beyond this relative standard error nothing determines a direction.
const NOTHING_DETERMINES: f64 = 100.0;

/// What is wrong with how well parameters are determined.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Identifiability {
    /// Combinations that could move by more than half their size unnoticed.
    pub flat: Vec<FlatDirection>,
    /// Parameters that ended at the edge of the range that was searched.
    pub at_bound: Vec<ParameterId>,
    /// Parameters that were held at their nominal value, since nothing
    /// determines them beside the others.
    pub held: Vec<ParameterId>,
    /// All of it in sentences.
    pub text: Vec<String>,
}

impl Identifiability {
    /// Looks at a finished fit; `held` were taken out of it before.
    pub fn of(fit: &Fit, held: &[ParameterId]) -> Self {
        let at_bound: Vec<ParameterId> = fit
            .free
            .iter()
            .enumerate()
            .filter(|(index, _)| fit.at_bound(*index))
            .map(|(_, &id)| id)
            .collect();
        let mut flat = fit.flat_directions();
        // A parameter at its bound is flat in the solver's coordinate only.
        flat.retain(|direction| {
            direction
                .shares
                .first()
                .is_some_and(|(id, _)| !at_bound.contains(id))
        });
        let name = |id: ParameterId| parameter_name(&fit.model, id);
        let mut text = Vec::new();
        for &id in held {
            text.push(format!(
                "{} is held at its nominal value: together with the others nothing in these recordings determines it",
                name(id)
            ));
        }
        for direction in &flat {
            let names: Vec<String> = direction.shares.iter().map(|&(id, _)| name(id)).collect();
            text.push(match names.as_slice() {
                [only] => format!("{only} is hardly determined by these recordings"),
                _ => format!(
                    "{} can change together almost unnoticed: their values are not to be trusted one by one",
                    names.join(", ")
                ),
            });
        }
        for &id in &at_bound {
            text.push(format!(
                "{} ended at the edge of the range that was searched",
                name(id)
            ));
        }
        Self {
            flat,
            at_bound,
            held: held.to_vec(),
            text,
        }
    }
}

/// Fits the nominal structure and holds, one by one, parameters that nothing
/// determines. Returns the fit, and the model file with what may still move.
pub fn refit(file: &ModelFile, fitter: &Fitter<'_>) -> (Candidate, ModelFile, Identifiability) {
    let mut file = file.clone();
    let mut held = Vec::new();
    loop {
        let fit = fitter.fit(&file.model, &file.free, Effort::Full);
        let undetermined = Identifiability::of(&fit, &held)
            .flat
            .into_iter()
            .filter(|direction| direction.reach > NOTHING_DETERMINES)
            .find_map(|direction| worst(&direction));
        match undetermined {
            Some(id) if file.free.len() > 1 => {
                file.free.retain(|&free| free != id);
                held.push(id);
            }
            _ => {
                let found = Identifiability::of(&fit, &held);
                let refit = Candidate::of(Vec::new(), fit);
                return (refit, file, found);
            }
        }
    }
}

/// The parameter to hold: the inertia where it takes part, since the scale of
/// everything else hangs on it; otherwise the one that moves most.
fn worst(direction: &FlatDirection) -> Option<ParameterId> {
    let ids = || direction.shares.iter().map(|&(id, _)| id);
    ids()
        .find(|id| *id == ParameterId::Inertia)
        .or_else(|| ids().next())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::estimate::Dataset;
    use crate::synth::example::{Hidden, make};

    #[test]
    fn the_scale_of_the_inertia_is_held_and_said() {
        let example = make(Hidden::Nothing, 0.2, 11).unwrap();
        let text = example.model.replace(
            "\"damping\", \"stiffness\", \"input_gain\"",
            "\"inertia\", \"damping\", \"stiffness\", \"input_gain\"",
        );
        let file = ModelFile::parse(&text, Path::new("model.toml")).unwrap();
        let recordings: Vec<_> = example
            .recordings
            .iter()
            .step_by(4)
            .map(|(_, recording, _)| recording.clone())
            .collect();
        let data = Dataset::of(&recordings);
        let fitter = Fitter::new(&file.model, &data);
        let (refit, without, found) = refit(&file, &fitter);
        assert_eq!(found.held, [ParameterId::Inertia]);
        assert!(!without.free.contains(&ParameterId::Inertia));
        assert!(found.text[0].starts_with("inertia is held"));
        assert!(refit.fit.rmse() < 0.25f64.to_radians());
    }
}
