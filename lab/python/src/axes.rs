//! Angles over time on the axes of matplotlib, for those who go on drawing.

use pyo3::exceptions::PyImportError;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

use softrig_formats::measurand::Measurand;

use crate::values::array;

/// A run with its angles (°) over time (s): measured, of the model as it was given, and of the one
/// that came of it.
pub struct Curves<'a> {
    pub name: &'a str,
    pub time: &'a [f64],
    pub measured: &'a [f64],
    pub nominal: &'a [f64],
    pub after: &'a [f64],
}

/// One axes a run, one below the other, as a NumPy array; `after` is the label of the last curve.
pub fn drawn<'py>(
    py: Python<'py>,
    runs: &[Curves<'_>],
    after: &str,
    measurand: &Measurand,
) -> PyResult<Bound<'py, PyAny>> {
    /// Inches of a run.
    const SIZE: [f64; 2] = [8.0, 2.4];
    let pyplot = py.import("matplotlib.pyplot").map_err(|_| {
        PyImportError::new_err("matplotlib is not installed: pip install 'softrig[plot]'")
    })?;
    let options = PyDict::new(py);
    options.set_item("squeeze", false)?;
    options.set_item("layout", "constrained")?;
    options.set_item("figsize", (SIZE[0], SIZE[1] * runs.len().max(1) as f64))?;
    let (_, axes): (Bound<'py, PyAny>, Bound<'py, PyAny>) = pyplot
        .call_method("subplots", (runs.len().max(1), 1), Some(&options))?
        .extract()?;
    let axes = axes.call_method0("flatten")?;
    for (place, run) in runs.iter().enumerate() {
        let one = axes.get_item(place)?;
        for (label, angles) in [
            ("measured", run.measured),
            ("nominal", run.nominal),
            (after, run.after),
        ] {
            let label = [("label", label)].into_py_dict(py)?;
            one.call_method(
                "plot",
                (array(py, run.time), array(py, angles)),
                Some(&label),
            )?;
        }
        let left = [("loc", "left")].into_py_dict(py)?;
        one.call_method("set_title", (run.name,), Some(&left))?;
        one.call_method1("set_ylabel", (measurand.label(),))?;
        if place == 0 {
            one.call_method0("legend")?;
        }
        if place + 1 == runs.len() {
            one.call_method1("set_xlabel", ("time (s)",))?;
        }
    }
    Ok(axes)
}
