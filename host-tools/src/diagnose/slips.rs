//! Columns that do not hold what their header says.
//!
//! Another unit, or pressure and angle exchanged: either makes a gap that no
//! effect explains, and a diagnosis would look for one all the same. The nominal
//! model tells: data sheets are right to a third, so that it agrees far better
//! with the recordings once the columns are read as they were meant.

use crate::error::InputError;
use crate::fit::{Fitter, Run};
use crate::model_file::ModelFile;
use crate::recording::Recording;
use crate::statistics::rms;

/// How a recording may have been meant.
enum Slip {
    /// A column is in another unit.
    Unit {
        column: &'static str,
        read_as: &'static str,
        /// What the column would have to be multiplied by.
        factor: f64,
    },
    /// Pressure and angle stand in each other's column.
    Exchanged,
}

const SLIPS: [Slip; 6] = [
    Slip::Unit {
        column: PRESSURE,
        read_as: "psi",
        factor: 6.894_757,
    },
    Slip::Unit {
        column: PRESSURE,
        read_as: "bar",
        factor: 100.0,
    },
    Slip::Unit {
        column: PRESSURE,
        read_as: "MPa",
        factor: 1000.0,
    },
    Slip::Unit {
        column: PRESSURE,
        read_as: "Pa",
        factor: 0.001,
    },
    Slip::Unit {
        column: "angle_deg",
        read_as: "radians",
        factor: 57.295_78,
    },
    Slip::Exchanged,
];

const PRESSURE: &str = "pressure_kpa";

/// Pascals in a file's unit of pressure.
const KILO: f64 = 1e3;

/// Refuses recordings with which the nominal model agrees far better if a
/// column is read in another unit, or pressure and angle are exchanged.
///
/// # Errors
///
/// Names the recordings, the columns and what to do with them.
pub fn refuse(file: &ModelFile, recordings: &[Recording]) -> Result<(), InputError> {
    /// A nominal model that misses by less, relative to the motion, reads the
    /// columns right.
    const WRONG: f64 = 0.6;
    /// One that misses by no more than this with a slip is convincing.
    const RIGHT: f64 = 0.35;
    let as_it_is = |recording| miss(file, &start_of(recording));
    let undone = |slip: &Slip, recording| miss(file, &slip.undone(start_of(recording)));
    let convincing = |recording| {
        (as_it_is(recording) >= WRONG)
            .then(|| {
                SLIPS
                    .iter()
                    .map(|slip| (undone(slip, recording), slip))
                    .filter(|(miss, _)| *miss < RIGHT)
                    .min_by(|a, b| a.0.total_cmp(&b.0))
            })
            .flatten()
    };
    let Some((first, slip)) = recordings
        .iter()
        .find_map(|recording| Some((recording, convincing(recording)?.1)))
    else {
        return Ok(());
    };
    // Where one shows it, it is likely in all that agree better so.
    let names: Vec<&str> = recordings
        .iter()
        .filter(|recording| undone(slip, recording) < as_it_is(recording))
        .map(|recording| recording.name.as_str())
        .collect();
    let whole = if names.len() == recordings.len() {
        "every recording".to_owned()
    } else {
        names.join(", ")
    };
    Err(slip.refused(&whole).in_file(&first.path))
}

impl Slip {
    /// A recording as it was meant.
    fn undone(&self, mut recording: Recording) -> Recording {
        match *self {
            Self::Unit { column, factor, .. } => {
                let values = if column == PRESSURE {
                    &mut recording.pressure
                } else {
                    &mut recording.angle
                };
                for value in values {
                    *value *= factor;
                }
            }
            Self::Exchanged => {
                for (pressure, angle) in recording.pressure.iter_mut().zip(&mut recording.angle) {
                    (*pressure, *angle) =
                        (angle.to_degrees() * KILO, (*pressure / KILO).to_radians());
                }
            }
        }
        recording
    }

    fn refused(&self, whole: &str) -> InputError {
        match self {
            Self::Unit {
                column,
                read_as,
                factor,
            } => InputError::new(
                format!(
                    "the units look mixed up: the model agrees with {whole} only if {column} is read as {read_as}"
                ),
                format!("multiply the column by {factor} and try again, or correct the model"),
            ),
            Self::Exchanged => InputError::new(
                format!(
                    "the columns look exchanged: the model agrees with {whole} only if {PRESSURE} and angle_deg change places"
                ),
                "exchange the two names in the header and try again, or correct the model",
            ),
        }
    }
}

/// As much of a recording as is enough to see a slip.
fn start_of(recording: &Recording) -> Recording {
    const ENOUGH: usize = 1_500;
    let count = recording.len().min(ENOUGH);
    Recording {
        time: recording.time[..count].to_vec(),
        pressure: recording.pressure[..count].to_vec(),
        angle: recording.angle[..count].to_vec(),
        ..Recording::default()
    }
}

/// RMS error of the nominal model relative to the motion.
fn miss(file: &ModelFile, recording: &Recording) -> f64 {
    let motion = rms(&recording.angle);
    let runs = [Run::new(recording)];
    let fitter = Fitter {
        nominal: &file.model,
        runs: &runs,
    };
    fitter.compare(&file.model).rmse() / motion.max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::super::quality::tests::example;
    use super::*;

    fn refusal(file: &ModelFile, recordings: &[Recording]) -> String {
        refuse(file, recordings).unwrap_err().to_string()
    }

    #[test]
    fn what_is_right_is_not_refused() {
        for seed in 21..27 {
            let (file, recordings) = example(seed);
            assert_eq!(refuse(&file, &recordings), Ok(()));
        }
    }

    #[test]
    fn other_units_are_named_with_the_recordings() {
        let (file, mut recordings) = example(22);
        for recording in &mut recordings {
            for pressure in &mut recording.pressure {
                *pressure /= 6.894_757;
            }
        }
        let all = refusal(&file, &recordings);
        assert!(
            all.contains("psi") && all.contains("every recording"),
            "{all}"
        );
        let (_, mut recordings) = example(22);
        for angle in &mut recordings[3].angle {
            *angle = angle.to_radians();
        }
        let one = refusal(&file, &recordings);
        assert!(
            one.contains("radians") && one.contains(&recordings[3].name),
            "{one}"
        );
    }

    #[test]
    fn exchanged_columns_are_named_with_the_recordings() {
        let (file, mut recordings) = example(22);
        let right = recordings[2].clone();
        recordings[2] = Slip::Exchanged.undone(right.clone());
        let one = refusal(&file, &recordings);
        assert!(
            one.contains("change places") && one.contains(&right.name),
            "{one}"
        );
        for recording in &mut recordings {
            *recording = Slip::Exchanged.undone(recording.clone());
        }
        recordings[2] = Slip::Exchanged.undone(right);
        let all = refusal(&file, &recordings);
        assert!(
            all.contains("change places") && all.contains("every recording"),
            "{all}"
        );
    }
}
