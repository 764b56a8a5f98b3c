//! What an identification found that a person should know: an angle that counts the other
//! way round, recordings that begin in motion, a second minimum that is as good.

use model_core::actuator::{Model, ParameterId};

use super::Identified;
use crate::estimate::Dataset;
use crate::estimate::usable::{Concern, Matter};
use crate::io::model_file::{parameter_name, parameter_unit, to_file_units};
use crate::numbers::short;

impl Identified {
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
            format!("{which} while the actuator moves: angle and rate at the start are estimated, and creep or hysteresis from before cannot be known"),
            "begin a recording at rest where you can",
        )
    })
}
