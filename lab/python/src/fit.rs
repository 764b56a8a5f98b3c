//! `softrig.fit`.

use std::num::NonZero;
use std::sync::Arc;

use library::diagnose::Job;
use library::diagnose::decide::verdict::Zeros;
use library::estimate::fit as fits;
use library::estimate::refit::{NOT_CONVERGED, Refit, refit};
use library::statistics::rms;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use softrig_cli::cli::fit::table;
use softrig_formats::model_file::{ModelFile, parameter_unit, parameters, to_file_units};
use softrig_formats::numbers::tidy;

use crate::axes::{self, Curves};
use crate::fault::{OrRaise, warn};
use crate::frame::frame;
use crate::model::Model;
use crate::recording::{angle_deg, inputs, pressure_kpa, recordings};
use crate::values::{Array, array};
use crate::work::{self, Listener};

/// A fitted model beside the one that it began with.
#[pyclass(frozen, module = "softrig")]
#[derive(Debug)]
pub struct Fit {
    #[pyo3(get)]
    model: Py<Model>,
    given: Arc<ModelFile>,
    refit: Box<Refit>,
}

/// A parameter that was free, in the unit of model files.
#[pyclass(frozen, get_all, module = "softrig")]
#[derive(Clone, Debug)]
pub struct Parameter {
    /// Its unit.
    unit: &'static str,
    /// The value that the fit began with.
    nominal: f64,
    /// The fitted value.
    value: f64,
    /// The ends of the 95 % interval; None if the recordings do not determine it.
    interval95: Option<(f64, f64)>,
}

#[pymethods]
impl Parameter {
    fn __repr__(&self) -> String {
        let Self {
            unit,
            nominal,
            value,
            interval95,
        } = self;
        let interval = interval95.map_or_else(
            || "not determined".to_owned(),
            |(low, high)| format!("95 %: {low:.4} … {high:.4}"),
        );
        format!("<softrig.Parameter {nominal:.4} → {value:.4} {unit} ({interval})>")
    }
}

/// A run of a fit: what was measured, and what the model makes of it before and after.
#[pyclass(frozen, module = "softrig")]
#[derive(Clone, Debug)]
pub struct FitRun {
    name: String,
    time: Vec<f64>,
    pressure: Vec<f64>,
    measured: Vec<f64>,
    nominal: Vec<f64>,
    fitted: Vec<f64>,
}

#[pymethods]
impl FitRun {
    /// Name of the run.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    /// Time of each sample (s).
    #[getter]
    fn time_s<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.time)
    }

    /// Gauge pressure (kPa).
    #[getter]
    fn pressure_kpa<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.pressure)
    }

    /// The measured angle (°).
    #[getter]
    fn measured_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.measured)
    }

    /// The angle of the model as it was given (°).
    #[getter]
    fn nominal_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.nominal)
    }

    /// The angle of the fitted model (°).
    #[getter]
    fn fitted_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.fitted)
    }

    /// The fitted angle less the measured one (°).
    #[getter]
    fn residual_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &less(&self.fitted, &self.measured))
    }

    /// RMS error of the fitted model (°).
    #[getter]
    fn rmse_deg(&self) -> f64 {
        rms(&less(&self.fitted, &self.measured))
    }

    /// All of it as a pandas frame.
    fn to_pandas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        frame(
            py,
            &[
                ("time_s", Some(&self.time)),
                ("pressure_kpa", Some(&self.pressure)),
                ("measured_deg", Some(&self.measured)),
                ("nominal_deg", Some(&self.nominal)),
                ("fitted_deg", Some(&self.fitted)),
            ],
        )
    }

    fn __repr__(&self) -> String {
        format!(
            "<softrig.FitRun {:?}: {} samples, RMS error {:.3}°>",
            self.name,
            self.time.len(),
            self.rmse_deg()
        )
    }
}

fn less(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

#[pymethods]
impl Fit {
    /// The parameters that were free, by their keys in files.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let Refit {
            nominal, fitted, ..
        } = &*self.refit;
        let keys = parameters(&fitted.model);
        let dictionary = PyDict::new(py);
        for (index, &id) in fitted.free.iter().enumerate() {
            let shown = |value: f64| tidy(to_file_units(&fitted.model, id, value));
            let Some((_, key)) = keys.iter().find(|(known, _)| *known == id) else {
                continue;
            };
            let of = |fit: &fits::Fit| fit.model.value(id).map_or(f64::NAN, shown);
            let parameter = Parameter {
                unit: parameter_unit(&fitted.model, id),
                nominal: of(nominal),
                value: of(fitted),
                interval95: fitted
                    .interval95(index)
                    .filter(|(low, high)| low.is_finite() && high.is_finite())
                    .map(|(low, high)| (shown(low), shown(high))),
            };
            dictionary.set_item(key, Py::new(py, parameter)?)?;
        }
        Ok(dictionary)
    }

    /// Whether the fit met its tolerance.
    #[getter]
    fn converged(&self) -> bool {
        self.refit.fitted.converged
    }

    /// RMS error of the fitted model over all runs (°).
    #[getter]
    fn rmse_deg(&self) -> f64 {
        self.refit.fitted.rmse().to_degrees()
    }

    /// RMS error of the model as it was given (°).
    #[getter]
    fn nominal_rmse_deg(&self) -> f64 {
        self.refit.nominal.rmse().to_degrees()
    }

    /// What the pressure sensor shows without pressure (kPa), a number a session.
    #[getter]
    fn pressure_zero_kpa(&self) -> Vec<f64> {
        self.zeros().pressure_zero_kpa
    }

    /// What the angle sensor shows at 0° (°), a number a session.
    #[getter]
    fn angle_zero_deg(&self) -> Vec<f64> {
        self.zeros().angle_zero_deg
    }

    /// The runs that were fitted.
    #[getter]
    fn runs(&self) -> Vec<FitRun> {
        let Refit {
            data,
            nominal,
            fitted,
            ..
        } = &*self.refit;
        let series = nominal.residuals.iter().zip(fitted.residuals.iter());
        data.fitted()
            .zip(series)
            .map(|(segment, (nominal, fitted))| {
                let measured = angle_deg(&segment.recording);
                let angle = |residual: &[f64]| {
                    let pairs = residual.iter().zip(&measured);
                    pairs.map(|(r, m)| r.to_degrees() + m).collect()
                };
                FitRun {
                    name: segment.recording.name.clone(),
                    time: segment.recording.time.clone(),
                    pressure: pressure_kpa(&segment.recording),
                    nominal: angle(nominal),
                    fitted: angle(fitted),
                    measured,
                }
            })
            .collect()
    }

    /// Draws measured and simulated angles on matplotlib's axes, an array with one a run.
    fn plot<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let runs = self.runs();
        let curves: Vec<Curves<'_>> = runs
            .iter()
            .map(|run| Curves {
                name: &run.name,
                time: &run.time,
                measured: &run.measured,
                nominal: &run.nominal,
                after: &run.fitted,
            })
            .collect();
        axes::drawn(py, &curves, "fitted")
    }

    /// The tables that `softrig fit` prints.
    fn __str__(&self) -> String {
        table(&self.given, &self.refit)
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
        format!(
            "<softrig.Fit: RMS error {:.3}° → {:.3}°>",
            self.nominal_rmse_deg(),
            self.rmse_deg()
        )
    }
}

impl Fit {
    fn zeros(&self) -> Zeros {
        Zeros::of(&self.refit.fitted, &self.refit.data)
    }
}

/// Fits the free parameters of a model to recordings.
#[pyfunction]
#[pyo3(signature = (model, recordings, *, threads = None))]
pub fn fit(
    py: Python<'_>,
    model: &Bound<'_, Model>,
    recordings: &Bound<'_, PyAny>,
    threads: Option<NonZero<usize>>,
) -> PyResult<Fit> {
    let [fitted, _] = inputs(py, &self::recordings(recordings)?, &[])?;
    let given = model.get();
    let file = Arc::clone(&given.file);
    let work = move |_: &Job| refit(&file, &fitted);
    let (job, listener) = (Job::default(), Listener::new(None));
    let refit = work::run(py, threads, job, listener, work)?.or_raise(py)?;
    let mut warnings: Vec<String> = refit.concerns.iter().map(ToString::to_string).collect();
    if !refit.fitted.converged {
        warnings.push(NOT_CONVERGED.to_owned());
    }
    warn(py, warnings)?;
    let model = given.with(py, &given.file.text_with(&refit.fitted.model, ""))?;
    Ok(Fit {
        given: Arc::clone(&given.file),
        model: Py::new(py, model)?,
        refit: Box::new(refit),
    })
}
