//! `softrig.fit`.

use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use library::diagnose::Job;
use library::diagnose::decide::verdict::Zeros;
use library::estimate::fit as fits;
use library::estimate::refit::{NOT_CONVERGED, Refit, refit};
use library::statistics::rms;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use softrig_cli::cli::fit::table;
use softrig_cli::cli::output::{self, FileKind, Output};
use softrig_formats::measurand::Measurand;
use softrig_formats::model_file::{ModelFile, parameter_unit, parameters, to_file_units};
use softrig_formats::numbers::{counted, short, tidy};
use softrig_report::pictures::{DrawnRun, NOMINAL, figure_of_drawn, left_out, named};
use softrig_report::plot::{Figure, Style};

use crate::axes::{self, Curves};
use crate::fault::{OrRaise, warn};
use crate::frame::{Rows, frame};
use crate::kept;
use crate::look::{self, words};
use crate::model::Model;
use crate::recording::{angle_deg, inputs, pressure_kpa, recordings};
use crate::values::{Array, array};
use crate::work::{self, Listener};

/// Label of the curve of the fitted model.
const FITTED: &str = "fitted";

/// A fitted model beside the one that it began with.
#[pyclass(frozen, module = "softrig")]
#[derive(Debug)]
pub struct Fit {
    #[pyo3(get)]
    model: Py<Model>,
    parts: Parts,
}

/// What a fit is made of beside its model, and pickled as.
#[derive(Clone, Debug, FromPyObject, IntoPyObject)]
#[pyo3(from_item_all)]
struct Parts {
    /// Key, unit, value before, fitted value and interval of each free parameter.
    parameters: Vec<(String, OfParameter)>,
    converged: bool,
    rmse_deg: f64,
    nominal_rmse_deg: f64,
    pressure_zero_kpa: Vec<f64>,
    angle_zero_deg: Vec<f64>,
    runs: Vec<OfRun>,
    /// Files that it was made from, which a picture does not overwrite.
    files: Vec<PathBuf>,
    /// The name of the model.
    name: String,
    /// The tables that `softrig fit` prints.
    table: String,
}

/// Unit, value before, fitted value and interval of a parameter.
type OfParameter = (String, f64, f64, Option<(f64, f64)>);

/// What a run of a fit is made of, and pickled as.
#[derive(Clone, Debug, FromPyObject, IntoPyObject)]
#[pyo3(from_item_all)]
struct OfRun {
    name: String,
    time: Vec<f64>,
    pressure: Vec<f64>,
    measured: Vec<f64>,
    nominal: Vec<f64>,
    fitted: Vec<f64>,
    /// Samples of the angle and of the pressure that are not believed.
    left_out: [Vec<usize>; 2],
    /// When time 0 was (s since 1970, UTC), if that is known.
    zero_unix_s: Option<f64>,
    /// Name and unit of the output: `angle_deg`.
    column: String,
}

/// A parameter that was free, in the unit of model files.
#[pyclass(frozen, get_all, module = "softrig")]
#[derive(Clone, Debug)]
pub struct Parameter {
    /// Its unit.
    unit: String,
    /// The value that the fit began with.
    nominal: f64,
    /// The fitted value.
    value: f64,
    /// The ends of the 95 % interval; None if the recordings do not determine it.
    interval95: Option<(f64, f64)>,
}

#[pymethods]
impl Parameter {
    /// Makes a parameter of what [`Self::__reduce__`] gave.
    #[staticmethod]
    fn _restored(unit: String, nominal: f64, value: f64, interval95: Option<(f64, f64)>) -> Self {
        Self {
            unit,
            nominal,
            value,
            interval95,
        }
    }

    /// For pickle.
    fn __reduce__<'py>(&self, py: Python<'py>) -> kept::Reduced<'py, OfParameter> {
        let Self { unit, nominal, .. } = self;
        let parts = (unit.clone(), *nominal, self.value, self.interval95);
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
pub struct FitRun(OfRun);

#[pymethods]
impl FitRun {
    /// Makes a run of what [`Self::__reduce__`] gave.
    #[staticmethod]
    fn _restored(parts: OfRun) -> Self {
        Self(parts)
    }

    /// For pickle.
    fn __reduce__<'py>(&self, py: Python<'py>) -> kept::Reduced<'py, (OfRun,)> {
        kept::reduced::<Self, _>(py, (self.0.clone(),))
    }

    /// Nothing of it changes, so it is its own copy.
    fn __copy__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    /// As [`Self::__copy__`].
    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    /// Name of the run.
    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// Time of each sample (s).
    #[getter]
    fn time_s<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.0.time)
    }

    /// Gauge pressure (kPa).
    #[getter]
    fn pressure_kpa<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.0.pressure)
    }

    /// The measured angle (°).
    #[getter]
    fn measured_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.0.measured)
    }

    /// The angle of the model as it was given (°).
    #[getter]
    fn nominal_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.0.nominal)
    }

    /// The angle of the fitted model (°).
    #[getter]
    fn fitted_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.0.fitted)
    }

    /// The fitted angle less the measured one (°).
    #[getter]
    fn residual_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &less(&self.0.fitted, &self.0.measured))
    }

    /// RMS error of the fitted model (°).
    #[getter]
    fn rmse_deg(&self) -> f64 {
        rms(&less(&self.0.fitted, &self.0.measured))
    }

    /// All of it as a pandas frame.
    fn to_pandas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        frame(
            py,
            &Rows {
                time: &self.0.time,
                zero_unix_s: self.0.zero_unix_s,
                measurand: Measurand::of_column(&self.0.column),
            },
            &[
                ("pressure_kpa", Some(&self.0.pressure)),
                ("measured_deg", Some(&self.0.measured)),
                ("nominal_deg", Some(&self.0.nominal)),
                ("fitted_deg", Some(&self.0.fitted)),
            ],
        )
    }

    fn __repr__(&self) -> String {
        format!(
            "<softrig.FitRun {:?}: {} samples, RMS error {:.3}{}>",
            self.0.name,
            self.0.time.len(),
            self.rmse_deg(),
            Measurand::of_column(&self.0.column).unit()
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
        let dictionary = PyDict::new(py);
        for (key, (unit, nominal, value, interval95)) in self.parts.parameters.clone() {
            let parameter = Parameter {
                unit,
                nominal,
                value,
                interval95,
            };
            dictionary.set_item(key, Py::new(py, parameter)?)?;
        }
        Ok(dictionary)
    }

    /// Whether the fit met its tolerance.
    #[getter]
    fn converged(&self) -> bool {
        self.parts.converged
    }

    /// RMS error of the fitted model over all runs (°).
    #[getter]
    fn rmse_deg(&self) -> f64 {
        self.parts.rmse_deg
    }

    /// RMS error of the model as it was given (°).
    #[getter]
    fn nominal_rmse_deg(&self) -> f64 {
        self.parts.nominal_rmse_deg
    }

    /// What the pressure sensor shows without pressure (kPa), a number a session.
    #[getter]
    fn pressure_zero_kpa(&self) -> Vec<f64> {
        self.parts.pressure_zero_kpa.clone()
    }

    /// What the angle sensor shows at 0° (°), a number a session.
    #[getter]
    fn angle_zero_deg(&self) -> Vec<f64> {
        self.parts.angle_zero_deg.clone()
    }

    /// The runs that were fitted.
    #[getter]
    fn runs(&self) -> Vec<FitRun> {
        self.parts.runs.iter().cloned().map(FitRun).collect()
    }

    /// Draws measured and simulated angles: with a path as a picture, SVG, PDF or PNG by its
    /// extension, without one on matplotlib's axes, an array with one a run.
    #[pyo3(signature = (path = None, *, runs = None, **look))]
    fn plot<'py>(
        &self,
        py: Python<'py>,
        path: Option<PathBuf>,
        runs: Option<&Bound<'py, PyAny>>,
        look: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        let all = &self.parts.runs;
        let drawn: Vec<&OfRun> = match runs {
            Some(names) => {
                named(all, &words(names)?, |run| (&run.name, Path::new(""))).or_raise(py)?
            }
            None => all.iter().collect(),
        };
        let Some(path) = path else {
            look::refuse(py, look)?;
            let curves = drawn.iter().map(|run| Curves {
                name: &run.name,
                time: &run.time,
                measured: &run.measured,
                nominal: &run.nominal,
                after: &run.fitted,
            });
            return axes::drawn(py, &curves.collect::<Vec<_>>(), FITTED, &self.measurand())
                .map(Some);
        };
        let output = Output::of("plot", FileKind::Picture, Some(&path));
        output::check(&[output], &self.parts.files).or_raise(py)?;
        look::draw(py, &path, &self.figure(&drawn), look)?;
        Ok(None)
    }

    /// The tables that `softrig fit` prints.
    fn __str__(&self) -> &str {
        &self.parts.table
    }

    /// Makes a fit of what [`Self::__reduce__`] gave.
    #[staticmethod]
    fn _restored(model: Py<Model>, parts: Parts) -> Self {
        Self { model, parts }
    }

    /// For pickle.
    fn __reduce__<'py>(&self, py: Python<'py>) -> kept::Reduced<'py, (Py<Model>, Parts)> {
        let parts = (self.model.clone_ref(py), self.parts.clone());
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
        let unit = self.measurand().unit();
        format!(
            "<softrig.Fit: RMS error {:.3}{unit} → {:.3}{unit}>",
            self.parts.nominal_rmse_deg, self.parts.rmse_deg
        )
    }
}

impl Fit {
    /// What the output is.
    fn measurand(&self) -> Measurand {
        let first = self.parts.runs.first();
        first.map_or_else(Measurand::default, |run| Measurand::of_column(&run.column))
    }

    /// The picture of some of its runs.
    fn figure(&self, runs: &[&OfRun]) -> Figure {
        let residuals: Vec<[Vec<f64>; 2]> = runs
            .iter()
            .map(|run| [&run.nominal, &run.fitted].map(|angle| less(angle, &run.measured)))
            .collect();
        let drawn = runs
            .iter()
            .zip(&residuals)
            .map(|(run, [nominal, fitted])| DrawnRun {
                title: run.name.clone(),
                time: &run.time,
                measured: &run.measured,
                pressure: &run.pressure,
                models: vec![
                    (NOMINAL, Style::NOMINAL, nominal.as_slice()),
                    (FITTED, Style::AFTER, fitted),
                ],
                left_out: run.left_out.clone(),
            });
        let [nominal, fitted] = [self.parts.nominal_rmse_deg, self.parts.rmse_deg].map(short);
        let measurand = self.measurand();
        let unit = measurand.unit();
        figure_of_drawn(
            format!(
                "{} fitted to {}",
                self.parts.name,
                counted(self.parts.runs.len(), "run")
            ),
            format!("RMS error: {nominal}{unit} as supplied, {fitted}{unit} fitted"),
            &measurand,
            &drawn.collect::<Vec<_>>(),
        )
    }
}

impl Parts {
    fn of(given: &ModelFile, refit: &Refit, files: Vec<PathBuf>) -> Self {
        let Refit {
            data,
            nominal,
            fitted,
            ..
        } = refit;
        let zeros = Zeros::of(fitted, data);
        Self {
            parameters: parameters_of(refit),
            converged: fitted.converged,
            rmse_deg: fitted.rmse().to_degrees(),
            nominal_rmse_deg: nominal.rmse().to_degrees(),
            pressure_zero_kpa: zeros.pressure_zero_kpa,
            angle_zero_deg: zeros.angle_zero_deg,
            runs: runs_of(refit),
            files,
            name: given.name.clone(),
            table: table(given, refit),
        }
    }
}

fn parameters_of(refit: &Refit) -> Vec<(String, OfParameter)> {
    let Refit {
        nominal, fitted, ..
    } = refit;
    let keys = parameters(&fitted.model);
    let of = |(index, &id)| {
        let shown = |value: f64| tidy(to_file_units(&fitted.model, id, value));
        let (_, key) = keys.iter().find(|(known, _)| *known == id)?;
        let value = |fit: &fits::Fit| fit.model.value(id).map_or(f64::NAN, shown);
        let interval = fitted
            .interval95(index)
            .filter(|(low, high)| low.is_finite() && high.is_finite())
            .map(|(low, high)| (shown(low), shown(high)));
        let unit = parameter_unit(&fitted.model, id).to_owned();
        Some((key.clone(), (unit, value(nominal), value(fitted), interval)))
    };
    fitted.free.iter().enumerate().filter_map(of).collect()
}

fn runs_of(refit: &Refit) -> Vec<OfRun> {
    let Refit {
        data,
        nominal,
        fitted,
        ..
    } = refit;
    let series = nominal.residuals.iter().zip(fitted.residuals.iter());
    data.fitted()
        .zip(series)
        .map(|(segment, (nominal, fitted))| {
            let measured = angle_deg(&segment.recording);
            let angle = |residual: &[f64]| {
                let pairs = residual.iter().zip(&measured);
                pairs.map(|(r, m)| r.to_degrees() + m).collect()
            };
            OfRun {
                name: segment.recording.name.clone(),
                time: segment.recording.time.clone(),
                pressure: pressure_kpa(&segment.recording),
                nominal: angle(nominal),
                fitted: angle(fitted),
                left_out: left_out(&segment.recording),
                zero_unix_s: data.zero_unix_s(segment),
                column: segment.recording.measurand.column(),
                measured,
            }
        })
        .collect()
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
    let paths = fitted.iter().map(|recording| recording.path.clone());
    let files = paths.chain([given.file.path.clone()]).collect();
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
        model: Py::new(py, model)?,
        parts: Parts::of(&given.file, &refit, files),
    })
}
