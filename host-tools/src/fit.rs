//! Output-error fits: the parameters whose simulation is nearest to what was
//! measured.
//!
//! The model is *simulated* over each recording and compared with the measured
//! angle; nothing is differentiated in time, so noise is not amplified. The
//! derivatives of every simulated sample come exactly from dual numbers that
//! run through the shared core ([`crate::dual`]), and a library solves the
//! least-squares problem (Levenberg–Marquardt, the MINPACK algorithm).
//!
//! Each session brings unknowns of its own, the zeros of its sensors and its
//! start ([`crate::estimate::nuisance`]); they are found in the same fit.

use std::ops::Range;

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use model_core::actuator::{Model, ParameterId};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};
use rayon::prelude::*;
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::checkpoint::{Checkpoint, fingerprint};
use crate::dual::Dual;
use crate::estimate::nuisance::{Nuisance, Shared, UNKNOWNS, ZEROS, wall};
use crate::estimate::{Dataset, Session};
use crate::information::{Block, Information};
use crate::simulate::{Origin, Start, run_from};
use crate::statistics::{correlation_time, rms};

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
    /// Zeros and start of each session; guesses where nothing of it was fitted.
    pub nuisances: Vec<Nuisance>,
    /// What zeros and starts cost, each in turn: the squares of their departures from
    /// what was known before, in standard deviations, summed over the sessions.
    departures: [f64; UNKNOWNS],
    /// Simulated minus measured angle (rad), a series a fitted segment.
    pub residuals: Vec<Vec<f64>>,
    /// Standard error of each free parameter, in SI units; infinite for a
    /// parameter that the recordings do not determine.
    pub standard_errors: Vec<f64>,
    /// Whether the solver met its tolerance.
    pub converged: bool,
    /// What each segment says about the free parameters; empty after a
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
    /// What zeros and starts cost: twice the logarithm of how improbable they are,
    /// less that of the most probable ones.
    pub fn departure(&self) -> f64 {
        self.departures.iter().sum()
    }

    /// What the zeros of the sensors cost, as a part of [`Fit::departure`].
    pub fn departure_of_zeros(&self) -> f64 {
        let [pressure, angle, ..] = self.departures;
        pressure + angle
    }

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

    /// RMS residual (rad).
    pub fn rmse(&self) -> f64 {
        (self.sse() / self.samples().max(1) as f64).sqrt()
    }

    /// How many correlated samples count as one.
    pub fn correlation_time(&self) -> f64 {
        correlation_time(&self.residuals)
    }

    /// The model as it would have been fitted without the segments at the places
    /// in `left_out`, to second order; none where that cannot be trusted.
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
    /// Until another step would change the sum of squares by a hundred-thousandth: far
    /// below what any test of significance can see.
    Full,
}

impl Effort {
    /// The solver for so many unknowns.
    fn solver(self, unknowns: usize) -> LevenbergMarquardt<f64> {
        /// Evaluations after which a fit that still moves is left: its valley is so
        /// flat that where it ends does not matter.
        const GLANCES: usize = 25;
        const MOST: usize = 120;
        // The library counts in units of the unknowns.
        let patience = |evaluations: usize| evaluations.div_ceil(unknowns + 1).max(1);
        let solver = LevenbergMarquardt::new().with_gtol(0.0);
        // The step bound is the first step relative to the size of the
        // coordinates. The solver's default of 100 leaps over the valley that
        // a start was chosen for.
        match self {
            Self::Glance => solver
                .with_stepbound(1.0)
                .with_patience(patience(GLANCES))
                .with_ftol(1e-3)
                .with_xtol(1e-3),
            Self::Full => solver
                .with_stepbound(0.1)
                .with_patience(patience(MOST))
                .with_ftol(1e-5)
                .with_xtol(1e-5),
        }
    }
}

/// Fits models to data.
#[derive(Clone, Copy, Debug)]
pub struct Fitter<'a> {
    /// The model before any fit, around which base parameters are searched.
    pub nominal: &'a Model<f64>,
    /// The sessions and their segments.
    pub data: &'a Dataset,
}

impl Fitter<'_> {
    /// Fits the parameters in `free`, starting from their values in `start`.
    ///
    /// With nothing free it estimates only zeros and starts: a plain comparison.
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
        let mut problem = Problem::new(self, start, free, Compared::Fitted);
        let key = if checkpoint.is_used() {
            self.fingerprint(start, free, effort)
        } else {
            0
        };
        if let Some(ended) = checkpoint.recall(key)
            && ended.position.len() == problem.unknowns()
        {
            problem.set_params(&DVector::from_column_slice(&ended.position));
            return problem.finish(ended.converged, effort);
        }
        let (problem, converged) = problem.solved(effort);
        if problem.unknowns() > 0 {
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

    /// Tells fits apart: by data, model, start, free parameters, effort and
    /// version.
    fn fingerprint(&self, start: &Model<f64>, free: &[ParameterId], effort: Effort) -> u64 {
        let version = env!("CARGO_PKG_VERSION");
        let text = format!("{version} {:?} {start:?} {free:?} {effort:?}", self.nominal);
        let sessions = self.data.sessions();
        let samples = sessions.iter().enumerate().flat_map(|(index, session)| {
            let recording = session.recording();
            let guess = session.guess();
            let own = [
                guess.pressure_zero,
                guess.angle_zero,
                guess.start.angle,
                guess.start.rate,
                session.prior().deviation.pressure_zero,
                session.prior().deviation.angle_zero,
                session.clock(),
                f64::from(u8::from(session.is_estimated())),
            ];
            let ranges = self.data.fitted_ranges(index);
            recording
                .time
                .iter()
                .chain(session.signal().values())
                .chain(&recording.angle)
                .copied()
                .chain(own)
                .chain(
                    ranges
                        .into_iter()
                        .flat_map(|range| [range.start as f64, range.end as f64]),
                )
                .flat_map(f64::to_le_bytes)
        });
        fingerprint(text.into_bytes().into_iter().chain(samples))
    }

    /// Simulates a model over the segments that are held out: zeros and start are
    /// those of the fitted segments of the same session, or if there are none,
    /// those that suit the session best. Series in the order of
    /// [`Dataset::held_out`].
    pub fn validate(&self, model: &Model<f64>) -> Validation {
        let (problem, _) =
            Problem::new(self, model, &[], Compared::Validated).solved(Effort::Glance);
        Validation {
            residuals: problem.residual_series(false),
            nuisances: problem.nuisances(),
        }
    }

    /// Widens the standard errors of a fit by what is not known about parameters
    /// that it held.
    pub fn allow_for(&self, fit: &mut Fit, held: &[ParameterId]) {
        // From the edge of a range the derivatives of the fit lie elsewhere.
        if (0..fit.free.len()).any(|index| fit.at_bound(index)) {
            return;
        }
        let free = [fit.free.as_slice(), held].concat();
        let wider = Problem::new(self, &fit.model, &free, Compared::Fitted)
            .with_nuisances(&fit.nuisances)
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
    /// other recordings, in the coordinates in which that was solved, without
    /// what zeros and starts can follow. A row a fitted sample.
    pub fn derivatives(&self, fit: &Fit) -> DMatrix<f64> {
        let mut problem = Problem::new(self, &fit.model, &fit.free, Compared::Fitted);
        problem.coordinates.clone_from(&fit.coordinates);
        for (to, from) in problem.position.iter_mut().zip(&fit.position) {
            *to = *from;
        }
        let problem = problem.with_nuisances(&fit.nuisances);
        let blocks = problem.projected();
        let free = fit.free.len();
        let rows = blocks.iter().map(|(block, _)| block.nrows()).sum();
        let mut all = DMatrix::zeros(rows, free);
        let mut first = 0;
        for (block, _) in &blocks {
            all.rows_mut(first, block.nrows()).copy_from(block);
            first += block.nrows();
        }
        all
    }

    /// The sum of squares (rad²) that one Gauss–Newton step from `start` promises:
    /// a score test at the price of a single simulation with derivatives. Not
    /// finite where the model cannot be simulated.
    pub fn promise(&self, start: &Model<f64>, free: &[ParameterId]) -> f64 {
        let problem = Problem::new(self, start, free, Compared::Fitted);
        let (Some(residuals), Some(jacobian)) = (problem.residuals(), problem.jacobian()) else {
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

    /// Residuals (rad) of a model at every fitted sample, and their derivatives in
    /// the coordinates in which the solver moves: the parameters in `free`, then
    /// zeros and starts of the sessions, about `nuisances`. None where it cannot
    /// be simulated.
    pub fn linearised(
        &self,
        model: &Model<f64>,
        free: &[ParameterId],
        nuisances: &[Nuisance],
    ) -> Option<(DVector<f64>, DMatrix<f64>)> {
        Problem::new(self, model, free, Compared::Fitted)
            .with_nuisances(nuisances)
            .dense()
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

/// What a model made of the segments that were held out.
#[derive(Clone, Debug)]
pub struct Validation {
    /// Simulated minus measured angle (rad), a series a held-out segment.
    pub residuals: Vec<Vec<f64>>,
    /// Zeros and start of each session.
    pub nuisances: Vec<Nuisance>,
}

/// Which samples of a session are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Compared {
    /// Those that are fitted; sessions without any take no part.
    Fitted,
    /// Only sessions that hold something out: their fitted samples, or all if
    /// there are none.
    Validated,
}

/// A session as it takes part in a problem.
struct Part<'a> {
    session: &'a Session,
    /// Its index in the data.
    index: usize,
    /// The samples that are compared.
    ranges: Vec<Range<usize>>,
    /// Column of its first own unknown; none if zeros and start are known.
    own: Option<usize>,
}

impl Part<'_> {
    /// Whether a zero is in part that of a whole sitting.
    fn shares(&self, unknown: usize) -> bool {
        self.own.is_some() && self.session.prior().apart[unknown].is_some()
    }

    /// What keeps a zero in its range: see [`wall`]. A start has no such range.
    fn wall(&self, unknown: usize, departure: f64) -> [f64; 2] {
        if ZEROS.contains(&unknown) {
            wall(departure)
        } else {
            [0.0, 0.0]
        }
    }

    fn rows(&self) -> usize {
        self.ranges.iter().map(ExactSizeIterator::len).sum()
    }
}

/// What the zeros of the sessions of one sitting have in common; none if there is
/// no such session.
fn shared(parts: &[Part<'_>], unknown: usize) -> Option<Shared> {
    let sitting: Vec<&Part<'_>> = parts.iter().filter(|part| part.shares(unknown)).collect();
    let prior = sitting.first()?.session.prior();
    let apart = prior.apart[unknown]?;
    let deviation = prior.deviations()[unknown];
    Some(Shared::new(sitting.len(), apart / deviation))
}

/// Residuals of one session and their derivatives by the free parameters and by
/// its own unknowns, a row a compared sample.
struct Linear {
    jacobian: DMatrix<f64>,
    residual: DVector<f64>,
}

/// The least-squares problem in the solver's coordinates: the free parameters,
/// then zeros and start of every session.
///
/// A session has thousands of samples and a dozen unknowns. What the solver needs
/// of it is the triangle of a QR decomposition of its derivatives and residuals,
/// which has the same normal equations and the same sum of squares; it is found
/// whenever the position moves, with one simulation on dual numbers.
struct Problem<'a> {
    model: Model<f64>,
    data: &'a Dataset,
    free: Vec<ParameterId>,
    coordinates: Vec<Coordinate>,
    parts: Vec<Part<'a>>,
    /// Of each unknown of a session, what those of one sitting have in common.
    shared: [Option<Shared>; UNKNOWNS],
    position: DVector<f64>,
    /// The triangle of each part at `position`: derivatives, residuals last. None
    /// where the model cannot be simulated.
    triangles: Option<Vec<DMatrix<f64>>>,
}

impl<'a> Problem<'a> {
    fn new(
        fitter: &Fitter<'a>,
        model: &Model<f64>,
        free: &[ParameterId],
        compared: Compared,
    ) -> Self {
        let data = fitter.data;
        let coordinates: Vec<Coordinate> = free
            .iter()
            .map(|&id| Coordinate::of(fitter.nominal, model, id))
            .collect();
        let mut position: Vec<f64> = free
            .iter()
            .zip(&coordinates)
            .map(|(&id, coordinate)| coordinate.position(model.value(id).unwrap_or(0.0)))
            .collect();
        let mut parts = Vec::new();
        for (index, session) in data.sessions().iter().enumerate() {
            let mut ranges = data.fitted_ranges(index);
            if compared == Compared::Validated {
                let held_out = data.ranges(index, false);
                if held_out.is_empty() {
                    continue;
                }
                if ranges.is_empty() {
                    ranges = held_out;
                }
            }
            if ranges.is_empty() {
                continue;
            }
            let own = session.is_estimated().then(|| {
                position.extend(session.prior().departures(&session.guess()));
                position.len() - UNKNOWNS
            });
            parts.push(Part {
                session,
                index,
                ranges,
                own,
            });
        }
        let mut this = Self {
            model: *model,
            data,
            free: free.to_vec(),
            coordinates,
            shared: std::array::from_fn(|unknown| shared(&parts, unknown)),
            parts,
            position: DVector::from_vec(position),
            triangles: None,
        };
        this.triangles = this.triangulated();
        this
    }

    /// The same with zeros and starts as given, one set a session.
    fn with_nuisances(mut self, nuisances: &[Nuisance]) -> Self {
        for part in &self.parts {
            if let (Some(first), Some(nuisance)) = (part.own, nuisances.get(part.index)) {
                let position = part.session.prior().departures(nuisance);
                for (offset, value) in position.into_iter().enumerate() {
                    self.position[first + offset] = value;
                }
            }
        }
        self.triangles = self.triangulated();
        self
    }

    /// Lets the solver find the position; whether it met its tolerance.
    fn solved(self, effort: Effort) -> (Self, bool) {
        if self.unknowns() == 0 {
            return (self, true);
        }
        let mut solver = effort.solver(self.unknowns());
        if self.free.is_empty() {
            // Zeros and starts alone are nearly linear: full steps.
            solver = solver.with_stepbound(100.0);
        }
        let (solved, report) = solver.minimize(self);
        (solved, report.termination.was_successful())
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

    fn own_position(&self, first: usize) -> [f64; UNKNOWNS] {
        std::array::from_fn(|offset| self.position[first + offset])
    }

    fn nuisance(&self, part: &Part<'_>) -> Nuisance {
        match part.own {
            Some(first) => part.session.prior().at(self.own_position(first)),
            None => part.session.guess(),
        }
    }

    /// Zeros and start of every session of the data.
    fn nuisances(&self) -> Vec<Nuisance> {
        let mut all: Vec<Nuisance> = self
            .data
            .sessions()
            .iter()
            .map(|session| session.guess())
            .collect();
        for part in &self.parts {
            all[part.index] = self.nuisance(part);
        }
        all
    }

    /// What was known before about the unknowns of each session, as residuals
    /// (rad): departures in standard deviations times the noise of the angle. None
    /// for a session whose zeros and start are known.
    fn prior_rows(&self) -> Vec<Option<[f64; UNKNOWNS]>> {
        let own: Vec<Option<[f64; UNKNOWNS]>> = self
            .parts
            .iter()
            .map(|part| {
                let departures = |_| part.session.prior().departures(&self.nuisance(part));
                part.own.map(departures)
            })
            .collect();
        let means: [f64; UNKNOWNS] = std::array::from_fn(|unknown| {
            let zeros: Vec<f64> = self
                .parts
                .iter()
                .zip(&own)
                .filter(|(part, _)| part.shares(unknown))
                .filter_map(|(_, own)| Some((*own)?[unknown]))
                .collect();
            crate::statistics::mean(&zeros)
        });
        self.parts
            .iter()
            .zip(own)
            .map(|(part, own)| {
                let own = own?;
                Some(std::array::from_fn(|unknown| {
                    let residual = match self.shared[unknown] {
                        Some(shared) if part.shares(unknown) => {
                            shared.residual(own[unknown], means[unknown])
                        }
                        _ => own[unknown],
                    };
                    let [wall, _] = part.wall(unknown, own[unknown]);
                    part.session.prior().noise * (residual + wall)
                }))
            })
            .collect()
    }

    /// The derivative of the row of one session's unknown by the same unknown of
    /// another, or of itself, in the solver's coordinates.
    fn prior_slope(&self, of: &Part<'_>, by: &Part<'_>, unknown: usize) -> f64 {
        let Some(first) = of.own else {
            return 0.0;
        };
        let (by_itself, by_other) = match self.shared[unknown] {
            Some(shared) if of.shares(unknown) && by.shares(unknown) => shared.slopes().into(),
            _ => (1.0, 0.0),
        };
        let slope = if of.index == by.index {
            let [_, wall] = of.wall(unknown, self.position[first + unknown]);
            by_itself + wall
        } else {
            by_other
        };
        of.session.prior().noise * slope
    }

    /// Derivatives of the rows of a session's own unknowns by themselves, as if it
    /// were alone.
    fn prior_slopes(&self, part: &Part<'_>) -> [f64; UNKNOWNS] {
        let Some(first) = part.own else {
            return [0.0; UNKNOWNS];
        };
        std::array::from_fn(|unknown| {
            let [_, wall] = part.wall(unknown, self.position[first + unknown]);
            part.session.prior().noise * (1.0 + wall)
        })
    }

    /// Residuals of the segments that are fitted, or of those held out; only of
    /// sessions that take part.
    fn residual_series(&self, fitted: bool) -> Vec<Vec<f64>> {
        let model = self.model();
        let series: Vec<Vec<Vec<f64>>> = self
            .parts
            .par_iter()
            .map(|part| {
                let simulated = part.session.simulate(&model, &self.nuisance(part));
                let residual = part.session.residual_of(&simulated);
                self.data
                    .ranges(part.index, fitted)
                    .into_iter()
                    .map(|range| residual[range].to_vec())
                    .collect()
            })
            .collect();
        series.into_iter().flatten().collect()
    }

    /// One session on dual numbers with `N` derivatives: at least the free
    /// parameters, the pressure's zero and the start.
    fn linear<const N: usize>(&self, model: &Model<f64>, part: &Part<'_>) -> Linear {
        let session = part.session;
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
        let free = self.free.len();
        let nuisance = self.nuisance(part);
        let unknown = |value: f64, column: usize| match part.own {
            Some(_) => Dual::variable(value, free + column, 1.0),
            None => Dual::constant(value),
        };
        let origin = Origin {
            start: Start {
                angle: unknown(nuisance.start.angle - nuisance.angle_zero, 1),
                rate: unknown(nuisance.start.rate, 2),
            },
            pressure_zero: unknown(nuisance.pressure_zero, 0),
            clock: Dual::constant(session.clock()),
        };
        let steps = session.substeps(model);
        let reading = run_from(&dual, session.signal(), origin, steps).reading;
        let columns = free + if part.own.is_some() { UNKNOWNS } else { 0 };
        let slopes = session.prior().deviations();
        let mut jacobian = DMatrix::zeros(part.rows(), columns);
        let mut residual = DVector::zeros(part.rows());
        let measured = &session.recording().angle;
        let silent = |sample: usize| session.silent().iter().any(|range| range.contains(&sample));
        for (row, sample) in part.ranges.iter().cloned().flatten().enumerate() {
            if silent(sample) {
                continue;
            }
            let partials = reading[sample].partials();
            residual[row] = reading[sample].value() + nuisance.angle_zero - measured[sample];
            for column in 0..free {
                jacobian[(row, column)] = partials[column];
            }
            if part.own.is_some() {
                let by_start = partials[free + 1];
                // The zero of the angle moves the reading, and the start behind it.
                let own = [partials[free], 1.0 - by_start, by_start, partials[free + 2]];
                for (column, (by, slope)) in own.into_iter().zip(slopes).enumerate() {
                    jacobian[(row, free + column)] = by * slope;
                }
            }
        }
        Linear { jacobian, residual }
    }

    /// Every session, with the derivatives carried in arrays of a size that
    /// suffices.
    fn linears(&self) -> Vec<Linear> {
        let model = self.model();
        self.parts
            .par_iter()
            .map(|part| match self.free.len() + 3 {
                0..=4 => self.linear::<4>(&model, part),
                5..=6 => self.linear::<6>(&model, part),
                7..=8 => self.linear::<8>(&model, part),
                9..=12 => self.linear::<12>(&model, part),
                // Five base parameters and three effects of four each.
                _ => self.linear::<20>(&model, part),
            })
            .collect()
    }

    fn triangulated(&self) -> Option<Vec<DMatrix<f64>>> {
        self.linears()
            .into_par_iter()
            .map(|Linear { jacobian, residual }| {
                let columns = jacobian.ncols();
                let mut both = jacobian.resize_horizontally(columns + 1, 0.0);
                both.set_column(columns, &residual);
                both.iter()
                    .all(|entry| entry.is_finite())
                    .then(|| both.qr().r())
            })
            .collect()
    }

    /// The residuals and derivatives of all fitted samples.
    fn dense(&self) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let linears = self.linears();
        let rows = linears.iter().map(|linear| linear.residual.len()).sum();
        let free = self.free.len();
        let mut residuals = DVector::zeros(rows);
        let mut jacobian = DMatrix::zeros(rows, self.unknowns());
        let mut first = 0;
        for (linear, part) in linears.iter().zip(&self.parts) {
            let height = linear.residual.len();
            residuals
                .rows_mut(first, height)
                .copy_from(&linear.residual);
            jacobian
                .view_mut((first, 0), (height, free))
                .copy_from(&linear.jacobian.columns(0, free));
            if let Some(own) = part.own {
                jacobian
                    .view_mut((first, own), (height, UNKNOWNS))
                    .copy_from(&linear.jacobian.columns(free, UNKNOWNS));
            }
            first += height;
        }
        let finite = |entry: &f64| entry.is_finite();
        (residuals.iter().all(finite) && jacobian.iter().all(finite))
            .then_some((residuals, jacobian))
    }

    /// Of each session, the derivatives by the free parameters without what its
    /// zeros and start can follow, and the residuals.
    fn projected(&self) -> Vec<(DMatrix<f64>, DVector<f64>)> {
        let free = self.free.len();
        self.linears()
            .into_iter()
            .zip(&self.parts)
            .map(|(linear, part)| {
                let parameters = linear.jacobian.columns(0, free).into_owned();
                if part.own.is_none() {
                    return (parameters, linear.residual);
                }
                let own = linear.jacobian.columns(free, UNKNOWNS).into_owned();
                let known = self.prior_slopes(part);
                (
                    crate::information::without_nuisance(&parameters, &own, &known),
                    linear.residual,
                )
            })
            .collect()
    }

    fn finish(self, converged: bool, effort: Effort) -> Fit {
        let residuals = self.residual_series(true);
        let information = match effort {
            Effort::Glance => Information::default(),
            Effort::Full => self.information(&residuals),
        };
        let free = self.free.len();
        let covariance = match effort {
            // Where a derivative is not finite, nothing is known.
            Effort::Full if information.unknowns() == free => information.covariance(),
            _ => None,
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
        let mut departures = [0.0; UNKNOWNS];
        for (part, rows) in self.parts.iter().zip(self.prior_rows()) {
            for (sum, row) in departures.iter_mut().zip(rows.unwrap_or_default()) {
                *sum += (row / part.session.prior().noise).powi(2);
            }
        }
        Fit {
            model: self.model(),
            nuisances: self.nuisances(),
            departures,
            free: self.free,
            residuals,
            standard_errors,
            converged,
            information,
            coordinates: self.coordinates,
            position: self.position.iter().take(free).copied().collect(),
        }
    }

    /// What each fitted segment says about the free parameters.
    fn information(&self, residuals: &[Vec<f64>]) -> Information {
        let unknowns = self.free.len();
        if unknowns == 0 {
            return Information::default();
        }
        let projected = self.projected();
        if !projected
            .iter()
            .all(|(block, _)| block.iter().all(|entry| entry.is_finite()))
        {
            return Information::default();
        }
        let mut blocks = Vec::new();
        for ((parameters, residual), part) in projected.iter().zip(&self.parts) {
            let mut first = 0;
            for range in &part.ranges {
                let rows = range.len();
                blocks.push(Block {
                    parameters: parameters.rows(first, rows).into_owned(),
                    residual: residual.rows(first, rows).into_owned(),
                });
                first += rows;
            }
        }
        Information::collect(unknowns, &blocks, correlation_time(residuals))
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, position: &DVector<f64>) {
        self.position.copy_from(position);
        self.triangles = self.triangulated();
    }

    fn params(&self) -> DVector<f64> {
        self.position.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        let mut all = Vec::new();
        for (triangle, rows) in self.triangles.as_ref()?.iter().zip(self.prior_rows()) {
            all.extend(triangle.column(triangle.ncols() - 1).iter());
            all.extend(rows.into_iter().flatten());
        }
        Some(DVector::from_vec(all))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let triangles = self.triangles.as_ref()?;
        let free = self.free.len();
        let own_rows = |part: &Part<'_>| if part.own.is_some() { UNKNOWNS } else { 0 };
        let rows = triangles
            .iter()
            .zip(&self.parts)
            .map(|(triangle, part)| triangle.nrows() + own_rows(part))
            .sum();
        let mut jacobian = DMatrix::zeros(rows, self.unknowns());
        let mut first = 0;
        for (triangle, part) in triangles.iter().zip(&self.parts) {
            let height = triangle.nrows();
            jacobian
                .view_mut((first, 0), (height, free))
                .copy_from(&triangle.columns(0, free));
            first += height;
            let Some(own) = part.own else { continue };
            jacobian
                .view_mut((first - height, own), (height, UNKNOWNS))
                .copy_from(&triangle.columns(free, UNKNOWNS));
            for by in &self.parts {
                let Some(column) = by.own else { continue };
                for unknown in 0..UNKNOWNS {
                    jacobian[(first + unknown, column + unknown)] =
                        self.prior_slope(part, by, unknown);
                }
            }
            first += UNKNOWNS;
        }
        Some(jacobian)
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
