//! `softrig.Recording` and `softrig.read`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use library::prediction::Prediction;
use numpy::{IntoPyArray, PyReadonlyArray1};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyString};
use serde_json::Value;
use softrig_cli::cli::input::layout_of_folder;
use softrig_formats::columns::{self, ATMOSPHERE_KPA, Columns, Layout, Names, Scale};
use softrig_formats::error::InputError as Fault;
use softrig_formats::measurand::Measurand;
use softrig_formats::recording::{
    self, Column, Meta, PASCAL_PER_KPA, check_distinct, recordings_among,
};
use softrig_formats::setup::Setup;
use softrig_report::provenance::{FITTED, METADATA, Source};

use crate::fault::{OrRaise, raised, warn};
use crate::frame;
use crate::kept;
use crate::model::Model;
use crate::values::{Array, array, from_json, numbers, to_json};

/// A recorded run or session: time, pressure and bending angle.
#[pyclass(frozen, module = "softrig")]
#[derive(Clone, Debug)]
pub struct Recording {
    pub inner: Arc<recording::Recording>,
    /// Where it was read from; none if it is of arrays.
    files: Option<Arc<Files>>,
}

/// What a recording was read from.
#[derive(Debug)]
struct Files {
    /// The files, as they were then.
    sources: Vec<Source>,
    /// Whether nothing was said of their columns.
    is_plain: bool,
}

/// What a recording is pickled as: all but its samples, its samples (s, Pa, rad), and its files with
/// sizes and hashes.
type Pickled<S> = (String, [S; 3], Option<PickledFiles>);

/// Paths, sizes and hashes, and whether nothing was said of the columns.
type PickledFiles = (Vec<(String, usize, String)>, bool);

#[pymethods]
impl Recording {
    #[new]
    #[pyo3(signature = (*, time_s, pressure_kpa, angle_deg, name = "recording", metadata = None, **meaning))]
    fn new(
        py: Python<'_>,
        time_s: &Bound<'_, PyAny>,
        pressure_kpa: &Bound<'_, PyAny>,
        angle_deg: &Bound<'_, PyAny>,
        name: &str,
        metadata: Option<&Bound<'_, PyAny>>,
        meaning: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let columns = columns_of(py, meaning)?;
        let samples = [
            numbers(py, "time_s", time_s)?,
            numbers(py, "pressure_kpa", pressure_kpa)?,
            numbers(py, "angle_deg", angle_deg)?,
        ];
        let (mut inner, warnings) =
            recording::Recording::of_samples(name, samples.each_ref().map(Vec::as_slice), &columns)
                .or_raise(py)?;
        if let Some(metadata) = metadata {
            inner.meta = meta_of(py, metadata)?;
        }
        warn(py, inner.remarks(warnings))?;
        Ok(Self::of_memory(inner))
    }

    /// Makes a recording of a pandas frame. The names of its columns can be given; the time
    /// may be its index. Other columns are kept; of dates in `time_utc` it is kept when the recording
    /// began.
    #[staticmethod]
    #[pyo3(signature = (frame, *, time_s = "time_s", pressure_kpa = "pressure_kpa", angle_deg = "angle_deg", name = "recording", metadata = None, **meaning))]
    #[allow(clippy::too_many_arguments)] // Each has a name where it is called.
    fn from_pandas(
        py: Python<'_>,
        frame: &Bound<'_, PyAny>,
        time_s: &str,
        pressure_kpa: &str,
        angle_deg: &str,
        name: &str,
        metadata: Option<&Bound<'_, PyAny>>,
        meaning: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let column = |name| frame::column(frame, name);
        let made = Self::new(
            py,
            &column(time_s)?,
            &column(pressure_kpa)?,
            &column(angle_deg)?,
            name,
            metadata,
            meaning,
        )?;
        let mut inner = Arc::unwrap_or_clone(made.inner);
        inner.measurand = Measurand::of(angle_deg, inner.columns.angle);
        let not_kept = [time_s, pressure_kpa, angle_deg, frame::TIME_UTC];
        // Rows without a place in time are not in the recording.
        let rows: Vec<usize> = (0..inner.len())
            .filter_map(|sample| usize::try_from(inner.lines.number(sample) - 1).ok())
            .collect();
        if inner.meta.started.is_none()
            && let Some(&row) = rows.first()
            && let Some(zero) = frame::zero_unix_s(frame, row, inner.time[0])?
        {
            inner.meta.set_started(zero);
        }
        for name in frame.getattr("columns")?.try_iter()? {
            let name = name?.str()?.to_string();
            if !not_kept.contains(&name.as_str()) {
                let all = fields(&frame::column(frame, &name)?)?;
                let fields = rows.iter().filter_map(|row| all.get(*row).cloned());
                let fields = fields.collect();
                inner.extra.push(Column { name, fields });
            }
        }
        Ok(Self::of_memory(inner))
    }

    /// Time of each sample (s).
    #[getter]
    fn time_s<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.inner.time)
    }

    /// Gauge pressure (kPa).
    #[getter]
    fn pressure_kpa<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &pressure_kpa(&self.inner))
    }

    /// Bending angle as the sensor shows it (°).
    #[getter]
    fn angle_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &angle_deg(&self.inner))
    }

    /// Name: of a file without its folder and extension.
    #[getter]
    fn name(&self) -> &str {
        &self.inner.name
    }

    /// The file that it was read from; None if it is of arrays.
    #[getter]
    fn path(&self) -> Option<&Path> {
        self.files.is_some().then_some(self.inner.path.as_path())
    }

    /// What is known about it, with the keys of `NAME.meta.toml`.
    #[getter]
    fn metadata<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &known(&self.inner.meta))
    }

    /// Duration from the first sample to the last (s).
    #[getter]
    fn duration_s(&self) -> f64 {
        self.inner.duration()
    }

    /// All columns as a pandas frame, whose `attrs` are the metadata. Where these say when the
    /// recording began, the column `time_utc` has dates.
    fn to_pandas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let columns = PyDict::new(py);
        columns.set_item("time_s", self.time_s(py))?;
        columns.set_item("pressure_kpa", self.pressure_kpa(py))?;
        columns.set_item(self.inner.measurand.column(), self.angle_deg(py))?;
        for column in &self.inner.extra {
            match as_numbers(&column.fields) {
                Some(values) => columns.set_item(&column.name, array(py, &values))?,
                None => columns.set_item(&column.name, &column.fields)?,
            }
        }
        let made = frame::of(py, &columns)?;
        frame::add_dates(&made, &self.inner.time, self.inner.zero_unix_s())?;
        made.getattr("attrs")?
            .call_method1("update", (self.metadata(py)?,))?;
        Ok(made)
    }

    /// Makes a recording of what [`Self::__reduce__`] gave.
    #[staticmethod]
    fn _restored(
        rest: &str,
        samples: [PyReadonlyArray1<'_, f64>; 3],
        files: Option<PickledFiles>,
    ) -> PyResult<Self> {
        let mut inner: recording::Recording = serde_json::from_str(rest).map_err(|error| {
            PyValueError::new_err(format!(
                "this recording was pickled by another version of softrig: {error}; read it anew"
            ))
        })?;
        let of_files = files.map(|(files, is_plain)| {
            let roles = std::iter::once(FITTED).chain(std::iter::repeat(METADATA));
            let sources = roles
                .zip(files)
                .map(|(role, (path, bytes, sha256))| Source {
                    role,
                    path,
                    bytes,
                    sha256,
                });
            let sources = sources.collect();
            Arc::new(Files { sources, is_plain })
        });
        [inner.time, inner.pressure, inner.angle] = samples.map(|it| it.as_array().to_vec());
        Ok(Self {
            inner: Arc::new(inner),
            files: of_files,
        })
    }

    /// For pickle: all of it, so that other processes need no file.
    fn __reduce__<'py>(&self, py: Python<'py>) -> kept::Reduced<'py, Pickled<Array<'py>>> {
        let mut rest = self.inner.as_ref().clone();
        let samples = [&mut rest.time, &mut rest.pressure, &mut rest.angle];
        let samples = samples.map(|it| std::mem::take(it).into_pyarray(py));
        let files = self.files.as_ref().map(|files| {
            let sources = files.sources.iter();
            let sources = sources.map(|it| (it.path.clone(), it.bytes, it.sha256.clone()));
            (sources.collect(), files.is_plain)
        });
        let mut rest =
            serde_json::to_value(rest).map_err(|error| PyValueError::new_err(error.to_string()))?;
        without_nothing(&mut rest);
        kept::reduced::<Self, _>(py, (rest.to_string(), samples, files))
    }

    fn __len__(&self) -> usize {
        self.inner.len()
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
            "<softrig.Recording {:?}: {} samples over {:.2} s>",
            self.inner.name,
            self.inner.len(),
            self.inner.duration()
        )
    }
}

impl Recording {
    /// A recording that is in no file.
    pub fn of_memory(inner: recording::Recording) -> Self {
        Self {
            inner: Arc::new(inner),
            files: None,
        }
    }

    fn read(path: &Path, layout: &Layout) -> Result<(Self, Vec<String>), Fault> {
        let (inner, warnings) = recording::Recording::read_as(path, layout)?;
        let warnings = inner.remarks(warnings);
        let files = Files {
            sources: Source::recording(FITTED, path)?,
            is_plain: *layout == Layout::default(),
        };
        Ok((
            Self {
                inner: Arc::new(inner),
                files: Some(Arc::new(files)),
            },
            warnings,
        ))
    }

    /// Whether it was read from a file.
    pub fn is_of_file(&self) -> bool {
        self.files.is_some()
    }

    /// Whether its path alone says how it was read.
    pub fn is_of_plain_file(&self) -> bool {
        let files = self.files.as_ref();
        files.is_some_and(|files| files.is_plain)
    }

    /// What a report says that it was made from: files with their hashes, or the hash of the
    /// three arrays, one after the other as little-endian doubles.
    pub fn sources(&self, role: &'static str) -> Vec<Source> {
        let mut sources = match &self.files {
            Some(files) => files.sources.clone(),
            None => vec![self.source_of_arrays()],
        };
        if let Some(first) = sources.first_mut() {
            first.role = role;
        }
        sources
    }

    /// Whether another has the same samples under the same name, as a copy by pickle has.
    fn is_copy_of(&self, other: &Self) -> bool {
        let (one, other) = (&*self.inner, &*other.inner);
        one.name == other.name
            && one.time == other.time
            && one.pressure == other.pressure
            && one.angle == other.angle
    }

    fn source_of_arrays(&self) -> Source {
        let columns = [
            &self.inner.time,
            &pressure_kpa(&self.inner),
            &angle_deg(&self.inner),
        ];
        let values = columns.into_iter().flatten();
        let bytes: Vec<u8> = values.flat_map(|value| value.to_le_bytes()).collect();
        Source::of(FITTED, format!("{}, in memory", self.inner.name), &bytes)
    }
}

/// Gauge pressure (kPa).
pub fn pressure_kpa(recording: &recording::Recording) -> Vec<f64> {
    let kpa = |pa: &f64| pa / PASCAL_PER_KPA;
    recording.pressure.iter().map(kpa).collect()
}

/// Bending angle (°).
pub fn angle_deg(recording: &recording::Recording) -> Vec<f64> {
    let degrees = |radians: &f64| radians.to_degrees();
    recording.angle.iter().map(degrees).collect()
}

/// Reads a recording, or several.
///
/// One path gives a recording, several give a list of them. `columns` and `units` say where
/// the recording stands in a file with other columns: `{"time": "t", "pressure": "p_psi"}` and
/// `{"time": "ms", "pressure": "psi"}`, and `scale` how numbers of the file become those of a
/// unit. `setup` says how the rig stood, as far as the metadata do not: `{"tilt_deg": 90}`. What
/// they leave open, `model` says, as its file may in the section `[recording]`, and then the same
/// section of `softrig.toml` in the folder where Python runs, as for the command.
#[pyfunction]
#[pyo3(signature = (path, *, columns = None, setup = None, model = None, **meaning))]
pub fn read<'py>(
    py: Python<'py>,
    path: &Bound<'py, PyAny>,
    columns: Option<&Bound<'py, PyDict>>,
    setup: Option<&Bound<'py, PyAny>>,
    model: Option<&Bound<'py, Model>>,
    meaning: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let mut layout = layout_of(py, columns, setup, meaning)?;
    if let Some(model) = model {
        layout = layout.or(&model.get().file.recording);
    }
    layout = layout.or(&layout_of_folder().or_raise(py)?);
    let one = |path: PathBuf| -> PyResult<Recording> {
        let read = py.detach(|| Recording::read(&path, &layout));
        py.check_signals()?;
        let (recording, warnings) = read.or_raise(py)?;
        warn(py, recording.inner.remarks(warnings))?;
        Ok(recording)
    };
    if is_path(path)? {
        return Ok(Bound::new(py, one(path.extract()?)?)?.into_any());
    }
    let paths = path
        .try_iter()?
        .map(|path| path?.extract())
        .collect::<PyResult<Vec<PathBuf>>>()?;
    check_distinct(&paths, &[]).or_raise(py)?;
    let mut warnings = Vec::new();
    let paths = recordings_among(&paths, |it| warnings.push(it.to_owned())).or_raise(py)?;
    warn(py, warnings)?;
    let recordings = paths.into_iter().map(one).collect::<PyResult<Vec<_>>>()?;
    Ok(recordings.into_pyobject(py)?.into_any())
}

/// Whether an argument is a path, and not several of them.
pub fn is_path(given: &Bound<'_, PyAny>) -> PyResult<bool> {
    Ok(given.is_instance_of::<PyString>() || given.hasattr("__fspath__")?)
}

/// Where recordings stand in their files, as far as the arguments say.
pub fn layout_of(
    py: Python<'_>,
    columns: Option<&Bound<'_, PyDict>>,
    setup: Option<&Bound<'_, PyAny>>,
    meaning: Option<&Bound<'_, PyDict>>,
) -> PyResult<Layout> {
    Ok(Layout {
        names: names_of(py, columns)?,
        columns: columns_of(py, meaning)?,
        setup: setup.map_or(Ok(Setup::default()), |given| setup_of(py, given))?,
        ..Layout::default()
    })
}

/// The recordings of an argument: one, or several. Names that arrays share are numbered.
pub fn recordings(given: &Bound<'_, PyAny>) -> PyResult<Vec<Recording>> {
    if let Ok(one) = given.cast::<Recording>() {
        return Ok(vec![one.get().clone()]);
    }
    given
        .try_iter()?
        .map(|item| {
            let item = item?;
            item.cast::<Recording>()
                .map(|recording| recording.get().clone())
                .map_err(|_| {
                    let kind = item.get_type();
                    PyTypeError::new_err(format!("expected a softrig.Recording, not {kind}"))
                })
        })
        .collect()
}

/// What a fit reads. Refuses a recording that is given twice, and tells those of arrays
/// apart by numbers where they have one name.
pub fn inputs(
    py: Python<'_>,
    fitted: &[Recording],
    held_out: &[Recording],
) -> PyResult<[Vec<recording::Recording>; 2]> {
    let files = |of: &[Recording]| -> Vec<PathBuf> {
        let read = of.iter().filter(|recording| recording.is_of_file());
        read.map(|recording| recording.inner.path.clone()).collect()
    };
    check_distinct(&files(fitted), &files(held_out)).or_raise(py)?;
    let all: Vec<&Recording> = fitted.iter().chain(held_out).collect();
    for (place, recording) in all.iter().enumerate() {
        if all[..place].iter().any(|other| other.is_copy_of(recording)) {
            let fault = Fault::new(
                format!("recording {:?} is given twice", recording.inner.name),
                "name each recording once: to be fitted, or as holdout for validation",
            );
            return Err(raised(py, &fault));
        }
    }
    let mut taken: Vec<PathBuf> = Vec::new();
    let mut told_apart = |of: &[Recording]| -> Vec<recording::Recording> {
        of.iter()
            .map(|recording| {
                let mut inner = recording.inner.as_ref().clone();
                let name = inner.name.clone();
                let mut number = 1;
                while taken.contains(&inner.path) {
                    number += 1;
                    inner.name = format!("{name} {number}");
                    inner.path = PathBuf::from(&inner.name);
                }
                taken.push(inner.path.clone());
                inner
            })
            .collect()
    };
    Ok([told_apart(fitted), told_apart(held_out)])
}

/// The column with the angles of somebody's own simulation, as `COLUMN` or `COLUMN:UNIT`.
pub fn predicted(given: &str) -> Result<Prediction, Fault> {
    given
        .parse()
        .map_err(|advice: String| Fault::new(format!("prediction is {given:?}"), advice))
}

/// The columns of a file, by what they hold.
fn names_of(py: Python<'_>, given: Option<&Bound<'_, PyDict>>) -> PyResult<Names> {
    let mut names = Names::default();
    for (key, column) in given.into_iter().flatten() {
        let (key, column): (String, String) = (key.extract()?, column.extract()?);
        let advice = "name columns as columns={\"time\": \"t\", \"pressure\": \"p_psi\"}";
        names
            .set(&key, &column)
            .map_err(|problem| Fault::new(format!("columns: {problem}"), advice))
            .or_raise(py)?;
    }
    Ok(names)
}

/// What the columns hold, by the keyword arguments that are named as the flags of `softrig`.
fn columns_of(py: Python<'_>, given: Option<&Bound<'_, PyDict>>) -> PyResult<Columns> {
    let mut columns = Columns::default();
    for (key, value) in given.into_iter().flatten() {
        let key: String = key.extract()?;
        if value.is_none() {
            continue;
        }
        match key.as_str() {
            "units" => {
                for (quantity, unit) in value.cast::<PyDict>()? {
                    let (quantity, unit): (String, String) = (quantity.extract()?, unit.extract()?);
                    let advice = "name units as units={\"time\": \"ms\", \"pressure\": \"psi\"}";
                    columns
                        .say_unit(&quantity, &unit)
                        .map_err(|problem| Fault::new(format!("units: {problem}"), advice))
                        .or_raise(py)?;
                }
            }
            "scale" => {
                for (quantity, points) in value.cast::<PyDict>()? {
                    let quantity: String = quantity.extract()?;
                    let advice = "give two numbers of the file and what they are: scale={\"pressure\": [[101, 0], [512, 100]]}";
                    let points: Option<[[f64; 2]; 2]> = points.extract().ok();
                    points
                        .and_then(Scale::through)
                        .ok_or_else(|| "these are no two points".to_owned())
                        .and_then(|scale| columns.say_scale(&quantity, scale))
                        .map_err(|problem| Fault::new(format!("scale: {problem}"), advice))
                        .or_raise(py)?;
                }
            }
            "absolute_pressure" => columns.air_kpa = air(py, &value)?,
            "angle_zero_deg" => columns.angle_zero_deg = Some(value.extract()?),
            "flip_angle" => columns.flip_angle = value.extract()?,
            "exchange_columns" => columns.exchange = value.extract()?,
            _ => {
                return Err(PyTypeError::new_err(format!(
                    "unexpected keyword argument {key:?}; what columns hold is said with units, scale, absolute_pressure, angle_zero_deg, flip_angle and exchange_columns"
                )));
            }
        }
    }
    Ok(columns)
}

/// The pressure of the air (kPa): True is that at sea level.
fn air(py: Python<'_>, given: &Bound<'_, PyAny>) -> PyResult<Option<f64>> {
    if let Ok(is_absolute) = given.cast::<PyBool>() {
        return Ok(is_absolute.is_true().then_some(ATMOSPHERE_KPA));
    }
    let kpa: f64 = given.extract()?;
    let checked = columns::air(kpa);
    let fault = |advice| Fault::new(format!("absolute_pressure is {kpa}"), advice);
    checked.map(Some).map_err(fault).or_raise(py)
}

/// Metadata from a dictionary. Unlike in a file, a key that is not known is refused: nobody
/// else can have put it there.
fn meta_of(py: Python<'_>, given: &Bound<'_, PyAny>) -> PyResult<Meta> {
    let value = to_json(py, "metadata", given)?;
    let refuse = |found: String| {
        let advice = "docs/formats.md lists what may be known about a recording";
        raised(py, &Fault::new(format!("metadata: {found}"), advice))
    };
    let meta: Meta =
        serde_json::from_value(value.clone()).map_err(|error| refuse(error.to_string()))?;
    let read = known(&meta);
    for (key, value) in value.as_object().into_iter().flatten() {
        let is_empty = value.is_null() || value.as_array().is_some_and(Vec::is_empty);
        if !is_empty && read.get(key).is_none() {
            return Err(refuse(format!("there is no key {key:?}")));
        }
    }
    if let Some(setup) = &meta.setup {
        setup.check().or_raise(py)?;
    }
    Ok(meta)
}

/// How the rig stood, from a dictionary.
fn setup_of(py: Python<'_>, given: &Bound<'_, PyAny>) -> PyResult<Setup> {
    let value = to_json(py, "setup", given)?;
    let setup: Setup = serde_json::from_value(value).map_err(|error| {
        let advice = "docs/formats.md lists what may be known about a rig";
        raised(py, &Fault::new(format!("setup: {error}"), advice))
    })?;
    setup.check().or_raise(py)?;
    Ok(setup)
}

/// The metadata that are known, by their keys in files.
fn known(meta: &Meta) -> Value {
    let mut value = serde_json::to_value(meta).unwrap_or_default();
    if let Some(map) = value.as_object_mut() {
        map.retain(|_, value| {
            !value.is_null() && value.as_array().is_none_or(|list| !list.is_empty())
        });
    }
    value
}

/// Takes out the keys under which nothing stands.
fn without_nothing(value: &mut Value) {
    let Some(map) = value.as_object_mut() else {
        return;
    };
    map.retain(|_, value| !value.is_null());
    map.values_mut().for_each(without_nothing);
}

/// The fields of a column as a file would hold them: empty where nothing is known.
fn fields(column: &Bound<'_, PyAny>) -> PyResult<Vec<String>> {
    let is_known = column.call_method0("notna")?;
    column
        .try_iter()?
        .zip(is_known.try_iter()?)
        .map(|(value, is_known)| {
            Ok(if is_known?.is_truthy()? {
                value?.str()?.to_string()
            } else {
                String::new()
            })
        })
        .collect()
}

/// A column of numbers with gaps; none if it holds anything else.
fn as_numbers(fields: &[String]) -> Option<Vec<f64>> {
    let number = |field: &String| match field.as_str() {
        "" => Some(f64::NAN),
        text => text.parse().ok(),
    };
    fields.iter().map(number).collect()
}
