//! Input errors as exceptions, and unusual inputs as warnings.
//!
//! The text is that of `softrig`: the place, the problem and the advice. Its parts are attributes
//! of the exception.

use std::ffi::CString;

use pyo3::exceptions::{PyUserWarning, PyValueError};
use pyo3::prelude::*;
use softrig_formats::error::InputError as Fault;

pyo3::create_exception!(
    softrig,
    InputError,
    PyValueError,
    "A fault in a file or an argument: where it is, what was found, and what to do about it."
);

pyo3::create_exception!(
    softrig,
    InputWarning,
    PyUserWarning,
    "Something unusual about a recording that may be meant."
);

/// The exception of a fault.
pub fn raised(py: Python<'_>, fault: &Fault) -> PyErr {
    let error = InputError::new_err(fault.to_string());
    let value = error.value(py);
    let parts = || -> PyResult<()> {
        let file = fault.file.as_ref().map(|path| path.display().to_string());
        value.setattr("file", file)?;
        value.setattr("line", fault.line)?;
        value.setattr("column", fault.column.as_deref())?;
        value.setattr("found", &fault.found)?;
        value.setattr("advice", &fault.advice)
    };
    match parts() {
        Ok(()) => error,
        Err(other) => other,
    }
}

/// A result whose fault becomes an exception.
pub trait OrRaise<T> {
    /// The value, or the exception.
    fn or_raise(self, py: Python<'_>) -> PyResult<T>;
}

impl<T> OrRaise<T> for Result<T, Fault> {
    fn or_raise(self, py: Python<'_>) -> PyResult<T> {
        self.map_err(|fault| raised(py, &fault))
    }
}

/// Says what is unusual where the caller's filters for warnings decide.
pub fn warn(py: Python<'_>, texts: impl IntoIterator<Item = String>) -> PyResult<()> {
    for text in texts {
        let text = softrig_formats::terminal::printable_line(&text).replace('\0', " ");
        let text = CString::new(text)?;
        PyErr::warn(py, py.get_type::<InputWarning>().as_any(), &text, 1)?;
    }
    Ok(())
}
