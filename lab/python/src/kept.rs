//! Copies and pickles.
//!
//! Nothing that the package gives ever changes, so each object is its own copy. A pickle holds what
//! a class is made of; its hidden `_restored` makes the object again, to the last bit.

use pyo3::PyTypeInfo;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

/// What `__reduce__` gives: a function, and what it is called with to make the object again.
pub type Reduced<'py, P> = PyResult<(Bound<'py, PyAny>, P)>;

/// For `__reduce__` of a class whose `_restored` takes these parts.
pub fn reduced<T: PyTypeInfo, P>(py: Python<'_>, parts: P) -> Reduced<'_, P> {
    Ok((py.get_type::<T>().getattr("_restored")?, parts))
}

/// Why an object cannot be pickled, and what of it can be kept instead.
pub fn refused(class: &str, because: &str, keep: &str) -> PyErr {
    PyTypeError::new_err(format!(
        "a softrig.{class} cannot be pickled: {because}; keep {keep}"
    ))
}
