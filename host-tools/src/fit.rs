//! Output-error fits: the parameters whose simulation is nearest to what was
//! measured.
//!
//! The model is *simulated* over each recording and compared with the measured
//! angle; nothing is differentiated in time, so noise is not amplified. The
//! derivatives of every simulated sample come exactly from dual numbers that
//! run through the shared core ([`crate::dual`]), and a library solves the
//! least-squares problem (Levenberg–Marquardt, the MINPACK algorithm).
//!
//! A recording that does not start at rest brings two unknowns of its own: the
//! angle and the rate with which it starts.

use std::num::NonZeroUsize;

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use model_core::actuator::{Model, ParameterId};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};
use rayon::prelude::*;
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::checkpoint::{Checkpoint, fingerprint};
use crate::denoise;
use crate::dual::Dual;
use crate::information::{Block, Information};
use crate::recording::Recording;
use crate::simulate::{Signal, Start, run, substeps};
use crate::smooth::{half_window, motion};
use crate::statistics::{clipped, correlation_time, mean, noise_by_differences, rms, scatter};

/// A recording prepared for fitting.
#[derive(Clone, Debug)]
pub struct Run<'a> {
    /// The recording.
    pub recording: &'a Recording,
    signal: Signal,
    /// Best knowledge of the start before any fit.
    start: Start<f64>,
    /// Whether the start has to be estimated.
    moving: bool,
    interval: f64,
    /// Largest angle measured (rad), which bounds the step length.
    reach: f64,
    /// Samples at which the sensor was at the end of its range.
    clipped: Vec<std::ops::Range<usize>>,
}

impl<'a> Run<'a> {
    /// Prepares a recording: decides from its first samples whether it starts
    /// at rest, takes the noise from its pressure and interpolates that.
    pub fn new(recording: &'a Recording) -> Self {
        let (start, moving) = find_start(recording);
        let pressure = denoise::pressure(recording);
        Self {
            recording,
            signal: Signal::new(recording.time.clone(), pressure),
            start,
            moving,
            interval: recording.interval(),
            reach: recording
                .angle
                .iter()
                .fold(0.0, |reach, angle| angle.abs().max(reach)),
            clipped: clipped(&recording.angle),
        }
    }

    /// Prepares several recordings.
    pub fn all(recordings: &'a [Recording]) -> Vec<Self> {
        recordings.iter().map(Self::new).collect()
    }

    /// Largest angle measured (rad).
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// Simulated minus measured angle (rad).
    fn residual(&self, model: &Model<f64>, start: Start<f64>) -> Vec<f64> {
        let steps = substeps(model, self.interval, self.reach);
        self.residual_of(&run(model, &self.signal, start, steps).reading)
    }

    /// A simulated angle minus the measured one (rad).
    pub fn residual_of(&self, simulated: &[f64]) -> Vec<f64> {
        let mut residual: Vec<f64> = simulated
            .iter()
            .zip(&self.recording.angle)
            .map(|(simulated, measured)| simulated - measured)
            .collect();
        // Beyond the end of its range the sensor says nothing.
        for range in &self.clipped {
            residual[range.clone()].fill(0.0);
        }
        residual
    }

    /// Simulates the recording with another scalar or power function, from the
    /// given start: the firmware's own arithmetic, for one.
    pub fn simulate<R, P>(&self, model: &Model<R, P>, start: Start<f64>) -> Vec<f64>
    where
        R: crate::simulate::FromF64,
        P: model_core::power::Power<R>,
    {
        let steps = substeps(model, self.interval, self.reach);
        let start = Start {
            angle: R::from_f64(start.angle),
            rate: R::from_f64(start.rate),
        };
        run(model, &self.signal, start, steps)
            .reading
            .into_iter()
            .map(crate::simulate::FromF64::to_f64)
            .collect()
    }
}

/// Decides how a recording starts: at rest, from the samples before anything
/// moves, or in motion, from a parabola through its first samples.
fn find_start(recording: &Recording) -> (Start<f64>, bool) {
    let noise = noise_by_differences(&recording.angle).max(1e-9);
    let rest = rest_at_start(recording);
    if rest == 0 {
        return (initial_motion(recording), true);
    }
    let angle = mean(&recording.angle[..rest]);
    let uncertainty = noise / (rest as f64).sqrt();
    // The zero is a tare at rest; a mean that does not contradict it is it.
    let angle = if angle.abs() < 4.0 * uncertainty {
        0.0
    } else {
        angle
    };
    (Start { angle, rate: 0.0 }, false)
}

/// Samples, of the first second, before pressure or angle move; zero if the
/// recording starts in motion, or if something shakes it while it rests.
pub fn rest_at_start(recording: &Recording) -> usize {
    /// Fewer samples than this do not show a rest.
    const FEWEST: usize = 5;
    /// A rest longer than this (s) adds nothing.
    const LONGEST: f64 = 1.0;
    /// So many samples show more than noise, …
    const ENOUGH: usize = 30;
    /// … if they scatter by more than this factor of it.
    const SHAKEN: f64 = 1.3;
    let noise = noise_by_differences(&recording.angle).max(1e-9);
    let pressure_noise = noise_by_differences(&recording.pressure);
    let swing = |values: &[f64]| {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        high - low
    };
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
    let shaken = rest >= ENOUGH && scatter(&recording.angle[..rest]) > SHAKEN * noise;
    if rest >= FEWEST && !shaken { rest } else { 0 }
}

/// Angle and rate at the first sample, from a parabola through the first ten.
fn initial_motion(recording: &Recording) -> Start<f64> {
    let first = motion(recording, 0, 10, 0);
    Start {
        angle: first.map_or(recording.angle[0], |motion| motion.angle),
        rate: first.map_or(0.0, |motion| motion.rate),
    }
}

/// Recordings cut into short pieces that each start where the measured motion
/// is: the ground on which fits find their way.
///
/// Over a whole recording a small error of frequency puts simulation and
/// measurement out of phase, and the sum of squares is full of valleys that
/// lead nowhere. Over half a swing it has one. Fitting the pieces is biased by
/// the noise of their starts and by hidden states that had no time to build
/// up, so it gives starts for fits and nothing else.
#[derive(Clone, Debug)]
pub struct Pieces {
    pieces: Vec<(Recording, Start<f64>)>,
}

impl Pieces {
    /// Cuts the recordings of `fitter` into pieces of about half a swing of
    /// its nominal model, between 10 samples and 1 s, and takes enough of them
    /// at even distances.
    pub fn of(fitter: &Fitter<'_, '_>) -> Self {
        const FEWEST: f64 = 10.0;
        const LONGEST_S: f64 = 1.0;
        /// Samples that are enough to find a start.
        const ENOUGH: usize = 2_000;
        let mut pieces = Vec::new();
        for run in fitter.runs {
            let stiffness = fitter.nominal.fastest_rate(run.reach).stiffness;
            let half_swing = std::f64::consts::PI / stiffness.sqrt();
            let samples = (half_swing.min(LONGEST_S) / run.interval).max(FEWEST);
            // At most a second of samples.
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let length = samples as usize;
            let recording = run.recording;
            let half = half_window(recording);
            let mut begin = half;
            while begin + length < recording.len() {
                let at = motion(recording, begin - half, begin + half + 1, begin);
                if let Some(motion) = at {
                    let range = begin..begin + length;
                    let piece = Recording {
                        time: recording.time[range.clone()].to_vec(),
                        pressure: recording.pressure[range.clone()].to_vec(),
                        angle: recording.angle[range].to_vec(),
                        ..Recording::default()
                    };
                    let start = Start {
                        angle: motion.angle,
                        rate: motion.rate,
                    };
                    pieces.push((piece, start));
                }
                begin += length;
            }
        }
        let samples: usize = pieces.iter().map(|(piece, _)| piece.len()).sum();
        let stride = samples.div_ceil(ENOUGH).max(1);
        let pieces = pieces.into_iter().step_by(stride).collect();
        Self { pieces }
    }

    /// The pieces as runs whose starts are known.
    pub fn runs(&self) -> Vec<Run<'_>> {
        self.pieces
            .iter()
            .map(|(recording, start)| Run {
                start: *start,
                moving: false,
                ..Run::new(recording)
            })
            .collect()
    }
}

/// A part of the recordings, whole runs where they are short: enough to rank
/// starts and candidates before the best are fitted to everything.
#[derive(Clone, Debug)]
pub struct Excerpt {
    recordings: Vec<Recording>,
}

impl Excerpt {
    /// Takes runs at even distances in the list until there are enough
    /// samples, and cuts the last one.
    pub fn of(fitter: &Fitter<'_, '_>) -> Self {
        /// Samples that are enough to rank.
        const ENOUGH: usize = 4_000;
        let all: usize = fitter.runs.iter().map(|run| run.recording.len()).sum();
        let stride = all.div_ceil(ENOUGH).max(1);
        let count = fitter.runs.len();
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by_key(|index| (index % stride, *index));
        let mut recordings = Vec::new();
        let mut room = ENOUGH;
        for index in order {
            let recording = fitter.runs[index].recording;
            let length = recording.len().min(room);
            // The rest of a run that is nearly over shows nothing new.
            if length < recording.len().min(100) {
                break;
            }
            recordings.push(Recording {
                time: recording.time[..length].to_vec(),
                pressure: recording.pressure[..length].to_vec(),
                angle: recording.angle[..length].to_vec(),
                ..Recording::default()
            });
            room -= length;
        }
        Self { recordings }
    }

    /// The runs of the excerpt.
    pub fn runs(&self) -> Vec<Run<'_>> {
        Run::all(&self.recordings)
    }
}

/// How a parameter maps to the unbounded coordinate that the solver moves.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Coordinate {
    /// No bounds: p = s·u.
    Linear { scale: f64 },
    /// A lower bound: p = l + s(√(u² + 1) − 1).
    Above { lower: f64, scale: f64 },
    /// Two bounds: p = l + (h − l)(1 + sin u)/2.
    Between { lower: f64, upper: f64 },
    /// Two positive bounds, orders of magnitude apart: the same in ln p.
    Logarithmic { lower: f64, upper: f64 },
}

impl Coordinate {
    fn of(nominal: &Model<f64>, model: &Model<f64>, id: ParameterId) -> Self {
        let value = model.value(id).unwrap_or(1.0);
        let scale = if value.abs() > 1e-12 {
            value.abs()
        } else {
            1.0
        };
        let (lower, upper) = search_range(nominal, model, id);
        match (lower.is_finite(), upper.is_finite()) {
            (true, true) if lower > 0.0 && upper / lower > 50.0 => {
                Self::Logarithmic { lower, upper }
            }
            (true, true) => Self::Between { lower, upper },
            (true, false) => Self::Above { lower, scale },
            _ => Self::Linear { scale },
        }
    }

    fn to_value(self, u: f64) -> f64 {
        match self {
            Self::Linear { scale } => scale * u,
            Self::Above { lower, scale } => lower + scale * ((u * u + 1.0).sqrt() - 1.0),
            Self::Between { lower, upper } => lower + (upper - lower) * 0.5 * (1.0 + u.sin()),
            Self::Logarithmic { lower, upper } => {
                lower * ((upper / lower).ln() * 0.5 * (1.0 + u.sin())).exp()
            }
        }
    }

    /// dp/du at `u`.
    fn slope(self, u: f64) -> f64 {
        match self {
            Self::Linear { scale } => scale,
            Self::Above { scale, .. } => scale * u / (u * u + 1.0).sqrt(),
            Self::Between { lower, upper } => (upper - lower) * 0.5 * u.cos(),
            Self::Logarithmic { lower, upper } => {
                self.to_value(u) * (upper / lower).ln() * 0.5 * u.cos()
            }
        }
    }

    /// Whether a position is within a thousandth of the end of the range.
    fn is_at_edge(self, u: f64) -> bool {
        match self {
            Self::Linear { .. } => false,
            Self::Above { .. } => u.abs() < 0.045,
            Self::Between { .. } | Self::Logarithmic { .. } => u.sin().abs() > 0.998,
        }
    }

    /// The coordinate of a value. On a bound the slope is zero and the solver
    /// could never leave, so starts keep a small distance.
    fn position(self, value: f64) -> f64 {
        const MARGIN: f64 = 2e-3;
        match self {
            Self::Linear { scale } => value / scale,
            Self::Above { lower, scale } => {
                let ratio = ((value - lower) / scale).max(MARGIN) + 1.0;
                (ratio * ratio - 1.0).sqrt()
            }
            Self::Between { lower, upper } => {
                let share = ((value - lower) / (upper - lower)).clamp(MARGIN, 1.0 - MARGIN);
                (2.0 * share - 1.0).asin()
            }
            Self::Logarithmic { lower, upper } => {
                let share =
                    ((value / lower).ln() / (upper / lower).ln()).clamp(MARGIN, 1.0 - MARGIN);
                (2.0 * share - 1.0).asin()
            }
        }
    }
}

/// How far a fit may move a base parameter from its nominal value, as a factor.
///
/// Data sheets are right to a third; a factor of ten allows for a slip of
/// units and keeps a fit whose structure is wrong from running to infinity
/// along a flat valley (inertia without influence, all else scaled up).
const SEARCH_FACTOR: f64 = 10.0;

/// Where a fit looks for a parameter, in SI units, given the model as it was
/// before any fit.
fn search_range(nominal: &Model<f64>, model: &Model<f64>, id: ParameterId) -> (f64, f64) {
    let (lower, upper) = bounds(model, id);
    let value = nominal.value(id).unwrap_or(0.0);
    match id {
        ParameterId::Effect { .. } | ParameterId::Exponent => (lower, upper),
        _ if value == 0.0 => (lower, upper),
        ParameterId::InputGain if value < 0.0 => (SEARCH_FACTOR * value, 0.0),
        ParameterId::Damping | ParameterId::Stiffness | ParameterId::InputGain => {
            (0.0, SEARCH_FACTOR * value)
        }
        ParameterId::Inertia => (value / SEARCH_FACTOR, value * SEARCH_FACTOR),
    }
}

/// The bounds of a parameter in SI units.
fn bounds(model: &Model<f64>, id: ParameterId) -> (f64, f64) {
    match id {
        ParameterId::Inertia => (1e-9, f64::INFINITY),
        ParameterId::Damping | ParameterId::Stiffness => (0.0, f64::INFINITY),
        ParameterId::Exponent => (0.25, 8.0),
        ParameterId::InputGain => (f64::NEG_INFINITY, f64::INFINITY),
        ParameterId::Effect { slot, parameter } => model
            .effects()
            .nth(slot)
            .and_then(|effect| effect.parameters().get(parameter))
            .map_or((f64::NEG_INFINITY, f64::INFINITY), |row| {
                (f64::from(row.lower), f64::from(row.upper))
            }),
    }
}

/// What a fit found.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The model with the fitted parameters.
    pub model: Model<f64>,
    /// Which parameters were free.
    pub free: Vec<ParameterId>,
    /// Start of each recording, estimated where it was unknown.
    pub starts: Vec<Start<f64>>,
    /// Simulated minus measured angle (rad), a series a recording.
    pub residuals: Vec<Vec<f64>>,
    /// Standard error of each free parameter, in SI units; infinite for a
    /// parameter that the recordings do not determine.
    pub standard_errors: Vec<f64>,
    /// Whether the solver met its tolerance.
    pub converged: bool,
    /// Number of starts that were estimated.
    moving: usize,
    /// What each recording says about the free parameters; empty after a
    /// glance.
    information: Information,
    coordinates: Vec<Coordinate>,
    position: Vec<f64>,
}

/// A combination of free parameters that the recordings hardly determine.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatDirection {
    /// How far the parameters can move along it, relative to their own size,
    /// before the residual grows by its standard error; infinite if nothing
    /// determines it.
    pub reach: f64,
    /// The parameters that take part, with their relative change; the largest
    /// first.
    pub shares: Vec<(ParameterId, f64)>,
}

impl Fit {
    /// Sum of squared residuals (rad²).
    pub fn sse(&self) -> f64 {
        self.residuals
            .iter()
            .flatten()
            .map(|residual| residual * residual)
            .sum()
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.residuals.iter().map(Vec::len).sum()
    }

    /// Number of numbers that were estimated.
    pub fn estimated(&self) -> usize {
        self.free.len() + 2 * self.moving
    }

    /// RMS residual (rad).
    pub fn rmse(&self) -> f64 {
        (self.sse() / self.samples().max(1) as f64).sqrt()
    }

    /// How many correlated samples count as one.
    pub fn correlation_time(&self) -> f64 {
        correlation_time(&self.residuals)
    }

    /// The model as it would have been fitted without the recordings in
    /// `left_out`, to second order; none where that cannot be trusted.
    pub fn without(&self, left_out: &[usize]) -> Option<Model<f64>> {
        if self.free.is_empty() {
            return Some(self.model);
        }
        if self.information.unknowns() != self.free.len() {
            return None;
        }
        let step = self.information.step_without(left_out)?;
        let mut model = self.model;
        for (k, (&id, coordinate)) in self.free.iter().zip(&self.coordinates).enumerate() {
            model = model.with_value(id, coordinate.to_value(self.position[k] + step[k]));
        }
        Some(model)
    }

    /// JᵀJ of all recordings in the coordinates of the solver; none after a
    /// glance.
    pub fn curvature(&self) -> Option<DMatrix<f64>> {
        (self.information.unknowns() == self.free.len() && !self.free.is_empty())
            .then(|| self.information.total(&[]))
    }

    /// Combinations of free parameters that could move by more than half their
    /// size unnoticed: singular values of the Jacobian by relative changes.
    pub fn flat_directions(&self) -> Vec<FlatDirection> {
        /// Standard error along a direction, relative to the parameters.
        const LIMIT: f64 = 0.5;
        /// A parameter with a smaller share does not take part.
        const SHARE: f64 = 0.2;
        if self.information.unknowns() != self.free.len() {
            return Vec::new();
        }
        let sizes: Vec<f64> = self
            .free
            .iter()
            .zip(&self.coordinates)
            .zip(&self.position)
            .map(|((&id, coordinate), &u)| {
                let value = self.model.value(id).unwrap_or(1.0);
                coordinate.slope(u) / value.abs().max(1e-9)
            })
            .collect();
        self.information
            .flat_directions(&sizes, LIMIT)
            .into_iter()
            .map(|(reach, direction)| {
                let mut shares: Vec<(ParameterId, f64)> = self
                    .free
                    .iter()
                    .copied()
                    .zip(direction)
                    .filter(|(_, share)| share.abs() > SHARE)
                    .collect();
                shares.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
                FlatDirection { reach, shares }
            })
            .collect()
    }

    /// Whether the free parameter at `index` ended at the edge of the range in
    /// which it was searched.
    pub fn at_bound(&self, index: usize) -> bool {
        self.coordinates
            .get(index)
            .zip(self.position.get(index))
            .is_some_and(|(coordinate, &u)| coordinate.is_at_edge(u))
    }

    /// 95 % interval of the free parameter at `index` in SI units, by Student's
    /// distribution, cut at the parameter's bounds.
    pub fn interval95(&self, index: usize) -> Option<(f64, f64)> {
        let id = *self.free.get(index)?;
        let value = self.model.value(id)?;
        let half =
            student95(self.information.degrees_of_freedom()) * self.standard_errors.get(index)?;
        let (lower, upper) = bounds(&self.model, id);
        Some(((value - half).max(lower), (value + half).min(upper)))
    }
}

/// Where a solver ended, in its own coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Ended {
    /// The unknowns.
    pub position: Vec<f64>,
    /// Whether the solver met its tolerance.
    pub converged: bool,
}

/// How hard a fit tries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// A few steps, to rank starts.
    Glance,
    /// Until another step would change the sum of squares by a millionth: far
    /// below what any test of significance can see.
    Full,
}

impl Effort {
    fn solver(self) -> LevenbergMarquardt<f64> {
        let solver = LevenbergMarquardt::new().with_gtol(0.0);
        // The step bound is the first step relative to the size of the
        // coordinates. The solver's default of 100 leaps over the valley that
        // a start was chosen for.
        match self {
            Self::Glance => solver
                .with_stepbound(1.0)
                .with_patience(3)
                .with_ftol(1e-3)
                .with_xtol(1e-3),
            Self::Full => solver
                .with_stepbound(0.1)
                .with_patience(6)
                .with_ftol(1e-6)
                .with_xtol(1e-5),
        }
    }
}

/// Fits models to a set of recordings.
#[derive(Clone, Copy, Debug)]
pub struct Fitter<'a, 'r> {
    /// The model before any fit, around which base parameters are searched.
    pub nominal: &'a Model<f64>,
    /// The recordings.
    pub runs: &'a [Run<'r>],
}

impl Fitter<'_, '_> {
    /// Fits the parameters in `free`, starting from their values in `start`.
    ///
    /// With nothing free it estimates only the starts of recordings that begin
    /// in motion: a plain comparison.
    pub fn fit(&self, start: &Model<f64>, free: &[ParameterId], effort: Effort) -> Fit {
        self.fit_kept(start, free, effort, &Checkpoint::default())
    }

    /// As [`Fitter::fit`], unless `checkpoint` knows where it ended.
    pub fn fit_kept(
        &self,
        start: &Model<f64>,
        free: &[ParameterId],
        effort: Effort,
        checkpoint: &Checkpoint,
    ) -> Fit {
        let mut problem = Problem::new(self, start, free);
        let key = if checkpoint.is_used() {
            self.fingerprint(start, free, effort)
        } else {
            0
        };
        if let Some(ended) = checkpoint.recall(key)
            && ended.position.len() == problem.unknowns()
        {
            problem.position = DVector::from_column_slice(&ended.position);
            return problem.finish(ended.converged, effort);
        }
        let mut converged = true;
        if problem.unknowns() > 0 {
            let (solved, report) = effort.solver().minimize(problem);
            converged = report.termination.was_successful();
            problem = solved;
            let position = problem.position.iter().copied().collect();
            checkpoint.keep(
                key,
                &Ended {
                    position,
                    converged,
                },
            );
        }
        problem.finish(converged, effort)
    }

    /// Tells fits apart: by recordings, model, start, free parameters, effort
    /// and version.
    fn fingerprint(&self, start: &Model<f64>, free: &[ParameterId], effort: Effort) -> u64 {
        let version = env!("CARGO_PKG_VERSION");
        let text = format!("{version} {:?} {start:?} {free:?} {effort:?}", self.nominal);
        let samples = self.runs.iter().flat_map(|run| {
            let Recording { time, angle, .. } = run.recording;
            let own = [
                run.start.angle,
                run.start.rate,
                f64::from(u8::from(run.moving)),
            ];
            time.iter()
                .chain(run.signal.values())
                .chain(angle)
                .copied()
                .chain(own)
                .flat_map(f64::to_le_bytes)
        });
        fingerprint(text.into_bytes().into_iter().chain(samples))
    }

    /// Widens the standard errors of a fit by what is not known about parameters
    /// that it held.
    pub fn allow_for(&self, fit: &mut Fit, held: &[ParameterId]) {
        // From the edge of a range the derivatives of the fit lie elsewhere.
        if (0..fit.free.len()).any(|index| fit.at_bound(index)) {
            return;
        }
        let free = [fit.free.as_slice(), held].concat();
        let wider = Problem::new(self, &fit.model, &free)
            .starting(&fit.starts)
            .finish(fit.converged, Effort::Full);
        for (error, wider) in fit.standard_errors.iter_mut().zip(wider.standard_errors) {
            if wider.is_finite() {
                *error = error.max(wider);
            }
        }
    }

    /// Simulates `model` as it is and compares.
    pub fn compare(&self, model: &Model<f64>) -> Fit {
        self.fit(model, &[], Effort::Full)
    }

    /// Derivatives of the simulated angles by the free parameters of a fit to
    /// other recordings, in the coordinates in which that was solved.
    pub fn derivatives(&self, fit: &Fit) -> DMatrix<f64> {
        let mut problem = Problem::new(self, &fit.model, &fit.free);
        problem.coordinates.clone_from(&fit.coordinates);
        for (to, from) in problem.position.iter_mut().zip(&fit.position) {
            *to = *from;
        }
        problem
            .exact_jacobian()
            .columns(0, fit.free.len())
            .into_owned()
    }

    /// The sum of squares (rad²) that one Gauss–Newton step from `start` promises:
    /// a score test at the price of a single simulation with derivatives. Not
    /// finite where the model cannot be simulated.
    pub fn promise(&self, start: &Model<f64>, free: &[ParameterId]) -> f64 {
        let starts: Vec<Start<f64>> = self.runs.iter().map(|run| run.start).collect();
        let Some((residuals, jacobian)) = self.linearised(start, free, &starts) else {
            return f64::INFINITY;
        };
        let mut normal = jacobian.tr_mul(&jacobian);
        let slope = jacobian.tr_mul(&residuals);
        for k in 0..normal.nrows() {
            // A column without influence must not make it singular.
            let ridge = 1e-9 * normal[(k, k)] + f64::MIN_POSITIVE;
            normal[(k, k)] += ridge;
        }
        let whole = residuals.norm_squared();
        normal
            .cholesky()
            .map_or(whole, |factor| whole - slope.dot(&factor.solve(&slope)))
    }

    /// Residuals (rad) of a model, and their derivatives in the coordinates in
    /// which the solver moves: the parameters in `free`, then the starts of
    /// recordings that begin in motion, about `starts`. None where it cannot be
    /// simulated.
    pub fn linearised(
        &self,
        model: &Model<f64>,
        free: &[ParameterId],
        starts: &[Start<f64>],
    ) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let problem = Problem::new(self, model, free).starting(starts);
        Some((problem.residuals()?, problem.jacobian()?))
    }

    /// The `count` starts that promise most.
    pub fn promising(
        &self,
        starts: &[Model<f64>],
        free: &[ParameterId],
        count: usize,
    ) -> Vec<(f64, Model<f64>)> {
        let mut ranked: Vec<(f64, Model<f64>)> = starts
            .par_iter()
            .map(|start| (self.promise(start, free), *start))
            .collect();
        ranked.retain(|(promise, _)| promise.is_finite());
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked.truncate(count);
        ranked
    }

    /// Fits from each start; the best. None if there is no start from which the
    /// model can be simulated.
    pub fn best_of(
        &self,
        starts: &[Model<f64>],
        free: &[ParameterId],
        effort: Effort,
    ) -> Option<Fit> {
        self.best_of_kept(starts, free, effort, &Checkpoint::default())
    }

    /// As [`Fitter::best_of`], taking up what `checkpoint` knows.
    pub fn best_of_kept(
        &self,
        starts: &[Model<f64>],
        free: &[ParameterId],
        effort: Effort,
        checkpoint: &Checkpoint,
    ) -> Option<Fit> {
        starts
            .par_iter()
            .map(|start| self.fit_kept(start, free, effort, checkpoint))
            .collect::<Vec<_>>()
            .into_iter()
            .filter(|fit| fit.sse().is_finite())
            .min_by(|a, b| a.sse().total_cmp(&b.sse()))
    }
}

/// The least-squares problem in the solver's coordinates: the free parameters,
/// then angle and rate of every recording that starts in motion.
struct Problem<'a, 'r> {
    model: Model<f64>,
    free: Vec<ParameterId>,
    coordinates: Vec<Coordinate>,
    runs: &'a [Run<'r>],
    /// First column of each recording's own unknowns.
    own: Vec<Option<NonZeroUsize>>,
    position: DVector<f64>,
}

impl<'a, 'r> Problem<'a, 'r> {
    fn new(fitter: &Fitter<'a, 'r>, model: &Model<f64>, free: &[ParameterId]) -> Self {
        let runs = fitter.runs;
        let coordinates: Vec<Coordinate> = free
            .iter()
            .map(|&id| Coordinate::of(fitter.nominal, model, id))
            .collect();
        let mut position: Vec<f64> = free
            .iter()
            .zip(&coordinates)
            .map(|(&id, coordinate)| coordinate.position(model.value(id).unwrap_or(0.0)))
            .collect();
        let own = runs
            .iter()
            .map(|run| {
                run.moving.then(|| {
                    position.extend([run.start.angle, run.start.rate]);
                    // Counted from 1, so that a column can be absent.
                    NonZeroUsize::new(position.len() - 1).unwrap_or(NonZeroUsize::MIN)
                })
            })
            .collect();
        Self {
            model: *model,
            free: free.to_vec(),
            coordinates,
            runs,
            own,
            position: DVector::from_vec(position),
        }
    }

    /// The same with other starts of the recordings that begin in motion.
    fn starting(mut self, starts: &[Start<f64>]) -> Self {
        for (own, start) in self.own.iter().zip(starts) {
            if let Some(column) = own {
                self.position[column.get() - 1] = start.angle;
                self.position[column.get()] = start.rate;
            }
        }
        self
    }

    fn unknowns(&self) -> usize {
        self.position.len()
    }

    fn model(&self) -> Model<f64> {
        let mut model = self.model;
        for ((&id, coordinate), &u) in self.free.iter().zip(&self.coordinates).zip(&self.position) {
            model = model.with_value(id, coordinate.to_value(u));
        }
        model
    }

    fn start(&self, index: usize) -> Start<f64> {
        match self.own[index] {
            Some(column) => Start {
                angle: self.position[column.get() - 1],
                rate: self.position[column.get()],
            },
            None => self.runs[index].start,
        }
    }

    fn residual_series(&self) -> Vec<Vec<f64>> {
        let model = self.model();
        self.runs
            .par_iter()
            .enumerate()
            .map(|(index, run)| run.residual(&model, self.start(index)))
            .collect()
    }

    /// Derivatives of one recording's samples: by the free parameters, then by
    /// its own start. `N` is at least the number of columns.
    fn sensitivities<const N: usize>(&self, model: &Model<f64>, index: usize) -> Vec<[f64; N]> {
        let recording = &self.runs[index];
        let steps = substeps(model, recording.interval, recording.reach);
        let mut dual: Model<Dual<N>> = model.map(Dual::constant);
        for (column, ((&id, coordinate), &u)) in self
            .free
            .iter()
            .zip(&self.coordinates)
            .zip(&self.position)
            .enumerate()
        {
            let value = coordinate.to_value(u);
            dual = dual.with_value(id, Dual::variable(value, column, coordinate.slope(u)));
        }
        let start = self.start(index);
        let columns = self.free.len();
        let start = if self.own[index].is_some() {
            Start {
                angle: Dual::variable(start.angle, columns, 1.0),
                rate: Dual::variable(start.rate, columns + 1, 1.0),
            }
        } else {
            Start {
                angle: Dual::constant(start.angle),
                rate: Dual::constant(start.rate),
            }
        };
        let mut partials: Vec<[f64; N]> = run(&dual, &recording.signal, start, steps)
            .reading
            .into_iter()
            .map(|reading| reading.partials())
            .collect();
        for range in &recording.clipped {
            partials[range.clone()].fill([0.0; N]);
        }
        partials
    }

    /// The Jacobian, with the derivatives carried in arrays of size `N`.
    fn jacobian_in<const N: usize>(&self) -> DMatrix<f64> {
        let model = self.model();
        let blocks: Vec<Vec<[f64; N]>> = (0..self.runs.len())
            .into_par_iter()
            .map(|index| self.sensitivities::<N>(&model, index))
            .collect();
        let rows = blocks.iter().map(Vec::len).sum();
        let mut jacobian = DMatrix::zeros(rows, self.unknowns());
        let mut first = 0;
        for (block, own) in blocks.iter().zip(&self.own) {
            for (offset, partials) in block.iter().enumerate() {
                for column in 0..self.free.len() {
                    jacobian[(first + offset, column)] = partials[column];
                }
                if let Some(column) = own {
                    jacobian[(first + offset, column.get() - 1)] = partials[self.free.len()];
                    jacobian[(first + offset, column.get())] = partials[self.free.len() + 1];
                }
            }
            first += block.len();
        }
        jacobian
    }

    fn exact_jacobian(&self) -> DMatrix<f64> {
        match self.free.len() + 2 * usize::from(self.own.iter().any(Option::is_some)) {
            0..=4 => self.jacobian_in::<4>(),
            5..=6 => self.jacobian_in::<6>(),
            7..=8 => self.jacobian_in::<8>(),
            9..=12 => self.jacobian_in::<12>(),
            // Five base parameters, three effects of four each and a start.
            _ => self.jacobian_in::<20>(),
        }
    }

    fn finish(self, converged: bool, effort: Effort) -> Fit {
        let residuals = self.residual_series();
        let information = match effort {
            Effort::Glance => Information::default(),
            Effort::Full => self.information(&residuals),
        };
        let free = self.free.len();
        let covariance = match effort {
            Effort::Glance => None,
            Effort::Full => information.covariance(),
        };
        let standard_errors = self
            .coordinates
            .iter()
            .enumerate()
            .map(|(column, coordinate)| {
                let slope = coordinate.slope(self.position[column]).abs();
                covariance.as_ref().map_or(f64::INFINITY, |covariance| {
                    slope * covariance[(column, column)].max(0.0).sqrt()
                })
            })
            .collect();
        let model = self.model();
        let starts = (0..self.runs.len())
            .map(|index| self.start(index))
            .collect();
        Fit {
            model,
            free: self.free,
            starts,
            residuals,
            standard_errors,
            converged,
            moving: self.own.iter().flatten().count(),
            information,
            coordinates: self.coordinates,
            position: self.position.iter().take(free).copied().collect(),
        }
    }

    /// What each recording says about the free parameters.
    fn information(&self, residuals: &[Vec<f64>]) -> Information {
        let unknowns = self.free.len();
        if unknowns == 0 {
            return Information::default();
        }
        let jacobian = self.exact_jacobian();
        if !jacobian.iter().all(|entry| entry.is_finite()) {
            return Information::default();
        }
        let mut first = 0;
        let blocks: Vec<(DMatrix<f64>, DMatrix<f64>)> = residuals
            .iter()
            .zip(&self.own)
            .map(|(residual, own)| {
                let rows = jacobian.rows(first, residual.len());
                first += residual.len();
                let start = own.map_or_else(
                    || DMatrix::zeros(residual.len(), 0),
                    |column| rows.columns(column.get() - 1, 2).into_owned(),
                );
                (rows.columns(0, unknowns).into_owned(), start)
            })
            .collect();
        Information::collect(
            unknowns,
            blocks
                .iter()
                .zip(residuals)
                .map(|((parameters, start), residual)| Block {
                    parameters,
                    start,
                    residual,
                }),
            correlation_time(residuals),
        )
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_, '_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, position: &DVector<f64>) {
        self.position.copy_from(position);
    }

    fn params(&self) -> DVector<f64> {
        self.position.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        let residuals: Vec<f64> = self.residual_series().into_iter().flatten().collect();
        residuals
            .iter()
            .all(|residual| residual.is_finite())
            .then(|| DVector::from_vec(residuals))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let jacobian = self.exact_jacobian();
        jacobian
            .iter()
            .all(|entry| entry.is_finite())
            .then_some(jacobian)
    }
}

/// The quantile of Student's distribution between whose two values 95 % lie.
fn student95(degrees_of_freedom: usize) -> f64 {
    StudentsT::new(0.0, 1.0, degrees_of_freedom.max(1) as f64)
        .map_or(f64::INFINITY, |student| student.inverse_cdf(0.975))
}

/// RMS of each recording's residual (rad), in order.
pub fn rms_each(fit: &Fit) -> Vec<f64> {
    fit.residuals.iter().map(|residual| rms(residual)).collect()
}
