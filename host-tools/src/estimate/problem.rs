//! The least-squares problem behind every fit.
//!
//! It turns sessions into residuals and derivatives, adds the priors of their zeros and
//! initial states, and hands both to the library's solver. [`super::fit`] uses it.

use std::ops::Range;

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use model_core::actuator::{Model, ParameterId};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::filter::{Innovation, Level, normalised, pass};
use super::fit::{Effort, Fit, Fitter};
use super::information::{Information, Recorded, without_nuisance};
use super::normal::{Normal, SharedRow};
use super::nuisance::{Nuisance, Prior, Shared, UNKNOWNS, ZEROS, wall};
use super::transform::ParameterTransform;
use super::{Dataset, Session};
use crate::sim::dual::Dual;
use crate::sim::simulate::{InitialState, Origin, run_from};
use crate::statistics::{correlation_time, mean};

/// Number of sessions from which the library's dense decomposition, cubic in their number,
/// costs more than simulating them.
const MANY_SESSIONS: usize = 32;

/// Relative gain of a step below which a short fit, or a fit to many sessions, is done:
/// the error changes by half of it.
const SLOW: f64 = 1e-4;

impl Effort {
    /// Most evaluations of a fit, and the relative gain below which it is done. A fit that
    /// still moves after so many evaluations is in a valley so flat that its end does not
    /// matter.
    fn patience(self) -> (usize, f64) {
        match self {
            Self::Steps(_) | Self::Coarse => (25, 1e-3),
            Self::Full => (120, 1e-5),
        }
    }

    /// The solver for `unknowns` unknowns, by which the library counts evaluations.
    fn solver(self, unknowns: usize) -> LevenbergMarquardt<f64> {
        let (evaluations, tolerance) = self.patience();
        let solver = LevenbergMarquardt::new().with_gtol(0.0);
        // The step bound is the first step relative to the size of the
        // coordinates. The solver's default of 100 leaps over the valley that
        // a start was chosen for.
        match self {
            Self::Steps(_) | Self::Coarse => solver.with_stepbound(1.0),
            Self::Full => solver.with_stepbound(0.1),
        }
        .with_patience(evaluations.div_ceil(unknowns + 1).max(1))
        .with_ftol(tolerance)
        .with_xtol(tolerance)
    }
}

/// Which samples of a session are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compared {
    /// Fitted samples; sessions without any take no part.
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

    fn rows(&self) -> usize {
        self.ranges.iter().map(ExactSizeIterator::len).sum()
    }
}

/// The soft bound of a zero, see [`wall`]. An initial state has none.
fn wall_of(unknown: usize, departure: f64, samples: usize) -> [f64; 2] {
    if ZEROS.contains(&unknown) {
        wall(departure, samples)
    } else {
        [0.0, 0.0]
    }
}

/// The common zero of the sessions of one sitting; none if there is no such session.
fn shared(parts: &[Part<'_>], unknown: usize) -> Option<Shared> {
    let sitting: Vec<&Part<'_>> = parts.iter().filter(|part| part.shares(unknown)).collect();
    let prior = sitting.first()?.session.prior();
    let apart = prior.apart[unknown]?;
    let deviation = prior.deviations()[unknown];
    Some(Shared::new(sitting.len(), apart / deviation))
}

/// Residuals of one session and their derivatives by the free parameters and by
/// its own unknowns, one row per compared sample.
struct Linear {
    jacobian: DMatrix<f64>,
    residual: DVector<f64>,
    /// Sum of ln S over the rows; zero for a simulation.
    log_variance: f64,
}

/// The least-squares problem in the solver's coordinates: the free parameters,
/// then zeros and initial state of every session.
///
/// A session has thousands of samples and a dozen unknowns. The solver only needs the
/// triangle of a QR decomposition of its derivatives and residuals, which has the same
/// normal equations and the same sum of squares. Each change of the position costs one
/// simulation on dual numbers.
pub struct Problem<'a> {
    model: Model<f64>,
    data: &'a Dataset,
    free: Vec<ParameterId>,
    transforms: Vec<ParameterTransform>,
    parts: Vec<Part<'a>>,
    /// For each unknown of a session, its common part within one sitting.
    shared: [Option<Shared>; UNKNOWNS],
    position: DVector<f64>,
    /// The prediction horizon; none for output error.
    level: Option<Level>,
    /// Factor of the prior rows: the geometric mean of √S, as for the innovations.
    scale: f64,
    /// The triangle of each part at `position`: derivatives, residuals last. None
    /// until a solver needs it, and if the model cannot be simulated.
    triangles: Option<Vec<DMatrix<f64>>>,
}

impl<'a> Problem<'a> {
    /// Starts at the parameters of `model` and at the guess of each session.
    pub fn new(
        fitter: &Fitter<'a>,
        model: &Model<f64>,
        free: &[ParameterId],
        compared: Compared,
    ) -> Self {
        let data = fitter.data;
        let transforms: Vec<ParameterTransform> = free
            .iter()
            .map(|&id| ParameterTransform::of(fitter.nominal, model, id))
            .collect();
        let mut position: Vec<f64> = free
            .iter()
            .zip(&transforms)
            .map(|(&id, transform)| transform.position(model.value(id).unwrap_or(0.0)))
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
        Self {
            model: *model,
            data,
            free: free.to_vec(),
            transforms,
            shared: std::array::from_fn(|unknown| shared(&parts, unknown)),
            parts,
            position: DVector::from_vec(position),
            level: None,
            scale: 1.0,
            triangles: None,
        }
    }

    /// The same problem at a level of the prediction horizon; none for output error.
    pub fn at_level(mut self, level: Option<&Level>) -> Self {
        self.level = level.copied();
        self
    }

    /// The same problem at the given zeros and initial states, one set per session.
    pub fn with_nuisances(mut self, nuisances: &[Nuisance]) -> Self {
        for part in &self.parts {
            if let (Some(first), Some(nuisance)) = (part.own, nuisances.get(part.index)) {
                let position = part.session.prior().departures(nuisance);
                for (offset, value) in position.into_iter().enumerate() {
                    self.position[first + offset] = value;
                }
            }
        }
        self
    }

    /// The same problem at a final position of the solver.
    pub fn at(mut self, position: &[f64]) -> Self {
        self.position.copy_from_slice(position);
        self
    }

    /// The same problem with the parameter transforms, and at the position, of another
    /// fit.
    pub fn with_transforms(mut self, transforms: &[ParameterTransform], position: &[f64]) -> Self {
        self.transforms = transforms.to_vec();
        for (to, from) in self.position.iter_mut().zip(position) {
            *to = *from;
        }
        self
    }

    /// The unknowns, in the solver's coordinates.
    pub fn position(&self) -> &[f64] {
        self.position.as_slice()
    }

    /// The predicted sum of squares (rad²) after one Gauss–Newton step.
    pub fn predicted_sse(mut self) -> f64 {
        /// A column without influence must not make the matrix singular.
        const RIDGE: f64 = 1e-9;
        self.triangulate();
        let Some(normal) = self.normal() else {
            return f64::INFINITY;
        };
        let gain = normal
            .step(RIDGE)
            .map_or(0.0, |step| normal.slope().dot(&step));
        normal.cost() - gain
    }

    /// Lets the solver find the position; whether it met its tolerance.
    pub fn solved(mut self, effort: Effort) -> (Self, bool) {
        if self.unknowns() == 0 {
            return (self, true);
        }
        if let Effort::Steps(steps) = effort {
            return (self.descended(steps, SLOW).0, false);
        }
        let sessions = self.parts.iter().filter(|part| part.own.is_some()).count();
        if sessions > MANY_SESSIONS {
            let (evaluations, tolerance) = effort.patience();
            return self.descended(evaluations, tolerance.max(SLOW));
        }
        self.triangulate();
        let mut solver = effort.solver(self.unknowns());
        if self.free.is_empty() {
            // Zeros and initial states alone are nearly linear: full steps.
            solver = solver.with_stepbound(100.0);
        }
        let (solved, report) = solver.minimize(self);
        (solved, report.termination.was_successful())
    }

    /// Makes at most `steps` damped Gauss–Newton steps (Levenberg, 1944), until one gains
    /// less than the share `tolerance` of the cost; also returns whether that was reached.
    /// The library's solver cannot be stopped after a few steps, since it counts
    /// evaluations by the number of unknowns, and it is cubic in the number of sessions.
    fn descended(mut self, steps: usize, tolerance: f64) -> (Self, bool) {
        /// Damping of the first step, relative to the curvature.
        const FIRST: f64 = 1e-3;
        /// Factors of the damping after a good step, and after a bad one.
        const CALMER: f64 = 0.1;
        const STRONGER: f64 = 10.0;
        self.triangulate();
        let mut damping = FIRST;
        let Some(mut normal) = self.normal() else {
            return (self, false);
        };
        for _ in 0..steps {
            let Some(step) = normal.step(damping) else {
                break;
            };
            let cost = normal.cost();
            let predicted = normal.slope().dot(&step);
            let before = self.position.clone();
            self.position -= step;
            self.triangulate();
            let moved = self.normal();
            let gain = moved.as_ref().map_or(f64::NAN, |it| cost - it.cost());
            // If predicted and actual reduction are both negligible, no further step helps.
            let is_done = gain.abs().max(predicted) < tolerance * cost;
            if let Some(better) = moved.filter(|_| gain > 0.0) {
                normal = better;
                damping *= CALMER;
                if gain < tolerance * cost {
                    return (self, true);
                }
            } else {
                self.position = before;
                damping *= STRONGER;
                if is_done {
                    self.triangulate();
                    return (self, true);
                }
            }
        }
        (self, false)
    }

    /// The normal equations at this position; none if the model cannot be simulated.
    fn normal(&self) -> Option<Normal> {
        let mut normal = Normal::new(self.free.len(), self.unknowns());
        let priors = self.prior_rows();
        for ((triangle, part), rows) in self
            .triangles
            .as_ref()?
            .iter()
            .zip(&self.parts)
            .zip(&priors)
        {
            let alone = std::array::from_fn(|unknown| {
                let row = (*rows)?[unknown];
                (!part.shares(unknown)).then(|| [self.prior_slope(part, part, unknown), row])
            });
            normal.session(triangle, part.own, alone);
        }
        for unknown in 0..UNKNOWNS {
            let sharing: Vec<SharedRow> = self
                .parts
                .iter()
                .zip(&priors)
                .filter(|(part, _)| part.shares(unknown))
                .filter_map(|(part, rows)| {
                    let whole = self.prior_slope(part, part, unknown);
                    let by_sum = self.mean_slope(part, unknown);
                    Some(SharedRow {
                        place: part.own? + unknown,
                        by_itself: whole - by_sum,
                        by_sum,
                        residual: (*rows)?[unknown],
                    })
                })
                .collect();
            if !sharing.is_empty() {
                normal.mean(&sharing);
            }
        }
        Some(normal)
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.position.len()
    }

    fn model(&self) -> Model<f64> {
        let mut model = self.model;
        for ((&id, transform), &u) in self.free.iter().zip(&self.transforms).zip(&self.position) {
            model = model.with_value(id, transform.to_value(u));
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

    /// Zeros and initial state of every session of the data.
    pub fn nuisances(&self) -> Vec<Nuisance> {
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

    /// Prior residuals (rad) of each session's unknowns: departures in standard
    /// deviations times the noise of the angle. None for a session whose zeros and initial
    /// state are known.
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
            mean(&zeros)
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
                    let [wall, _] = wall_of(unknown, own[unknown], part.rows());
                    let prior = part.session.prior();
                    self.scale * (self.counts(prior, unknown) * residual + prior.noise * wall)
                }))
            })
            .collect()
    }

    /// Weight (rad) of one standard deviation of an unknown. Innovations are nearly white
    /// at any horizon; the residual of output error is not.
    fn counts(&self, prior: &Prior, unknown: usize) -> f64 {
        if self.level.is_some() {
            prior.noise
        } else {
            prior.scale(unknown)
        }
    }

    /// The derivative of the prior row of one session's unknown by the same unknown of
    /// another session, or of itself, in the solver's coordinates.
    fn prior_slope(&self, of: &Part<'_>, by: &Part<'_>, unknown: usize) -> f64 {
        if of.index != by.index {
            return if by.shares(unknown) {
                self.mean_slope(of, unknown)
            } else {
                0.0
            };
        }
        let Some(first) = of.own else {
            return 0.0;
        };
        let by_itself = match self.shared[unknown] {
            Some(shared) if of.shares(unknown) => shared.slopes()[0],
            _ => 1.0,
        };
        let prior = of.session.prior();
        let [_, wall] = wall_of(unknown, self.position[first + unknown], of.rows());
        self.scale * (self.counts(prior, unknown) * by_itself + prior.noise * wall)
    }

    /// The derivative of the prior row of one session's unknown by the sum of those that
    /// share it.
    fn mean_slope(&self, of: &Part<'_>, unknown: usize) -> f64 {
        match self.shared[unknown] {
            Some(shared) if of.shares(unknown) => {
                self.scale * self.counts(of.session.prior(), unknown) * shared.slopes()[1]
            }
            _ => 0.0,
        }
    }

    /// Derivatives of the prior rows of a session's own unknowns by themselves, as if it
    /// were alone.
    fn prior_slopes(&self, part: &Part<'_>) -> [f64; UNKNOWNS] {
        let Some(first) = part.own else {
            return [0.0; UNKNOWNS];
        };
        std::array::from_fn(|unknown| {
            let [_, wall] = wall_of(unknown, self.position[first + unknown], part.rows());
            let prior = part.session.prior();
            self.scale * (self.counts(prior, unknown) + prior.noise * wall)
        })
    }

    /// Residuals of the fitted or of the held-out segments, of sessions that take part. At
    /// a level they are the normalised innovations after the Huber loss, times the
    /// geometric mean of √S.
    pub fn residual_series(&self, fitted: bool) -> Vec<Vec<f64>> {
        let model = self.model();
        if let (Some(level), true) = (&self.level, fitted) {
            return self.innovation_series(&model, level);
        }
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

    fn innovation_series(&self, model: &Model<f64>, level: &Level) -> Vec<Vec<f64>> {
        let Some((mut series, log_variance)) =
            normalised(model, self.data, &self.nuisances(), level)
        else {
            return vec![vec![f64::INFINITY]];
        };
        let scale = (0.5 * log_variance).exp();
        for value in series.iter_mut().flatten() {
            *value = scale * level.counted(*value)[0];
        }
        series
    }

    /// One session by the filter, with each row divided by √S of its innovation.
    fn filtered<const N: usize>(
        &self,
        model: &Model<Dual<N>>,
        part: &Part<'_>,
        level: &Level,
    ) -> Linear {
        let session = part.session;
        let free = self.free.len();
        let nuisance = self.nuisance(part);
        let zero = match part.own {
            Some(_) => Dual::variable(nuisance.pressure_zero, free, 1.0),
            None => Dual::constant(nuisance.pressure_zero),
        };
        let columns = free + if part.own.is_some() { UNKNOWNS } else { 0 };
        let mut jacobian = DMatrix::zeros(part.rows(), columns);
        let mut residual = DVector::zeros(part.rows());
        let mut log_variance = 0.0;
        let Some(passed) = pass(model, session, &nuisance, zero, level, free + 1) else {
            residual.fill(f64::INFINITY);
            return Linear {
                jacobian,
                residual,
                log_variance,
            };
        };
        let slopes = session.prior().deviations();
        let silent = |sample: usize| session.silent().iter().any(|range| range.contains(&sample));
        for (row, sample) in part.ranges.iter().cloned().flatten().enumerate() {
            let Innovation { error, variance } = passed[sample];
            log_variance += variance.ln();
            if silent(sample) {
                continue;
            }
            let spread = variance.sqrt();
            let [counted, slope] = level.counted(error.value() / spread);
            let partials = error.partials();
            residual[row] = counted;
            for column in 0..free {
                jacobian[(row, column)] = partials[column] * slope / spread;
            }
            if part.own.is_some() {
                // The filter estimates the initial state. The zero of the angle stays at
                // the value of the refit: only the spring would show it.
                jacobian[(row, free)] = partials[free] * slopes[0] * slope / spread;
            }
        }
        Linear {
            jacobian,
            residual,
            log_variance,
        }
    }

    /// One session on dual numbers with `N` derivatives: at least the free
    /// parameters, the pressure zero and the initial state.
    fn linear<const N: usize>(&self, model: &Model<f64>, part: &Part<'_>) -> Linear {
        let session = part.session;
        let mut dual: Model<Dual<N>> = model.map(Dual::constant);
        for (column, ((&id, transform), &u)) in self
            .free
            .iter()
            .zip(&self.transforms)
            .zip(&self.position)
            .enumerate()
        {
            let value = transform.to_value(u);
            dual = dual.with_value(id, Dual::variable(value, column, transform.slope(u)));
        }
        if let Some(level) = &self.level {
            return self.filtered(&dual, part, level);
        }
        let free = self.free.len();
        let nuisance = self.nuisance(part);
        let unknown = |value: f64, column: usize| match part.own {
            Some(_) => Dual::variable(value, free + column, 1.0),
            None => Dual::constant(value),
        };
        let origin = Origin {
            start: InitialState {
                angle: unknown(nuisance.start.angle - nuisance.angle_zero, 1),
                rate: unknown(nuisance.start.rate, 2),
            },
            pressure_zero: unknown(nuisance.pressure_zero, 0),
            clock: Dual::constant(session.clock()),
        };
        let stepping = session.stepping(model);
        let reading = run_from(&dual, session.signal(), origin, stepping).reading;
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
                // The zero of the angle moves the reading and the initial angle.
                let own = [partials[free], 1.0 - by_start, by_start, partials[free + 2]];
                for (column, (by, slope)) in own.into_iter().zip(slopes).enumerate() {
                    jacobian[(row, free + column)] = by * slope;
                }
            }
        }
        Linear {
            jacobian,
            residual,
            log_variance: 0.0,
        }
    }

    /// One session, with the derivatives in the smallest array size that suffices.
    fn linear_of(&self, model: &Model<f64>, part: &Part<'_>) -> Linear {
        match self.free.len() + 3 {
            0..=4 => self.linear::<4>(model, part),
            5..=6 => self.linear::<6>(model, part),
            7..=8 => self.linear::<8>(model, part),
            9..=12 => self.linear::<12>(model, part),
            // Five base parameters and three effects of four each.
            _ => self.linear::<20>(model, part),
        }
    }

    /// The geometric mean of √S over the rows of all sessions, by which innovations are
    /// multiplied; 1 for output error.
    fn scale_of(&self, rows: impl Iterator<Item = (usize, f64)>) -> f64 {
        if self.level.is_none() {
            return 1.0;
        }
        let (rows, sum) = rows.fold((0, 0.0), |(rows, sum), (more, log_variance)| {
            (rows + more, sum + log_variance)
        });
        (0.5 * sum / rows.max(1) as f64).exp()
    }

    /// Every session.
    fn linears(&self) -> Vec<Linear> {
        let model = self.model();
        let mut linears: Vec<Linear> = self
            .parts
            .par_iter()
            .map(|part| self.linear_of(&model, part))
            .collect();
        let scale = self.scale_of(
            linears
                .iter()
                .map(|linear| (linear.residual.len(), linear.log_variance)),
        );
        for linear in &mut linears {
            linear.jacobian *= scale;
            linear.residual *= scale;
        }
        linears
    }

    /// Finds the triangles, one session at a time: the derivatives of all samples of many
    /// sessions would not fit in memory.
    fn triangulate(&mut self) {
        let model = self.model();
        let found: Option<Vec<(DMatrix<f64>, f64)>> = self
            .parts
            .par_iter()
            .map(|part| {
                let linear = self.linear_of(&model, part);
                let columns = linear.jacobian.ncols();
                let mut both = linear.jacobian.resize_horizontally(columns + 1, 0.0);
                both.set_column(columns, &linear.residual);
                both.iter()
                    .all(|entry| entry.is_finite())
                    .then(|| (both.qr().r(), linear.log_variance))
            })
            .collect();
        let rows = found.iter().flatten().zip(&self.parts);
        let scale =
            self.scale_of(rows.map(|((_, log_variance), part)| (part.rows(), *log_variance)));
        self.scale = scale;
        self.triangles = found.map(|found| {
            let scaled = |(triangle, _)| triangle * scale;
            found.into_iter().map(scaled).collect()
        });
    }

    /// The residuals and derivatives of all fitted samples.
    pub fn dense(&self) -> Option<(DVector<f64>, DMatrix<f64>)> {
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

    /// For each session, the residuals and the derivatives by the free parameters, with
    /// zeros and initial state projected out.
    pub fn projected(&self) -> Vec<(DMatrix<f64>, DVector<f64>)> {
        let (found, scale) = self.of_sessions(|_, parameters, residual| (parameters, residual));
        found
            .into_iter()
            .map(|(parameters, residual)| (parameters * scale, residual * scale))
            .collect()
    }

    /// Applies `take` to each session's derivatives and residuals, which are not multiplied
    /// by the returned scale. One session at a time: those of a thousand take hundreds of
    /// megabytes.
    fn of_sessions<T: Send>(
        &self,
        take: impl Fn(&Part, DMatrix<f64>, DVector<f64>) -> T + Sync,
    ) -> (Vec<T>, f64) {
        let free = self.free.len();
        let model = self.model();
        let (kept, sizes): (Vec<T>, Vec<(usize, f64)>) = self
            .parts
            .par_iter()
            .map(|part| {
                let linear = self.linear_of(&model, part);
                let mut parameters = linear.jacobian.columns(0, free).into_owned();
                if part.own.is_some() {
                    let own = linear.jacobian.columns(free, UNKNOWNS).into_owned();
                    // Neither these rows nor those of the priors are multiplied by the scale yet.
                    let known = self.prior_slopes(part).map(|slope| slope / self.scale);
                    parameters = without_nuisance(&parameters, &own, &known);
                }
                let size = (linear.residual.len(), linear.log_variance);
                (take(part, parameters, linear.residual), size)
            })
            .unzip();
        (kept, self.scale_of(sizes.into_iter()))
    }

    /// The fit at this position. A coarse fit has no standard errors.
    pub fn into_fit(self, converged: bool, effort: Effort) -> Fit {
        let residuals = self.residual_series(true);
        let information = match effort {
            Effort::Steps(_) | Effort::Coarse => Information::default(),
            Effort::Full => self.information(&residuals),
        };
        let free = self.free.len();
        let covariance = match effort {
            // A derivative that is not finite gives no standard error.
            Effort::Full if information.unknowns() == free => information.covariance(),
            _ => None,
        };
        let standard_errors = self
            .transforms
            .iter()
            .enumerate()
            .map(|(column, transform)| {
                let slope = transform.slope(self.position[column]).abs();
                covariance.as_ref().map_or(f64::INFINITY, |covariance| {
                    slope * covariance[(column, column)].max(0.0).sqrt()
                })
            })
            .collect();
        let departure = self
            .parts
            .iter()
            .zip(self.prior_rows())
            .filter_map(|(part, rows)| Some((part.session.prior(), rows?)))
            .flat_map(|(prior, rows)| {
                let each = rows.into_iter().enumerate();
                let counts: [f64; UNKNOWNS] =
                    std::array::from_fn(|unknown| self.counts(prior, unknown));
                each.map(move |(unknown, row)| (row / counts[unknown]).powi(2))
            })
            .sum();
        Fit {
            model: self.model(),
            nuisances: self.nuisances(),
            departure,
            free: self.free,
            residuals,
            standard_errors,
            converged,
            information,
            transforms: self.transforms,
            position: self.position.iter().take(free).copied().collect(),
        }
    }

    /// Information of each fitted segment about the free parameters.
    fn information(&self, residuals: &[Vec<f64>]) -> Information {
        let unknowns = self.free.len();
        if unknowns == 0 {
            return Information::default();
        }
        let correlation = correlation_time(residuals);
        let (sessions, scale) = self.of_sessions(|part, parameters, residual| {
            if !parameters.iter().all(|entry| entry.is_finite()) {
                return None;
            }
            let mut first = 0;
            let recordings = part.ranges.iter().map(|range| {
                let rows = if part.ranges.len() == 1 {
                    residual.len()
                } else {
                    range.len()
                };
                let recording = Recorded::of(
                    parameters.rows(first, rows),
                    residual.rows(first, rows),
                    correlation,
                );
                first += rows;
                recording
            });
            Some(recordings.collect::<Vec<_>>())
        });
        match sessions.into_iter().collect::<Option<Vec<_>>>() {
            Some(sessions) if scale.is_finite() => {
                Information::sum(unknowns, sessions.into_iter().flatten(), scale)
            }
            _ => Information::default(),
        }
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, position: &DVector<f64>) {
        self.position.copy_from(position);
        self.triangulate();
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
