//! `softrig.simulate`.

use library::comparison::check_comparable;
use library::diagnose::Job;
use library::estimate::simulation::{ANGLES_DEG, Arithmetic, Drive, HOLDS_S, in_range};
use library::statistics::rms;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use softrig_formats::columns::Columns;
use softrig_formats::error::InputError as Fault;
use softrig_formats::measurand::Measurand;
use softrig_formats::recording;

use crate::fault::{OrRaise, warn};
use crate::frame::{Rows, frame};
use crate::kept;
use crate::model::Model;
use crate::recording::{Recording, angle_deg as measured_angle, pressure_kpa as kpa_of};
use crate::values::{Array, array, choice, numbers};
use crate::work::{self, Listener};

/// A simulated run.
#[pyclass(frozen, module = "softrig")]
#[derive(Clone, Debug)]
pub struct Simulation {
    time: Vec<f64>,
    pressure: Vec<f64>,
    angle: Vec<f64>,
    measured: Option<Vec<f64>>,
    setpoint: Option<Vec<f64>>,
    /// When time 0 was (s since 1970, UTC), if that is known.
    zero_unix_s: Option<f64>,
    /// Name and unit of the output: `angle_deg`.
    column: String,
}

/// What a simulation is pickled as: times, pressures and angles; measured angles; set-points;
/// when time 0 was; and the name of the output's column.
type Parts = (
    [Vec<f64>; 3],
    Option<Vec<f64>>,
    Option<Vec<f64>>,
    Option<f64>,
    String,
);

#[pymethods]
impl Simulation {
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

    /// The simulated angle, as the sensor would show it (°).
    #[getter]
    fn angle_deg<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.angle)
    }

    /// The measured angle of the recording (°); None without one.
    #[getter]
    fn measured_deg<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        self.measured.as_ref().map(|values| array(py, values))
    }

    /// The set-points of the protocol (°); None without one.
    #[getter]
    fn setpoint_deg<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        self.setpoint.as_ref().map(|values| array(py, values))
    }

    /// RMS error against the recording (°); None without one.
    #[getter]
    fn rmse_deg(&self) -> Option<f64> {
        let measured = self.measured.as_ref()?;
        let error: Vec<f64> = self
            .angle
            .iter()
            .zip(measured)
            .map(|(a, b)| a - b)
            .collect();
        Some(rms(&error))
    }

    /// All of it as a pandas frame.
    fn to_pandas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        frame(
            py,
            &Rows {
                time: &self.time,
                zero_unix_s: self.zero_unix_s,
                measurand: Measurand::of_column(&self.column),
            },
            &[
                ("pressure_kpa", Some(&self.pressure)),
                (self.column.as_str(), Some(&self.angle)),
                ("measured_deg", self.measured.as_deref()),
                ("setpoint_deg", self.setpoint.as_deref()),
            ],
        )
    }

    /// Makes a simulation of what [`Self::__reduce__`] gave.
    #[staticmethod]
    fn _restored(
        series: [Vec<f64>; 3],
        measured: Option<Vec<f64>>,
        setpoint: Option<Vec<f64>>,
        zero_unix_s: Option<f64>,
        column: String,
    ) -> Self {
        let [time, pressure, angle] = series;
        Self {
            time,
            pressure,
            angle,
            measured,
            setpoint,
            zero_unix_s,
            column,
        }
    }

    /// For pickle.
    fn __reduce__<'py>(&self, py: Python<'py>) -> kept::Reduced<'py, Parts> {
        let this = self.clone();
        let parts = (
            [this.time, this.pressure, this.angle],
            this.measured,
            this.setpoint,
            this.zero_unix_s,
            this.column,
        );
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

    fn __len__(&self) -> usize {
        self.time.len()
    }

    fn __repr__(&self) -> String {
        let unit = Measurand::of_column(&self.column).unit();
        let error = self
            .rmse_deg()
            .map_or_else(String::new, |rmse| format!(", RMS error {rmse:.3}{unit}"));
        format!("<softrig.Simulation: {} samples{error}>", self.time.len())
    }
}

/// Simulates a model over a recording, over a pressure, or over a protocol.
///
/// Over a recording, zeros and start are those with which the model comes nearest to it. Over
/// `time_s` and `pressure_kpa`, or over a protocol, it starts at rest.
#[pyfunction]
#[pyo3(signature = (model, recording = None, *, time_s = None, pressure_kpa = None, protocol = None, angle_deg = 60.0, hold_s = 5.0, linear = false, arithmetic = "f64"))]
#[allow(clippy::too_many_arguments)] // Each has a name where it is called.
pub fn simulate(
    py: Python<'_>,
    model: &Bound<'_, Model>,
    recording: Option<&Bound<'_, Recording>>,
    time_s: Option<&Bound<'_, PyAny>>,
    pressure_kpa: Option<&Bound<'_, PyAny>>,
    protocol: Option<&str>,
    angle_deg: f64,
    hold_s: f64,
    linear: bool,
    arithmetic: &str,
) -> PyResult<Simulation> {
    let file = std::sync::Arc::clone(&model.get().file);
    let arithmetic: Arithmetic = choice(py, "arithmetic", arithmetic)?;
    arithmetic.check(&file).or_raise(py)?;
    let drive = match (recording, time_s, pressure_kpa, protocol) {
        (Some(recording), None, None, None) => {
            let recording = recording.get().inner.as_ref().clone();
            let checked = check_comparable([&*file], std::slice::from_ref(&recording));
            warn(py, checked.or_raise(py)?)?;
            Drive::measured(recording)
        }
        (None, Some(time), Some(pressure), None) => {
            let time = numbers(py, "time_s", time)?;
            let pressure = numbers(py, "pressure_kpa", pressure)?;
            let nothing = vec![0.0; time.len()];
            let samples = [time.as_slice(), &pressure, &nothing];
            let (recording, warnings) =
                recording::Recording::of_samples("pressure", samples, &Columns::default())
                    .or_raise(py)?;
            warn(py, warnings)?;
            Drive::pressure(recording)
        }
        (None, None, None, Some(name)) => {
            let checked = |name: &str, value, range, unit| {
                in_range(value, range, unit)
                    .map_err(|advice| Fault::new(format!("{name} is {value}"), advice))
            };
            checked("angle_deg", angle_deg, &ANGLES_DEG, "degrees")
                .and_then(|_| checked("hold_s", hold_s, &HOLDS_S, "seconds"))
                .and_then(|_| Drive::protocol(&file, name, angle_deg, hold_s))
                .or_raise(py)?
        }
        _ => {
            return Err(PyTypeError::new_err(
                "give a recording, or time_s and pressure_kpa, or a protocol",
            ));
        }
    };
    let (job, listener) = (Job::default(), Listener::new(None));
    let (drive, angle) = work::run(py, None, job, listener, move |_| {
        let model = if linear {
            drive.linear_rival(&file.model)
        } else {
            file.model
        };
        let angle = drive.simulate(&model, arithmetic);
        (drive, angle)
    })?;
    let angle = angle.or_raise(py)?;
    Ok(Simulation {
        pressure: kpa_of(&drive.recording),
        measured: drive.is_measured.then(|| measured_angle(&drive.recording)),
        setpoint: drive.setpoint_deg,
        zero_unix_s: drive.recording.zero_unix_s(),
        column: drive.recording.measurand.column(),
        time: drive.recording.time,
        angle,
    })
}
