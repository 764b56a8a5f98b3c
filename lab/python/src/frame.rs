//! Columns as a pandas frame. pandas is imported only here, so that the package works
//! without it.

use numpy::IntoPyArray;
use pyo3::exceptions::PyImportError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use softrig_formats::error::InputError as Fault;
use softrig_formats::measurand::Measurand;

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

/// The column of dates.
pub const TIME_UTC: &str = "time_utc";

/// What is known of the rows of a frame.
pub struct Rows<'a> {
    /// Time of each (s).
    pub time: &'a [f64],
    /// When time 0 was (s since 1970, UTC), if that is known.
    pub zero_unix_s: Option<f64>,
    /// What the output is.
    pub measurand: Measurand,
}

/// A frame of the times and the other columns that are there, in this order, and of dates behind
/// them, if they are known. Columns of an output that is no angle have its unit in their names:
/// `measured_mm`.
pub fn frame<'py>(
    py: Python<'py>,
    rows: &Rows<'_>,
    columns: &[(&str, Option<&[f64]>)],
) -> PyResult<Bound<'py, PyAny>> {
    let dictionary = PyDict::new(py);
    dictionary.set_item("time_s", array(py, rows.time))?;
    for (name, values) in columns {
        if let Some(values) = values {
            let name = match name.strip_suffix("_deg") {
                Some(stem) => format!("{stem}_{}", rows.measurand.suffix()),
                None => (*name).to_owned(),
            };
            dictionary.set_item(name, array(py, values))?;
        }
    }
    let frame = of(py, &dictionary)?;
    add_dates(&frame, rows.time, rows.zero_unix_s)?;
    Ok(frame)
}

/// Adds the dates of times (s) to a frame, if it is known when time 0 was (s since 1970, UTC).
pub fn add_dates(frame: &Bound<'_, PyAny>, time: &[f64], zero_unix_s: Option<f64>) -> PyResult<()> {
    let Some(zero) = zero_unix_s else {
        return Ok(());
    };
    let py = frame.py();
    // A double has the seconds of this century to a microsecond only.
    #[allow(clippy::cast_possible_truncation)] // saturates
    let nanoseconds: Vec<i64> = time
        .iter()
        .map(|time| {
            let whole = time.floor();
            let seconds = (zero + whole) * 1e6;
            seconds.round() as i64 * 1000 + ((time - whole) * 1e9).round() as i64
        })
        .collect();
    let options = PyDict::new(py);
    options.set_item("unit", "ns")?;
    options.set_item("utc", true)?;
    let dates = pandas(py)?.call_method(
        "to_datetime",
        (nanoseconds.into_pyarray(py),),
        Some(&options),
    )?;
    frame.set_item(TIME_UTC, dates)
}

/// When time 0 was (s since 1970, UTC) by the dates of a frame; none where it has no such column.
/// `row` is one of its rows, which is at `time` (s).
pub fn zero_unix_s(frame: &Bound<'_, PyAny>, row: usize, time: f64) -> PyResult<Option<f64>> {
    if !frame.getattr("columns")?.contains(TIME_UTC)? {
        return Ok(None);
    }
    let options = PyDict::new(frame.py());
    options.set_item("utc", true)?;
    let column = frame.get_item(TIME_UTC)?;
    let dates = pandas(frame.py())?.call_method("to_datetime", (column,), Some(&options))?;
    let date = dates.getattr("iloc")?.get_item(row)?;
    let unix_s: f64 = date.call_method0("timestamp")?.extract()?;
    Ok(Some(unix_s - time).filter(|it| it.is_finite()))
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
