//! The Python package `softrig`: the `softrig` command on NumPy arrays and pandas frames.
//!
//! Nothing is computed here. Each module converts Python objects to those of `softrig`, the library,
//! calls it, and converts the results back: [`recording`], [`model`], [`simulation`],
//! [`fit`], [`diagnosis`], [`batch`], [`measure`], [`analysis`], [`example`]; [`command`] is `softrig` itself. They share the conversion of errors to exceptions
//! ([`fault`]), of numbers ([`values`], [`frame`], [`axes`], [`look`]), copies and pickles ([`kept`]), and long work without the interpreter's
//! lock ([`work`]).
//!
//! A test compares the definitions here with `softrig.pyi`.
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]
// What Python calls takes what Python gives, by value.
#![allow(clippy::needless_pass_by_value)]

use pyo3::prelude::*;

mod analysis;
mod axes;
mod batch;
mod command;
mod diagnosis;
mod example;
mod fault;
mod fit;
mod frame;
mod kept;
mod look;
mod measure;
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
    use super::analysis::{init, linearise, plan, residuals};
    #[pymodule_export]
    use super::batch::{Batch, batch};
    #[pymodule_export]
    use super::command::rig;
    #[pymodule_export]
    use super::diagnosis::{Diagnosis, Run, diagnose};
    #[pymodule_export]
    use super::example::{Example, example};
    #[pymodule_export]
    use super::fault::{InputError, InputWarning};
    #[pymodule_export]
    use super::fit::{Fit, FitRun, Parameter, fit};
    #[pymodule_export]
    use super::measure::{compare, gap};
    #[pymodule_export]
    use super::model::Model;
    #[pymodule_export]
    use super::progress::Progress;
    #[pymodule_export]
    use super::recording::{Recording, read};
    #[pymodule_export]
    use super::simulation::{Simulation, simulate};

    #[pymodule_init]
    fn fill(module: &Bound<'_, PyModule>) -> PyResult<()> {
        softrig_importers::install();
        softrig_print::install();
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
