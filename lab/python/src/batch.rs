//! `softrig.batch`: many independent diagnoses.

use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::time::Instant;

use library::diagnose::Job;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use softrig_cli::batch::manifest::{self, Case, Cases, List};
use softrig_cli::batch::results::{Cells, columns};
use softrig_cli::batch::{Batch as Plan, Settings, Summary, rows, table};
use softrig_cli::cli::input::layout_of_folder;
use softrig_formats::columns::Layout;
use softrig_formats::error::InputError as Fault;
use softrig_formats::own_effects::OwnEffects;

use crate::diagnosis::budget;
use crate::fault::{OrRaise, raised, warn};
use crate::frame;
use crate::kept;
use crate::recording::{is_path, layout_of};
use crate::values::array;
use crate::work::{self, Listener};

/// The results of a batch: a row for each case.
#[pyclass(frozen, module = "softrig")]
pub struct Batch {
    out: PathBuf,
    columns: Vec<(&'static str, Cells)>,
    summary: Summary,
    seconds: f64,
}

#[pymethods]
impl Batch {
    /// The folder of all results.
    #[getter]
    fn path(&self) -> &Path {
        &self.out
    }

    /// A dictionary for each case, in their order, with the columns of `results.parquet`.
    #[getter]
    fn rows<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let rows = PyList::empty(py);
        for index in 0..self.len() {
            let row = PyDict::new(py);
            for (name, cells) in &self.columns {
                match cells {
                    Cells::Text(cells) => row.set_item(name, cells[index].as_deref())?,
                    Cells::Number(cells) => row.set_item(name, cells[index])?,
                    Cells::Flag(cells) => row.set_item(name, cells[index])?,
                }
            }
            rows.append(row)?;
        }
        Ok(rows)
    }

    /// Names of the cases that could not be diagnosed.
    #[getter]
    fn failed(&self) -> Vec<&str> {
        let of = |name| match self.columns.iter().find(|(known, _)| *known == name) {
            Some((_, Cells::Text(cells))) => cells.as_slice(),
            _ => &[],
        };
        let names = of("case").iter().zip(of("status"));
        names
            .filter(|(_, status)| status.as_deref() == Some("failed"))
            .filter_map(|(name, _)| name.as_deref())
            .collect()
    }

    /// The rows as a pandas frame.
    fn to_pandas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let frame = PyDict::new(py);
        for (name, cells) in &self.columns {
            match cells {
                Cells::Text(cells) => frame.set_item(name, cells)?,
                Cells::Number(cells) => {
                    let cells: Vec<f64> = cells.iter().map(|it| it.unwrap_or(f64::NAN)).collect();
                    frame.set_item(name, array(py, &cells))?;
                }
                Cells::Flag(cells) => frame.set_item(name, cells)?,
            }
        }
        frame::of(py, &frame)
    }

    /// Refuses to be pickled: the results are in files.
    fn __reduce__(&self) -> PyResult<()> {
        let table = table(&self.out);
        let keep = format!(".rows, which are dictionaries, or read {}", table.display());
        Err(kept::refused("Batch", "its results are in files", &keep))
    }

    /// Nothing of it changes, so it is its own copy.
    fn __copy__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    /// As [`Self::__copy__`].
    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __len__(&self) -> usize {
        self.summary.cases
    }

    fn __str__(&self) -> String {
        format!("{} cases in {}", self.len(), table(&self.out).display())
    }

    fn __repr__(&self) -> String {
        let Self { seconds, .. } = self;
        let (cases, failed) = (self.len(), self.summary.failed.len());
        format!("<softrig.Batch: {cases} cases, {failed} failed, {seconds:.1} s>")
    }
}

impl Batch {
    fn len(&self) -> usize {
        self.summary.cases
    }
}

/// Diagnoses many cases, each into its own folder below `out`, as `softrig diagnose --batch` does.
///
/// `cases` is a manifest, or a list of dictionaries with its columns: case, model, recordings and,
/// where they are needed, holdout, columns, units and setup, which are what `read` takes. `jobs`
/// cases are diagnosed at a time. With `resume` a case is skipped if its results are there, made
/// from the same inputs. `budget_s` is the time of each case; the rest is as for `diagnose`.
#[pyfunction]
#[pyo3(signature = (cases, *, out, jobs = 1, resume = true, effects = None, formulas = true, seed = 1, progress = None, threads = None, budget_s = None))]
#[allow(clippy::too_many_arguments)] // Each has a name where it is called.
pub fn batch(
    py: Python<'_>,
    cases: &Bound<'_, PyAny>,
    out: PathBuf,
    jobs: usize,
    resume: bool,
    effects: Option<PathBuf>,
    formulas: bool,
    seed: u64,
    progress: Option<Bound<'_, PyAny>>,
    threads: Option<NonZero<usize>>,
    budget_s: Option<f64>,
) -> PyResult<Batch> {
    let mut cases: Box<dyn Cases> = if is_path(cases)? {
        let path: PathBuf = cases.extract()?;
        Box::new(py.detach(|| manifest::open(&path)).or_raise(py)?)
    } else {
        let listed = cases.try_iter()?.enumerate();
        let listed = listed.map(|(index, given)| case_of(py, index, &given?));
        Box::new(List::of(listed.collect::<PyResult<_>>()?).or_raise(py)?)
    };
    let jobs = NonZero::new(jobs)
        .ok_or_else(|| Fault::new("jobs is 0", "give how many cases at a time, 1 or more"))
        .or_raise(py)?;
    let own = effects.map(|path| OwnEffects::read_for_any(&path));
    let settings = Settings {
        layout: Layout::default(),
        folder: layout_of_folder().or_raise(py)?,
        seed,
        own: own.transpose().or_raise(py)?,
        formulas,
        budget: budget_s.map(budget).transpose().or_raise(py)?,
        anew: !resume,
    };
    let clock = Instant::now();
    let folder = out.clone();
    let work = move |job: &Job| -> Result<_, anyhow::Error> {
        let plan = Plan {
            out: &folder,
            settings: &settings,
            share: None,
            jobs,
        };
        let summary = plan.run(&mut *cases, job, &|_| Ok(()))?;
        let rows = rows(&folder, &mut *cases).collect::<Result<Vec<_>, _>>()?;
        Ok((summary, columns(&rows)))
    };
    let listener = Listener::new(progress);
    let (summary, columns) =
        work::run(py, threads, Job::default(), listener, work)?.map_err(|error| {
            match error.downcast::<Fault>() {
                Ok(fault) => raised(py, &fault),
                Err(error) => PyRuntimeError::new_err(format!("{error:#}")),
            }
        })?;
    warn(py, summary.warning().into_iter().chain(summary.failure()))?;
    Ok(Batch {
        out,
        columns,
        summary,
        seconds: clock.elapsed().as_secs_f64(),
    })
}

/// A case from a dictionary.
fn case_of(py: Python<'_>, index: usize, given: &Bound<'_, PyAny>) -> PyResult<Case> {
    let fail = |found: String| {
        let advice = "give a dictionary with case, model and recordings; holdout, columns, units and setup may be there too";
        raised(py, &Fault::new(format!("cases[{index}] {found}"), advice))
    };
    let Ok(given) = given.cast::<PyDict>() else {
        return Err(fail(format!("is of {}", given.get_type())));
    };
    let (mut name, mut model) = (None, None);
    let [mut recordings, mut holdout] = [Vec::new(), Vec::new()];
    let mut columns = None;
    let [mut units, mut setup] = [None, None];
    for (key, value) in given {
        let key: String = key.extract()?;
        if value.is_none() {
            continue;
        }
        match key.as_str() {
            "case" => name = Some(value.extract()?),
            "model" => model = Some(value.extract()?),
            "recordings" => recordings = files(&value)?,
            "holdout" => holdout = files(&value)?,
            "columns" => columns = Some(value.cast_into::<PyDict>()?),
            "units" => units = Some(value),
            "setup" => setup = Some(value),
            _ => return Err(fail(format!("has a key {key:?}"))),
        }
    }
    let meaning = PyDict::new(py);
    meaning.set_item("units", units)?;
    Ok(Case {
        name: name.ok_or_else(|| fail("has no case, which is its name".into()))?,
        model: model.ok_or_else(|| fail("has no model".into()))?,
        recordings,
        holdout,
        layout: layout_of(py, columns.as_ref(), setup.as_ref(), Some(&meaning))?,
    })
}

/// One path, or several.
fn files(given: &Bound<'_, PyAny>) -> PyResult<Vec<PathBuf>> {
    if is_path(given)? {
        return Ok(vec![given.extract()?]);
    }
    given.try_iter()?.map(|path| path?.extract()).collect()
}
