//! Base parameters that a refit moves farther than anybody misjudges them.
//!
//! A structure that lacks an effect bends its parameters to follow it: a damping forty times that of the model is creep
//! or friction, told in the only words that the model has.

use model_core::actuator::ParameterId;
use softrig_formats::model_file::{ModelFile, parameter_name};
use softrig_formats::numbers::short;

use crate::diagnose::recordings::quality::{Concern, Matter};
use crate::estimate::fit::Fit;

/// How far a number of a model is off at most, as a factor: data sheets and hand calculations of soft
/// bodies are right within two or three.
pub const FARTHEST: f64 = 5.0;

/// What imitates a parameter that is far above and far below what was expected.
const IMITATES: [(ParameterId, [&str; 2]); 3] = [
    (
        ParameterId::Damping,
        [
            "creep, dry friction and a slow input look like so much damping",
            "a second mode of vibration looks like so little damping",
        ],
    ),
    (
        ParameterId::Stiffness,
        [
            "gravity, an end stop and stiffening by pressure look like so much stiffness",
            "creep, weight that pulls along and softening look like so little stiffness",
        ],
    ),
    (
        ParameterId::InputGain,
        [
            "a wrong unit of the pressure looks like so large a gain",
            "a wrong unit of the pressure, a leak and an offset of the pressure look like so small a gain",
        ],
    ),
];

/// Concerns about parameters of the refit that are far from those of the model file. Where the
/// inertia does not show, only ratios of the parameters do: a factor that all of them share is not
/// a concern.
pub fn far_numbers(file: &ModelFile, refit: &Fit) -> Vec<Concern> {
    let logarithm = |id: ParameterId| -> Option<f64> {
        let ratio = refit.model.value(id)? / file.model.value(id)?;
        (ratio > 0.0 && ratio.is_finite()).then(|| libm::log(ratio))
    };
    let moved: Vec<(usize, f64)> = IMITATES
        .iter()
        .enumerate()
        .filter(|(_, (id, _))| refit.free.contains(id))
        .filter_map(|(place, (id, _))| Some((place, logarithm(*id)?)))
        .collect();
    let of_inertia = logarithm(ParameterId::Inertia).unwrap_or(0.0);
    let mut all: Vec<f64> = moved.iter().map(|(_, moved)| *moved).collect();
    all.push(of_inertia);
    let common = crate::statistics::median(&mut all);
    moved
        .into_iter()
        .map(|(place, moved)| (&IMITATES[place], moved))
        .filter(|(_, moved)| {
            moved.abs() > libm::log(FARTHEST) && (moved - common).abs() > libm::log(FARTHEST)
        })
        .map(|((id, [above, below]), moved)| {
            let name = parameter_name(&refit.model, *id);
            let text = if moved > 0.0 {
                format!(
                    "without any effect, {name} ends at {} times its nominal value",
                    short(libm::exp(moved))
                )
            } else {
                format!(
                    "without any effect, {name} ends at 1/{} of its nominal value",
                    short(libm::exp(-moved))
                )
            };
            Concern::of(
                Matter::FarNumber,
                None,
                text,
                if moved > 0.0 { above } else { below },
            )
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::estimate::Dataset;
    use crate::estimate::fitter::Fitter;
    use crate::synth::example::{Hidden, make};
    use softrig_formats::recording::Recording;

    /// The refit of a model whose damping is a fiftieth of the true one says so; one that is off as
    /// data sheets are says nothing, and neither does one in other units of force.
    #[test]
    fn a_number_that_nobody_misjudges_is_said() {
        let example = make(Hidden::Nothing, 0.1, 3).unwrap();
        let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
        let recordings: Vec<Recording> = example.recordings.into_iter().map(|it| it.1).collect();
        let data = Dataset::of(&recordings);
        let refit = |file: &ModelFile| {
            let fitter = Fitter::new(&file.model, &data);
            fitter.fit(&file.model, &file.free, crate::estimate::fit::Effort::Full)
        };
        let fitted = refit(&file);
        assert!(far_numbers(&file, &fitted).is_empty());
        let mut off = file.clone();
        let damping = fitted.model.value(ParameterId::Damping).unwrap();
        off.model = off.model.with_value(ParameterId::Damping, damping / 50.0);
        let said = far_numbers(&off, &fitted);
        assert_eq!(said.len(), 1);
        assert!(
            said[0].text.contains("damping ends at 50.0 times"),
            "{}",
            said[0].text
        );
        // All forces by the same factor: another unit.
        let mut scaled = file.clone();
        for id in [
            ParameterId::Damping,
            ParameterId::Stiffness,
            ParameterId::InputGain,
        ] {
            let value = fitted.model.value(id).unwrap();
            scaled.model = scaled.model.with_value(id, value / 50.0);
        }
        assert!(far_numbers(&scaled, &fitted).is_empty());
    }
}
