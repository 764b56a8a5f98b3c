//! The least-squares problem behind every fit.
//!
//! It turns sessions into residuals and derivatives, adds the priors of their zeros and
//! initial states, and hands both to the solver ([`super::descent`]). [`super::fit`] uses it.

use std::ops::Range;

use model_core::actuator::{Model, ParameterId};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::descent::{Bounded, Descent, descend};
use super::filter::{Innovation, Level, normalised, pass};
use super::fit::{Effort, Fit};
use super::information::{Contribution, Information, without_nuisance};
use super::normal::{Normal, SharedRow};
use super::nuisance::{Nuisance, PAST_PLACE, Prior, Shared, UNKNOWNS, ZEROS, wall};
use super::transform::{Limits, ParameterTransform};
use super::{Dataset, Session};
use crate::sim::dual::Dual;
use crate::sim::simulate::{Grain, InitialState, Origin, run_from};
use crate::statistics::{correlation_time, mean};

impl Effort {
    /// Most evaluations of a fit, and the relative gain below which it is done. A fit that
    /// still moves after so many evaluations is in a valley so flat that its end does not
    /// matter.
    const fn patience(self) -> (usize, f64) {
        match self {
            Self::Steps(steps) => (steps, 1e-4),
            Self::Coarse => (25, 1e-3),
            Self::Full => (120, 1e-5),
        }
    }
}

/// Which samples of a session are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleSet {
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

/// The soft bound of a zero or of the past, see [`wall`]. An initial state has none.
fn wall_of(unknown: usize, departure: f64, samples: usize) -> [f64; 2] {
    if ZEROS.contains(&unknown) || unknown == PAST_PLACE {
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

/// The variable at a place among all, as a dual number of a block of them; a constant if it
/// is not of the block, or `is_free` is false.
fn variable<const N: usize>(
    value: f64,
    place: usize,
    slope: f64,
    block: &Range<usize>,
    is_free: bool,
) -> Dual<N> {
    if is_free && block.contains(&place) {
        Dual::variable(value, place - block.start, slope)
    } else {
        Dual::constant(value)
    }
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
    /// Length of the steps of simulations with derivatives.
    grain: Grain,
    /// Square of the fastest swing (rad²/s²) that is looked for: that of the samples, or where the
    /// fit starts.
    fastest: f64,
    /// Factor of the prior rows: the geometric mean of √S, as for the innovations.
    scale: f64,
    /// The triangle of each part at `position`: derivatives, residuals last. None
    /// until a solver needs it, and if the model cannot be simulated.
    triangles: Option<Vec<DMatrix<f64>>>,
}

impl<'a> Problem<'a> {
    /// Starts at the parameters of `model` and at the guess of each session.
    pub fn new(
        data: &'a Dataset,
        model: &Model<f64>,
        free: &[ParameterId],
        compared: SampleSet,
    ) -> Self {
        let limits = Limits::of(data);
        let transforms: Vec<ParameterTransform> = free
            .iter()
            .map(|&id| ParameterTransform::of(&limits, model, id))
            .collect();
        let mut position: Vec<f64> = free
            .iter()
            .zip(&transforms)
            .map(|(&id, transform)| transform.position(model.value(id).unwrap_or(0.0)))
            .collect();
        let mut parts = Vec::new();
        for (index, session) in data.sessions().iter().enumerate() {
            let mut ranges = data.fitted_ranges(index);
            if compared == SampleSet::Validated {
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
        let longest = parts.iter().map(|part| part.session.interval());
        let shown = std::f64::consts::PI / longest.fold(0.0, f64::max);
        let angle = data.largest_angle();
        Self {
            fastest: (shown * shown).max(model.fastest_swing(angle)),
            model: *model,
            data,
            free: free.to_vec(),
            transforms,
            shared: std::array::from_fn(|unknown| shared(&parts, unknown)),
            parts,
            position: DVector::from_vec(position),
            level: None,
            grain: Grain::Fine,
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
        self.grain = Grain::Coarse;
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
    pub fn solved(self, effort: Effort) -> (Self, bool) {
        let (problem, ended) = self.descended(effort, &|| false);
        (problem, ended == Descent::Converged)
    }

    /// The same, unless it is interrupted.
    pub fn solved_unless(
        self,
        effort: Effort,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Option<(Self, bool)> {
        let (problem, ended) = self.descended(effort, is_interrupted);
        (ended != Descent::Interrupted).then_some((problem, ended == Descent::Converged))
    }

    fn descended(mut self, effort: Effort, is_interrupted: &dyn Fn() -> bool) -> (Self, Descent) {
        if self.unknowns() == 0 {
            return (self, Descent::Converged);
        }
        let (evaluations, tolerance) = effort.patience();
        // A model as it is is compared as exactly as it is shown; one on its way is not.
        let grains: &[Grain] = if self.free.is_empty() {
            &[Grain::Fine]
        } else if effort == Effort::Full && self.level.is_none() {
            &[Grain::Coarse, Grain::Fine]
        } else {
            &[Grain::Coarse]
        };
        let mut ended = Descent::Converged;
        for &grain in grains {
            self.grain = grain;
            ended = descend(&mut self, evaluations, tolerance, is_interrupted);
            if ended == Descent::Interrupted {
                break;
            }
        }
        (self, ended)
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

    /// The model at this position.
    pub fn model(&self) -> Model<f64> {
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
        let scale = libm::exp(0.5 * log_variance);
        for value in series.iter_mut().flatten() {
            *value = scale * level.counted(*value)[0];
        }
        series
    }

    /// One session by the filter, with each row divided by √S of its innovation: the
    /// columns of one block of variables.
    fn filtered<const N: usize>(
        &self,
        model: &Model<Dual<N>>,
        part: &Part<'_>,
        level: &Level,
        block: &Range<usize>,
        linear: &mut Linear,
    ) {
        let session = part.session;
        let free = self.free.len();
        let nuisance = self.nuisance(part);
        let zero = variable(nuisance.pressure_zero, free, 1.0, block, part.own.is_some());
        let Some(passed) = pass(model, session, &nuisance, zero, level, block.len()) else {
            linear.residual.fill(f64::INFINITY);
            return;
        };
        let slopes = session.prior().deviations();
        let silent = |sample: usize| session.silent().iter().any(|range| range.contains(&sample));
        let mut log_variance = 0.0;
        for (row, sample) in part.ranges.iter().cloned().flatten().enumerate() {
            let Innovation { error, variance } = passed[sample];
            log_variance += libm::log(variance);
            if silent(sample) {
                continue;
            }
            let spread = variance.sqrt();
            let [counted, slope] = level.counted(error.value() / spread);
            let partials = error.partials();
            linear.residual[row] = counted;
            for (partial, column) in partials.iter().zip(block.clone()) {
                // The filter estimates the initial state. The zero of the angle stays at
                // the value of the refit: only the spring would show it.
                let unit = if column == free { slopes[0] } else { 1.0 };
                if column < linear.jacobian.ncols() {
                    linear.jacobian[(row, column)] = partial * unit * slope / spread;
                }
            }
        }
        linear.log_variance = log_variance;
    }

    /// One session by simulation: the columns of one block of variables, which are the free
    /// parameters, the pressure zero, the initial state and the past.
    fn simulated<const N: usize>(
        &self,
        model: &Model<Dual<N>>,
        part: &Part<'_>,
        block: &Range<usize>,
        linear: &mut Linear,
    ) {
        let session = part.session;
        let free = self.free.len();
        let nuisance = self.nuisance(part);
        let unknown = |value: f64, offset: usize| {
            variable(value, free + offset, 1.0, block, part.own.is_some())
        };
        let origin = Origin {
            start: InitialState {
                angle: unknown(nuisance.start.angle - nuisance.angle_zero, 1),
                rate: unknown(nuisance.start.rate, 2),
            },
            past: unknown(nuisance.past, 3),
            stretched: session.placement().stretched_rad,
            pressure_zero: unknown(nuisance.pressure_zero, 0),
            clock: Dual::constant(session.clock()),
        };
        let plain: Model<f64> = model.map(|value| value.value());
        let placed = session.placed(model);
        let stepping = session.stepping_by(&plain, self.grain);
        let reading = run_from(&placed, session.signal(), origin, stepping).reading;
        let slopes = session.prior().deviations();
        let measured = &session.recording().angle;
        let silent = |sample: usize| session.silent().iter().any(|range| range.contains(&sample));
        for (row, sample) in part.ranges.iter().cloned().flatten().enumerate() {
            if silent(sample) {
                continue;
            }
            let partials = reading[sample].partials();
            linear.residual[row] = reading[sample].value() + nuisance.angle_zero - measured[sample];
            for (by, variable) in partials.into_iter().zip(block.clone()) {
                let jacobian = &mut linear.jacobian;
                if variable < free {
                    jacobian[(row, variable)] = by;
                } else if part.own.is_some() {
                    match variable - free {
                        0 => jacobian[(row, free)] = by * slopes[0],
                        1 => {
                            // The zero of the angle moves the reading and the initial angle.
                            jacobian[(row, free + 1)] = (1.0 - by) * slopes[1];
                            jacobian[(row, free + 2)] = by * slopes[2];
                        }
                        own => jacobian[(row, free + own + 1)] = by * slopes[own + 1],
                    }
                }
            }
        }
    }

    /// One session on dual numbers with `N` derivatives, of which those of `block` are
    /// variables.
    fn filled<const N: usize>(
        &self,
        model: &Model<f64>,
        part: &Part<'_>,
        block: &Range<usize>,
        linear: &mut Linear,
    ) {
        let mut dual: Model<Dual<N>> = model.map(Dual::constant);
        for (column, ((&id, transform), &u)) in self
            .free
            .iter()
            .zip(&self.transforms)
            .zip(&self.position)
            .enumerate()
        {
            let value = transform.to_value(u);
            dual = dual.with_value(id, variable(value, column, transform.slope(u), block, true));
        }
        match &self.level {
            Some(level) => self.filtered(&dual, part, level, block, linear),
            None => self.simulated(&dual, part, block, linear),
        }
    }

    /// One session. Derivatives are taken in blocks, each by the smallest dual number that
    /// has room for it, so that any number of unknowns can be free.
    fn linear_of(&self, model: &Model<f64>, part: &Part<'_>) -> Linear {
        /// Most derivatives of one pass: three base parameters and three effects of four
        /// each, with zeros and start.
        const MOST: usize = 20;
        let own = if part.own.is_some() { UNKNOWNS } else { 0 };
        let mut linear = Linear {
            jacobian: DMatrix::zeros(part.rows(), self.free.len() + own),
            residual: DVector::zeros(part.rows()),
            log_variance: 0.0,
        };
        // Of the unknowns of the session the zero of the angle needs none. The initial state is
        // estimated by a filter, which needs two derivatives of its own instead.
        let (variables, kept) = match self.level {
            Some(_) => (self.free.len() + 1, 2),
            None => (self.free.len() + UNKNOWNS - 1, 0),
        };
        let mut first = 0;
        while first < variables {
            let block = first..variables.min(first + MOST - kept);
            first = block.end;
            match block.len() + kept {
                0..=4 => self.filled::<4>(model, part, &block, &mut linear),
                5..=6 => self.filled::<6>(model, part, &block, &mut linear),
                7..=8 => self.filled::<8>(model, part, &block, &mut linear),
                9..=12 => self.filled::<12>(model, part, &block, &mut linear),
                _ => self.filled::<MOST>(model, part, &block, &mut linear),
            }
        }
        linear
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
        libm::exp(0.5 * sum / rows.max(1) as f64)
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

    /// Whether the model swings faster than the samples show. The fit of a wrong structure goes
    /// there where all forces can grow together beside an inertia that does not show, and each
    /// evaluation of the model costs a hundred.
    fn is_faster_than_shown(&self, model: &Model<f64>) -> bool {
        let swing = model.fastest_swing(self.data.largest_angle());
        let decay = model.dynamics().damping / model.dynamics().inertia;
        self.grain == Grain::Coarse && swing > self.fastest && decay * decay < 4.0 * swing
    }

    /// Finds the triangles, one session at a time: the derivatives of all samples of many
    /// sessions would not fit in memory.
    fn triangulate(&mut self) {
        let model = self.model();
        if self.is_faster_than_shown(&model) {
            self.triangles = None;
            return;
        }
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
        let rows = self.prior_rows();
        let penalty = rows.iter().flatten().flatten().map(|row| row * row).sum();
        let departure = self
            .parts
            .iter()
            .zip(rows)
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
            penalty,
            free: self.free,
            residuals: residuals.into(),
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
                let recording = Contribution::of(
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

impl Bounded for Problem<'_> {
    fn position(&self) -> DVector<f64> {
        self.position.clone()
    }

    fn bounds(&self) -> Vec<[f64; 2]> {
        let bounds = |transform: &ParameterTransform| transform.bounds();
        self.transforms.iter().map(bounds).collect()
    }

    fn move_to(&mut self, position: &DVector<f64>) -> Option<Normal> {
        self.position.copy_from(position);
        self.triangulate();
        self.normal()
    }
}

#[cfg(test)]
mod tests {
    use crate::estimate::fitter::Fitter;
    use model_core::catalogue::{Effect, Kind};
    use model_core::dynamics::Dynamics;
    use model_core::effects::table::{Table, Variable};
    use proptest::prelude::*;

    use super::*;
    use crate::estimate::filter::Pace;
    use softrig_formats::recording::Recording;

    fn pulled_and_let_go() -> Dataset {
        let time: Vec<f64> = (0..60).map(|k| f64::from(k) * 0.02).collect();
        Dataset::of(&[Recording {
            pressure: time
                .iter()
                .map(|t| if *t < 0.6 { 15e3 * t } else { 0.0 })
                .collect(),
            angle: time.iter().map(|t| 0.3 * (2.0 * t).sin()).collect(),
            time,
            ..Recording::default()
        }])
    }

    /// A model with these effects at their first start, and a table.
    fn model(kinds: &[Kind], nodes: usize) -> Model<f64> {
        let dynamics = Dynamics {
            inertia: 0.3,
            damping: 0.9,
            stiffness: 2.5,
            exponent: 1.6,
            input_gain: 1e-4,
        };
        let effect = |kind: &Kind| {
            let values: Vec<f64> = kind
                .parameters()
                .iter()
                .map(|row| {
                    let start = row.held.or(row.starts.first().copied()).unwrap_or(1.0);
                    // At a bound a problem begins a little inside.
                    if row.lower < start && start < row.upper {
                        f64::from(start)
                    } else {
                        0.5 * (f64::from(row.lower) + f64::from(row.upper))
                    }
                })
                .collect();
            kind.build(&values)
        };
        let mut effects: Vec<Effect<f64>> = kinds.iter().filter_map(effect).collect();
        if nodes > 1 {
            let at: Vec<f32> = (0..nodes).map(|k| k as f32 / nodes as f32 - 0.4).collect();
            let table = Table::new(Variable::Angle, &at, &vec![0.01; nodes]).unwrap();
            effects.push(Effect::Table(table));
        }
        Model::new(dynamics, &effects).unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        /// However many parameters are free, the derivative by each is that of a problem
        /// in which it is free alone. Twenty unknowns are more than one pass has room for.
        #[test]
        fn any_number_of_parameters_is_free(
            base in proptest::sample::subsequence(ParameterId::BASE.to_vec(), 1..=5),
            kinds in proptest::sample::subsequence(Kind::NAMES.to_vec(), 0..=2),
            nodes in 0usize..=16,
            at_level in proptest::bool::ANY,
        ) {
            let (data, model) = (pulled_and_let_go(), model(&kinds, nodes));
            let effects: Vec<Effect<f64>> = model.effects().collect();
            let of_effects = effects.iter().enumerate().flat_map(|(slot, effect)| {
                (0..effect.parameters().len())
                    .map(move |parameter| ParameterId::Effect { slot, parameter })
            });
            let free: Vec<ParameterId> = base.into_iter().chain(of_effects).collect();
            let level = Level {
                intensity: 1.0,
                noise: 0.01,
                pace: Pace::of(&data),
                outlier: None,
            };
            let fitter = Fitter::new(&model, &data).at(at_level.then_some(&level));
            let nuisances = [data.sessions()[0].guess()];
            let linearised = |free: &[ParameterId]| fitter.linearised(&model, free, &nuisances);
            let (_, together) = linearised(&free).unwrap();
            prop_assert_eq!(together.ncols(), free.len() + UNKNOWNS);
            for (column, &id) in free.iter().enumerate() {
                let (_, alone) = linearised(&[id]).unwrap();
                let apart = (together.column(column) - alone.column(0)).norm();
                prop_assert!(apart <= 1e-9 * (1.0 + alone.column(0).norm()), "{id:?}: {apart}");
            }
        }
    }
}
