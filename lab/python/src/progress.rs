//! `softrig.Progress`: the argument of a progress callback.

use library::diagnose::work::progress::State;
use pyo3::prelude::*;

use crate::kept;

/// How far a diagnosis is, or a batch. As a text it is one line that says all of it.
#[pyclass(frozen, get_all, module = "softrig")]
#[derive(Clone, Debug)]
pub struct Progress {
    /// What is being done; of a batch, what its last case found.
    stage: String,
    /// Fits of the present step that are finished; of a batch, cases.
    done: usize,
    /// Fits of the present step; 0 where they are not counted in advance; of a batch, cases.
    planned: usize,
    /// Finished fits of all steps.
    fits: usize,
    /// Share of the whole that is done, by what its stages usually take.
    share: f64,
    /// Time since the beginning (s).
    elapsed_s: f64,
    /// How long the present step still takes (s); None if that cannot be said yet.
    remaining_s: Option<f64>,
    /// The best explanation so far; None if there is none.
    best: Option<String>,
    /// All of it in one line.
    line: String,
}

impl Progress {
    pub fn of(state: &State) -> Self {
        Self {
            stage: state.stage.clone(),
            done: state.done,
            planned: state.planned,
            fits: state.fits,
            share: state.share,
            elapsed_s: state.elapsed.as_secs_f64(),
            remaining_s: state.remaining().map(|left| left.as_secs_f64()),
            best: state.best_explanation(),
            line: state.to_string(),
        }
    }
}

/// What a progress is pickled as: stage; done, planned and fits; share, elapsed and remaining time;
/// the best explanation; and the line.
type Parts = (
    String,
    [usize; 3],
    (f64, f64, Option<f64>),
    Option<String>,
    String,
);

#[pymethods]
impl Progress {
    /// Makes a progress of what [`Self::__reduce__`] gave.
    #[staticmethod]
    fn _restored(
        stage: String,
        counts: [usize; 3],
        times: (f64, f64, Option<f64>),
        best: Option<String>,
        line: String,
    ) -> Self {
        let [done, planned, fits] = counts;
        let (share, elapsed_s, remaining_s) = times;
        Self {
            stage,
            done,
            planned,
            fits,
            share,
            elapsed_s,
            remaining_s,
            best,
            line,
        }
    }

    /// For pickle: a process that diagnoses may report to another.
    fn __reduce__<'py>(&self, py: Python<'py>) -> kept::Reduced<'py, Parts> {
        let this = self.clone();
        let parts = (
            this.stage,
            [this.done, this.planned, this.fits],
            (this.share, this.elapsed_s, this.remaining_s),
            this.best,
            this.line,
        );
        kept::reduced::<Self, _>(py, parts)
    }

    /// Nothing of it changes, so it is its own copy.
    fn __copy__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    /// As [`Self::__copy__`].
    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __str__(&self) -> &str {
        &self.line
    }

    fn __repr__(&self) -> String {
        format!("<softrig.Progress {:?}>", self.line)
    }
}
