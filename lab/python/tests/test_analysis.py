"""What the commands for analysis and export say, from Python, and in other tools."""

import importlib.util
import json
import subprocess
import sys
from ctypes import c_double, c_int, c_uint32
from pathlib import Path
from typing import Any

import fmpy  # type: ignore[import-untyped]
import fmpy.fmi2  # type: ignore[import-untyped]
import numpy as np
import pytest
from fmpy.validation import validate_fmu  # type: ignore[import-untyped]
from numpy.typing import NDArray
from scipy import signal  # type: ignore[import-untyped]

import softrig
from conftest import SEED, Rig


def module(path: Path) -> Any:
    """A Python file, as a module."""
    found = importlib.util.spec_from_file_location(path.stem, path)
    assert found and found.loader
    loaded = importlib.util.module_from_spec(found)
    found.loader.exec_module(loaded)
    return loaded


def stepped(
    unit: Path, time_s: NDArray[np.float64], pressure_kpa: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The angles of a unit whose master knows the slope of the pressure."""
    about = fmpy.read_model_description(str(unit))
    slave = fmpy.fmi2.FMU2Slave(
        guid=about.guid,
        unzipDirectory=fmpy.extract(str(unit)),
        modelIdentifier=about.coSimulation.modelIdentifier,
        instanceName="finger",
    )
    slave.instantiate()
    slave.setupExperiment(startTime=time_s[0])
    slave.enterInitializationMode()
    slave.setReal([0], [pressure_kpa[0]])
    slave.exitInitializationMode()
    angles = [slave.getReal([1])[0]]
    for k, interval in enumerate(np.diff(time_s)):
        slave.setReal([0], [pressure_kpa[k]])
        slope = (pressure_kpa[k + 1] - pressure_kpa[k]) / interval
        slave.fmi2SetRealInputDerivatives(
            slave.component, (c_uint32 * 1)(0), 1, (c_int * 1)(1), (c_double * 1)(slope)
        )
        slave.doStep(time_s[k], interval)
        angles.append(slave.getReal([1])[0])
    slave.terminate()
    slave.freeInstance()
    return np.array(angles)


@pytest.mark.parametrize(
    "effect", ["coulomb_friction", "dead_time", "maxwell_branch", "input_backlash", "sensor_lag"]
)
def test_a_functional_mockup_unit_moves_as_the_model_does(effect: str, tmp_path: Path) -> None:
    model = softrig.example(5, effect=effect).truth
    unit = tmp_path / "finger.fmu"
    model.export(unit)
    assert validate_fmu(str(unit)) == []
    # The file that the test of exports compares with `softrig simulate`.
    model.export(tmp_path / "reference.py")
    reference = module(tmp_path / "reference.py")
    time_s = np.arange(0.0, 8.0, 0.01)
    # Straight lines, of which both tools make the same.
    for pressure_kpa in [np.full_like(time_s, 25.0), 6.0 * time_s, 40.0 - 5.0 * time_s]:
        expected = reference.simulate(list(time_s), list(pressure_kpa))
        found = stepped(unit, time_s, pressure_kpa)
        assert np.ptp(found) > 1.0
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    # As a tool does it that knows no slopes.
    held = fmpy.simulate_fmu(
        str(unit),
        stop_time=time_s[-1],
        step_size=0.01,
        output_interval=0.01,
        start_values={"pressure_kpa": 25.0},
        output=["angle_deg"],
    )
    expected = reference.simulate(list(time_s), [25.0] * len(time_s))
    np.testing.assert_allclose(held["angle_deg"], expected, rtol=1e-9, atol=1e-9)


def test_a_linear_model_is_that_of_the_command_and_of_scipy(
    rig: Rig, folder: Path, tmp_path: Path
) -> None:
    model = softrig.Model.read(folder / "truth.toml")
    said = tmp_path / "linear.json"
    code = tmp_path / "finger_linear.py"
    expected = rig.json(
        said,
        *["linearise", "--model", folder / "truth.toml", "--at", "30deg"],
        *["--json", said, "-o", code],
    )
    found = softrig.linearise(model, at_deg=30)
    assert found == expected
    assert found["left_out"] == ["coulomb_friction"]
    system = module(code).system
    assert isinstance(system, signal.StateSpace)
    poles = [complex(pole["re_per_s"], pole["im_per_s"]) for pole in found["poles"]]
    np.testing.assert_allclose(
        np.sort_complex(np.array(poles)), np.sort_complex(system.poles), rtol=1e-5
    )
    steady = (-system.C @ np.linalg.solve(system.A, system.B)).item()
    assert steady == pytest.approx(found["steady_gain_deg_per_kpa"], rel=1e-5)
    # The rest under its pressure is the rest.
    again = softrig.linearise(model, at_kpa=found["pressure_kpa"])
    assert again["angle_deg"] == pytest.approx(30, abs=1e-3)
    with pytest.raises(TypeError, match="one of them"):
        softrig.linearise(model)


def test_residuals_and_plans_are_those_of_the_commands(
    rig: Rig, folder: Path, paths: list[Path], model: softrig.Model, tmp_path: Path
) -> None:
    recordings = softrig.read(paths)
    of_model = ["--model", folder / "model.toml"]
    said = tmp_path / "said.json"
    expected = rig.json(said, "residuals", *of_model, *paths, "--json", said)
    assert softrig.residuals(model, recordings) == expected
    between = "coulomb_friction,maxwell_branch"
    expected = rig.json(
        said, "plan", *of_model, "--between", between, *paths, "--limits", "deg=60", "--json", said
    )
    assert softrig.plan(model, between, recordings, limits="deg=60") == expected
    with pytest.raises(softrig.InputError, match="two different explanations"):
        softrig.plan(model, "gravity")


def test_a_first_model_is_that_of_the_command(rig: Rig, paths: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "first.toml"
    done = rig("init", "--recording", *paths, "-o", out)
    assert done.returncode == 0, done.stderr
    expected = softrig.Model.read(out)
    found = softrig.init(softrig.read(paths))
    assert found.parameters == expected.parameters
    assert found.free == expected.free


def test_fits_are_printed_and_drawn(rig: Rig, tmp_path: Path) -> None:
    """Of a model that lacks nothing, on a rig whose pressure sensor is off by 3 kPa: all
    parameters are determined, and the zero is what there is to warn of."""
    import matplotlib

    matplotlib.use("agg")
    made = softrig.example(SEED, effect="none")
    made.write(tmp_path)
    paths = sorted((tmp_path / "recordings").glob("step*_[12].csv"))
    for path in paths:
        rows = softrig.read(path).to_pandas()
        rows["pressure_kpa"] += 3.0
        rows.to_csv(path, index=False)
    with pytest.warns(softrig.InputWarning, match="the zero of the pressure") as warned:
        fit = softrig.fit(made.model, softrig.read(paths))
    assert len(warned) == 1 and fit.converged
    assert fit.pressure_zero_kpa == pytest.approx([3.0] * len(paths), abs=0.1)
    for name, parameter in fit.parameters.items():
        assert parameter.interval95 is not None
        low, high = parameter.interval95
        assert low < made.truth.parameters[name] < high, name
    done = rig("fit", "--model", tmp_path / "model.toml", *paths)
    assert str(fit) in done.stdout
    axes = fit.plot()
    assert len(axes) == len(fit.runs)
    lines = axes[0].get_lines()
    assert [line.get_label() for line in lines] == ["measured", "nominal", "fitted"]
    np.testing.assert_array_equal(lines[0].get_ydata(), fit.runs[0].measured_deg)


def test_the_package_installs_the_command(folder: Path) -> None:
    command = Path(sys.executable).with_name("softrig")
    done = subprocess.run([command, "--version"], capture_output=True, text=True)
    assert done.stdout.strip() == f"softrig {softrig.__version__}", done
    done = subprocess.run([command, "fit"], capture_output=True, text=True)
    assert done.returncode == 2 and "<REC.csv>" in done.stderr
    done = subprocess.run(
        [command, "linearise", "--model", folder / "truth.toml", "--at", "20deg", "--json", "-"],
        capture_output=True,
        text=True,
    )
    assert json.loads(done.stdout)["angle_deg"] == 20
