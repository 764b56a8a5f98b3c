//! The `softrig` command that the package installs.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs `softrig` with the arguments of this process and returns its exit code.
#[pyfunction]
#[pyo3(name = "_command")]
pub fn rig(py: Python<'_>) -> PyResult<u8> {
    let arguments: Vec<OsString> = py.import("sys")?.getattr("argv")?.extract()?;
    // Python only notes Ctrl-C, for when it gets a word again. The command listens itself where a
    // rig has to be stopped first, and otherwise ends.
    let signal = py.import("signal")?;
    let default = signal.getattr("SIG_DFL")?;
    signal.call_method1("signal", (signal.getattr("SIGINT")?, default))?;
    Ok(py.detach(|| softrig_cli::command::main(&arguments)))
}
