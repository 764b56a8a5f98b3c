//! Detects columns that do not hold what their header says.
//!
//! A wrong unit, absolute pressure, or exchanged columns make a model error that no effect explains, and a diagnosis would look for one all the
//! same. The nominal model shows such errors: data sheets are right to a third, so it
//! agrees far better once the columns are read as they were meant. Two errors show
//! without a simulation: times in milliseconds, with which a simulation would take hours,
//! and absolute pressure, which is that of the air when the actuator rests.
//!
//! What the command line says of the columns ([`Columns`]) is not doubted.

use model_core::actuator::{Model, ParameterId};
use model_core::dynamics::Dynamics;

use crate::estimate::Dataset;
use crate::estimate::fitter::Fitter;
use crate::estimate::identify::{EXPONENTS, Identification, Order, identify};
use crate::statistics::{mean, median, rms};
use softrig_formats::columns::{ATMOSPHERE_KPA, AngleUnit, Columns, PressureUnit, TimeUnit};
use softrig_formats::error::InputError;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::{PASCAL_PER_KPA, Recording};

/// Below this relative error of the nominal model the columns are right. Psi make the
/// pressure 6.9 times smaller and, with the exponent of silicone (2.4), the angle 2.3
/// times: an error of 0.56.
const WRONG: f64 = 0.45;

/// Largest relative error after the columns are reread that is convincing.
const RIGHT: f64 = 0.35;

/// Largest ratio of the error after rereading to the one before.
const BETTER: f64 = 0.5;

/// Intervals between samples below this (s) are taken for seconds.
const SLOW_SAMPLING_S: f64 = 1.0;

/// Intervals (ms) of recorders that note milliseconds.
const MILLISECONDS: std::ops::RangeInclusive<f64> = 0.2..=500.0;

/// Interval between samples, in slowest time constants of the model, from which they show
/// nothing of its dynamics: nobody samples so slowly for a fit.
const NOTHING_SHOWS: f64 = 10.0;

/// The same, from which that alone is convincing.
const HOPELESS: f64 = 50.0;

/// Pressures (kPa) of the air, from 2 000 m above the sea to fair weather.
const AIR_KPA: std::ops::RangeInclusive<f64> = 80.0..=106.0;

/// Largest difference (kPa) from the standard atmosphere that is not stated: the zero
/// error of a pressure sensor.
const NEAR_STANDARD_KPA: f64 = 0.5;

/// An angle within this share of the motion is at rest.
const NEAR_ZERO: f64 = 0.15;

/// Largest ratio of the error after rereading to the one before, if the actuator rests at
/// the pressure of the air.
const BETTER_IN_AIR: f64 = 0.7;

/// Other units that a pressure column may be in.
const OTHER_UNITS: [PressureUnit; 4] = [
    PressureUnit::Psi,
    PressureUnit::Bar,
    PressureUnit::Mpa,
    PressureUnit::Pa,
];

/// Least absolute pressure (kPa): the vacuum pumps of such rigs reach no further, and
/// zero is a vent to the air.
const LEAST_ABSOLUTE_KPA: f64 = 15.0;

/// Samples at each end from which pressure and angle at rest are taken.
const AT_ENDS: usize = 10;

/// Refuses recordings with which the nominal model agrees far better if their
/// columns are read in another way.
///
/// # Errors
///
/// Names the recordings, the columns, and the flags that say what they hold.
pub fn refuse(file: &ModelFile, recordings: &[Recording]) -> Result<(), InputError> {
    // Before any simulation, which would take hours.
    if let Some(first) = recordings.iter().find(|it| in_milliseconds(file, it)) {
        let whole = names(recordings, |it| in_milliseconds(file, it));
        return Err(refused(
            &Columns {
                time: Some(TimeUnit::Ms),
                ..Columns::default()
            },
            &whole,
            first,
        ));
    }
    let Some((first, unit_error)) = recordings.iter().find_map(|recording| {
        let unit_error = convincing(file, recording, |unit_error| {
            unit_error.angle.is_none() || could_be_radians(file, recordings)
        })?;
        Some((recording, unit_error))
    }) else {
        return Ok(());
    };
    // If one recording has it, so do probably all that agree better with it.
    let whole = names(recordings, |recording| {
        undone(file, &unit_error, recording) < as_it_is(file, recording)
    });
    Err(refused(&unit_error, &whole, first))
}

/// The names of the recordings that show an error.
fn names(recordings: &[Recording], shows: impl Fn(&Recording) -> bool) -> String {
    let names: Vec<&str> = recordings
        .iter()
        .filter(|recording| shows(recording))
        .map(|recording| recording.name.as_str())
        .collect();
    if names.len() == recordings.len() {
        "every recording".to_owned()
    } else {
        names.join(", ")
    }
}

/// Whether the angles could be radians. An actuator bends by less than a full turn, so
/// recordings with larger numbers are in degrees; if the model is wrong on those as well, the
/// unit is not the cause. A model without a dry friction that holds the actuator back
/// overestimates the motion and seems to use larger units.
fn could_be_radians(file: &ModelFile, recordings: &[Recording]) -> bool {
    let farthest = |recording: &Recording| {
        let angles = recording.angle.iter();
        angles.fold(0.0, |farthest: f64, angle| {
            farthest.max(angle.abs().to_degrees())
        })
    };
    recordings
        .iter()
        .filter(|recording| farthest(recording) > std::f64::consts::TAU)
        .all(|recording| as_it_is(file, recording) < WRONG)
}

/// The unit error that a recording shows, if any.
fn convincing(
    file: &ModelFile,
    recording: &Recording,
    is_possible: impl Fn(&Columns) -> bool,
) -> Option<Columns> {
    let as_it_is = as_it_is(file, recording);
    if let Some(unit_error) = rests_in_air(recording)
        && undone(file, &unit_error, recording) < BETTER_IN_AIR * as_it_is
    {
        return Some(unit_error);
    }
    if as_it_is < WRONG {
        return None;
    }
    possible_errors(recording)
        .into_iter()
        .filter(is_possible)
        .map(|unit_error| (undone(file, &unit_error, recording), unit_error))
        .filter(|(miss, _)| *miss < BETTER * as_it_is && *miss < RIGHT)
        .filter(|(_, unit_error)| {
            unit_error.air_kpa.is_none() || could_be_absolute(unit_error, recording)
        })
        // A swing that the model follows undriven says nothing about the unit of the pressure.
        .filter(|(miss, unit_error)| {
            unit_error.pressure.is_none() || *miss < BETTER * undriven(file, recording)
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, unit_error)| unit_error)
        .filter(|unit_error| {
            is_believed(file, &read_again(unit_error, start_of(recording)))
                && !agrees_refitted(file, recording)
        })
}

/// Whether the model of the file is right enough to say what a column holds: identified from
/// the reread recording, no parameter moves far. A model that is wrong itself may agree with a
/// wrong unit by chance.
fn is_believed(file: &ModelFile, reread: &Recording) -> bool {
    /// Largest factor; the smallest unit error makes 6.9.
    const NEAR: f64 = 2.0;
    identified(file, reread).is_some_and(|it| {
        let near = |factor: &f64| (1.0 / NEAR..NEAR).contains(factor);
        factors(&file.model, &it).iter().all(near)
    })
}

/// Whether the identified model agrees with the unchanged recording, without the large change
/// of gain or damping that a wrong unit needs. The stiffness may change: where an actuator
/// hardly springs back it is poorly known, and a simulation drifts.
fn agrees_refitted(file: &ModelFile, recording: &Recording) -> bool {
    /// Largest factor; psi for kPa is 6.9, the smallest of all errors.
    const LEAP: f64 = 4.0;
    let start = start_of(recording);
    identified(file, &start).is_some_and(|it| {
        let leaps = |factor: &f64| !(1.0 / LEAP..LEAP).contains(factor);
        it.released.rmse() < RIGHT * rms(&start.angle)
            && !factors(&file.model, &it).iter().any(leaps)
    })
}

/// The base model of the recording alone, whatever the file's numbers.
fn identified(file: &ModelFile, recording: &Recording) -> Option<Identification> {
    let data = Dataset::of(std::slice::from_ref(recording)).calibrated();
    identify(&file.model, &file.free, &EXPONENTS, &data)
}

/// By how much damping and input gain differ from the file's, by the inertia; where that does
/// not show, the gain by the damping.
fn factors(given: &Model<f64>, identified: &Identification) -> Vec<f64> {
    let found = identified.released.model.dynamics();
    let factor = |of: fn(&Dynamics<f64>) -> f64| of(found) / of(given.dynamics());
    match identified.order {
        Order::First => vec![factor(|d| d.input_gain / d.damping)],
        Order::Second => vec![
            factor(|d| d.damping / d.inertia),
            factor(|d| d.input_gain / d.inertia),
        ],
    }
}

/// Whether a pressure, reread in this unit, could be absolute.
fn could_be_absolute(unit_error: &Columns, recording: &Recording) -> bool {
    let factor = unit_error.pressure.map_or(1.0, PressureUnit::kilopascals) / PASCAL_PER_KPA;
    recording
        .pressure
        .iter()
        .all(|pressure| pressure * factor >= LEAST_ABSOLUTE_KPA)
}

/// The possible errors of a recording, besides what the command line says of it.
fn possible_errors(recording: &Recording) -> Vec<Columns> {
    let said = recording.columns;
    let nothing = Columns::default();
    let air_kpa = Some(ATMOSPHERE_KPA);
    let mut possible_errors = Vec::new();
    if said.pressure.is_none() {
        possible_errors.extend(OTHER_UNITS.map(|unit| Columns {
            pressure: Some(unit),
            ..nothing
        }));
    }
    if said.air_kpa.is_none() {
        possible_errors.push(Columns { air_kpa, ..nothing });
    }
    if said.pressure.is_none() && said.air_kpa.is_none() {
        possible_errors.extend(OTHER_UNITS.map(|unit| Columns {
            pressure: Some(unit),
            air_kpa,
            ..nothing
        }));
    }
    if said.angle.is_none() {
        possible_errors.push(Columns {
            angle: Some(AngleUnit::Rad),
            ..nothing
        });
    }
    if !said.exchange && !angle_follows(recording) {
        possible_errors.push(Columns {
            exchange: true,
            ..nothing
        });
    }
    possible_errors
}

/// Whether the times of a recording are milliseconds: read as seconds, its samples are too
/// far apart to show the model's dynamics; read as milliseconds, they are not.
fn in_milliseconds(file: &ModelFile, recording: &Recording) -> bool {
    let interval = recording.interval();
    if recording.columns.time.is_some()
        || interval < SLOW_SAMPLING_S
        || !MILLISECONDS.contains(&interval)
    {
        return false;
    }
    let slowest = slowest_time_constant(file, recording);
    let ratio = interval / slowest;
    let meant = Columns {
        time: Some(TimeUnit::Ms),
        ..Columns::default()
    };
    ratio >= HOPELESS || ratio >= NOTHING_SHOWS && undone(file, &meant, recording) < RIGHT
}

/// The slowest time constant (s) of a model's mass, damper and spring at the angles of a
/// recording: of the swing, of its decay, or of the overdamped return.
fn slowest_time_constant(file: &ModelFile, recording: &Recording) -> f64 {
    let largest_angle = recording.angle.iter().fold(0.0, |a, b| b.abs().max(a));
    let rates = file.model.fastest_rate(largest_angle);
    [
        1.0 / rates.stiffness.sqrt(),
        1.0 / rates.relaxation,
        rates.relaxation / rates.stiffness,
    ]
    .into_iter()
    .fold(0.0, |slowest, time| {
        // An undefined time constant counts as slow.
        if time.is_nan() {
            f64::INFINITY
        } else {
            time.max(slowest)
        }
    })
}

/// Medians of the first and of the last samples.
fn ends(values: &[f64]) -> [f64; 2] {
    let count = AT_ENDS.min(values.len());
    let mut first = values[..count].to_vec();
    let mut last = values[values.len() - count..].to_vec();
    [median(&mut first), median(&mut last)]
}

/// Absolute pressure, in any unit, if a recording shows it without a model: the pressure is
/// that of the air where the angle is zero, and never far below.
fn rests_in_air(recording: &Recording) -> Option<Columns> {
    let said = recording.columns;
    if said.air_kpa.is_some() {
        return None;
    }
    let largest = recording.angle.iter().fold(0.0, |a, b| b.abs().max(a));
    let at_zero = ends(&recording.angle)
        .iter()
        .all(|angle| angle.abs() < NEAR_ZERO * largest);
    if !at_zero {
        return None;
    }
    let [first, last] = ends(&recording.pressure);
    let lowest = recording
        .pressure
        .iter()
        .copied()
        .fold(f64::INFINITY, f64::min);
    let read_as = |unit: Option<PressureUnit>| {
        let factor = unit.map_or(1.0, PressureUnit::kilopascals) / PASCAL_PER_KPA;
        let rest = first.min(last) * factor;
        let rests = AIR_KPA.contains(&rest) && lowest * factor >= *AIR_KPA.start();
        rests.then(|| Columns {
            pressure: unit,
            air_kpa: Some(if (rest - ATMOSPHERE_KPA).abs() > NEAR_STANDARD_KPA {
                (10.0 * rest).round() / 10.0
            } else {
                ATMOSPHERE_KPA
            }),
            ..Columns::default()
        })
    };
    let others = OTHER_UNITS.into_iter().map(Some);
    std::iter::once(None)
        .chain(others.filter(|_| said.pressure.is_none()))
        .find_map(read_as)
}

/// The message about a unit error, with the flags that mend it.
fn refused(unit_error: &Columns, whole: &str, first: &Recording) -> InputError {
    let flags = unit_error.flags();
    let units = unit_error.pressure.map(|unit| {
        let absolute = if unit_error.air_kpa.is_some() {
            " of absolute pressure"
        } else {
            ""
        };
        (
            format!("pressure_kpa is read as {}{absolute}", unit.symbol()),
            if unit_error.air_kpa.is_some() {
                "--units pressure=kpa --absolute-pressure=0 if the column is right"
            } else {
                "--units pressure=kpa if the column is right"
            },
        )
    });
    let (found, otherwise) = if unit_error.time.is_some() {
        (
            format!(
                "the times look like milliseconds: {:.3} s lie between two samples, in which the model comes to rest, in {whole}",
                first.interval()
            ),
            "--units time=s if they are seconds",
        )
    } else if let Some((read_as, otherwise)) = units {
        (
            format!("the units look mixed up: the model agrees with {whole} only if {read_as}"),
            otherwise,
        )
    } else if unit_error.air_kpa.is_some() {
        (
            format!(
                "the pressure looks absolute: the model agrees better with {whole} if pressure_kpa is read so"
            ),
            "--absolute-pressure=0 if it is gauge pressure",
        )
    } else if unit_error.angle.is_some() {
        (
            format!(
                "the units look mixed up: the model agrees with {whole} only if angle_deg is read as radians"
            ),
            "--units angle=deg if the column is right",
        )
    } else {
        (
            format!(
                "the columns look exchanged: the model agrees with {whole} only if pressure_kpa and angle_deg change places"
            ),
            "correct the model",
        )
    };
    InputError::new(found, format!("add {flags}, or {otherwise}")).in_file(&first.path)
}

/// Whether the angle lags the pressure, as an effect follows its cause: the shift of the
/// largest cross-correlation is not negative.
fn angle_follows(recording: &Recording) -> bool {
    /// Longest shift (s): actuators respond sooner.
    const LONGEST_S: f64 = 1.0;
    // At most some hundred samples.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let most = (LONGEST_S / recording.interval()).clamp(1.0, 200.0) as usize;
    let centred = |values: &[f64]| -> Vec<f64> {
        let middle = mean(values);
        values.iter().map(|value| value - middle).collect()
    };
    let (pressure, angle) = (centred(&recording.pressure), centred(&recording.angle));
    let cross_correlation = |cause: &[f64], effect: &[f64], shift: usize| -> f64 {
        let later = effect.iter().skip(shift);
        cause.iter().zip(later).map(|(a, b)| a * b).sum()
    };
    let best = |cause: &[f64], effect: &[f64], from: usize| {
        (from..=most)
            .map(|shift| cross_correlation(cause, effect, shift))
            .fold(f64::NEG_INFINITY, f64::max)
    };
    best(&pressure, &angle, 0) >= best(&angle, &pressure, 1)
}

/// The first part of a recording, enough to show an error: a session may begin with a
/// rest and small steps that hardly move.
fn start_of(recording: &Recording) -> Recording {
    const ENOUGH: usize = 10_000;
    let count = recording.len().min(ENOUGH);
    Recording {
        time: recording.time[..count].to_vec(),
        pressure: recording.pressure[..count].to_vec(),
        angle: recording.angle[..count].to_vec(),
        ..Recording::default()
    }
}

/// A recording as it was meant.
fn read_again(unit_error: &Columns, mut recording: Recording) -> Recording {
    for k in 0..recording.len() {
        let sample = [recording.time[k], recording.pressure[k], recording.angle[k]];
        [recording.time[k], recording.pressure[k], recording.angle[k]] =
            unit_error.read_again(sample);
    }
    recording
}

/// Relative error of the nominal model on the recording as read.
fn as_it_is(file: &ModelFile, recording: &Recording) -> f64 {
    miss(file, &start_of(recording))
}

/// Relative error after the columns are reread.
fn undone(file: &ModelFile, unit_error: &Columns, recording: &Recording) -> f64 {
    miss(file, &read_again(unit_error, start_of(recording)))
}

/// Relative error of the undriven model.
fn undriven(file: &ModelFile, recording: &Recording) -> f64 {
    let mut file = file.clone();
    file.model = file.model.with_value(ParameterId::InputGain, 0.0);
    miss(&file, &start_of(recording))
}

/// RMS error of the nominal model relative to the motion. Infinite if it cannot
/// be simulated.
fn miss(file: &ModelFile, recording: &Recording) -> f64 {
    let motion = rms(&recording.angle);
    // Free zeros would hide a part of the error.
    let data = Dataset::of(std::slice::from_ref(recording)).calibrated();
    let fitter = Fitter::new(&file.model, &data);
    let miss = fitter.compare(&file.model).rmse() / motion.max(f64::MIN_POSITIVE);
    if miss.is_nan() { f64::INFINITY } else { miss }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::recordings::quality::tests::example;

    /// The model with a parameter multiplied.
    fn times(file: &ModelFile, id: ParameterId, factor: f64) -> ModelFile {
        let value = file.model.value(id).unwrap();
        let mut changed = file.clone();
        changed.model = changed.model.with_value(id, factor * value);
        changed
    }

    fn refusal(file: &ModelFile, recordings: &[Recording]) -> String {
        refuse(file, recordings).unwrap_err().to_string()
    }

    /// Changes what a column holds.
    fn change(recordings: &mut [Recording], with: impl Fn(&mut f64, &mut f64, &mut f64)) {
        for recording in recordings {
            let samples = recording.time.iter_mut().zip(&mut recording.pressure);
            for ((time, pressure), angle) in samples.zip(&mut recording.angle) {
                with(time, pressure, angle);
            }
        }
    }

    fn say(recordings: &mut [Recording], columns: Columns) {
        for recording in recordings {
            recording.columns = columns;
        }
    }

    /// Asserts a refusal with every part for all recordings.
    fn assert_refused(with: impl Fn(&mut f64, &mut f64, &mut f64), parts: &[&str]) {
        let (file, mut recordings) = example(22);
        change(&mut recordings, with);
        let said = refusal(&file, &recordings);
        for part in parts {
            assert!(said.contains(part), "no {part:?} in {said:?}");
        }
    }

    /// Two recordings that are as good in radians, and one that bends too far for them.
    #[test]
    fn what_a_friction_holds_back_is_no_matter_of_units() {
        let (file, mut recordings) = example(22);
        recordings.truncate(3);
        change(&mut recordings, |_, _, angle| *angle = angle.to_radians());
        assert!(refusal(&file, &recordings).contains("radians"));
        change(&mut recordings[2..], |_, _, angle| *angle *= 15.0);
        refuse(&file, &recordings).unwrap();
    }

    #[test]
    fn what_is_right_is_not_refused() {
        for seed in 21..27 {
            let (file, recordings) = example(seed);
            assert_eq!(refuse(&file, &recordings), Ok(()));
        }
    }

    /// Data sheets are right to a third, guesses to a factor of three.
    #[test]
    fn a_poor_first_model_is_no_unit_error() {
        for seed in 21..27 {
            let (file, recordings) = example(seed);
            for off in [3.0, 1.0 / 3.0] {
                let poor = times(&file, ParameterId::Damping, off);
                let poor = times(&poor, ParameterId::InputGain, off);
                let poor = times(&poor, ParameterId::Stiffness, 1.0 / off);
                assert_eq!(refuse(&poor, &recordings), Ok(()), "seed {seed}, {off}");
            }
        }
    }

    #[test]
    fn other_units_are_named_with_their_flags() {
        let every = "every recording";
        assert_refused(|_, p, _| *p /= 6.894_757, &["--units pressure=psi", every]);
        assert_refused(|_, p, _| *p /= 100.0, &["--units pressure=bar", every]);
        assert_refused(|_, p, _| *p /= 1e3, &["--units pressure=mpa", every]);
        assert_refused(|_, p, _| *p *= 1e3, &["--units pressure=pa,", every]);
        assert_refused(|_, _, a| *a = a.to_radians(), &["--units angle=rad", every]);
        assert_refused(
            |_, p, _| *p = (*p + 101_325.0) / 6.894_757,
            &["--units pressure=psi --absolute-pressure", every],
        );
    }

    #[test]
    fn one_recording_in_radians_is_named() {
        let (file, mut recordings) = example(22);
        change(&mut recordings[3..4], |_, _, a| *a = a.to_radians());
        let one = refusal(&file, &recordings);
        assert!(
            one.contains("radians") && one.contains(&recordings[3].name),
            "{one}"
        );
    }

    #[test]
    fn what_follows_is_the_angle() {
        let (_, recordings) = example(22);
        // Slow ramps hardly show what came first; edges do.
        let is_step = |recording: &Recording| recording.name.starts_with("step");
        for recording in recordings.into_iter().filter(is_step) {
            assert!(angle_follows(&recording), "{}", recording.name);
            let exchange = Columns {
                exchange: true,
                ..Columns::default()
            };
            let exchanged = read_again(&exchange, recording);
            assert!(!angle_follows(&exchanged), "{}", exchanged.name);
        }
    }

    #[test]
    fn exchanged_columns_are_named_with_the_recordings() {
        let exchange = Columns {
            exchange: true,
            ..Columns::default()
        };
        let (file, mut recordings) = example(22);
        let right = recordings[2].clone();
        recordings[2] = read_again(&exchange, right.clone());
        let one = refusal(&file, &recordings);
        assert!(
            one.contains("change places") && one.contains(&right.name),
            "{one}"
        );
        for recording in &mut recordings {
            *recording = read_again(&exchange, recording.clone());
        }
        recordings[2] = read_again(&exchange, right);
        let all = refusal(&file, &recordings);
        assert!(
            all.contains("--exchange-columns") && all.contains("every recording"),
            "{all}"
        );
    }

    #[test]
    fn absolute_pressure_is_named_with_that_of_the_air() {
        let all = "every recording";
        assert_refused(|_, p, _| *p += 101_325.0, &["--absolute-pressure,", all]);
        // In Madrid.
        let (file, mut recordings) = example(22);
        change(&mut recordings, |_, p, _| *p += 94_300.0);
        let said = refusal(&file, &recordings);
        assert!(said.contains("--absolute-pressure=94."), "{said}");
        // A rest at the pressure of the air is enough if the model is poor.
        let poor = times(&file, ParameterId::Stiffness, 4.0);
        let said = refusal(&poor, &recordings);
        assert!(said.contains("--absolute-pressure=94."), "{said}");
        change(&mut recordings, |_, p, _| *p /= 6.894_757);
        let said = refusal(&poor, &recordings);
        assert!(
            said.contains("--units pressure=psi --absolute-pressure=94."),
            "{said}"
        );
    }

    #[test]
    fn a_pressure_that_is_zero_is_not_absolute() {
        let unit_error = Columns {
            air_kpa: Some(ATMOSPHERE_KPA),
            ..Columns::default()
        };
        let (_, mut recordings) = example(22);
        assert!(!could_be_absolute(&unit_error, &recordings[0]));
        change(&mut recordings, |_, p, _| *p += 101_325.0);
        assert!(could_be_absolute(&unit_error, &recordings[0]));
    }

    #[test]
    fn milliseconds_are_named_without_simulating_hours() {
        let clock = std::time::Instant::now();
        assert_refused(|t, _, _| *t *= 1e3, &["--units time=ms", "every recording"]);
        // Simulating them takes minutes.
        assert!(clock.elapsed().as_secs() < 10, "{:?}", clock.elapsed());
        // A model as slow as the samples is believed.
        let (file, mut recordings) = example(22);
        change(&mut recordings, |t, _, _| *t *= 1e3);
        let slow = times(&file, ParameterId::Damping, 1e4);
        assert!(!in_milliseconds(&slow, &recordings[0]));
    }

    #[test]
    fn what_was_said_is_not_doubted() {
        let (file, mut recordings) = example(22);
        change(&mut recordings, |_, p, _| *p /= 6.894_757);
        let columns = Columns {
            pressure: Some(PressureUnit::Kpa),
            ..Columns::default()
        };
        say(&mut recordings, columns);
        let said = refuse(&file, &recordings);
        assert!(
            said.as_ref()
                .map_or_else(|error| !error.to_string().contains("psi"), |()| true),
            "{said:?}"
        );
        let (_, mut recordings) = example(22);
        change(&mut recordings, |t, _, _| *t *= 1e3);
        let columns = Columns {
            time: Some(TimeUnit::S),
            ..Columns::default()
        };
        say(&mut recordings, columns);
        assert!(!in_milliseconds(&file, &recordings[0]));
    }
}
