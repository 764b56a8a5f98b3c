//! Practical identifiability: which parameters the recordings determine.
//!
//! The Jacobian of the simulated angle by *relative* changes of the parameters has a small
//! singular value for each practically unidentifiable direction, and that direction is
//! reported. Where nothing at all determines it (the scale of the inertia, if everything
//! is free), one of its parameters is held at its nominal value, which is reported too: a
//! fit would only return its initial guess.
//!
//! Two quantities are never identifiable and not tried: the gain of the angle sensor,
//! which stiffness, damping and input gain absorb, and the scale of the inertia.

use model_core::actuator::ParameterId;

use super::candidates::Candidate;
use crate::estimate::fit::{Effort, Fit, Fitter, UnidentifiableDirection};
use crate::io::model_file::{ModelFile, parameter_name};

/// Relative standard error from which a direction counts as undetermined.
const NOTHING_DETERMINES: f64 = 100.0;

/// Problems of identifiability.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Identifiability {
    /// Practically unidentifiable directions.
    pub unidentifiable: Vec<UnidentifiableDirection>,
    /// Parameters that ended at a bound of their search range.
    pub at_bound: Vec<ParameterId>,
    /// Parameters that were held at their nominal value because the recordings do not
    /// determine them beside the others.
    pub held: Vec<ParameterId>,
    /// All of it in sentences.
    pub text: Vec<String>,
}

impl Identifiability {
    /// Examines a final fit, in which `held` were not free.
    pub fn of(fit: &Fit, held: &[ParameterId]) -> Self {
        let at_bound: Vec<ParameterId> = fit
            .free
            .iter()
            .enumerate()
            .filter(|(index, _)| fit.at_bound(*index))
            .map(|(_, &id)| id)
            .collect();
        let mut unidentifiable = fit.unidentifiable_directions();
        // At a bound the slope of the transform is zero, whatever the recordings say.
        unidentifiable.retain(|direction| {
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
        for direction in &unidentifiable {
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
            unidentifiable,
            at_bound,
            held: held.to_vec(),
            text,
        }
    }
}

/// Fits the nominal structure and holds, one by one, undetermined parameters. Returns the
/// fit, and the model file with the parameters that are still free.
pub fn refit(file: &ModelFile, fitter: &Fitter<'_>) -> (Candidate, ModelFile, Identifiability) {
    let mut file = file.clone();
    let mut held = Vec::new();
    loop {
        let fit = fitter.fit(&file.model, &file.free, Effort::Full);
        let undetermined = Identifiability::of(&fit, &held)
            .unidentifiable
            .into_iter()
            .filter(|direction| direction.standard_error > NOTHING_DETERMINES)
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

/// The parameter to hold: the inertia if it is involved, since it scales everything else;
/// otherwise the one with the largest share.
fn worst(direction: &UnidentifiableDirection) -> Option<ParameterId> {
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
