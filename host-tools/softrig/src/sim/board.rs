//! A model on the board: whether it can run there, and what it predicts.
//!
//! The board steps [`model_core::predictor`] beside the rig, one period of 10 ms for each
//! line of telemetry, with the power from a table and the pressure in hundredths of a kPa.
//! What is said here of the board comes from that code and not from another integrator in
//! single precision. A recording with other samples is read by the board's clock: its
//! pressure at the lines, and between the predicted lines at its samples.

use std::ops::RangeInclusive;

use model_core::actuator::Model;
use model_core::power::Minimax;
use model_core::predictor::{self, PRESSURES_PA, Prediction, Predictor};
use model_core::prepared::{self, BUDGET_CYCLES, Plan, Unsteppable};
use wire::settings::{Key, Settings};

use super::simulate::{DIVERGED, Origin, Signal, is_lost, state_at};

/// Cycles of an ATmega2560 between two lines of telemetry.
const CYCLES_PER_PERIOD: u32 = 160_000;

/// The longest recording (s) that is predicted: more than a day, in about a second.
const LONGEST_S: f64 = 1e5;

/// Lines of telemetry in a second.
const LINES_PER_S: f64 = predictor::RATE_HZ as f64;

/// The largest angle (rad) that a board has to follow: what it is shipped to stop at, or
/// what was recorded beyond that (rad).
pub fn farthest(recorded: f64) -> f32 {
    let shipped = Settings::DEFAULT.number(Key::MaxAngle).to_radians();
    single(recorded).max(shipped)
}

/// A part of the board's processor (%), of cycles in a period.
pub fn percent_of(cycles: u32) -> f64 {
    f64::from(cycles) * 100.0 / f64::from(CYCLES_PER_PERIOD)
}

/// How a board would step a model for angles up to `farthest` (rad).
///
/// # Errors
///
/// Says why it refuses the model, as a clause.
pub fn plan(model: &Model<f64>, farthest: f32) -> Result<Plan, String> {
    let model = rounded(model);
    predictor::check(&model, farthest).map_err(|error| {
        let load = match error {
            Unsteppable::TooFast => load_percent(&model, farthest),
            _ => None,
        };
        let load = load.map_or_else(String::new, |percent| {
            format!(
                ": it would take about {percent:.0} % of the board's processor, which has {:.1} % for it",
                percent_of(BUDGET_CYCLES)
            )
        });
        format!("the model {error}{load}")
    })
}

/// The load of a model that is too fast for one step per period, from the number of shorter
/// steps that it needs. None if no step is short enough.
fn load_percent(model: &Model<f32>, farthest: f32) -> Option<f64> {
    (2_u8..=200)
        .find(|&parts| {
            prepared::plan(model, farthest, predictor::STEP_S / f32::from(parts)).is_ok()
        })
        .map(|parts| f64::from(parts) * percent_of(BUDGET_CYCLES))
}

/// Why the board does not predict a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BoardLimit {
    /// Its pressure is beyond what the board's memory holds.
    #[error("the pressure goes beyond the −50 … 605 kPa that the board can tell apart")]
    Pressure,
    /// It lasts too long.
    #[error("a recording lasts longer than a day of the board's 100 lines a second")]
    Long,
}

/// A model, prepared as on the board.
#[derive(Clone, Debug)]
pub struct OnBoard {
    predictor: Predictor,
}

impl OnBoard {
    /// Prepares a model for angles up to `farthest` (rad).
    ///
    /// # Errors
    ///
    /// [`Unsteppable`], and then a board refuses the model too.
    pub fn new(model: &Model<f64>, farthest: f32) -> Result<Self, Unsteppable> {
        let predictor = Predictor::new(&rounded(model), farthest)?;
        Ok(Self { predictor })
    }

    /// The predicted reading of the angle sensor (rad) at the samples of a pressure, from
    /// `origin`. [`DIVERGED`] once the prediction has left all bounds.
    ///
    /// # Errors
    ///
    /// [`BoardLimit`].
    pub fn predict(&self, signal: &Signal, origin: Origin<f32>) -> Result<Vec<f64>, BoardLimit> {
        let zero = f64::from(origin.pressure_zero);
        is_seen(signal, zero)?;
        let state = state_at(self.predictor.model(), signal, &origin);
        let mut lines = Lines {
            predictor: &self.predictor,
            prediction: self
                .predictor
                .start_at(&state, hundredths(signal.values()[0] - zero)),
            signal,
            zero,
            newest: 0,
            sample: 0,
            readings: [f64::NAN; 4],
        };
        lines.note();
        let mut lost = false;
        let readings = signal.times().iter().map(|time| {
            let reading = lines.at(time - signal.times()[0]);
            lost |= is_lost(reading);
            if lost { DIVERGED } else { reading }
        });
        Ok(readings.collect())
    }
}

/// Whether the board sees a pressure as it is, `zero` (Pa) subtracted, and to its end.
///
/// # Errors
///
/// Says why not.
pub fn is_seen(signal: &Signal, zero: f64) -> Result<(), BoardLimit> {
    let seen: RangeInclusive<f64> =
        f64::from(*PRESSURES_PA.start())..=f64::from(*PRESSURES_PA.end());
    if !signal
        .values()
        .iter()
        .all(|value| seen.contains(&(value - zero)))
    {
        return Err(BoardLimit::Pressure);
    }
    match signal.times() {
        [first, .., last] if last - first > LONGEST_S => Err(BoardLimit::Long),
        _ => Ok(()),
    }
}

/// The lines that the board would send, as far as they are predicted.
struct Lines<'a> {
    predictor: &'a Predictor,
    prediction: Prediction,
    signal: &'a Signal,
    zero: f64,
    /// The number of the newest line.
    newest: usize,
    /// A sample of the signal near it.
    sample: usize,
    /// The readings (rad) of the last four.
    readings: [f64; 4],
}

impl Lines<'_> {
    /// The reading (rad) at a time (s) since the first line, never before an earlier one: on
    /// the cubic through the four lines around it, as the pressure between samples.
    fn at(&mut self, time: f64) -> f64 {
        let place = time * LINES_PER_S;
        // At most a day of lines.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let line = place as usize;
        while self.newest < line + 2 {
            self.step();
        }
        let [mut before, here, next, after] = self.readings;
        if line == 0 {
            before = 2.0 * here - next;
        }
        let u = place - line as f64;
        let (from, to) = (0.5 * (next - before), 0.5 * (after - here));
        let rise = next - here;
        here + u * (from + u * (3.0 * rise - 2.0 * from - to + u * (from + to - 2.0 * rise)))
    }

    fn step(&mut self) {
        self.newest += 1;
        let time = self.newest as f64 / LINES_PER_S;
        let (pressure, sample) = self.signal.since_start(time, self.sample);
        self.sample = sample;
        let line = hundredths(pressure - self.zero);
        self.predictor.step(&mut self.prediction, Some(line));
        self.note();
    }

    fn note(&mut self) {
        self.readings.rotate_left(1);
        self.readings[3] = f64::from(self.prediction.reading());
    }
}

/// A pressure (Pa) as a line of telemetry has it.
fn hundredths(pressure: f64) -> i32 {
    // Saturates.
    #[expect(clippy::cast_possible_truncation)]
    let line = (pressure / 10.0).round() as i32;
    line
}

/// A model in the numbers of the board's settings.
fn rounded(model: &Model<f64>) -> Model<f32, Minimax> {
    model.map(single)
}

#[expect(clippy::cast_possible_truncation)] // Rounding is the point.
fn single(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::simulate::{InitialState, Stepping, run_from};
    use model_core::catalogue::Kind;
    use model_core::dynamics::Dynamics;

    const DYNAMICS: Dynamics<f64> = Dynamics {
        inertia: 0.36,
        damping: 1.8,
        stiffness: 5.0,
        exponent: 2.365,
        input_gain: 1.45e-4,
    };

    fn at_rest<R: crate::sim::dual::FromF64>(zero: f64, clock: f64) -> Origin<R> {
        let start = InitialState {
            angle: R::zero(),
            rate: R::zero(),
        };
        Origin {
            start,
            past: R::zero(),
            stretched: 0.0,
            pressure_zero: R::from_f64(zero),
            clock: R::from_f64(clock),
        }
    }

    /// Up and down within 20 s, sampled at these times (s).
    fn signal(time: impl Iterator<Item = f64>) -> Signal {
        let time: Vec<f64> = time.collect();
        let pressure = time.iter().map(|t| 2e4 * (1.0 - (0.6 * t).cos())).collect();
        Signal::new(time, pressure)
    }

    /// Line by line, with nothing in between.
    #[test]
    fn a_recording_of_the_board_is_predicted_by_the_code_that_the_board_runs() {
        let model: Model<f64> = Model::new(DYNAMICS, &[]).unwrap();
        let lines: Vec<i32> = (0..2_000).map(|k| 4_000.min(3 * k)).collect();
        let signal = Signal::new(
            (0..2_000).map(|k| f64::from(k) * 0.01).collect(),
            lines
                .iter()
                .map(|line| f64::from(*line) * 10.0 + 300.0)
                .collect(),
        );
        let board = OnBoard::new(&model, 2.3).unwrap();
        let found = board.predict(&signal, at_rest(300.0, 0.0)).unwrap();
        let predictor = Predictor::new(&model.map(single), 2.3).unwrap();
        let mut prediction = predictor.start(0, lines[0]);
        for (line, found) in lines[1..].iter().zip(&found[1..]) {
            predictor.step(&mut prediction, Some(*line));
            let gap = found - f64::from(prediction.reading());
            assert!(gap.abs() < 1e-9, "{gap}");
        }
        assert!(found[1_999] > 0.5);
    }

    #[test]
    fn other_samples_are_read_by_the_clock_of_the_board() {
        let late = Kind::DeadTime.build(&[0.137]).unwrap();
        let drift = Kind::SensorDrift.build(&[0.01]).unwrap();
        let model: Model<f64> = Model::new(DYNAMICS, &[late, drift]).unwrap();
        let board = OnBoard::new(&model, 2.3).unwrap();
        for interval in [0.0017, 0.004, 0.01, 0.025, 0.1] {
            let signal = signal(
                (0..)
                    .map(|k| 5.0 + f64::from(k) * interval)
                    .take_while(|t| *t < 25.0),
            );
            let fine = run_from(
                &model,
                &signal,
                at_rest(800.0, 70.0),
                Stepping::runge_kutta(20),
            );
            let found = board.predict(&signal, at_rest(800.0, 70.0)).unwrap();
            assert_eq!(found.len(), fine.reading.len());
            for (found, fine) in found.iter().zip(&fine.reading) {
                assert!((found - fine).abs() < 5e-4, "{interval}: {found} {fine}");
            }
        }
    }

    #[test]
    fn what_the_board_cannot_see_is_no_prediction() {
        let model: Model<f64> = Model::new(DYNAMICS, &[]).unwrap();
        let board = OnBoard::new(&model, 2.3).unwrap();
        let of = |time: Vec<f64>, pressure| {
            board.predict(&Signal::new(time, pressure), at_rest(0.0, 0.0))
        };
        assert_eq!(
            of(vec![0.0, 0.1], vec![0.0, 7e5]),
            Err(BoardLimit::Pressure)
        );
        assert_eq!(of(vec![0.0, 2e5], vec![0.0, 0.0]), Err(BoardLimit::Long));
        assert!(of(vec![0.0, 0.1, 600.0], vec![0.0, 1e4, 0.0]).is_ok());
    }

    /// Dry friction stops it within a step of the board.
    #[test]
    fn a_light_overdamped_actuator_with_friction_is_refused() {
        let light = Dynamics {
            inertia: 0.0004,
            damping: 1.5,
            ..DYNAMICS
        };
        let friction = Kind::CoulombFriction.build(&[0.3, 0.02]).unwrap();
        assert!(plan(&Model::new(light, &[]).unwrap(), farthest(0.0)).is_ok());
        let why = plan(&Model::new(light, &[friction]).unwrap(), farthest(0.0)).unwrap_err();
        assert!(why.contains("the model moves too fast"), "{why}");
    }

    #[test]
    fn a_model_that_is_too_fast_is_told_its_load() {
        let fast = Dynamics {
            inertia: 0.001,
            damping: 0.01,
            stiffness: 2000.0,
            exponent: 1.7,
            input_gain: 1e-4,
        };
        let message = plan(&Model::new(fast, &[]).unwrap(), farthest(0.0)).unwrap_err();
        let percent: f64 = message
            .split_once("about ")
            .and_then(|(_, rest)| rest.split_once(" %"))
            .and_then(|(number, _)| number.parse().ok())
            .unwrap_or_else(|| panic!("{message}"));
        assert!((25.0..2_500.0).contains(&percent), "{message}");
        assert!(message.contains("12.5 % for it"), "{message}");
    }
}
