//! What an identification found that a person should know: an angle that counts the other
//! way round, recordings that begin in motion, a second minimum that is as good, zeros that
//! are no zeros.

use model_core::actuator::{Model, ParameterId};

use super::Identification;
use crate::estimate::Dataset;
use crate::estimate::fit::Fit;
use crate::estimate::nuisance::{Nuisance, ZEROS};
use crate::estimate::usable::{Concern, Matter};
use softrig_formats::model_file::{parameter_name, parameter_unit, to_file_units};
use softrig_formats::numbers::short;
use softrig_formats::recording::PASCAL_PER_KPA;

impl Identification {
    /// Remarks about the fit of the model `given` in the file.
    pub fn remarks(&self, given: &Model<f64>, data: &Dataset) -> Vec<Concern> {
        let mut remarks = Vec::new();
        remarks.extend(self.opposite_gain(given));
        remarks.extend(self.second_minimum());
        remarks.extend(in_motion(data));
        remarks
    }

    /// The gain has the other sign than the one given, beyond doubt.
    fn opposite_gain(&self, given: &Model<f64>) -> Option<Concern> {
        let gain = ParameterId::InputGain;
        let place = self.fit.free.iter().position(|id| *id == gain)?;
        let (low, high) = self.fit.interval95(place)?;
        let given = given.value(gain)?;
        let is_opposite = low * high > 0.0 && low * given < 0.0;
        let sign = if low < 0.0 { "negative" } else { "positive" };
        is_opposite.then(|| {
            Concern::of(
                Matter::OppositeGain,
                None,
                format!(
                    "the input gain comes out {sign}, against the model file: the angle {} as the pressure grows",
                    if low < 0.0 { "falls" } else { "grows" }
                ),
                "add --flip-angle if the angle counts the other way round; else give the gain its sign in the model file",
            )
        })
    }

    fn second_minimum(&self) -> Option<Concern> {
        let twin = self.twin?;
        let values = |model: &Model<f64>| -> String {
            let values: Vec<String> = self
                .fit
                .free
                .iter()
                .filter_map(|&id| {
                    let value = short(to_file_units(model, id, model.value(id)?));
                    let unit = parameter_unit(model, id);
                    Some(
                        format!("{} {value} {unit}", parameter_name(model, id))
                            .trim_end()
                            .into(),
                    )
                })
                .collect();
            values.join(", ")
        };
        Some(Concern::of(
            Matter::TwoMinima,
            None,
            format!(
                "two sets of base parameters fit equally well: {} is used, {} is as good",
                values(&self.fit.model),
                values(&twin)
            ),
            "record faster steps, or a slow cycle, and hold what you know: leave it out of [fit] free",
        ))
    }
}

/// How many sessions begin while the actuator moves.
fn in_motion(data: &Dataset) -> Option<Concern> {
    /// Standard errors of a rate that is one.
    const CLEAR: f64 = 5.0;
    let sessions = data.sessions();
    let moving = sessions
        .iter()
        .filter(|session| {
            let (start, error) = (session.prior().mean.start, session.prior().deviation.start);
            start.rate.abs() > CLEAR * error.rate
        })
        .count();
    (moving > 0).then(|| {
        let which = match (moving, sessions.len()) {
            (_, 1) => "the recording begins".to_owned(),
            (all, of) if all == of => "all recordings begin".to_owned(),
            (1, of) => format!("1 of {of} recordings begins"),
            (some, of) => format!("{some} of {of} recordings begin"),
        };
        Concern::of(
            Matter::InMotion,
            None,
            format!("{which} while the actuator moves: angle, rate and the state of creep or hysteresis are estimated"),
            "begin a recording at rest where you can",
        )
    })
}

/// Zeros of a fit that are farther from the calibration than its error: what they take up is
/// a property of the rig. At most one concern for each sensor.
pub fn far_zeros(fit: &Fit, data: &Dataset) -> Vec<Concern> {
    /// Standard deviations of a zero that are still a zero: one in twenty is farther.
    const NEAR: f64 = 2.0;
    /// Name, unit, size of that unit, and the zero.
    type Sensor<'a> = (&'a str, &'a str, f64, fn(&Nuisance) -> f64);
    let measurand = data.measurand();
    let sensors: [Sensor<'_>; 2] = [
        ("pressure", " kPa", PASCAL_PER_KPA, |it| it.pressure_zero),
        (
            measurand.name(),
            measurand.unit(),
            1f64.to_radians(),
            |it| it.angle_zero,
        ),
    ];
    ZEROS
        .zip(sensors)
        .filter_map(|(place, (name, unit, one, zero))| {
            let far: Vec<[f64; 2]> = data
                .sessions()
                .iter()
                .zip(&fit.nuisances)
                .filter(|(session, _)| session.is_estimated())
                .filter(|(session, found)| session.prior().departures(found)[place].abs() > NEAR)
                .map(|(session, found)| {
                    [
                        zero(found) / one,
                        zero(&session.prior().deviation) / one,
                    ]
                })
                .collect();
            let [worst, deviation] = *far.iter().max_by(|a, b| a[0].abs().total_cmp(&b[0].abs()))?;
            let which = if far.len() == 1 && data.sessions().len() == 1 {
                String::new()
            } else {
                format!(" in {} of {} sessions", far.len(), data.sessions().len())
            };
            Some(Concern::of(
                Matter::FarZero,
                None,
                format!(
                    "the zero of the {name} ends up to {}{unit} from the calibration{which}, which should hold within {}{unit}",
                    short(worst),
                    short(NEAR * deviation)
                ),
                "calibrate it and record again; if it persists, it reflects an offset of the rig or a missing effect, and biases parameters and names",
            ))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::estimate::refit::refit;
    use crate::synth::example::{Hidden, make};
    use softrig_formats::model_file::ModelFile;
    use softrig_formats::recording::Recording;

    /// Of a sensor that is off by three times what a calibration leaves, a fit says so; of one
    /// that is right, nothing.
    #[test]
    fn a_zero_beyond_its_calibration_is_said() {
        let example = make(Hidden::Nothing, 0.1, 5).unwrap();
        let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
        let said_with = |offset_deg: f64| {
            let shifted = |recording: Recording| Recording {
                angle: recording
                    .angle
                    .iter()
                    .map(|angle| angle + offset_deg.to_radians())
                    .collect(),
                ..recording
            };
            let recordings: Vec<Recording> = example
                .recordings
                .iter()
                .map(|(_, recording, _)| shifted(recording.clone()))
                .collect();
            let found = refit(&file, &recordings).unwrap();
            let said = found.concerns.into_iter();
            let said: Vec<String> = said
                .filter(|it| it.matter == Matter::FarZero)
                .map(|it| it.text)
                .collect();
            said
        };
        assert_eq!(said_with(0.0), Vec::<String>::new());
        let said = said_with(-7.0);
        assert!(
            said.iter().any(|it| it.contains("zero of the angle")),
            "{said:?}"
        );
    }
}
