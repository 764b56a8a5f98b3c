//! Nuisance parameters of every fit: sensor zeros and initial states.
//!
//! The zeros of both sensors are never known exactly, and the initial state of a session
//! is measured with noise. On a rig with the exponent 2.4 the stiffness vanishes at 0°,
//! and an error of 0.3 kPa in the pressure zero moves the rest angle by 9°: a fit would
//! distort an effect to repair it. So each session has five unknowns of its own
//! ([`Nuisance`]), each with a [`Prior`].

use std::ops::Range;

use crate::estimate::smooth::{motion, noise_of};
use crate::sim::simulate::InitialState;
use crate::statistics::{mean, moves, quantisation_step, rms, standard_deviation, swing};
use softrig_formats::recording::{PASCAL_PER_KPA, Recording};
use softrig_formats::removed::Channel;
use softrig_formats::setup::Setup;

/// Standard deviation of the input's zero where the metadata has no calibration, as a share of
/// the range that was used: sensors are sold with an offset of one to two percent of their span,
/// of which a rig uses a part.
const INPUT_ZERO_SHARE: f64 = 0.01;

/// Standard deviation of the angle's zero where the metadata has no
/// calibration (rad): 2°, how well a flex sensor is put back in its place.
const ANGLE_ZERO_SD_RAD: f64 = 0.034_906_585_039_886_59;

/// Standard deviation of the input's zero between the recordings of one sitting, as a share of
/// its own: what a third of a degree of warming moves an 80 psi sensor.
const INPUT_ZERO_APART: f64 = 0.1;

/// Standard deviation of the angle's zero between the recordings of one sitting
/// (rad): 0.1°, the set of a flex sensor that was bent.
const ANGLE_ZERO_APART_RAD: f64 = 0.001_745_329_251_994_329_6;

/// Standard deviation of a zero that is held (Pa).
const HELD_PA: f64 = 1e-3;

/// Standard deviation of the past, as a share of the swing: [`FARTHEST`] of it are the swing.
const PAST: f64 = 1.0 / FARTHEST;

/// The share of that after a rest: what a rest of a few time constants leaves.
const PAST_AFTER_REST: f64 = 0.1;

/// Least standard deviation of the past (rad).
const LEAST_PAST_RAD: f64 = 1e-9;

/// Largest departure of a zero, in standard deviations.
pub const FARTHEST: f64 = 3.0;

/// Unknowns of a session.
pub const UNKNOWNS: usize = 5;

/// The unknowns that are zeros of sensors.
pub const ZEROS: Range<usize> = 0..2;

/// The unknown that is the past.
pub const PAST_PLACE: usize = 4;

/// The unknowns of one session.
///
/// ```text
/// p = p_measured − p₀        y_measured = y + b        y(0) = s − b,  ẏ(0) = r
/// ```
///
/// | symbol | quantity | prior |
/// |---|---|---|
/// | p₀ | zero of the pressure (Pa) | the calibration, else 0 ± 1 % of the range that was used |
/// | b | zero of the angle (rad) | the calibration, else 0 ± 2° |
/// | s | measured angle at the first sample (rad) | the rest, or a parabola |
/// | r | its rate (rad/s) | the same |
/// | h | where what creeps had settled before, from the angle at the start (rad) | 0 ± a third of the swing; after a rest, a tenth of that |
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nuisance {
    /// The zero of the pressure sensor (Pa).
    pub pressure_zero: f64,
    /// The zero of the angle sensor (rad).
    pub angle_zero: f64,
    /// The measured angle and its rate at the first sample.
    pub start: InitialState<f64>,
    /// Where what creeps had settled before, from the angle at the start (rad).
    ///
    /// h: a recording that was cut out of a longer one begins in mid-creep. The dashpot of a Maxwell
    /// branch is extended by θ(0) + h, not by θ(0). Without h, a creep that explains the first half of
    /// a long record says nothing about the second. A rest of unknown length before a run does not let
    /// all of a creep recover either.
    pub past: f64,
}

impl Nuisance {
    /// No zero errors, and an initial state at rest at 0 rad.
    pub const AT_ZERO: Self = Self {
        pressure_zero: 0.0,
        angle_zero: 0.0,
        start: InitialState {
            angle: 0.0,
            rate: 0.0,
        },
        past: 0.0,
    };

    /// From pressure zero, angle zero, initial angle, initial rate, past.
    fn of([pressure_zero, angle_zero, angle, rate, past]: [f64; UNKNOWNS]) -> Self {
        Self {
            pressure_zero,
            angle_zero,
            start: InitialState { angle, rate },
            past,
        }
    }

    /// The inverse of [`Nuisance::of`].
    fn values(&self) -> [f64; UNKNOWNS] {
        let InitialState { angle, rate } = self.start;
        [self.pressure_zero, self.angle_zero, angle, rate, self.past]
    }
}

/// The prior of a session's unknowns.
///
/// Each prior adds one residual to the sum of squares, (estimate − mean)/standard deviation, in
/// units of the angle's noise. A zero beyond [`FARTHEST`] standard deviations is no error of a
/// zero, and nothing creeps from beyond the swing: a [`wall`] keeps estimates below that, and an
/// effect has to explain the rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Means.
    pub mean: Nuisance,
    /// Standard deviations, in the same units.
    pub deviation: Nuisance,
    /// Standard deviation of a zero's departure from the common zero of one sitting; none
    /// for an unknown that belongs to the session alone.
    pub apart: [Option<f64>; UNKNOWNS],
    /// Noise of the measured angle (rad): the weight of one standard deviation.
    pub noise: f64,
    /// Weight of one standard deviation of a zero, in units of the noise: 1, or where
    /// models leave more than noise, the RMS of the model error over the noise times the
    /// root of its correlation time in samples.
    ///
    /// A weight of 1 weighs a zero against white noise. Where a model leaves a correlated error, a zero
    /// far from its mean could remove a little of that error in every sample, at the price of a few
    /// samples' noise. There a departure weighs as much as one independent sample of the model error.
    pub zero_weight: f64,
}

impl Prior {
    /// Takes the prior from the first samples and the metadata.
    pub fn of(recording: &Recording) -> Self {
        let noise = noise_of(recording, Channel::Angle)
            .max(quantisation_step(&recording.angle) / 12f64.sqrt())
            .max(1e-6);
        let calibration = recording.meta.calibration.as_ref();
        let pressure_zero = pressure_zero_sd(recording)
            .unwrap_or_else(|| INPUT_ZERO_SHARE * swing(&recording.pressure));
        // A constant pressure is a constant force, which the zero of the angle can
        // compensate as well.
        let pressure_zero = if moves(&recording.time, &recording.pressure) {
            pressure_zero
        } else {
            HELD_PA
        };
        let angle_zero = calibration
            .and_then(|known| known.angle_zero_sd_deg)
            .map_or(ANGLE_ZERO_SD_RAD, f64::to_radians);
        let of_a_sitting = calibration.is_none() && recording.meta.started.is_none();
        let apart = |sd: f64| of_a_sitting.then_some(sd);
        let rest = rest_at_start(recording);
        let (start, deviation) = if rest == 0 {
            in_motion(recording)
        } else {
            at_rest(recording, rest, noise)
        };
        let setup = recording.meta.setup.as_ref();
        let has_rested = setup.is_some_and(Setup::has_rested);
        let after = if rest == 0 && !has_rested {
            1.0
        } else {
            PAST_AFTER_REST
        };
        let past = after * PAST * swing(&recording.angle);
        Self {
            mean: Nuisance {
                pressure_zero: 0.0,
                angle_zero: 0.0,
                start,
                past: 0.0,
            },
            deviation: Nuisance {
                pressure_zero: pressure_zero.max(HELD_PA),
                angle_zero: angle_zero.max(1e-9),
                start: deviation,
                past: past.max(LEAST_PAST_RAD),
            },
            apart: [
                apart(INPUT_ZERO_APART * pressure_zero).filter(|sd| *sd < pressure_zero),
                apart(ANGLE_ZERO_APART_RAD),
                None,
                None,
                None,
            ],
            noise,
            zero_weight: 1.0,
        }
    }

    /// The same prior with the zero of the input by a range (Pa) that was used, in this recording
    /// or in others; none where it is known otherwise.
    pub fn in_range(mut self, recording: &Recording, range: f64) -> Option<Self> {
        let own = INPUT_ZERO_SHARE * swing(&recording.pressure);
        let is_held = own <= HELD_PA || self.deviation.pressure_zero < own;
        if is_held || pressure_zero_sd(recording).is_some() {
            return None;
        }
        let pressure_zero = INPUT_ZERO_SHARE * range;
        self.deviation.pressure_zero = pressure_zero;
        self.apart[0] = self.apart[0].map(|_| INPUT_ZERO_APART * pressure_zero);
        Some(self)
    }

    /// The same prior with the initial state known by so many first samples; none where these do
    /// not follow a parabola.
    ///
    /// Where a model misses by far more than the noise, a fit bends the initial state by thousands
    /// of its standard errors: an overdamped stage that seems to start 25 mm/s too slowly hides a
    /// friction. A start that was seen is not for a fit to choose.
    pub fn starting_from(&self, recording: &Recording, samples: usize) -> Option<Self> {
        /// RMS about the parabola up to which it is one, as a share of the range of these samples:
        /// noise is a larger share of it.
        const SHARE: f64 = 0.01;
        /// Least samples that say how well they follow a parabola.
        const FEWEST: usize = 8;
        /// Standard deviation of a start that is known (rad, rad/s).
        const KNOWN: f64 = 1e-9;
        if samples < FEWEST || samples > recording.len() {
            return None;
        }
        let first = motion(recording, 0, samples, 0)?;
        let time = recording.time.iter().take(samples);
        let errors: Vec<f64> = time
            .zip(&recording.angle)
            .map(|(t, angle)| {
                let t = t - recording.time[0];
                first.angle + t * (first.rate + 0.5 * first.acceleration * t) - angle
            })
            .collect();
        let moved = swing(&recording.angle[..samples]);
        if rms(&errors) > SHARE * moved {
            return None;
        }
        let known = InitialState {
            angle: KNOWN,
            rate: KNOWN,
        };
        Some(Self {
            mean: Nuisance {
                start: InitialState {
                    angle: first.angle,
                    rate: first.rate,
                },
                ..self.mean
            },
            deviation: Nuisance {
                start: known,
                ..self.deviation
            },
            ..*self
        })
    }

    /// Weight (rad) of one standard deviation of an unknown in output error.
    pub fn scale(&self, unknown: usize) -> f64 {
        if ZEROS.contains(&unknown) {
            self.noise * self.zero_weight
        } else {
            self.noise
        }
    }

    /// The same prior for data thinned to every n-th sample: their correlation time is n
    /// times fewer samples.
    pub fn thinned(mut self, every: usize) -> Self {
        self.zero_weight = (self.zero_weight / (every as f64).sqrt()).max(1.0);
        self
    }

    /// Departures of estimates from the prior means, in standard deviations: pressure
    /// zero, angle zero, initial angle, initial rate, past.
    pub fn departures(&self, estimate: &Nuisance) -> [f64; UNKNOWNS] {
        let (estimate, mean, sd) = (estimate.values(), self.mean.values(), self.deviations());
        std::array::from_fn(|k| (estimate[k] - mean[k]) / sd[k])
    }

    /// The standard deviations, in the order of the unknowns.
    pub fn deviations(&self) -> [f64; UNKNOWNS] {
        self.deviation.values()
    }

    /// The same prior with the standard deviations of the zeros multiplied by `part`.
    pub fn sharpened(mut self, part: f64) -> Self {
        self.deviation.pressure_zero *= part;
        self.deviation.angle_zero *= part;
        self.apart = self.apart.map(|sd| sd.map(|sd| sd * part));
        self
    }

    /// The estimates at a position of the solver: departures in standard deviations.
    pub fn at(&self, position: [f64; UNKNOWNS]) -> Nuisance {
        let (mean, sd) = (self.mean.values(), self.deviations());
        Nuisance::of(std::array::from_fn(|k| mean[k] + sd[k] * position[k]))
    }
}

/// How well the zero of the input is known by a calibration (Pa).
fn pressure_zero_sd(recording: &Recording) -> Option<f64> {
    let calibration = recording.meta.calibration.as_ref()?;
    Some(calibration.pressure_zero_sd_kpa? * PASCAL_PER_KPA)
}

/// The soft bound of a zero or a past beyond [`FARTHEST`] standard deviations: what it adds
/// to the residual in a fit to `samples` samples, and its slope. It must cost more than a
/// zero can gain where a missing effect moves thousands of samples, so it grows with
/// their number: one standard deviation beyond weighs as much as three times the noise in
/// every sample. It begins without a kink, on which a descent would not come to rest.
pub fn wall(departure: f64, samples: usize) -> [f64; 2] {
    /// Weight of one standard deviation beyond, in noise of every sample.
    const STEEP: f64 = 3.0;
    /// Least number of samples that counts.
    const FEWEST: f64 = 100.0;
    /// Standard deviations over which it gets steep.
    const ONSET: f64 = 0.1;
    let steep = STEEP * (samples as f64).max(FEWEST).sqrt();
    let beyond = departure.abs() - FARTHEST;
    if beyond > ONSET {
        [steep * (beyond - 0.5 * ONSET) * departure.signum(), steep]
    } else if beyond > 0.0 {
        let share = beyond / ONSET;
        [
            0.5 * steep * beyond * share * departure.signum(),
            steep * share,
        ]
    } else {
        [0.0, 0.0]
    }
}

/// The common zero of the sessions of one sitting.
///
/// A zero z, in standard deviations, is the common zero plus a departure of standard
/// deviation δ. The residuals of m zeros, whitened by their covariance
/// (1 − δ²)·1·1ᵀ + δ²·I, are
///
/// ```text
/// r_k = (z_k − c z̄)/δ,   z̄ = mean of the z_k,   c = 1 − δ/√(δ² + m (1 − δ²))
/// ```
///
/// Recordings without a time of recording count as one sitting. With independent zeros, twelve runs
/// could hide a friction, which lets each run end at another angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shared {
    /// Sessions that share the zero.
    sessions: f64,
    /// δ.
    apart: f64,
    /// c.
    common: f64,
}

impl Shared {
    /// Zeros of `sessions` sessions that deviate from the common one by `apart`, in
    /// standard deviations.
    pub fn new(sessions: usize, apart: f64) -> Self {
        let sessions = sessions as f64;
        let in_common = (1.0 - apart * apart).max(0.0);
        Self {
            sessions,
            apart,
            common: 1.0 - apart / (apart * apart + sessions * in_common).sqrt(),
        }
    }

    /// The residual of a zero, given the mean of all.
    pub fn residual(&self, zero: f64, mean: f64) -> f64 {
        (zero - self.common * mean) / self.apart
    }

    /// Derivatives of the residual by the zero itself and by the zero of another session.
    pub fn slopes(&self) -> [f64; 2] {
        let by_other = -self.common / (self.sessions * self.apart);
        [1.0 / self.apart + by_other, by_other]
    }
}

/// Initial state and its standard deviations for a session that rests over its first
/// `rest` samples: from a straight line through them, since it may still creep.
fn at_rest(
    recording: &Recording,
    rest: usize,
    noise: f64,
) -> (InitialState<f64>, InitialState<f64>) {
    let (time, angle) = (&recording.time[..rest], &recording.angle[..rest]);
    let count = rest as f64;
    let error = noise / count.sqrt();
    let middle = mean(time) - recording.time[0];
    let spread: f64 = time
        .iter()
        .map(|t| (t - recording.time[0] - middle).powi(2))
        .sum::<f64>()
        .max(f64::MIN_POSITIVE);
    let level = mean(angle);
    let slope = time
        .iter()
        .zip(angle)
        .map(|(t, a)| (t - recording.time[0] - middle) * (a - level))
        .sum::<f64>()
        / spread;
    let slope_error = noise / spread.sqrt();
    // A slope that noise explains is none.
    let slope = if slope.abs() < 3.0 * slope_error {
        0.0
    } else {
        slope
    };
    (
        InitialState {
            angle: level - slope * middle,
            rate: slope,
        },
        InitialState {
            angle: error + slope.abs() * middle,
            rate: slope_error,
        },
    )
}

/// Initial state for a session that begins in motion: from a parabola through the first
/// ten samples, with standard deviations that leave the fit free.
fn in_motion(recording: &Recording) -> (InitialState<f64>, InitialState<f64>) {
    let first = motion(recording, 0, 10, 0);
    let largest_angle = recording
        .angle
        .iter()
        .fold(1e-3, |largest_angle: f64, angle| {
            angle.abs().max(largest_angle)
        });
    let duration = 10.0 * recording.interval();
    (
        InitialState {
            angle: first.map_or(recording.angle[0], |motion| motion.angle),
            rate: first.map_or(0.0, |motion| motion.rate),
        },
        InitialState {
            angle: largest_angle,
            rate: largest_angle / duration.max(1e-6),
        },
    )
}

/// Number of samples, within the first second, before pressure or angle move; zero if
/// the recording starts in motion or is disturbed while it rests.
pub fn rest_at_start(recording: &Recording) -> usize {
    /// Fewest samples of a rest.
    const FEWEST: usize = 5;
    /// Longest rest (s) that is used.
    const LONGEST: f64 = 1.0;
    /// Samples from which the standard deviation is compared with the noise.
    const ENOUGH: usize = 30;
    /// Standard deviation over noise from which a recording does not rest.
    const SHAKEN: f64 = 1.3;
    let noise = noise_of(recording, Channel::Angle).max(1e-9);
    let pressure_noise = noise_of(recording, Channel::Pressure);
    let still = 0.01 * swing(&recording.pressure) + 5.0 * pressure_noise;
    let first_pressure = mean(&recording.pressure[..FEWEST.min(recording.len())]);
    let first_angle = mean(&recording.angle[..FEWEST.min(recording.len())]);
    let rest = (0..recording.len())
        .take_while(|&k| {
            recording.time[k] - recording.time[0] <= LONGEST
                && (recording.pressure[k] - first_pressure).abs() <= still
                && (recording.angle[k] - first_angle).abs() <= 5.0 * noise
        })
        .count();
    let shaken = rest >= ENOUGH && standard_deviation(&recording.angle[..rest]) > SHAKEN * noise;
    if rest >= FEWEST && !shaken { rest } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn resting(angle: f64, slope: f64) -> Recording {
        let time: Vec<f64> = (0..400).map(|k| f64::from(k) * 0.01).collect();
        Recording {
            pressure: time
                .iter()
                .map(|t| if *t > 0.6 { 40e3 } else { 0.0 })
                .collect(),
            angle: time
                .iter()
                .enumerate()
                .map(|(k, t)| {
                    let noise = 1e-3 * f64::from(u8::try_from(k * 7 % 5).unwrap()) - 2e-3;
                    angle + slope * t + (t - 0.6).max(0.0) + noise
                })
                .collect(),
            time,
            ..Recording::default()
        }
    }

    #[test]
    fn a_rest_gives_the_start_and_how_well_it_is_known() {
        assert!(rest_at_start(&resting(0.2, 0.0)) > 0);
        let prior = Prior::of(&resting(0.2, 0.0));
        assert!((prior.mean.start.angle - 0.2).abs() < 1e-3);
        assert!(prior.deviation.start.angle < 1e-3);
        let creeping = Prior::of(&resting(0.2, 0.01));
        assert!((creeping.mean.start.rate - 0.01).abs() < 2e-3);
    }

    #[test]
    fn the_metadata_says_how_well_zeros_are_known() {
        let mut recording = resting(0.0, 0.0);
        let unknown = Prior::of(&recording);
        assert!((unknown.deviation.angle_zero.to_degrees() - 2.0).abs() < 1e-9);
        recording.meta.calibration = Some(softrig_formats::recording::CalibrationMeta {
            pressure_zero_sd_kpa: Some(0.1),
            angle_zero_sd_deg: Some(0.5),
        });
        let known = Prior::of(&recording);
        assert!((known.deviation.pressure_zero - 100.0).abs() < 1e-9);
        assert!((known.deviation.angle_zero.to_degrees() - 0.5).abs() < 1e-9);
    }

    proptest! {
        /// The density of jointly normal zeros, by its covariance matrix.
        #[test]
        fn shared_zeros_have_the_density_of_their_covariance(
            zeros in proptest::collection::vec(-3.0..3.0f64, 1..7), apart in 0.05..0.9f64,
        ) {
            use nalgebra::{DMatrix, DVector};
            let count = zeros.len();
            let shared = Shared::new(count, apart);
            let mean = zeros.iter().sum::<f64>() / count as f64;
            let squares: f64 = zeros.iter().map(|zero| shared.residual(*zero, mean).powi(2)).sum();
            let own = apart * apart;
            let covariance = DMatrix::from_fn(count, count, |i, j| {
                1.0 - own + if i == j { own } else { 0.0 }
            });
            let zeros = DVector::from_vec(zeros);
            let solved = covariance.cholesky().unwrap().solve(&zeros);
            let expected = zeros.dot(&solved);
            prop_assert!((squares - expected).abs() < 1e-9 * (1.0 + expected), "{squares}, not {expected}");
        }

        #[test]
        fn positions_and_estimates_are_inverse(
            pressure in -0.9..0.9f64, angle in -0.9..0.9f64,
            start in -5.0..5.0f64, rate in -5.0..5.0f64, past in -5.0..5.0f64,
        ) {
            let prior = Prior::of(&resting(0.1, 0.0));
            let position = [pressure, angle, start, rate, past];
            let back = prior.departures(&prior.at(position));
            for (there, here) in back.iter().zip(position) {
                prop_assert!((there - here).abs() < 1e-9);
            }
        }
    }
}
