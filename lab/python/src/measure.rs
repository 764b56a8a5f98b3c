//! `softrig.gap` and `softrig.compare`: how far a model that is given is off.

use library::board_gap::{BoardGap, PredictedRun, predicted_runs};
use library::comparison::{Comparison, check_comparable};
use library::diagnose::Job;
use library::estimate::assemble::assemble;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use softrig_formats::model_file::ModelFile;

use crate::fault::{OrRaise, warn};
use crate::frame;
use crate::model::Model;
use crate::recording::{inputs, predicted, recordings};
use crate::values::from_json;
use crate::work::{self, Listener};

/// The error of the board's own prediction, before and after an upload.
///
/// The prediction is the column predicted_deg that `softrig record` writes. The result is what
/// `softrig gap --json` writes.
#[pyfunction]
#[pyo3(signature = (before, after = None))]
pub fn gap<'py>(
    py: Python<'py>,
    before: &Bound<'py, PyAny>,
    after: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let before = recordings(before)?;
    let after = after.map_or_else(|| Ok(Vec::new()), recordings)?;
    let [before, after] = inputs(py, &before, &after)?;
    let runs = |of: &[_]| -> PyResult<Vec<PredictedRun>> {
        let (runs, notes) = predicted_runs(of).or_raise(py)?;
        warn(py, notes)?;
        Ok(runs)
    };
    let gap = BoardGap::of(&runs(&before)?, &runs(&after)?);
    let value = serde_json::to_value(gap)
        .map_err(|error| pyo3::exceptions::PyRuntimeError::new_err(error.to_string()))?;
    from_json(py, &value)
}

/// The RMS error of each model against the mean of the repeats to each set-point, as a pandas
/// frame with the columns that `softrig compare -o` writes. `prediction` adds a simulation of your
/// own, whose angles are in that column of the recordings; then models may be None.
#[pyfunction]
#[pyo3(signature = (models, recordings, *, linear = false, prediction = None))]
pub fn compare<'py>(
    py: Python<'py>,
    models: Option<&Bound<'py, PyAny>>,
    recordings: &Bound<'py, PyAny>,
    linear: bool,
    prediction: Option<&str>,
) -> PyResult<Bound<'py, PyAny>> {
    let one = |item: &Bound<'py, PyAny>| -> PyResult<ModelFile> {
        Ok(ModelFile::clone(&item.cast::<Model>()?.get().file))
    };
    let files: Vec<ModelFile> = match models.map(|models| (models, one(models))) {
        None => Vec::new(),
        Some((_, Ok(file))) => vec![file],
        Some((several, Err(_))) => several
            .try_iter()?
            .map(|item| one(&item?))
            .collect::<PyResult<_>>()?,
    };
    let prediction = prediction.map(predicted).transpose().or_raise(py)?;
    if files.is_empty() && (linear || prediction.is_none()) {
        return Err(PyTypeError::new_err(
            "give a model, or several; without one prediction, the column of a simulation of your own",
        ));
    }
    let [used, _] = inputs(py, &crate::recording::recordings(recordings)?, &[])?;
    warn(py, check_comparable(&files, &used).or_raise(py)?)?;
    let assembled = assemble(&used, &[]).or_raise(py)?;
    warn(py, assembled.concerns.iter().map(ToString::to_string))?;
    let work = move |_: &Job| {
        let found = Comparison::of(&files, &assembled.data, linear);
        match &prediction {
            Some(prediction) => found.with_prediction(prediction),
            None => Ok(found),
        }
    };
    let found = work::run(py, None, Job::default(), Listener::new(None), work)?.or_raise(py)?;
    let rows = || {
        found.models.iter().flat_map(|model| {
            let errors = found.groups.iter().zip(&model.errors);
            errors.map(move |(group, error)| (model, group, error))
        })
    };
    let columns = PyDict::new(py);
    columns.set_item(
        "run",
        rows()
            .map(|(_, group, _)| &*group.label)
            .collect::<Vec<_>>(),
    )?;
    let setpoints: Vec<f64> = rows().map(|(_, group, _)| group.setpoint_deg).collect();
    columns.set_item("setpoint_deg", setpoints)?;
    let repeats: Vec<usize> = rows().map(|(_, group, _)| group.runs.len()).collect();
    columns.set_item("repeats", repeats)?;
    columns.set_item(
        "model",
        rows().map(|(model, ..)| &*model.name).collect::<Vec<_>>(),
    )?;
    let rms: Vec<f64> = rows().map(|(.., error)| error.rms_deg).collect();
    columns.set_item("rms_deg", rms)?;
    let percent: Vec<f64> = rows().map(|(.., error)| error.percent).collect();
    columns.set_item("rms_percent", percent)?;
    frame::of(py, &columns)
}
