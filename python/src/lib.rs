//! The Python package `softrig`: what the `rig` command does, on NumPy arrays and pandas
//! frames.
//!
//! Nothing is computed here. Each module turns the objects of Python into those of
//! `host_tools`, calls it, and turns the results back: [`recording`], [`model`],
//! [`simulation`], [`fit`], [`diagnosis`], [`example`]. What they share is how faults of the
//! input become exceptions ([`fault`]), how numbers cross ([`values`], [`frame`]) and how
//! long work leaves the interpreter free ([`work`]).
//!
//! What is defined here and what `softrig.pyi` says of it is held together by a test.
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]
// What Python calls takes what Python gives, by value.
#![allow(clippy::needless_pass_by_value)]

use pyo3::prelude::*;

mod diagnosis;
mod example;
mod fault;
mod fit;
mod frame;
mod model;
mod progress;
mod recording;
mod simulation;
mod values;
mod work;

/// Finds where the simulation of a soft pneumatic actuator and its measurements disagree,
/// names the missing effect, and repairs the model.
#[pymodule]
mod softrig {
    use super::{Bound, PyModule, PyModuleMethods, PyResult};

    #[pymodule_export]
    use super::diagnosis::{Diagnosis, Run, diagnose};
    #[pymodule_export]
    use super::example::{Example, example};
    #[pymodule_export]
    use super::fault::{InputError, InputWarning};
    #[pymodule_export]
    use super::fit::{Fit, FitRun, Parameter, fit};
    #[pymodule_export]
    use super::model::Model;
    #[pymodule_export]
    use super::progress::Progress;
    #[pymodule_export]
    use super::recording::{Recording, read};
    #[pymodule_export]
    use super::simulation::{Simulation, simulate};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
