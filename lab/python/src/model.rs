//! `softrig.Model`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use softrig_cli::cli::export::{Exported, Target, exported};
use softrig_cli::cli::output::{self, FileKind, Output};
use softrig_export::Defaults;
use softrig_formats::error::{InputError as Fault, write_atomically};
use softrig_formats::model_file::{
    ModelFile, from_file_units, parameter_unit, parameters, to_file_units,
};
use softrig_formats::numbers::tidy;
use softrig_report::provenance::{MODEL, Source};

use crate::fault::{OrRaise, warn};
use crate::kept;

/// A model: its parameters, what a fit may move, and the text of its file.
#[pyclass(frozen, module = "softrig")]
#[derive(Clone, Debug)]
pub struct Model {
    pub file: Arc<ModelFile>,
    is_of_file: bool,
}

#[pymethods]
impl Model {
    /// Reads and checks a model file.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let file = ModelFile::read(&path).or_raise(py)?;
        Ok(Self {
            file: Arc::new(file),
            is_of_file: true,
        })
    }

    /// Parses the text of a model file; `name` is named in messages.
    #[staticmethod]
    #[pyo3(signature = (text, *, name = "model.toml"))]
    fn from_toml(py: Python<'_>, text: &str, name: &str) -> PyResult<Self> {
        let file = ModelFile::parse(text, Path::new(name)).or_raise(py)?;
        Ok(Self::of_memory(file))
    }

    /// The text of the model file, with its comments.
    fn to_toml(&self) -> &str {
        self.file.text()
    }

    /// Writes the model file.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let outputs = [Output::of("write", FileKind::Model, Some(&path))];
        output::check(&outputs, [])
            .and_then(|()| write_atomically(&path, self.file.text().as_bytes()))
            .or_raise(py)
    }

    /// Writes the model as a file of another tool, as `softrig export` does: C (.c), Python (.py),
    /// MATLAB (.m), Modelica (.mo), or a functional mock-up unit (.fmu).
    fn export(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let outputs = [Output::of("export", FileKind::Code, Some(&path))];
        let target = Target::of(&path).ok_or_else(|| {
            Fault::new(
                format!("{} has no extension that is known", path.display()),
                "end it with .c, .py, .m, .mo or .fmu",
            )
        });
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let exported = target.and_then(|target| {
            output::check(&outputs, [])?;
            exported(&self.file, target, &name, Defaults::default())
        });
        let Exported { content, warning } = exported.or_raise(py)?;
        warn(py, warning)?;
        write_atomically(&path, &content).or_raise(py)
    }

    /// Name for reports.
    #[getter]
    fn name(&self) -> &str {
        &self.file.name
    }

    /// The file that it was read from; None if it is of a text.
    #[getter]
    fn path(&self) -> Option<&Path> {
        self.is_of_file.then_some(self.file.path.as_path())
    }

    /// All parameters in the units that their keys say, those of an effect behind its kind.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dictionary = PyDict::new(py);
        for (key, value) in self.values() {
            dictionary.set_item(key, value)?;
        }
        Ok(dictionary)
    }

    /// Units of the parameters, by the same keys.
    #[getter]
    fn units<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dictionary = PyDict::new(py);
        for (id, key) in parameters(&self.file.model) {
            dictionary.set_item(key, parameter_unit(&self.file.model, id))?;
        }
        Ok(dictionary)
    }

    /// Keys of the parameters that a fit may move.
    #[getter]
    fn free(&self) -> Vec<String> {
        let all = parameters(&self.file.model).into_iter();
        all.filter(|(id, _)| self.file.free.contains(id))
            .map(|(_, key)| key)
            .collect()
    }

    /// Kinds of the effects, in the order of the file.
    #[getter]
    fn effects(&self) -> Vec<&'static str> {
        let effects = self.file.model.effects();
        effects.map(|effect| effect.kind().name()).collect()
    }

    /// Effective inertia (kg·m).
    #[getter]
    fn inertia_kg_m(&self) -> f64 {
        self.value_of("inertia_kg_m")
    }

    /// Viscous damping (N·s/rad).
    #[getter]
    fn damping_n_s_per_rad(&self) -> f64 {
        self.value_of("damping_n_s_per_rad")
    }

    /// Stiffness (N/radⁿ).
    #[getter]
    fn stiffness_n_per_rad_n(&self) -> f64 {
        self.value_of("stiffness_n_per_rad_n")
    }

    /// Exponent n of the stiffness.
    #[getter]
    fn exponent(&self) -> f64 {
        self.value_of("exponent")
    }

    /// Force for each kPa (N/kPa).
    #[getter]
    fn input_gain_n_per_kpa(&self) -> f64 {
        self.value_of("input_gain_n_per_kpa")
    }

    /// The model with other parameters: `model.replace(exponent=2.0)`. Keys with a dot are
    /// given as `model.replace(**{"gravity.force_n": 0.3})`.
    #[pyo3(signature = (**parameters))]
    fn replace(&self, py: Python<'_>, parameters: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut model = self.file.model;
        for (key, value) in parameters.into_iter().flatten() {
            let key: String = key.extract()?;
            let id = self.id(&key).or_raise(py)?;
            let value: f64 = value.extract()?;
            model = model.with_value(id, from_file_units(&model, id, value));
        }
        self.with(py, &self.file.text_with(&model, ""))
    }

    /// Makes a model of what [`Self::__reduce__`] gave.
    #[staticmethod]
    fn _restored(py: Python<'_>, text: &str, path: PathBuf, is_of_file: bool) -> PyResult<Self> {
        let file = ModelFile::parse(text, &path).or_raise(py)?;
        Ok(Self {
            file: Arc::new(file),
            is_of_file,
        })
    }

    /// For pickle: the text of its file, so that other processes need no file.
    fn __reduce__<'py>(&self, py: Python<'py>) -> kept::Reduced<'py, (String, PathBuf, bool)> {
        let Self { file, is_of_file } = self;
        let parts = (file.text().to_owned(), file.path.clone(), *is_of_file);
        kept::reduced::<Self, _>(py, parts)
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
        let parameters: Vec<String> = self
            .values()
            .into_iter()
            .map(|(key, value)| format!("{key}={value}"))
            .collect();
        let name = &self.file.name;
        format!("<softrig.Model {name:?}: {}>", parameters.join(", "))
    }
}

impl Model {
    /// A model that is in no file.
    pub fn of_memory(file: ModelFile) -> Self {
        Self {
            file: Arc::new(file),
            is_of_file: false,
        }
    }

    /// A model of another text that stands for this one.
    pub fn with(&self, py: Python<'_>, text: &str) -> PyResult<Self> {
        ModelFile::parse(text, &self.file.path)
            .map(Self::of_memory)
            .or_raise(py)
    }

    /// Whether it was read from a file.
    pub fn is_of_file(&self) -> bool {
        self.is_of_file
    }

    /// What a report says that it was made from.
    pub fn source(&self) -> Source {
        let mut path = self.file.path.display().to_string();
        if !self.is_of_file {
            path += ", in memory";
        }
        Source::of(MODEL, path, self.file.text().as_bytes())
    }

    fn values(&self) -> Vec<(String, f64)> {
        let model = &self.file.model;
        parameters(model)
            .into_iter()
            .filter_map(|(id, key)| Some((key, tidy(to_file_units(model, id, model.value(id)?)))))
            .collect()
    }

    fn value_of(&self, key: &str) -> f64 {
        let mut values = self.values().into_iter();
        values
            .find(|(known, _)| known == key)
            .map_or(f64::NAN, |(_, value)| value)
    }

    fn id(&self, key: &str) -> Result<model_core::actuator::ParameterId, Fault> {
        let known = parameters(&self.file.model);
        let found = known.iter().find(|(_, known)| known == key);
        found.map(|&(id, _)| id).ok_or_else(|| {
            let known: Vec<&str> = known.iter().map(|(_, key)| key.as_str()).collect();
            Fault::new(
                format!("the model has no parameter {key}"),
                format!("use one of: {}", known.join(", ")),
            )
        })
    }
}
