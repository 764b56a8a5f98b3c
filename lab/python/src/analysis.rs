//! `softrig.residuals`, `linearise`, `plan` and `init`: what the commands of these names say, as
//! the values that they write as JSON.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use library::diagnose::Job;
use library::estimate::assemble::assemble;
use library::first_model::from_recordings;
use library::prediction::Prediction;
use pyo3::exceptions::{PyRuntimeError, PyTypeError};
use pyo3::prelude::*;
use serde::Serialize;
use softrig_cli::cli::linearise::{Linearised, Rest};
use softrig_cli::cli::plan::{Plan, limits};
use softrig_cli::cli::residuals::Analysis;
use softrig_formats::columns::Layout;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::PASCAL_PER_KPA;

use crate::fault::{OrRaise, warn};
use crate::model::Model;
use crate::recording::{inputs, predicted, recordings};
use crate::values::from_json;
use crate::work::{self, Listener};

/// A result as Python values.
fn said<'py>(py: Python<'py>, result: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let value =
        serde_json::to_value(result).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    from_json(py, &value)
}

/// What simulates.
enum Simulated {
    /// A model.
    By(Arc<ModelFile>),
    /// Something that is known by a column of its angles.
    In(Prediction),
}

/// What a model leaves of recordings: correlations, prediction error over the time ahead, and
/// distribution, as `softrig residuals --json` writes them. With `prediction`, and None for the
/// model, what a simulation of your own leaves, whose angles are in that column.
#[pyfunction]
#[pyo3(signature = (model, recordings, *, prediction = None))]
pub fn residuals<'py>(
    py: Python<'py>,
    model: Option<&Bound<'py, Model>>,
    recordings: &Bound<'py, PyAny>,
    prediction: Option<&str>,
) -> PyResult<Bound<'py, PyAny>> {
    let [used, _] = inputs(py, &self::recordings(recordings)?, &[])?;
    let of = match (model, prediction) {
        (Some(model), None) => Simulated::By(Arc::clone(&model.get().file)),
        (None, Some(column)) => Simulated::In(predicted(column).or_raise(py)?),
        _ => {
            return Err(PyTypeError::new_err(
                "give a model, or None and prediction, the column of a simulation of your own",
            ));
        }
    };
    let work = move |_: &Job| match &of {
        Simulated::By(file) => Analysis::of(file, &used),
        Simulated::In(column) => Analysis::of_prediction(column, &used),
    };
    let (job, listener) = (Job::default(), Listener::new(None));
    let (analysis, warnings) = work::run(py, None, job, listener, work)?.or_raise(py)?;
    warn(py, warnings)?;
    said(py, &analysis)
}

/// A model for small motions about a rest, at an angle or under a pressure: state space, poles,
/// gain and bandwidth, as `softrig linearise --json` writes them.
#[pyfunction]
#[pyo3(signature = (model, *, at_deg = None, at_kpa = None))]
pub fn linearise<'py>(
    py: Python<'py>,
    model: &Bound<'py, Model>,
    at_deg: Option<f64>,
    at_kpa: Option<f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let rest = match (at_deg, at_kpa) {
        (Some(angle), None) => Rest::Angle(angle.to_radians()),
        (None, Some(pressure)) => Rest::Pressure(pressure * PASCAL_PER_KPA),
        _ => return Err(PyTypeError::new_err("give at_deg or at_kpa, one of them")),
    };
    let (_, result) = Linearised::at(&model.get().file, rest).or_raise(py)?;
    said(py, &result)
}

/// The runs that tell two effects apart, best first, as `softrig plan --json` writes them.
#[pyfunction]
#[pyo3(signature = (model, between, recordings = None, *, limits = None, noise_deg = None))]
pub fn plan<'py>(
    py: Python<'py>,
    model: &Bound<'py, Model>,
    between: String,
    recordings: Option<&Bound<'py, PyAny>>,
    limits: Option<&str>,
    noise_deg: Option<f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let given = recordings.map_or_else(|| Ok(Vec::new()), self::recordings)?;
    let [used, _] = inputs(py, &given, &[])?;
    let limits = self::limits(limits).or_raise(py)?;
    let file = Arc::clone(&model.get().file);
    let work = move |_: &Job| Plan::between(&file, used, &between, None, limits, noise_deg);
    let (job, listener) = (Job::default(), Listener::new(None));
    let (plan, _) = work::run(py, None, job, listener, work)?.or_raise(py)?;
    said(py, &plan)
}

/// A first model, identified from recordings as `softrig init --recording` does.
#[pyfunction]
#[pyo3(signature = (recordings, *, name = "model"))]
pub fn init(py: Python<'_>, recordings: &Bound<'_, PyAny>, name: &str) -> PyResult<Model> {
    let [used, _] = inputs(py, &self::recordings(recordings)?, &[])?;
    let assembled = assemble(&used, &[]).or_raise(py)?;
    warn(py, assembled.concerns.iter().map(ToString::to_string))?;
    let data = assembled.data;
    let work = move |_: &Job| from_recordings(&data, None);
    let (job, listener) = (Job::default(), Listener::new(None));
    let first = work::run(py, None, job, listener, work)?.or_raise(py)?;
    let nowhere: [PathBuf; 0] = [];
    let text = first.text(name, &nowhere, &Layout::default(), Path::new("model.toml"));
    let file = ModelFile::parse(&text, Path::new("model.toml")).or_raise(py)?;
    Ok(Model::of_memory(file))
}
