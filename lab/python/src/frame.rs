//! Columns as a pandas frame. pandas is imported only here, so that the package works
//! without it.

use pyo3::exceptions::PyImportError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use softrig_formats::error::InputError as Fault;

use crate::fault::raised;
use crate::values::array;

fn pandas(py: Python<'_>) -> PyResult<Bound<'_, PyModule>> {
    py.import("pandas").map_err(|error| {
        let wanted = PyImportError::new_err(
            "frames need pandas, which is not installed: pip install pandas",
        );
        wanted.set_cause(py, Some(error));
        wanted
    })
}

/// A frame of the columns that are there, in this order.
pub fn frame<'py>(
    py: Python<'py>,
    columns: &[(&str, Option<&[f64]>)],
) -> PyResult<Bound<'py, PyAny>> {
    let dictionary = PyDict::new(py);
    for (name, values) in columns {
        if let Some(values) = values {
            dictionary.set_item(name, array(py, values))?;
        }
    }
    of(py, &dictionary)
}

/// A frame of a dictionary of columns.
pub fn of<'py>(py: Python<'py>, columns: &Bound<'py, PyDict>) -> PyResult<Bound<'py, PyAny>> {
    pandas(py)?.call_method1("DataFrame", (columns,))
}

/// A column of a frame, or the frame's index if that has the name.
pub fn column<'py>(frame: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    let py = frame.py();
    let columns = frame.getattr("columns")?;
    if columns.contains(name)? {
        return frame.get_item(name);
    }
    let index = frame.getattr("index")?;
    if index.getattr("name")?.eq(name)? {
        return Ok(index);
    }
    let has: Vec<String> = columns
        .try_iter()?
        .map(|name| Ok(name?.str()?.to_string()))
        .collect::<PyResult<_>>()?;
    Err(raised(
        py,
        &Fault::new(
            format!("the frame has no column {name} (it has {})", has.join(", ")),
            "add it, or say which column holds it, such as angle_deg=\"theta\"",
        ),
    ))
}
