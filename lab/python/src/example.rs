//! `softrig.example`: recordings with an effect hidden in them.

use std::path::{Path, PathBuf};

use library::synth::example::{Example as Made, Hidden, make};
use pyo3::prelude::*;
use softrig_formats::model_file::ModelFile;

use crate::fault::OrRaise;
use crate::kept;
use crate::model::Model;
use crate::recording::Recording;

/// Simulated recordings of an actuator that hides something.
#[pyclass(frozen, module = "softrig")]
#[derive(Debug)]
pub struct Example {
    /// The nominal model.
    #[pyo3(get)]
    model: Py<Model>,
    /// The answer: look here last.
    #[pyo3(get)]
    truth: Py<Model>,
    recordings: Vec<Recording>,
    inner: Made,
    /// Seed, effect and noise (°) that it was made with.
    call: (u64, Option<String>, f64),
}

#[pymethods]
impl Example {
    /// The recordings.
    #[getter]
    fn recordings(&self) -> Vec<Recording> {
        self.recordings.clone()
    }

    /// Writes model.toml, truth.toml and recordings/ into a folder, as `softrig example` does.
    fn write(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        self.inner.write(&folder).or_raise(py)
    }

    /// Makes an example of what [`Self::__reduce__`] gave.
    #[staticmethod]
    fn _restored(
        py: Python<'_>,
        seed: u64,
        effect: Option<&str>,
        noise_deg: f64,
    ) -> PyResult<Self> {
        example(py, seed, effect, noise_deg)
    }

    /// For pickle: the call, which makes the same again, to the last bit.
    fn __reduce__<'py>(&self, py: Python<'py>) -> kept::Reduced<'py, (u64, Option<String>, f64)> {
        kept::reduced::<Self, _>(py, self.call.clone())
    }

    /// Nothing of it changes, so it is its own copy.
    fn __copy__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    /// As [`Self::__copy__`].
    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __repr__(&self) -> String {
        format!("<softrig.Example: {} recordings>", self.recordings.len())
    }
}

/// Simulates recordings with an effect hidden in them.
///
/// The seed decides the actuator, the noise and the hidden effect, unless one is named;
/// "none" hides nothing but wrong parameters.
#[pyfunction]
#[pyo3(signature = (seed = 1, *, effect = None, noise_deg = 0.4))]
pub fn example(
    py: Python<'_>,
    seed: u64,
    effect: Option<&str>,
    noise_deg: f64,
) -> PyResult<Example> {
    let hidden = Hidden::named(effect).or_raise(py)?;
    let made = py.detach(|| make(hidden, noise_deg, seed)).or_raise(py)?;
    let model = |text: &str, name: &str| -> PyResult<Py<Model>> {
        let file = ModelFile::parse(text, Path::new(name)).or_raise(py)?;
        Py::new(py, Model::of_memory(file))
    };
    let recordings = made.as_read().or_raise(py)?;
    Ok(Example {
        model: model(&made.model, "model.toml")?,
        truth: model(&made.truth, "truth.toml")?,
        recordings: recordings.into_iter().map(Recording::of_memory).collect(),
        inner: made,
        call: (seed, effect.map(str::to_owned), noise_deg),
    })
}
