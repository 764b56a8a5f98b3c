//! The normal equations of a fit to many sessions, solved in time linear in their number.
//!
//! Zeros and initial state of a session do not influence any other session. So the matrix
//! is an arrow: the free parameters, which all sessions share, and one block of four per
//! session. A dense decomposition takes time cubic in the number of sessions; eliminating
//! each session's own unknowns first (Schur complement; Triggs et al., Bundle adjustment,
//! 2000, section 6) takes linear time. Zeros of one sitting share a mean, which couples
//! the blocks by two columns per zero (Woodbury formula).

use nalgebra::{DMatrix, DVector, SMatrix};

use super::nuisance::UNKNOWNS;

/// The block of one session.
#[derive(Clone)]
struct Own {
    /// Index of its first unknown.
    first: usize,
    /// JᵀJ of its own unknowns, without the shared mean.
    square: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    /// JᵀJ of its own unknowns with the free parameters.
    border: DMatrix<f64>,
}

/// Rows of priors `r_k = … + b_k Σ z`, one a session that shares the zero `z`: their
/// derivative by it is `diag(a) + b eᵀ`, with e = 1 for all that share.
#[derive(Clone)]
struct Mean {
    /// Indices of the unknowns.
    places: Vec<usize>,
    /// a ∘ b.
    both: Vec<f64>,
    /// |b|².
    square: f64,
}

/// The prior's row of a zero that shares a mean, with its derivatives.
pub struct SharedRow {
    /// Index of the unknown.
    pub place: usize,
    /// Derivative by the unknown itself, without its part in the mean.
    pub by_itself: f64,
    /// Derivative by the sum of all that share the mean.
    pub by_sum: f64,
    /// The row.
    pub residual: f64,
}

/// `JᵀJ δ = Jᵀr` of free parameters, which come first, and of the sessions' unknowns.
#[derive(Clone)]
pub struct Normal {
    free: DMatrix<f64>,
    slope: DVector<f64>,
    sessions: Vec<Own>,
    means: Vec<Mean>,
    /// r·r.
    cost: f64,
}

impl Normal {
    /// Empty equations of `unknowns` unknowns, of which `free` are free parameters.
    pub fn new(free: usize, unknowns: usize) -> Self {
        Self {
            free: DMatrix::zeros(free, free),
            slope: DVector::zeros(unknowns),
            sessions: Vec::new(),
            means: Vec::new(),
            cost: 0.0,
        }
    }

    /// Adds a session: a matrix of its derivatives by the free parameters, those by its
    /// own unknowns if it has any, and its residuals last. `first` is the index of its own
    /// unknowns, which follow those of the session before. `priors` are the rows of the
    /// unknowns without a shared mean, each with its derivative and residual.
    pub fn session(
        &mut self,
        rows: &DMatrix<f64>,
        first: Option<usize>,
        priors: [Option<[f64; 2]>; UNKNOWNS],
    ) {
        let count = self.free.nrows();
        let products = rows.tr_mul(rows);
        let last = products.ncols() - 1;
        self.free += products.view((0, 0), (count, count));
        self.cost += products[(last, last)];
        for place in 0..count {
            self.slope[place] += products[(place, last)];
        }
        let Some(first) = first else { return };
        let mut square = SMatrix::from_fn(|row, column| products[(count + row, count + column)]);
        for (unknown, prior) in priors.into_iter().enumerate() {
            self.slope[first + unknown] += products[(count + unknown, last)];
            if let Some([slope, residual]) = prior {
                square[(unknown, unknown)] += slope * slope;
                self.slope[first + unknown] += slope * residual;
                self.cost += residual * residual;
            }
        }
        self.sessions.push(Own {
            first,
            square,
            border: products.view((count, 0), (UNKNOWNS, count)).into_owned(),
        });
    }

    /// Adds the prior rows of zeros that share a mean, after their sessions.
    pub fn mean(&mut self, rows: &[SharedRow]) {
        let pull: f64 = rows.iter().map(|row| row.by_sum * row.residual).sum();
        for row in rows {
            self.slope[row.place] += row.by_itself * row.residual + pull;
            self.cost += row.residual * row.residual;
            let after = row.place - self.free.nrows();
            let (session, unknown) = (after / UNKNOWNS, after % UNKNOWNS);
            if let Some(own) = self.sessions.get_mut(session) {
                own.square[(unknown, unknown)] += row.by_itself * row.by_itself;
            }
        }
        self.means.push(Mean {
            places: rows.iter().map(|row| row.place).collect(),
            both: rows.iter().map(|row| row.by_itself * row.by_sum).collect(),
            square: rows.iter().map(|row| row.by_sum * row.by_sum).sum(),
        });
    }

    /// r·r.
    pub fn cost(&self) -> f64 {
        self.cost
    }

    /// Jᵀr.
    pub fn slope(&self) -> &DVector<f64> {
        &self.slope
    }

    /// Decides that the free parameter at `place` moves by `by`: the others are solved for
    /// beside that, and the step's own entry is left to the caller.
    pub fn fix(&mut self, place: usize, by: f64) {
        let count = self.free.nrows();
        let mut top = self.slope.rows_mut(0, count);
        top -= self.free.column(place) * by;
        for own in &mut self.sessions {
            let mut rows = self.slope.rows_mut(own.first, UNKNOWNS);
            rows -= own.border.column(place) * by;
            own.border.column_mut(place).fill(0.0);
        }
        self.free.column_mut(place).fill(0.0);
        self.free.row_mut(place).fill(0.0);
        self.slope[place] = 0.0;
    }

    /// What r·r loses by a step −δ if the residuals are linear: 2 δᵀJᵀr − |J δ|².
    pub fn predicted_gain(&self, step: &DVector<f64>) -> f64 {
        let count = self.free.nrows();
        let top = step.rows(0, count).into_owned();
        let mut squares = top.dot(&(&self.free * &top));
        for own in &self.sessions {
            let alone = step.fixed_rows::<UNKNOWNS>(own.first).into_owned();
            squares += alone.dot(&(own.square * alone)) + 2.0 * alone.dot(&(&own.border * &top));
        }
        for mean in &self.means {
            let pairs = || mean.places.iter().zip(&mean.both);
            let sum: f64 = mean.places.iter().map(|&place| step[place]).sum();
            let by_both: f64 = pairs().map(|(&place, both)| both * step[place]).sum();
            squares += 2.0 * by_both * sum + mean.square * sum * sum;
        }
        2.0 * self.slope.dot(step) - squares
    }

    /// The diagonal of JᵀJ.
    fn diagonal(&self) -> DVector<f64> {
        let mut diagonal = DVector::zeros(self.slope.len());
        diagonal
            .rows_mut(0, self.free.nrows())
            .copy_from(&self.free.diagonal());
        for own in &self.sessions {
            diagonal
                .rows_mut(own.first, UNKNOWNS)
                .copy_from(&own.square.diagonal());
        }
        for mean in &self.means {
            for (&place, both) in mean.places.iter().zip(&mean.both) {
                diagonal[place] += 2.0 * both + mean.square;
            }
        }
        diagonal
    }

    /// The δ of `(JᵀJ + damping · diag(JᵀJ)) δ = Jᵀr`; none where that is singular.
    pub fn step(&self, damping: f64) -> Option<DVector<f64>> {
        // An unknown without influence must not make it singular.
        let damped = self
            .diagonal()
            .map(|entry| damping * entry + f64::MIN_POSITIVE);
        // The shared mean adds W M Wᵀ, with two columns in W, (a ∘ b, e), and
        // M = [[0, 1], [1, b·b]], whose inverse is [[−b·b, 1], [1, 0]].
        let mut joined = DMatrix::zeros(self.slope.len(), 2 * self.means.len());
        let mut inner = DMatrix::zeros(2 * self.means.len(), 2 * self.means.len());
        for (index, mean) in self.means.iter().enumerate() {
            for (&place, both) in mean.places.iter().zip(&mean.both) {
                joined[(place, 2 * index)] = *both;
                joined[(place, 2 * index + 1)] = 1.0;
            }
            inner[(2 * index, 2 * index)] = -mean.square;
            inner[(2 * index, 2 * index + 1)] = 1.0;
            inner[(2 * index + 1, 2 * index)] = 1.0;
        }
        let mut right = joined.clone().insert_column(0, 0.0);
        right.set_column(0, &self.slope);
        let solved = self.without_means(&damped, right)?;
        let step = solved.column(0).into_owned();
        if self.means.is_empty() {
            return Some(step);
        }
        let by_joined = solved.columns(1, joined.ncols());
        inner += joined.tr_mul(&by_joined);
        let pull = inner.lu().solve(&joined.tr_mul(&step))?;
        Some(step - by_joined * pull)
    }

    /// Solves the equations without shared means for each column of `right`.
    fn without_means(&self, damped: &DVector<f64>, right: DMatrix<f64>) -> Option<DMatrix<f64>> {
        let count = self.free.nrows();
        let columns = right.ncols();
        let mut schur = &self.free + DMatrix::from_diagonal(&damped.rows(0, count).into_owned());
        let mut solution = right;
        let mut factors = Vec::with_capacity(self.sessions.len());
        for own in &self.sessions {
            let mut square = own.square;
            for unknown in 0..UNKNOWNS {
                square[(unknown, unknown)] += damped[own.first + unknown];
            }
            let factor = square.cholesky()?;
            let to_free = factor.solve(&own.border);
            schur -= own.border.tr_mul(&to_free);
            let alone = factor.solve(&solution.rows(own.first, UNKNOWNS).into_owned());
            let change = own.border.tr_mul(&alone);
            let mut top = solution.rows_mut(0, count);
            top -= change;
            solution.rows_mut(own.first, UNKNOWNS).copy_from(&alone);
            factors.push(to_free);
        }
        let free = if count == 0 {
            DMatrix::zeros(0, columns)
        } else {
            schur
                .cholesky()?
                .solve(&solution.rows(0, count).into_owned())
        };
        solution.rows_mut(0, count).copy_from(&free);
        for (own, to_free) in self.sessions.iter().zip(&factors) {
            let mut rows = solution.rows_mut(own.first, UNKNOWNS);
            rows -= to_free * &free;
        }
        Some(solution)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const FREE: usize = 3;
    const ROWS: usize = 9;

    /// The rows of one session, the derivatives of its priors, and what its zero has
    /// in common with others.
    type Drawn = (Vec<f64>, Vec<f64>, [f64; 3]);

    fn drawn() -> impl Strategy<Value = Vec<Drawn>> {
        let session = (
            proptest::collection::vec(-1.0..1.0, ROWS * (FREE + UNKNOWNS + 1)),
            proptest::collection::vec(0.1..2.0, 2 * UNKNOWNS),
            [0.5..2.0, -0.3..0.0, -1.0..1.0],
        );
        proptest::collection::vec(session, 1..7)
    }

    proptest! {
        /// The dense normal equations are the reference: the same step at any damping.
        #[test]
        fn the_step_is_that_of_the_whole_matrix(sessions in drawn(), damping in 0.0..1.0) {
            let unknowns = FREE + UNKNOWNS * sessions.len();
            let mut normal = Normal::new(FREE, unknowns);
            let height = ROWS + UNKNOWNS;
            let mut jacobian = DMatrix::zeros(height * sessions.len(), unknowns);
            let mut residual = DVector::zeros(height * sessions.len());
            let mut shared = Vec::new();
            for (index, (entries, priors, [by_itself, by_sum, zero])) in sessions.iter().enumerate() {
                let own = FREE + UNKNOWNS * index;
                let top = height * index;
                let rows = DMatrix::from_column_slice(ROWS, FREE + UNKNOWNS + 1, entries);
                jacobian.view_mut((top, 0), (ROWS, FREE)).copy_from(&rows.columns(0, FREE));
                jacobian.view_mut((top, own), (ROWS, UNKNOWNS)).copy_from(&rows.columns(FREE, UNKNOWNS));
                residual.rows_mut(top, ROWS).copy_from(&rows.column(FREE + UNKNOWNS));
                // The second unknown is that of a whole sitting.
                let alone: [Option<[f64; 2]>; UNKNOWNS] = std::array::from_fn(|unknown| {
                    (unknown != 1).then(|| [priors[unknown], priors[UNKNOWNS + unknown]])
                });
                for (unknown, prior) in alone.iter().enumerate() {
                    let Some([slope, value]) = prior else { continue };
                    jacobian[(top + ROWS + unknown, own + unknown)] = *slope;
                    residual[top + ROWS + unknown] = *value;
                }
                for other in 0..sessions.len() {
                    jacobian[(top + ROWS + 1, FREE + UNKNOWNS * other + 1)] = *by_sum;
                }
                jacobian[(top + ROWS + 1, own + 1)] += by_itself;
                residual[top + ROWS + 1] = *zero;
                normal.session(&rows, Some(own), alone);
                shared.push(SharedRow {
                    place: own + 1,
                    by_itself: *by_itself,
                    by_sum: *by_sum,
                    residual: *zero,
                });
            }
            normal.mean(&shared);
            let mut whole = jacobian.tr_mul(&jacobian);
            let diagonal = whole.diagonal();
            for place in 0..unknowns {
                whole[(place, place)] += damping * diagonal[place];
            }
            let slope = jacobian.tr_mul(&residual);
            prop_assert!((normal.slope() - &slope).norm() <= 1e-12 * (1.0 + slope.norm()));
            prop_assert!((normal.cost() - residual.norm_squared()).abs() <= 1e-12 * normal.cost());
            let moved = normal.cost() - (&residual - &jacobian * &slope).norm_squared();
            let predicted = normal.predicted_gain(&slope);
            prop_assert!((predicted - moved).abs() <= 1e-9 * (normal.cost() + moved.abs()));
            let expected = whole.clone().lu().solve(&slope).unwrap();
            let found = normal.step(damping).unwrap();
            // Both solve the equations; how near the steps are depends on the matrix.
            prop_assert!((&whole * &found - &slope).norm() <= 1e-8 * (1.0 + slope.norm() + expected.norm()));
        }
    }
}
