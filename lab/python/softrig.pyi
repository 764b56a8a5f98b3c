"""Finds where the simulation of a soft pneumatic actuator and its measurements disagree,
names the missing effect, and repairs the model.

Names say their units: ``_s``, ``_kpa`` (gauge pressure), ``_deg`` (bending angle),
``_n`` (force).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, TypeAlias, TypedDict, final, overload

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Unpack

__all__ = [
    "Batch",
    "Diagnosis",
    "Example",
    "Fit",
    "FitRun",
    "InputError",
    "InputWarning",
    "Model",
    "Parameter",
    "Progress",
    "Recording",
    "Run",
    "Simulation",
    "__version__",
    "_command",
    "batch",
    "compare",
    "diagnose",
    "example",
    "fit",
    "gap",
    "init",
    "linearise",
    "plan",
    "read",
    "residuals",
    "simulate",
]

__version__: str

_Path: TypeAlias = str | PathLike[str]
_Array: TypeAlias = NDArray[np.float64]
_Recordings: TypeAlias = Recording | Iterable[Recording]

class InputError(ValueError):
    """A fault in a file or an argument. Its text gives the place, the finding and advice."""

    file: str | None
    """The file, if the fault is in one."""
    line: int | None
    """Line, from 1."""
    column: str | None
    """Name of a column, or a position from 1 in a text."""
    found: str
    """The finding."""
    advice: str
    """What to do about it."""

class InputWarning(UserWarning):
    """Something unusual about a recording that may be intended."""

class _Names(TypedDict, total=False):
    """The names of a file's columns, where they differ from the standard ones."""

    time: str
    pressure: str
    angle: str
    setpoint_deg: str
    setpoint_kpa: str
    pump_ul: str
    predicted_deg: str
    state: str
    fault: str
    seq: str

class _Units(TypedDict, total=False):
    """Units as in ``softrig --units``; common spellings such as ``"sec"`` are accepted too."""

    time: Literal["s", "ms", "us", "ns", "min", "day"] | str
    pressure: Literal["kpa", "psi", "bar", "mbar", "mpa", "pa", "mmhg"] | str
    angle: Literal["deg", "rad", "mm", "cm", "um", "mv"] | str

class _Look(TypedDict, total=False):
    """How a picture looks that is written to a file, like the flags of ``softrig``."""

    width: str | None
    """Its width: ``"89mm"``, ``"3.5in"``, ``"252pt"`` or ``"800px"``."""
    font_size: float | None
    """Size of its labels in points."""
    headline: bool | None
    """Whether it has a heading; a PDF has none unless asked for."""
    panels: str | Sequence[str | int] | None
    """Only these panels: numbers from the top left, or words of their headings and labels."""
    colours: Literal["screen", "print"] | None
    """Colours of the screen, or of print, which differ in grey too."""

class _Meaning(TypedDict, total=False):
    """Units and meaning of columns that are not in s, kPa (gauge) and °, like the flags of
    ``softrig``."""

    units: _Units | None
    """A factor may stand with a unit: ``"psi*100"`` for values times 100."""
    scale: Mapping[str, Sequence[Sequence[float]]] | None
    """Two numbers of the file and what they are: ``{"pressure": [[101, 0], [512, 100]]}``."""
    absolute_pressure: bool | float
    """True subtracts the atmospheric pressure at sea level, a number that many kPa."""
    angle_zero_deg: float
    """The angle at rest: subtracted, before any change of its sign."""
    flip_angle: bool
    """The angle has the opposite sign."""
    exchange_columns: bool
    """The columns of pressure and angle are exchanged."""

@final
class Recording:
    """A recorded run or session: time, pressure and bending angle."""

    def __new__(
        cls,
        *,
        time_s: ArrayLike,
        pressure_kpa: ArrayLike,
        angle_deg: ArrayLike,
        name: str = "recording",
        metadata: Mapping[str, Any] | None = None,
        **meaning: Unpack[_Meaning],
    ) -> Recording: ...
    @staticmethod
    def from_pandas(
        frame: pd.DataFrame,
        *,
        time_s: str = "time_s",
        pressure_kpa: str = "pressure_kpa",
        angle_deg: str = "angle_deg",
        name: str = "recording",
        metadata: Mapping[Any, Any] | None = None,
        **meaning: Unpack[_Meaning],
    ) -> Recording:
        """Makes a recording from a frame. The names of its columns can be given; the time may
        be its index. Other columns are kept; dates in ``time_utc`` say when it began."""

    @property
    def time_s(self) -> _Array: ...
    @property
    def pressure_kpa(self) -> _Array: ...
    @property
    def angle_deg(self) -> _Array: ...
    @property
    def name(self) -> str:
        """The name; for a file, its name without folder and extension."""

    @property
    def path(self) -> PathLike[str] | None:
        """The file that it was read from; None if it was made from arrays."""

    @property
    def metadata(self) -> dict[str, Any]:
        """Its metadata, with the keys of ``NAME.meta.toml``."""

    @property
    def duration_s(self) -> float: ...
    def to_pandas(self) -> pd.DataFrame:
        """All columns as a frame, with the metadata as its ``attrs``. The column ``time_utc`` has
        the date of each sample where it is known when the recording began."""

    def __copy__(self) -> Recording: ...
    def __deepcopy__(self, _memo: Any) -> Recording: ...
    def __len__(self) -> int: ...

# A text is a path, although it is an iterable of texts as well.
@overload
def read(  # type: ignore[overload-overlap]
    path: _Path,
    *,
    columns: _Names | None = None,
    setup: Mapping[str, Any] | None = None,
    model: Model | None = None,
    **meaning: Unpack[_Meaning],
) -> Recording: ...
@overload
def read(
    path: Iterable[_Path],
    *,
    columns: _Names | None = None,
    setup: Mapping[str, Any] | None = None,
    model: Model | None = None,
    **meaning: Unpack[_Meaning],
) -> list[Recording]:
    """Reads a recording, or several.

    ``columns`` and ``units`` describe a file with other columns:
    ``{"time": "t", "pressure": "p_psi"}`` and ``{"time": "ms", "pressure": "psi"}``.
    ``setup`` says how the rig stood, as far as the metadata of a recording do not:
    ``{"tilt_deg": 90}``. The section ``[recording]`` of ``model`` fills in what they leave
    open, and then that of ``softrig.toml`` in the working directory."""

@final
class Model:
    """A model: its parameters, the free ones among them, and the text of its file."""

    @staticmethod
    def read(path: _Path) -> Model: ...
    @staticmethod
    def from_toml(text: str, *, name: str = "model.toml") -> Model:
        """Parses the text of a model file; messages refer to it by ``name``."""

    def to_toml(self) -> str:
        """The text of the model file, with its comments."""

    def write(self, path: _Path) -> None: ...
    def export(self, path: _Path) -> None:
        """Writes the model as a file of another tool, as ``softrig export`` does: C (.c), Python
        (.py), MATLAB (.m), Modelica (.mo), or a functional mock-up unit (.fmu)."""

    def replace(self, **parameters: float) -> Model:
        """The model with other parameters: ``model.replace(exponent=2.0)``. Keys with a dot
        are given as ``model.replace(**{"gravity.force_n": 0.3})``."""

    @property
    def name(self) -> str: ...
    @property
    def path(self) -> PathLike[str] | None:
        """The file that it was read from; None if it was made from a text."""

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters in the units of their keys. The kind of an effect precedes its
        parameters: ``coulomb_friction.force_n``."""

    @property
    def units(self) -> dict[str, str]:
        """Units of the parameters, by the same keys."""

    @property
    def free(self) -> list[str]:
        """Keys of the free parameters, which a fit estimates."""

    @property
    def effects(self) -> list[str]:
        """Kinds of the effects, in the order of the file."""

    @property
    def inertia_kg_m(self) -> float: ...
    @property
    def damping_n_s_per_rad(self) -> float: ...
    @property
    def stiffness_n_per_rad_n(self) -> float: ...
    @property
    def exponent(self) -> float: ...
    @property
    def input_gain_n_per_kpa(self) -> float: ...
    def __copy__(self) -> Model: ...
    def __deepcopy__(self, _memo: Any) -> Model: ...

@final
class Simulation:
    """A simulated run."""

    @property
    def time_s(self) -> _Array: ...
    @property
    def pressure_kpa(self) -> _Array: ...
    @property
    def angle_deg(self) -> _Array:
        """The simulated reading of the angle sensor."""

    @property
    def measured_deg(self) -> _Array | None:
        """The measured angle of the recording; None without one."""

    @property
    def setpoint_deg(self) -> _Array | None:
        """The set-points of the protocol; None without one."""

    @property
    def rmse_deg(self) -> float | None:
        """RMS error against the recording; None without one."""

    def to_pandas(self) -> pd.DataFrame: ...
    def __copy__(self) -> Simulation: ...
    def __deepcopy__(self, _memo: Any) -> Simulation: ...
    def __len__(self) -> int: ...

def simulate(
    model: Model,
    recording: Recording | None = None,
    *,
    time_s: ArrayLike | None = None,
    pressure_kpa: ArrayLike | None = None,
    protocol: str | None = None,
    angle_deg: float = 60.0,
    hold_s: float = 5.0,
    linear: bool = False,
    arithmetic: Literal["f64", "board", "minimax", "micromath"] = "f64",
) -> Simulation:
    """Simulates a model over a recording, over a pressure, or over a protocol.

    Over a recording, zeros and initial state are fitted to it. Over ``time_s`` and
    ``pressure_kpa``, or over a protocol, the simulation starts at rest."""

class _RunError(TypedDict):
    name: str
    rms_deg: float
    largest_deg: float

class _GapOf(TypedDict):
    rms_deg: float
    largest_deg: float
    runs: list[_RunError]

class _Gap(TypedDict):
    schema: int
    before: _GapOf
    after: _GapOf | None
    sentence: str | None

def gap(before: _Recordings, after: _Recordings | None = None) -> _Gap:
    """The error of the board's own prediction, before and after an upload.

    The prediction is the column predicted_deg that ``softrig record`` writes. The result is what
    ``softrig gap --json`` writes."""

def compare(
    models: Model | Iterable[Model] | None,
    recordings: _Recordings,
    *,
    linear: bool = False,
    prediction: str | None = None,
) -> pd.DataFrame:
    """The RMS error of each model against the mean of the repeats to each set-point, with the
    columns that ``softrig compare -o`` writes. ``linear`` adds the paper's linear rival of the first
    model, refitted. ``prediction`` adds a simulation of your own, whose angles are in that column
    of the recordings: ``"theta_sim"``, or ``"theta_sim:rad"``. Then ``models`` may be None."""

@final
class Parameter:
    """A free parameter, in the unit of model files."""

    @property
    def unit(self) -> str: ...
    @property
    def nominal(self) -> float: ...
    @property
    def value(self) -> float: ...
    @property
    def interval95(self) -> tuple[float, float] | None:
        """The ends of the 95 % interval; None if the recordings do not determine it."""

    def __copy__(self) -> Parameter: ...
    def __deepcopy__(self, _memo: Any) -> Parameter: ...

@final
class FitRun:
    """A run of a fit: measured and simulated angles."""

    @property
    def name(self) -> str: ...
    @property
    def time_s(self) -> _Array: ...
    @property
    def pressure_kpa(self) -> _Array: ...
    @property
    def measured_deg(self) -> _Array: ...
    @property
    def nominal_deg(self) -> _Array:
        """The angle of the nominal model."""

    @property
    def fitted_deg(self) -> _Array: ...
    @property
    def residual_deg(self) -> _Array:
        """The fitted minus the measured angle."""

    @property
    def rmse_deg(self) -> float: ...
    def to_pandas(self) -> pd.DataFrame: ...
    def __copy__(self) -> FitRun: ...
    def __deepcopy__(self, _memo: Any) -> FitRun: ...

@final
class Fit:
    """A fitted model, with the nominal one."""

    @property
    def model(self) -> Model: ...
    @property
    def parameters(self) -> dict[str, Parameter]:
        """The free parameters, by their keys in files."""

    @property
    def converged(self) -> bool: ...
    @property
    def rmse_deg(self) -> float: ...
    @property
    def nominal_rmse_deg(self) -> float: ...
    @property
    def pressure_zero_kpa(self) -> list[float]:
        """The zero of the pressure sensor, a number for each session."""

    @property
    def angle_zero_deg(self) -> list[float]:
        """The zero of the angle sensor, a number for each session."""

    @property
    def runs(self) -> list[FitRun]: ...
    @overload
    def plot(
        self, path: None = None, *, runs: str | Sequence[str] | None = None, **look: Unpack[_Look]
    ) -> NDArray[Any]: ...
    @overload
    def plot(
        self, path: _Path, *, runs: str | Sequence[str] | None = None, **look: Unpack[_Look]
    ) -> None:
        """Draws measured and simulated angles: with a path as a picture, SVG, PDF or PNG by its
        extension, without one on matplotlib's axes, an array with one a run. ``runs`` are the
        names of those to draw."""

    def __copy__(self) -> Fit: ...
    def __deepcopy__(self, _memo: Any) -> Fit: ...

def fit(model: Model, recordings: _Recordings, *, threads: int | None = None) -> Fit:
    """Fits the free parameters of a model to recordings."""

@final
class Progress:
    """The progress of a diagnosis, or of a batch. Its text is one line."""

    @property
    def line(self) -> str:
        """The progress in one line."""

    @property
    def stage(self) -> str:
        """The present stage; of a batch, what its last case found."""

    @property
    def done(self) -> int:
        """Fits of the present step that are finished; of a batch, cases."""

    @property
    def planned(self) -> int:
        """Fits of the present step; 0 where they are not counted in advance; of a batch, cases."""

    @property
    def fits(self) -> int:
        """Finished fits of all steps."""

    @property
    def share(self) -> float:
        """Share of the whole that is done, by what its stages usually take."""

    @property
    def elapsed_s(self) -> float: ...
    @property
    def remaining_s(self) -> float | None:
        """Estimated remaining time of the present step; None while it is unknown."""

    @property
    def best(self) -> str | None:
        """The best explanation so far; None if there is none."""

    def __copy__(self) -> Progress: ...
    def __deepcopy__(self, _memo: Any) -> Progress: ...

_Answer: TypeAlias = Literal[
    "effect_found", "parameters_only", "no_discrepancy", "cannot_tell", "unexplained"
]

class _NamedEffect:
    kind: str
    parameters: dict[str, float]
    interval95: dict[str, list[float]]
    probability: float
    formula: str | None
    """A force that no effect of the catalogue makes."""
    title: str | None
    """What that is, in words."""
    alike: list[str]
    """Other formulas that push alike in these recordings."""

class _Alternative:
    kinds: list[str]
    formulas: list[str]
    probability: float
    delta_bic: float

class _Adequacy:
    adequate: bool
    holdout_gap_closed: float
    exact_form: bool

class _Closure:
    short: float
    medium: float
    full: float
    overall: float

class _Remaining:
    rmse_deg: float
    times_noise: float
    goes_with: str | None

class _Repair:
    kind: str
    of: list[str]

class _Place:
    feature: str
    share_of_gap: float
    text: str

class _Step:
    feature: str
    measured: float
    simulated: float
    steps: int
    alike: int

class _FittedError:
    nominal: float
    refit: float
    repaired: float
    noise_floor: float

class _HeldOutError:
    nominal: float
    refit: float
    repaired: float

class _Zeros:
    pressure_zero_kpa: list[float]
    angle_zero_deg: list[float]

class _Experiment:
    protocol: str
    tilt_deg: float | None
    tip_load_g: float | None
    tube_mm: float | None
    rested_s: float | None
    work_min: float
    separates: list[str]
    expected_delta_chi2: float

class _TestError:
    """Errors on a test recording, which chose nothing."""

    recording: str
    start_from: str
    """A number of first samples, which are not scored, ``"rest"`` or ``"period"``."""
    samples: int
    nominal: float
    refit: float
    repaired: float

class _LeftOut:
    """What was left out of a file, or changed in it, by the same rule."""

    what: str
    """Its kind, such as ``"impossible_angle"``; new kinds may come."""
    file: str
    count: int
    places: list[str]
    """The first of them: ``"line 12"``, or ``"sample 12"`` where a recording has no lines."""
    text: str
    """How it is handled, and what to do if that is not meant."""

class _StandIn:
    """What a verdict is about where that is a simulation of somebody's own."""

    column: str
    rmse_deg: float
    stand_in_rmse_deg: float
    caveat: str

class _Verdict:
    """The verdict with the names of the JSON, which ``softrig schema`` explains. The JSON's
    ``where`` is called ``places`` here."""

    schema: int
    verdict: _Answer
    strength: Literal["explains", "part"] | None
    family: str | None
    effects: list[_NamedEffect]
    alternatives: list[_Alternative]
    adequacy: _Adequacy
    tolerance_deg: float
    closure: _Closure | None
    remaining: _Remaining
    repair: _Repair | None
    places: list[_Place]
    steps: list[_Step]
    rmse_deg: _FittedError
    holdout_rmse_deg: _HeldOutError
    nuisance: _Zeros
    upload: bool
    upload_refused: str | None
    next_experiment: list[_Experiment]
    simulation: _StandIn | None
    ended: Literal["budget"] | None
    not_tried: list[str]
    test: list[_TestError]
    left_out: list[_LeftOut]
    recordings: list[str]
    seed: int
    tool_version: str
    seconds: float

@final
class Run:
    """A run of a diagnosis: the measured angle, and the angle of each model."""

    @property
    def name(self) -> str: ...
    @property
    def held_out(self) -> bool:
        """Whether it was held out of the fit for validation."""

    @property
    def time_s(self) -> _Array: ...
    @property
    def pressure_kpa(self) -> _Array: ...
    @property
    def measured_deg(self) -> _Array: ...
    @property
    def nominal_deg(self) -> _Array:
        """The angle of the nominal model."""

    @property
    def refit_deg(self) -> _Array:
        """The angle of the refitted model."""

    @property
    def repaired_deg(self) -> _Array:
        """The angle of the repaired model."""

    @property
    def nominal_residual_deg(self) -> _Array:
        """Simulated minus measured angle, for the nominal model."""

    @property
    def refit_residual_deg(self) -> _Array: ...
    @property
    def repaired_residual_deg(self) -> _Array: ...
    @property
    def missing_force_n(self) -> _Array | None:
        """The force that the refitted model lacks, positive where it acts against growing
        angles; None for a held-out run."""

    @property
    def missing_force_sd_n(self) -> _Array | None:
        """Standard deviation of the missing force."""

    @property
    def compared(self) -> NDArray[np.bool_]:
        """Whether each sample's measured angle was compared. Samples with the sensor at the
        end of its range are not."""

    def to_pandas(self) -> pd.DataFrame: ...
    def __copy__(self) -> Run: ...
    def __deepcopy__(self, _memo: Any) -> Run: ...

@final
class Diagnosis:
    """The result of a diagnosis. Its text is the summary that ``softrig diagnose`` prints."""

    @property
    def answer(self) -> _Answer: ...
    @property
    def sentence(self) -> str:
        """The answer in one sentence."""

    @property
    def effects(self) -> list[str]:
        """Kinds of the named effects, as in model files."""

    @property
    def notes(self) -> list[str]:
        """Notes on the recordings."""

    @property
    def verdict(self) -> _Verdict: ...
    def json(self) -> str:
        """The verdict as ``softrig diagnose --json`` writes it."""

    @property
    def model(self) -> Model:
        """The model to go on with: repaired, refitted, or nominal. An AttributeError where the
        diagnosis is about a ``prediction``, of which there is no model."""

    @property
    def runs(self) -> tuple[Run, ...]:
        """The runs, fitted ones first."""

    def report(self, path: _Path) -> None:
        """Writes the report: one HTML page that needs no network."""

    @overload
    def plot(
        self, path: None = None, *, runs: str | Sequence[str] | None = None, **look: Unpack[_Look]
    ) -> NDArray[Any]: ...
    @overload
    def plot(
        self, path: _Path, *, runs: str | Sequence[str] | None = None, **look: Unpack[_Look]
    ) -> None:
        """Draws measured, before and after: with a path as the picture of ``softrig diagnose
        --plot``, as SVG, PDF or PNG by its extension, without one on matplotlib's axes, an array
        with one a run. ``runs`` are the names of those to draw."""

    def __copy__(self) -> Diagnosis: ...
    def __deepcopy__(self, _memo: Any) -> Diagnosis: ...
    def _repr_html_(self) -> str: ...

def diagnose(
    model: Model,
    recordings: _Recordings,
    *,
    holdout: _Recordings | None = None,
    effects: _Path | None = None,
    formulas: bool = True,
    seed: int = 1,
    progress: Callable[[Progress], object] | None = None,
    threads: int | None = None,
    resume: _Path | None = None,
    budget_s: float | None = None,
    prediction: str | None = None,
) -> Diagnosis:
    """Diagnoses a model against recordings: which effect does it lack?

    Without ``holdout`` the runs are left out in turn for validation. ``progress`` is called a
    few times a second; ``print`` will do. ``resume`` is a folder that keeps finished fits, so
    that an interrupted diagnosis can go on. ``effects`` is a file of your own effects by
    formula, which are tried beside the catalogue. Where no effect is enough, formulas are tried
    that nobody wrote, unless ``formulas`` is False. After ``budget_s`` seconds the search ends
    with an answer from what was tried until then. With ``prediction``, a column of the recordings
    with the angles of a simulation of your own (``"theta_sim"``, or ``"theta_sim:rad"``), the
    answer is what that lacks; the model, fitted to these angles, stands in for it."""

class _Row(TypedDict):
    """A row of ``results.parquet``; None where a case has no such value."""

    case: str
    status: Literal["diagnosed", "failed", "missing"]
    error: str | None
    warnings: str | None
    verdict: _Answer | None
    strength: Literal["explains", "part"] | None
    family: str | None
    effects: str | None
    parameters_json: str | None
    alternatives: str | None
    probability: float | None
    closure_overall: float | None
    closure_full: float | None
    rmse_nominal_deg: float | None
    rmse_refit_deg: float | None
    rmse_repaired_deg: float | None
    noise_floor_deg: float | None
    holdout_rmse_nominal_deg: float | None
    holdout_rmse_refit_deg: float | None
    holdout_rmse_repaired_deg: float | None
    remaining_rmse_deg: float | None
    upload: bool | None
    seconds: float | None
    tool_version: str | None
    interval95_json: str | None
    ended: Literal["budget"] | None
    seed: float | None

@final
class Batch:
    """The results of a batch: a row for each case."""

    @property
    def path(self) -> PathLike[str]:
        """The folder of all results."""

    @property
    def rows(self) -> list[_Row]:
        """A dictionary for each case, in their order, with the columns of ``results.parquet``."""

    @property
    def failed(self) -> list[str]:
        """Names of the cases that could not be diagnosed; their row says why."""

    def to_pandas(self) -> pd.DataFrame:
        """The rows as a frame."""

    def __copy__(self) -> Batch: ...
    def __deepcopy__(self, _memo: Any) -> Batch: ...
    def __len__(self) -> int: ...

def batch(
    cases: _Path | Iterable[Mapping[str, object]],
    *,
    out: _Path,
    jobs: int = 1,
    resume: bool = True,
    effects: _Path | None = None,
    formulas: bool = True,
    seed: int = 1,
    progress: Callable[[Progress], object] | None = None,
    threads: int | None = None,
    budget_s: float | None = None,
) -> Batch:
    """Diagnoses many cases, each into its own folder below ``out``, as
    ``softrig diagnose --batch`` does.

    ``cases`` is a manifest, or a list of dictionaries with its columns: ``case``, the name, which
    is that of its folder; ``model`` and ``recordings``, paths; and, where they are needed,
    ``holdout``, ``columns``, ``units`` and ``setup``, as for ``read``. ``jobs`` cases are diagnosed
    at a time, each on its part of the ``threads``. With ``resume`` a case is skipped if
    its results are there, made from the same inputs. ``budget_s`` is the time of each case; the
    rest is as for ``diagnose``. A case that cannot be diagnosed is a row that says why, and an
    InputWarning."""

@final
class Example:
    """Simulated recordings of an actuator with a hidden effect."""

    @property
    def model(self) -> Model:
        """The nominal model."""

    @property
    def truth(self) -> Model:
        """The answer: look here last."""

    @property
    def recordings(self) -> list[Recording]: ...
    def write(self, folder: _Path) -> None:
        """Writes model.toml, truth.toml and recordings/ into a folder, as ``softrig example``
        does."""

    def __copy__(self) -> Example: ...
    def __deepcopy__(self, _memo: Any) -> Example: ...

def example(seed: int = 1, *, effect: str | None = None, noise_deg: float = 0.4) -> Example:
    """Simulates recordings of an actuator with a hidden effect.

    The seed decides the actuator, the noise and the hidden effect, unless one is named;
    "none" hides no effect, only wrong parameters."""

def residuals(
    model: Model | None, recordings: _Recordings, *, prediction: str | None = None
) -> dict[str, Any]:
    """What a model leaves of recordings: correlations, prediction error over the time ahead,
    and distribution, as ``softrig residuals --json`` writes them. With ``prediction``, and None
    for the model, what a simulation of your own leaves, whose angles are in that column."""

def linearise(
    model: Model, *, at_deg: float | None = None, at_kpa: float | None = None
) -> dict[str, Any]:
    """A model for small motions about a rest, at an angle or under a pressure: state space,
    poles, gain and bandwidth, as ``softrig linearise --json`` writes them."""

def plan(
    model: Model,
    between: str,
    recordings: _Recordings | None = None,
    *,
    limits: str | None = None,
    noise_deg: float | None = None,
) -> dict[str, Any]:
    """The runs that tell two effects apart, best first, as ``softrig plan --json`` writes them."""

def init(recordings: _Recordings, *, name: str = "model") -> Model:
    """A first model, identified from recordings as ``softrig init --recording`` does."""

def _command() -> int:
    """Runs ``softrig`` with the arguments of this process and returns its exit code."""
