//! x
#![forbid(unsafe_code)]
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;

pyo3::create_exception!(softrig, InputError, pyo3::exceptions::PyValueError, "doc");

/// A.
#[pyclass(frozen, module = "softrig")]
#[derive(Debug)]
struct A {
    x: Vec<f64>,
}

#[pymethods]
impl A {
    #[new]
    fn new(x: Vec<f64>) -> Self {
        Self { x }
    }
    /// X.
    #[getter]
    fn x<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.x.clone().into_pyarray(py)
    }
}

/// Softrig.
#[pymodule]
mod softrig {
    #[pymodule_export]
    use super::A;
    #[pymodule_export]
    use super::InputError;
}
