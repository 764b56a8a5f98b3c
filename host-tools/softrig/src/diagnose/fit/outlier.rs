//! A recording of another actuator among good ones.

use softrig_formats::model_file::{ModelFile, parameter_name};

use crate::diagnose::fit::candidates::Candidate;
use crate::diagnose::recordings::noise::NoiseFloor;
use crate::diagnose::recordings::quality::{Concern, Matter};
use crate::estimate::fit::{Effort, rms_each};
use crate::estimate::fitter::Fitter;
use crate::statistics::median;

/// An outlying recording, which seems to be of another actuator.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlier {
    /// Its index.
    pub index: usize,
    /// The concern, if it is left out.
    pub concern: Concern,
    /// The concern, if there is no time to repeat the diagnosis without it.
    pub kept: Concern,
}

/// Looks for one recording that a structure cannot fit together with the others, although
/// the others agree without it and the structure fits it alone with other base parameters:
/// another actuator, or another sensor.
pub fn outlying_recording(
    file: &ModelFile,
    fitter: &Fitter<'_>,
    candidate: &Candidate,
    floor: &NoiseFloor,
) -> Option<Outlier> {
    /// Fewest recordings that have a majority.
    const FEWEST: usize = 4;
    /// Least ratio of its error to that of the others.
    const STANDS_OUT: f64 = 2.5;
    /// Least relative difference of parameters for another actuator.
    const DIFFERS: f64 = 0.08;
    let places: Vec<usize> = (0..candidate.fit.residuals.len()).collect();
    if places.len() < FEWEST {
        return None;
    }
    let each = rms_each(&candidate.fit);
    let index = (0..each.len()).max_by(|&a, &b| each[a].total_cmp(&each[b]))?;
    let mut others_each: Vec<f64> = each.clone();
    others_each.remove(index);
    if each[index] < STANDS_OUT * median(&mut others_each).max(floor.rms) / 1.5 {
        return None;
    }
    let segment = fitter.data.fitted().nth(index)?;
    let own_session = fitter.data.fitted_ranges(segment.session).len() == 1;
    if !own_session {
        // Nobody changes the actuator within a session.
        return None;
    }
    let others = fitter.data.without(&[index]);
    let nominal = fitter.nominal;
    let without =
        Fitter::new(nominal, &others).fit(&candidate.fit.model, &candidate.fit.free, Effort::Full);
    let only = fitter.data.only(&[index]);
    let alone = Fitter::new(nominal, &only);
    let predicted = alone.compare(&without.model).rmse();
    if !floor.covers(without.rmse()) || predicted < STANDS_OUT * without.rmse() {
        return None;
    }
    let own = alone.fit(&without.model, &file.free, Effort::Full);
    if !floor.covers(own.rmse()) {
        return None;
    }
    let (id, ratio) = file
        .free
        .iter()
        .filter_map(|&id| {
            let (others, own) = (without.model.value(id)?, own.model.value(id)?);
            (others.abs() > 0.0).then(|| (id, own / others))
        })
        .max_by(|a, b| {
            libm::log(a.1.abs())
                .abs()
                .total_cmp(&libm::log(b.1.abs()).abs())
        })?;
    if (ratio - 1.0).abs() < DIFFERS {
        return None;
    }
    let recording = &segment.recording;
    let unit = recording.measurand.unit();
    let why = format!(
        "the others agree among themselves to {:.2}{unit} and miss it by {:.2}{unit}; alone it gives {:.2} times their {}",
        without.rmse().to_degrees(),
        predicted.to_degrees(),
        ratio,
        parameter_name(&candidate.fit.model, id)
    );
    let concern = |what: &str| {
        Concern::of(
            Matter::OtherActuator,
            Some(recording),
            format!("behaves like another actuator and {what}: {why}"),
            "check which actuator and which calibration it was recorded with",
        )
    };
    Some(Outlier {
        index,
        concern: concern("is left out"),
        kept: concern("is used all the same"),
    })
}

#[cfg(test)]
mod tests {
    use softrig_formats::recording::Recording;

    use super::*;
    use crate::diagnose::recordings::quality::tests::example;
    use crate::estimate::Dataset;

    #[test]
    fn another_actuator_among_good_recordings_is_named() {
        let (file, mut recordings) = example(25);
        let (_, others) = example(26);
        let index = 4;
        recordings[index] = Recording {
            name: "stranger".into(),
            ..others[index].clone()
        };
        let data = Dataset::of(&recordings);
        let fitter = Fitter::new(&file.model, &data);
        let refit = Candidate::of(0, fitter.fit(&file.model, &file.free, Effort::Full));
        let floor = NoiseFloor::of(&recordings);
        let odd = outlying_recording(&file, &fitter, &refit, &floor).unwrap();
        assert_eq!(
            (odd.index, odd.concern.recording.as_deref()),
            (index, Some("stranger"))
        );
        // Among its own kind nothing is odd.
        let (file, recordings) = example(25);
        let data = Dataset::of(&recordings);
        let fitter = Fitter::new(&file.model, &data);
        let fit = fitter.fit(&file.model, &file.free, Effort::Full);
        let refit = Candidate::of(0, fit);
        assert_eq!(outlying_recording(&file, &fitter, &refit, &floor), None);
    }
}
