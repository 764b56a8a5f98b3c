//! Angles that somebody else's simulation gives: a column of a recording beside the measured one.
//!
//! Whatever made it (an ARX model, SOFA, Simulink, a mock-up unit, the board itself), what it is off
//! needs no model: two columns are subtracted. What it *lacks* is a question of forces, and a column
//! has none. So a model is fitted to the predictions and [stands in](StandIn) for the simulation: the
//! rig that this model would have to follow is its own motion plus what the simulation is off.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::Serialize;
use softrig_formats::columns::{AngleUnit, Columns, Quantity, Unit};
use softrig_formats::error::InputError;
use softrig_formats::model_file::ModelFile;
use softrig_formats::numbers::short;
use softrig_formats::recording::{CalibrationMeta, Recording};

use crate::estimate::refit::refit;
use crate::estimate::simulation::{Arithmetic, Drive};
use crate::statistics::rms;

/// The column in which the board's own prediction stands.
pub const BOARD: &str = "predicted_deg";

/// Standard deviation (kPa, °) of a zero that there is none of.
const NO_ZERO: f64 = 1e-3;

/// A column with predicted angles.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Prediction {
    /// Its name.
    pub column: String,
    /// Its unit, if that was said.
    pub unit: Option<AngleUnit>,
}

impl FromStr for Prediction {
    type Err = String;

    /// Reads `COLUMN` or `COLUMN:UNIT`.
    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        if text.is_empty() {
            return Err("give the name of a column, such as theta_sim or theta_sim:rad".into());
        }
        let with_unit = text.rsplit_once(':').and_then(|(column, unit)| {
            let unit = angle_unit(unit)?;
            (!column.is_empty()).then(|| (column.to_owned(), unit))
        });
        Ok(match with_unit {
            Some((column, unit)) => Self {
                column,
                unit: Some(unit),
            },
            None => Self {
                column: text.to_owned(),
                unit: None,
            },
        })
    }
}

impl fmt::Display for Prediction {
    /// As it is read.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.column)?;
        match self.unit {
            Some(unit) => write!(f, ":{}", Unit::Angle(unit).name()),
            None => Ok(()),
        }
    }
}

fn angle_unit(written: &str) -> Option<AngleUnit> {
    match Unit::of(Quantity::Angle, written) {
        Some(Unit::Angle(unit)) => Some(unit),
        _ => None,
    }
}

impl Prediction {
    /// The board's own.
    pub fn of_board() -> Self {
        Self {
            column: BOARD.to_owned(),
            unit: Some(AngleUnit::Deg),
        }
    }

    /// The predicted angles (rad) of a recording; NaN where there is none.
    ///
    /// Zero and sign are those of the angle's column, and so is the unit unless it was said or ends the
    /// name. What softrig wrote is in degrees as they are.
    ///
    /// # Errors
    ///
    /// Names a recording without such a column, and one that is in another unit than it says.
    pub fn angles(&self, recording: &Recording) -> Result<Vec<f64>, InputError> {
        let column = recording
            .column(&self.column)
            .filter(|column| column.iter().any(|value| value.is_finite()))
            .ok_or_else(|| self.missing(recording))?;
        if self.column == BOARD {
            return Ok(column.iter().map(|degrees| degrees.to_radians()).collect());
        }
        let said = self.unit.or_else(|| self.unit_of_name());
        let of_file = recording.columns;
        let columns = Columns {
            exchange: false,
            angle: said.or(of_file.angle),
            scales: if said.is_some() {
                Default::default()
            } else {
                of_file.scales
            },
            ..of_file
        };
        let read = |value: f64| columns.read([0.0, 0.0, value])[2].to_radians();
        let angles: Vec<f64> = column.into_iter().map(read).collect();
        self.check_unit(recording, &angles)?;
        Ok(angles)
    }

    /// Predicted less measured angle (rad); NaN where nothing is predicted.
    ///
    /// # Errors
    ///
    /// As for [`Self::angles`].
    pub fn residual(&self, recording: &Recording) -> Result<Vec<f64>, InputError> {
        let angles = self.angles(recording)?;
        let both = angles.iter().zip(&recording.angle);
        Ok(both
            .map(|(predicted, measured)| predicted - measured)
            .collect())
    }

    /// The unit that ends the name of the column: `theta_rad`, `theta (deg)`.
    fn unit_of_name(&self) -> Option<AngleUnit> {
        let last = self.column.rsplit(['_', ' ', '(', '[']).next()?;
        angle_unit(last)
    }

    fn missing(&self, recording: &Recording) -> InputError {
        let others: Vec<&str> = recording.extra.iter().map(|it| it.name.as_str()).collect();
        let remedy = if self.column == BOARD {
            "give recordings of `softrig record`: the board logs its prediction in them".to_owned()
        } else if others.is_empty() {
            "add a column with the angles of your simulation, a number a row".to_owned()
        } else {
            format!("its other columns are {}", others.join(", "))
        };
        let found = format!("has no column {} with numbers in it", self.column);
        InputError::new(found, remedy).in_file(&recording.path)
    }

    /// Refuses degrees that are read as radians, and the other way round.
    fn check_unit(&self, recording: &Recording, predicted: &[f64]) -> Result<(), InputError> {
        /// How near to the factor between the units the ratio has to be.
        const NEAR: Range<f64> = 0.7..1.4;
        let pairs = predicted.iter().zip(&recording.angle);
        let pairs = pairs.filter(|(predicted, _)| predicted.is_finite());
        let (product, square) = pairs.fold((0.0, 0.0), |(product, square), (p, m)| {
            (product + p * m, square + m * m)
        });
        let ratio = product / square;
        let unit = if NEAR.contains(&(ratio * 1f64.to_degrees())) {
            "deg"
        } else if NEAR.contains(&(ratio / 1f64.to_degrees())) {
            "rad"
        } else {
            return Ok(());
        };
        // What is 57 times too small was radians and read as degrees.
        let unit = if unit == "deg" { "rad" } else { "deg" };
        Err(InputError::new(
            format!(
                "has predictions in {} that are {} times the measured angle, as if in another unit",
                self.column,
                short(ratio)
            ),
            format!("say the unit: --prediction '{}:{unit}'", self.column),
        )
        .in_file(&recording.path))
    }
}

/// A model in the place of a simulation of which only predictions are known.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct StandIn {
    /// The column with the predictions.
    pub column: String,
    /// RMS of predicted less measured angle (°), over all recordings.
    pub rmse_deg: f64,
    /// RMS of the model that stands in, fitted to the predictions, less the predicted angle (°).
    pub stand_in_rmse_deg: f64,
    /// What a verdict about it can and cannot say.
    pub caveat: String,
}

impl StandIn {
    /// Fits the model to the predictions, and replaces the measured angles by its motion plus what
    /// the simulation is off. Returns the fitted model with it.
    ///
    /// # Errors
    ///
    /// Names a recording without predictions, or with holes in them; whatever keeps a model from
    /// being fitted.
    pub fn of(
        file: &ModelFile,
        prediction: &Prediction,
        fitted: &mut [Recording],
        held_out: &mut [Recording],
    ) -> Result<(Self, ModelFile), InputError> {
        let mut predicted = Vec::new();
        for recording in fitted.iter_mut().chain(held_out.iter_mut()) {
            predicted.push(only_predicted(prediction, recording)?);
        }
        let found = refit(file, &predicted[..fitted.len()])?;
        let model = found.fitted.model;
        let (mut off, mut between) = (Vec::new(), Vec::new());
        let all = fitted.iter_mut().chain(held_out.iter_mut());
        for (recording, predicted) in all.zip(predicted) {
            let angles = predicted.angle.clone();
            // At rest and without zeros, which are then to be found as those of any rig are.
            let simulated = Drive::pressure(predicted)
                .simulate(&model, Arithmetic::F64)
                .map_err(|error| error.in_file(&recording.path))?;
            let rows = recording.angle.iter_mut().zip(&angles).zip(simulated);
            for ((measured, predicted), simulated) in rows {
                let simulated = simulated.to_radians();
                off.push(predicted - *measured);
                between.push(simulated - predicted);
                *measured += simulated - predicted;
            }
        }
        let [rmse_deg, stand_in_rmse_deg] = [off, between].map(|it| rms(&it).to_degrees());
        let text = file.text_with(&model, "");
        let stand_in = Self {
            column: prediction.column.clone(),
            rmse_deg,
            stand_in_rmse_deg,
            caveat: caveat(
                &file.name,
                &prediction.column,
                [rmse_deg, stand_in_rmse_deg],
                fitted.first().map_or("°", |it| it.measurand.unit()),
            ),
        };
        Ok((stand_in, ModelFile::parse(&text, &file.path)?))
    }
}

fn caveat(model: &str, column: &str, [rmse_deg, stand_in_deg]: [f64; 2], unit: &str) -> String {
    let poor = if stand_in_deg > rmse_deg {
        ". It misses the predictions by more than they miss the rig: take the answer as a hint"
    } else {
        ""
    };
    format!(
        "the simulation behind {column} is {}{unit} RMS off the rig. {model}, fitted to its \
         predictions with {}{unit} RMS, is diagnosed in its place: the answer is the force on it \
         that leaves the same residual{poor}",
        short(rmse_deg),
        short(stand_in_deg)
    )
}

/// The part of a recording that has predictions, and the same with these as its angle.
fn only_predicted(
    prediction: &Prediction,
    recording: &mut Recording,
) -> Result<Recording, InputError> {
    let angles = prediction.angles(recording)?;
    let has = |angle: &f64| angle.is_finite();
    let begin = angles.iter().position(has).unwrap_or(0);
    let end = angles.iter().rposition(has).map_or(0, |last| last + 1);
    let holes = angles[begin..end].iter().filter(|it| !has(it)).count();
    if holes > 0 {
        return Err(InputError::new(
            format!(
                "has {holes} samples without a number in {}, between others that have one",
                prediction.column
            ),
            "fill them, or cut the recording there: a residual with holes is no motion",
        )
        .in_file(&recording.path));
    }
    if begin > 0 || end < recording.len() {
        *recording = recording.slice(&(begin..end));
    }
    let mut predicted = Recording {
        angle: angles[begin..end].to_vec(),
        removed: Vec::new(),
        ..recording.clone()
    };
    // A simulation has no sensors, so there are no zeros to be found in it.
    predicted.meta.calibration = Some(CalibrationMeta {
        pressure_zero_sd_kpa: Some(NO_ZERO),
        angle_zero_sd_deg: Some(NO_ZERO),
    });
    Ok(predicted)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn recording(name: &str, values: &str) -> Recording {
        let rows = values
            .split(' ')
            .enumerate()
            .map(|(row, value)| format!("{},0,{},{value}\n", row as f64 * 0.01, 10 * row));
        let rows: Vec<String> = rows.collect();
        let rows = rows.concat();
        let text = format!("time_s,pressure_kpa,angle_deg,{name}\n{rows}");
        Recording::parse(&text, Path::new("run.csv")).unwrap().0
    }

    fn degrees(prediction: &str, name: &str, values: &str) -> Result<Vec<f64>, String> {
        let prediction: Prediction = prediction.parse().unwrap();
        let angles = prediction.angles(&recording(name, values));
        angles
            .map(|it| it.iter().map(|angle| angle.to_degrees().round()).collect())
            .map_err(|error| error.to_string())
    }

    #[test]
    fn the_unit_is_said_or_ends_the_name_or_is_that_of_the_angle() {
        let expected = Ok(vec![0.0, 11.0, 23.0]);
        let radians = "0 0.192 0.4014";
        assert_eq!(degrees("sim:rad", "sim", radians), expected);
        assert_eq!(degrees("sim_rad", "sim_rad", radians), expected);
        assert_eq!(degrees("sim", "sim", "0 11 23"), expected);
        assert_eq!(degrees("a:b", "a:b", "0 11 23"), expected);
        let error = degrees("sim", "sim", radians).unwrap_err();
        assert!(error.contains("sim:rad"), "{error}");
        let error = degrees("sim:rad", "sim", "0 11 23").unwrap_err();
        assert!(error.contains("sim:deg"), "{error}");
        let error = degrees("other", "sim", "0 11 23").unwrap_err();
        assert!(error.contains("its other columns are sim"), "{error}");
    }

    #[test]
    fn what_has_no_prediction_at_an_end_is_cut_off_and_a_hole_is_refused() {
        let prediction: Prediction = "sim".parse().unwrap();
        let mut run = recording("sim", "nan 11 23 nan");
        let predicted = only_predicted(&prediction, &mut run).unwrap();
        assert_eq!((run.len(), predicted.len()), (2, 2));
        let error = only_predicted(&prediction, &mut recording("sim", "0 nan 23")).unwrap_err();
        assert!(error.to_string().contains("1 samples"), "{error}");
    }
}
