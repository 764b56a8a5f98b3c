//! Practical identifiability: which parameters the recordings determine.
//!
//! The Jacobian of the simulated angle by *relative* changes of the parameters has a small
//! singular value for each practically unidentifiable direction, and that direction is
//! reported. Where nothing at all determines it (the scale of the inertia, if everything
//! is free), one of its parameters is held, which is reported too.
//!
//! Two quantities are never identifiable and not tried: the gain of the angle sensor,
//! which stiffness, damping and input gain absorb, and the scale of the inertia.

use model_core::actuator::ParameterId;

use crate::diagnose::fit::candidates::Candidate;
use crate::estimate::fit::{Effort, Fit, UnidentifiableDirection};
use crate::estimate::fitter::Fitter;
use crate::estimate::identify::{EXPONENTS, Order, identify};
use crate::estimate::usable::Concern;
use softrig_formats::model_file::{ModelFile, parameter_name};

/// Relative standard error from which a direction counts as undetermined.
const NOTHING_DETERMINES: f64 = 100.0;

/// Problems of identifiability.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Identifiability {
    /// Practically unidentifiable directions.
    pub unidentifiable: Vec<UnidentifiableDirection>,
    /// Parameters that ended at a bound of their search range.
    pub at_bound: Vec<ParameterId>,
    /// Parameters that were held because the recordings do not determine them beside the
    /// others.
    pub held: Vec<ParameterId>,
    /// Whether the inertia shows.
    pub order: Order,
    /// All of it in sentences.
    pub text: Vec<String>,
}

impl Identifiability {
    /// Examines a final fit, in which `held` were not free.
    pub fn of(fit: &Fit, held: &[ParameterId], order: Order) -> Self {
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
            let name = name(id);
            text.push(match id {
                ParameterId::Inertia => format!(
                    "{name} is held at its nominal value: these recordings do not determine it alongside the others"
                ),
                _ => format!(
                    "{name} is held as first fitted: these recordings do not determine it alongside the others"
                ),
            });
        }
        if order == Order::First {
            text.push(
                "without an effect the motion is first-order: the inertia is not identifiable, only the ratios of damping, stiffness and gain are".to_owned(),
            );
        }
        let is_the_scale = |direction: &UnidentifiableDirection| {
            let mut ids = direction.shares.iter().map(|&(id, _)| id);
            order == Order::First && ids.any(|id| id == ParameterId::Damping)
        };
        for direction in unidentifiable.iter().filter(|it| !is_the_scale(it)) {
            let names: Vec<String> = direction.shares.iter().map(|&(id, _)| name(id)).collect();
            text.push(match names.as_slice() {
                [only] => format!("{only} is hardly determined by these recordings"),
                _ => format!(
                    "{} can change together almost unnoticed: do not trust their individual values",
                    names.join(", ")
                ),
            });
        }
        for (index, &id) in fit.free.iter().enumerate() {
            if !at_bound.contains(&id) {
                continue;
            }
            let name = name(id);
            text.push(if fit.is_nothing(index) {
                format!("{name} ended at zero: these recordings show none of it")
            } else {
                format!("{name} ended at the edge of the range that was searched")
            });
        }
        Self {
            unidentifiable,
            at_bound,
            held: held.to_vec(),
            order,
            text,
        }
    }
}

/// The nominal structure as the recordings identify it.
#[derive(Clone, Debug)]
pub struct NominalRefit {
    /// The fit.
    pub refit: Candidate,
    /// The model file as fitted, with the parameters that are still free.
    pub file: ModelFile,
    /// What the recordings determine.
    pub identified: Identifiability,
    /// What a person should know.
    pub remarks: Vec<Concern>,
}

/// Identifies the nominal structure and holds, one by one, undetermined parameters. None
/// if the model cannot be simulated.
pub fn refit(file: &ModelFile, fitter: &Fitter<'_>) -> Option<NominalRefit> {
    let mut file = file.clone();
    let identified = identify(&file.model, &file.free, &EXPONENTS, fitter.data)?;
    let remarks = identified.remarks(&file.model, fitter.data);
    let order = identified.order;
    let mut held: Vec<ParameterId> = file
        .free
        .iter()
        .copied()
        .filter(|id| !identified.released.free.contains(id))
        .collect();
    file.free.clone_from(&identified.released.free);
    let mut fit = identified.released;
    loop {
        let undetermined = Identifiability::of(&fit, &held, order)
            .unidentifiable
            .into_iter()
            .filter(|direction| direction.standard_error > NOTHING_DETERMINES)
            .find_map(|direction| worst(&direction));
        match undetermined {
            Some(id) if file.free.len() > 1 => {
                file.free.retain(|&free| free != id);
                held.push(id);
                // The file's inertia scales everything; nothing else in it is better known.
                let start = match file.model.value(id) {
                    Some(value) if id == ParameterId::Inertia => fit.model.with_value(id, value),
                    _ => fit.model,
                };
                fit = fitter.fit(&start, &file.free, Effort::Full);
            }
            _ => {
                file.model = fit.model;
                return Some(NominalRefit {
                    identified: Identifiability::of(&fit, &held, order),
                    refit: Candidate::of(0, fit),
                    file,
                    remarks,
                });
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
        let NominalRefit {
            refit,
            file: without,
            identified: found,
            ..
        } = refit(&file, &fitter).unwrap();
        assert_eq!(found.held, [ParameterId::Inertia]);
        assert!(!without.free.contains(&ParameterId::Inertia));
        assert!(found.text[0].starts_with("inertia is held"));
        assert!(refit.fit.rmse() < 0.25f64.to_radians());
    }
}
