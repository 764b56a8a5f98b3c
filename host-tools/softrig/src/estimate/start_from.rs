//! Free-run simulation of a test recording: only its first samples say where it starts.
//!
//! Every other simulation over a recording estimates zeros and initial state on the whole of it.
//! Public benchmarks forbid that: a test record may give its initial state by a few first samples,
//! and nothing else. Here the zeros are given, by the fitted recordings, and the initial state is
//! that of [`StartFrom`]. The rest of the measured angle is never looked at, except to bound the
//! length of the integration steps by its largest value.

use std::fmt;
use std::str::FromStr;

use model_core::actuator::Model;

use super::dataset::Mark;
use super::fitter::Fitter;
use super::nuisance::{Nuisance, Prior};
use super::{Dataset, Session};
use crate::sim::simulate::InitialState;
use crate::statistics::rms;
use softrig_formats::error::InputError;
use softrig_formats::recording::Recording;

/// Standard deviation of a zero that is given (Pa, rad): next to nothing.
const GIVEN: f64 = 1e-9;

/// Where the initial state of a test recording comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartFrom {
    /// It starts at rest at zero, without pressure.
    Rest,
    /// From so many first samples, by the model: angle, rate, and where what creeps had settled.
    Samples(usize),
    /// The recording is one period of a steady state: the state that the same input leads to,
    /// played once before from rest. No measured angle is used.
    Period,
}

impl StartFrom {
    /// First samples that are not scored, because the start comes from them.
    pub const fn used(self) -> usize {
        match self {
            Self::Samples(count) => count,
            Self::Rest | Self::Period => 0,
        }
    }

    /// Refuses a recording of which nothing is left to be scored.
    ///
    /// # Errors
    ///
    /// Names the recording and what to do.
    pub fn check(self, recording: &Recording) -> Result<(), InputError> {
        let count = recording.len();
        if self.used() < count {
            return Ok(());
        }
        let found = format!("has {count} samples, so none would be left to score");
        let error = InputError::new(found, "start from fewer: --start-from 20");
        Err(error.in_file(&recording.path))
    }
}

impl fmt::Display for StartFrom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rest => f.write_str("rest"),
            Self::Samples(count) => write!(f, "{count}"),
            Self::Period => f.write_str("period"),
        }
    }
}

impl FromStr for StartFrom {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "rest" | "0" => Ok(Self::Rest),
            "period" => Ok(Self::Period),
            _ => text.parse().map(Self::Samples).map_err(|_| {
                "give a number of first samples, such as 20; rest, for a recording that starts at \
                 rest at zero; or period, for one period of a steady state"
                    .to_owned()
            }),
        }
    }
}

/// The simulated reading of the angle sensor (rad) over a test recording, one a sample; `zeros`
/// are those of its sensors, the rest of it is not used.
pub fn simulate_from(
    model: &Model<f64>,
    session: &Session,
    zeros: &Nuisance,
    start: StartFrom,
) -> Vec<f64> {
    match start {
        StartFrom::Rest => session.simulate(model, &at_rest(model, zeros)),
        StartFrom::Period => {
            let simulated = session.twice().simulate(model, &at_rest(model, zeros));
            simulated[simulated.len() - session.recording().len()..].to_vec()
        }
        StartFrom::Samples(count) => {
            session.simulate(model, &from_samples(model, session, zeros, count))
        }
    }
}

/// RMS error (rad) of a simulation by [`simulate_from`], over the samples from which the start does
/// not come.
pub fn error_of(simulated: &[f64], recording: &Recording, start: StartFrom) -> f64 {
    let pairs = simulated.iter().zip(&recording.angle).skip(start.used());
    let errors: Vec<f64> = pairs.map(|(ours, measured)| ours - measured).collect();
    rms(&errors)
}

/// Rest at zero, as the sensors show it.
fn at_rest(model: &Model<f64>, zeros: &Nuisance) -> Nuisance {
    Nuisance {
        start: InitialState {
            angle: model.reading(&model.at_rest(0.0, 0.0)) + zeros.angle_zero,
            rate: 0.0,
        },
        past: 0.0,
        ..*zeros
    }
}

/// The initial state with which the model comes nearest to the first samples.
fn from_samples(model: &Model<f64>, session: &Session, zeros: &Nuisance, count: usize) -> Nuisance {
    let count = count.min(session.recording().len());
    let head = session.recording().slice(&(0..count));
    let free = Prior::of(&head);
    let prior = Prior {
        mean: Nuisance {
            pressure_zero: zeros.pressure_zero,
            angle_zero: zeros.angle_zero,
            ..free.mean
        },
        deviation: Nuisance {
            pressure_zero: GIVEN,
            angle_zero: GIVEN,
            ..free.deviation
        },
        apart: Default::default(),
        ..free
    };
    let mark = Mark {
        range: 0..count,
        about: Recording::default(),
        fitted: true,
    };
    let head = Session::new(head, session.clock(), Vec::new())
        .standing(session.placement())
        .guessing(prior.mean, &prior);
    let mut data = Dataset::default();
    data.push(head, vec![mark]);
    Fitter::new(model, &data).compare(model).nuisances[0]
}
