//! `softrig.diagnose`.

use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use library::diagnose::decide::verdict::{Verdict, schema};
use library::diagnose::{Budget, Diagnosis as Found, Job, Request, diagnose_from};
use library::estimate::checkpoint::Checkpoint;
use library::estimate::placement::with_tip_load;
use library::prediction::{Prediction, StandIn};
use minijinja::value::Serde;
use minijinja::{Environment, context};
use pyo3::exceptions::{PyAttributeError, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyTuple};
use softrig_cli::cli::output::{self, FileKind, Output};
use softrig_formats::error::{InputError as Fault, write_atomically};
use softrig_formats::measurand::Measurand;
use softrig_formats::model_file::ModelFile;
use softrig_formats::own_effects::OwnEffects;
use softrig_formats::recording;
use softrig_report::Outputs;
use softrig_report::content::Content;
use softrig_report::html::page;
use softrig_report::pictures::{figure, figure_of_runs, named};
use softrig_report::provenance::{EFFECTS, FITTED, HELD_OUT, Provenance, Source, today};
use softrig_report::runs::runs;
use softrig_report::terminal::{KEEP, summary};

use crate::axes::{self, Curves};
use crate::fault::OrRaise;
use crate::fault::warn;
use crate::frame::{Rows, frame};
use crate::kept;
use crate::look::{self, words};
use crate::model::Model;
use crate::recording::{Recording, inputs, predicted, recordings};
use crate::values::{Array, array, object};
use crate::work::{self, Listener};

/// The summary in a notebook.
const TEMPLATE: &str = include_str!("assets/summary.html");

/// How the result is kept.
const KEEP_HERE: &str =
    "Call .report(\"report.html\") or .model.write(\"repaired.toml\") to keep the result.";

/// What a diagnosis found.
#[pyclass(frozen, module = "softrig")]
pub struct Diagnosis {
    model: Py<Model>,
    file: ModelFile,
    fitted: Vec<recording::Recording>,
    held_out: Vec<recording::Recording>,
    own: Option<OwnEffects>,
    formulas: bool,
    seed: u64,
    seconds: f64,
    provenance: Provenance,
    content: Content,
    found: Box<Found>,
    runs: PyOnceLock<Py<PyTuple>>,
    /// What stands in for a simulation of somebody's own, if the diagnosis is about one.
    stand_in: Option<StandIn>,
}

#[pymethods]
impl Diagnosis {
    /// The model to go on with. A simulation of which only predictions are known has none.
    #[getter]
    fn model(&self, py: Python<'_>) -> PyResult<Py<Model>> {
        match &self.stand_in {
            None => Ok(self.model.clone_ref(py)),
            Some(stand_in) => Err(PyAttributeError::new_err(format!(
                "this diagnosis is of {}, a simulation known only by its predictions: there is no \
                 model to repair; .verdict.effects has what it lacks, with the parameters of its \
                 substitute model",
                stand_in.column
            ))),
        }
    }

    /// The answer: effect_found, parameters_only, no_discrepancy, cannot_tell or unexplained.
    #[getter]
    fn answer(&self) -> PyResult<String> {
        let answer = serde_json::to_value(self.found.finding.answer()).map_err(defect)?;
        Ok(answer.as_str().unwrap_or_default().to_owned())
    }

    /// The answer in one sentence.
    #[getter]
    fn sentence(&self) -> &str {
        &self.content.sentence
    }

    /// Kinds of the effects that are named, as in model files.
    #[getter]
    fn effects(&self) -> Vec<&'static str> {
        self.found
            .finding
            .inclusions()
            .iter()
            .map(|it| it.kind.name())
            .collect()
    }

    /// What is noteworthy about the recordings.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.found
            .concerns
            .iter()
            .map(ToString::to_string)
            .collect()
    }

    /// The whole verdict, with the names of the JSON as attributes.
    #[getter]
    fn verdict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let verdict = serde_json::to_value(self.as_verdict()).map_err(defect)?;
        let schema = schema();
        object(py, &verdict, &schema, &schema["$defs"])
    }

    /// The verdict as `softrig diagnose --json` writes it.
    fn json(&self) -> PyResult<String> {
        let mut text = serde_json::to_string_pretty(&self.as_verdict()).map_err(defect)?;
        text.push('\n');
        Ok(text)
    }

    /// The runs, fitted ones first.
    #[getter]
    fn runs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let made = self.runs.get_or_try_init(py, || {
            Ok::<_, PyErr>(PyTuple::new(py, self.make_runs())?.unbind())
        })?;
        Ok(made.bind(py).clone())
    }

    /// Writes the report: one HTML page that needs no network.
    fn report(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        self.check(&Output::of("report", FileKind::Page, Some(&path)))
            .or_raise(py)?;
        let text = py
            .detach(|| {
                page(
                    &self.request(),
                    &self.found,
                    &self.content,
                    &self.provenance,
                    self.seconds,
                )
            })
            .map_err(defect)?;
        write_atomically(&path, text.as_bytes()).or_raise(py)
    }

    /// Draws measured, before and after: with a path as the picture of `softrig diagnose --plot`, as
    /// SVG, PDF or PNG by its extension, without one on matplotlib's axes, an array with one a run.
    #[pyo3(signature = (path = None, *, runs = None, **look))]
    fn plot<'py>(
        &self,
        py: Python<'py>,
        path: Option<PathBuf>,
        runs: Option<&Bound<'py, PyAny>>,
        look: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        let names = runs.map(words).transpose()?;
        let Some(path) = path else {
            look::refuse(py, look)?;
            let all = self.make_runs();
            let drawn: Vec<&Run> = match names {
                Some(names) => {
                    named(&all, &names, |run| (&run.0.name, Path::new(""))).or_raise(py)?
                }
                None => all.iter().collect(),
            };
            let curves = drawn.iter().map(|Run(run)| Curves {
                name: &run.name,
                time: &run.time,
                measured: &run.measured,
                nominal: &run.nominal,
                after: &run.repaired,
            });
            let curves: Vec<Curves<'_>> = curves.collect();
            let measurand = self.found.data.measurand();
            return axes::drawn(py, &curves, "repaired", &measurand).map(Some);
        };
        self.check(&Output::of("plot", FileKind::Picture, Some(&path)))
            .or_raise(py)?;
        let chosen = match names {
            Some(names) => figure_of_runs(&self.found, &names).or_raise(py)?,
            None => figure(&self.found),
        };
        look::draw(py, &path, &chosen, look)?;
        Ok(None)
    }

    /// The summary that `softrig diagnose` prints.
    fn __str__(&self) -> String {
        let nothing = Outputs::default();
        summary(&self.content, &nothing, self.seed, self.seconds).replace(KEEP, KEEP_HERE)
    }

    /// Nothing of it changes, so it is its own copy.
    fn __copy__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    /// As [`Self::__copy__`].
    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    /// Refuses to be pickled: what it can still draw and write hangs on the whole search.
    fn __reduce__(&self) -> PyResult<()> {
        let model = if self.stand_in.is_none() {
            ".model, "
        } else {
            ""
        };
        let keep = format!("{model}.runs and .json(), which can be, or the file of .report(path)");
        Err(kept::refused(
            "Diagnosis",
            "it holds the whole search",
            &keep,
        ))
    }

    fn __repr__(&self) -> PyResult<String> {
        let answer = self.answer()?;
        let effects = self.effects().join(", ");
        Ok(if effects.is_empty() {
            format!("<softrig.Diagnosis: {answer}>")
        } else {
            format!("<softrig.Diagnosis: {answer}, {effects}>")
        })
    }

    fn _repr_html_(&self) -> PyResult<String> {
        let mut environment = Environment::new();
        // The name decides that values are escaped: they are names that users gave.
        environment
            .add_template("summary.html", TEMPLATE)
            .and_then(|()| environment.get_template("summary.html"))
            .and_then(|template| {
                template.render(context! {
                    content => Serde(&self.content),
                    missing => self.content.something_is_missing(),
                    seed => self.seed,
                    seconds => format!("{:.1}", self.seconds),
                })
            })
            .map_err(defect)
    }
}

impl Diagnosis {
    fn request(&self) -> Request<'_> {
        Request {
            file: &self.file,
            recordings: &self.fitted,
            holdout: &self.held_out,
            start_from: &[],
            own: self.own.as_ref(),
            formulas: self.formulas,
            without: &[],
            seed: self.seed,
        }
    }

    fn as_verdict(&self) -> Verdict {
        Verdict {
            simulation: self.stand_in.clone(),
            ..self.found.verdict(&self.request(), self.seconds)
        }
    }

    /// Refuses a file that should not be written over.
    fn check(&self, output: &Output<'_>) -> Result<(), Fault> {
        let recordings = self.fitted.iter().chain(&self.held_out);
        let read = recordings
            .map(|recording| &recording.path)
            .chain([&self.file.path])
            .chain(self.own.iter().map(|own| &own.path));
        output::check(std::slice::from_ref(output), read)
    }

    fn make_runs(&self) -> Vec<Run> {
        let forces = &self.found.gap.runs;
        runs(&self.found)
            .into_iter()
            .map(|run| {
                let force = forces.get(run.index).filter(|_| !run.held_out);
                Run(OfRun {
                    name: run.recording.name.clone(),
                    held_out: run.held_out,
                    time: run.recording.time.clone(),
                    nominal: run.angle(&run.nominal),
                    refit: run.angle(&run.refit),
                    repaired: run.angle(&run.repaired),
                    residuals: [run.nominal, run.refit, run.repaired],
                    force: force.map(|force| force.force.clone()),
                    deviation: force.map(|force| force.deviation.clone()),
                    pressure: run.pressure,
                    measured: run.measured,
                    is_compared: run.silent.iter().map(|silent| !silent).collect(),
                    zero_unix_s: run.zero_unix_s,
                    column: run.recording.measurand.column(),
                })
            })
            .collect()
    }
}

/// Something that no input is known to cause.
fn defect(error: impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(format!("softrig has a defect: {error}"))
}

/// A run of a diagnosis: what was measured, and what each model makes of it.
#[pyclass(frozen, module = "softrig")]
#[derive(Clone, Debug)]
pub struct Run(OfRun);

/// What a run is made of, and pickled as.
#[derive(Clone, Debug, FromPyObject, IntoPyObject)]
#[pyo3(from_item_all)]
struct OfRun {
    name: String,
    held_out: bool,
    time: Vec<f64>,
    pressure: Vec<f64>,
    measured: Vec<f64>,
    nominal: Vec<f64>,
    refit: Vec<f64>,
    repaired: Vec<f64>,
    /// Of nominal, refitted and repaired model.
    residuals: [Vec<f64>; 3],
    force: Option<Vec<f64>>,
    deviation: Option<Vec<f64>>,
    is_compared: Vec<bool>,
    /// When time 0 was (s since 1970, UTC), if that is known.
    zero_unix_s: Option<f64>,
    /// Name and unit of the output: `angle_deg`.
    column: String,
}

#[pymethods]
impl Run {
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

    /// Whether it was kept out of the fit.
    #[getter]
    fn held_out(&self) -> bool {
        self.0.held_out
    }

    /// Time of each sample (s).
    #[getter]
    fn time_s<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.0.time)
    }

    /// Gauge pressure (kPa), its zero still in it.
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

    /// The angle of the refitted model (°).
    #[getter]
    fn refit_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.0.refit)
    }

    /// The angle of the repaired model (°).
    #[getter]
    fn repaired_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.0.repaired)
    }

    /// Simulated less measured angle of the model as it was given (°).
    #[getter]
    fn nominal_residual_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.0.residuals[0])
    }

    /// The same of the refitted model (°).
    #[getter]
    fn refit_residual_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.0.residuals[1])
    }

    /// The same of the repaired model (°).
    #[getter]
    fn repaired_residual_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.0.residuals[2])
    }

    /// The force that the refitted model lacks (N), positive where it acts against growing
    /// angles; None for a run that was held out.
    #[getter]
    fn missing_force_n<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        self.0.force.as_ref().map(|values| array(py, values))
    }

    /// Standard deviation of the missing force (N).
    #[getter]
    fn missing_force_sd_n<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        self.0.deviation.as_ref().map(|values| array(py, values))
    }

    /// Whether the measured angle of each sample was compared: not where the sensor was at
    /// the end of its range.
    #[getter]
    fn compared<'py>(&self, py: Python<'py>) -> Bound<'py, numpy::PyArray1<bool>> {
        numpy::PyArray1::from_slice(py, &self.0.is_compared)
    }

    /// All of it as a pandas frame.
    fn to_pandas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let frame = frame(
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
                ("refit_deg", Some(&self.0.refit)),
                ("repaired_deg", Some(&self.0.repaired)),
                ("missing_force_n", self.0.force.as_deref()),
                ("missing_force_sd_n", self.0.deviation.as_deref()),
            ],
        )?;
        frame.set_item("compared", self.compared(py))?;
        Ok(frame)
    }

    fn __repr__(&self) -> String {
        let OfRun { name, time, .. } = &self.0;
        let role = if self.0.held_out {
            "held out"
        } else {
            "fitted"
        };
        format!("<softrig.Run {name:?}: {role}, {} samples>", time.len())
    }
}

/// Diagnoses a model against recordings: which effect does it lack?
///
/// Without `holdout` the runs are left out in turn for validation. `progress` is called a few
/// times a second with a Progress; `print` will do. `resume` is a folder in which finished
/// fits are kept, and from which they are taken up. `effects` is a file of effects with
/// formulas of your own, which are tried beside those that are known. Without `formulas`, no other
/// formula is tried where no effect is enough. After `budget_s` seconds
/// the search ends with an answer on what was tried until then. With `prediction`, a column of the
/// recordings with the angles of a simulation of your own, the answer is what that lacks; the model,
/// fitted to these angles, stands in for it.
#[pyfunction]
#[pyo3(signature = (model, recordings, *, holdout = None, effects = None, formulas = true, seed = 1, progress = None, threads = None, resume = None, budget_s = None, prediction = None))]
#[allow(clippy::too_many_arguments)] // Each has a name where it is called.
pub fn diagnose(
    py: Python<'_>,
    model: &Bound<'_, Model>,
    recordings: &Bound<'_, PyAny>,
    holdout: Option<&Bound<'_, PyAny>>,
    effects: Option<PathBuf>,
    formulas: bool,
    seed: u64,
    progress: Option<Bound<'_, PyAny>>,
    threads: Option<NonZero<usize>>,
    resume: Option<PathBuf>,
    budget_s: Option<f64>,
    prediction: Option<&str>,
) -> PyResult<Diagnosis> {
    let given = model.get();
    let fitted = self::recordings(recordings)?;
    let held_out = holdout.map_or_else(|| Ok(Vec::new()), self::recordings)?;
    let budget = budget_s.map(budget).transpose().or_raise(py)?;
    let prediction = prediction.map(predicted).transpose().or_raise(py)?;
    let own = effects
        .map(|path| OwnEffects::read(&path, &given.file.model))
        .transpose()
        .or_raise(py)?;
    let call = Call {
        model: given,
        fitted: &fitted,
        held_out: &held_out,
        own: own.as_ref(),
        formulas,
        seed,
        budget_s,
        prediction: prediction.as_ref(),
    };
    let provenance = call.provenance().or_raise(py)?;
    let [mut fitted, mut held_out] = inputs(py, &fitted, &held_out)?;
    let checkpoint = match resume {
        Some(folder) => Checkpoint::open(&folder).or_raise(py)?,
        None => Checkpoint::default(),
    };
    warn(py, checkpoint.damaged().map(str::to_owned))?;
    let file = with_tip_load(ModelFile::clone(&given.file), &fitted);
    let clock = Instant::now();
    let work = move |job: &Job| {
        let (stand_in, file) = match &prediction {
            Some(prediction) => {
                let (stand_in, file) = StandIn::of(&file, prediction, &mut fitted, &mut held_out)?;
                (Some(stand_in), file)
            }
            None => (None, file),
        };
        let request = Request {
            file: &file,
            recordings: &fitted,
            holdout: &held_out,
            start_from: &[],
            own: own.as_ref(),
            formulas,
            without: &[],
            seed,
        };
        let found = diagnose_from(&request, &checkpoint, job)?;
        let seconds = clock.elapsed().as_secs_f64();
        let mut content = Content::of(&request, &found);
        if let Some(stand_in) = &stand_in {
            content.speak_of_simulation(stand_in);
        }
        Ok(Done {
            file,
            fitted,
            held_out,
            own,
            stand_in,
            content,
            seconds,
            found: Box::new(found),
        })
    };
    let listener = Listener::new(progress);
    let job = Job::within(budget);
    let done: Done = work::run(py, threads, job, listener, work)?.or_raise(py)?;
    let repaired = given.with(py, &done.found.model_text(&given.file))?;
    Ok(Diagnosis {
        model: Py::new(py, repaired)?,
        file: done.file,
        fitted: done.fitted,
        held_out: done.held_out,
        own: done.own,
        formulas,
        seed,
        seconds: done.seconds,
        provenance,
        content: done.content,
        found: done.found,
        runs: PyOnceLock::new(),
        stand_in: done.stand_in,
    })
}

/// What the work of a diagnosis gives back: its inputs as it used them, and what it found.
struct Done {
    file: ModelFile,
    fitted: Vec<recording::Recording>,
    held_out: Vec<recording::Recording>,
    own: Option<OwnEffects>,
    stand_in: Option<StandIn>,
    content: Content,
    seconds: f64,
    found: Box<Found>,
}

/// The time that a search may take, of seconds.
pub fn budget(seconds: f64) -> Result<Budget, Fault> {
    let time = Duration::try_from_secs_f64(seconds).map_err(|_| {
        let advice = "give the seconds after which the search shall end, such as 30";
        Fault::new(format!("budget_s is {seconds}"), advice)
    })?;
    Ok(Budget::Time(time))
}

/// What a diagnosis was called with.
struct Call<'a> {
    model: &'a Model,
    fitted: &'a [Recording],
    held_out: &'a [Recording],
    own: Option<&'a OwnEffects>,
    formulas: bool,
    seed: u64,
    budget_s: Option<f64>,
    prediction: Option<&'a Prediction>,
}

impl Call<'_> {
    /// What a report says of how it was made: the call, as far as files can say it, and
    /// hashes.
    fn provenance(&self) -> Result<Provenance, Fault> {
        let mut files = vec![self.model.source()];
        if let Some(own) = self.own {
            files.push(Source::read(EFFECTS, &own.path)?);
        }
        for (recordings, role) in [(self.fitted, FITTED), (self.held_out, HELD_OUT)] {
            files.extend(recordings.iter().flat_map(|it| it.sources(role)));
        }
        Ok(Provenance {
            command: self.text(),
            version: env!("CARGO_PKG_VERSION"),
            date: today(),
            files,
        })
    }

    fn text(&self) -> String {
        let mut text = if self.model.is_of_file() {
            let path = quoted(&self.model.file.path);
            format!("softrig.diagnose(softrig.Model.read({path}), ")
        } else {
            "softrig.diagnose(softrig.Model.from_toml(…), ".to_owned()
        };
        text += &read(self.fitted);
        if !self.held_out.is_empty() {
            text += &format!(", holdout={}", read(self.held_out));
        }
        if let Some(own) = self.own {
            text += &format!(", effects={}", quoted(&own.path));
        }
        if !self.formulas {
            text += ", formulas=False";
        }
        if let Some(prediction) = self.prediction {
            text += &format!(", prediction={:?}", prediction.to_string());
        }
        text += &format!(", seed={}", self.seed);
        if let Some(seconds) = self.budget_s {
            text += &format!(", budget_s={seconds}");
        }
        text + ")"
    }
}

fn quoted(path: &Path) -> String {
    format!("{:?}", path.display().to_string())
}

/// How recordings were read, if their paths say it.
fn read(recordings: &[Recording]) -> String {
    if !recordings.iter().all(Recording::is_of_plain_file) {
        return "[…]".to_owned();
    }
    let paths = recordings
        .iter()
        .map(|recording| quoted(&recording.inner.path));
    format!("softrig.read([{}])", paths.collect::<Vec<_>>().join(", "))
}
