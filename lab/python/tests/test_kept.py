"""What a user keeps can be copied and pickled, for instance to come back from another process."""

import copy
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import softrig


def fitted(model: softrig.Model, recordings: list[softrig.Recording]) -> softrig.Fit:
    with pytest.warns(softrig.InputWarning, match="from the calibration"):
        return softrig.fit(model, recordings)


@pytest.fixture(scope="module")
def fit(model: softrig.Model, recordings: list[softrig.Recording]) -> softrig.Fit:
    return fitted(model, recordings[:2])


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_a_recording_comes_back_to_the_last_bit(
    protocol: int, paths: list[Path], model: softrig.Model, tmp_path: Path
) -> None:
    recording = softrig.read(paths[0])
    again = pickle.loads(pickle.dumps(recording, protocol))
    for name in ["time_s", "pressure_kpa", "angle_deg"]:
        np.testing.assert_array_equal(getattr(again, name), getattr(recording, name))
    assert (again.name, again.path) == (recording.name, recording.path)
    assert again.metadata == recording.metadata and again.metadata["simulated"] is True
    pd.testing.assert_frame_equal(again.to_pandas(), recording.to_pandas())
    # It is the same in a fit, and the same to one that is given both.
    ours, theirs = (softrig.simulate(model, it).rmse_deg for it in [recording, again])
    assert ours == theirs
    with pytest.raises(softrig.InputError, match="is given twice"):
        softrig.fit(model, [recording, again])


def test_what_was_said_of_a_recording_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    rows = [f"{k},{k % 7},{0.01 * k},{'a' if k % 2 else ''}" for k in range(100)]
    # A line that is no row is left out, and the rest keeps its lines.
    rows[50] = "torn"
    path.write_text("n,p,theta,note\n" + "\n".join(rows) + "\n")
    with pytest.warns(softrig.InputWarning, match="left out"):
        recording = softrig.read(
            path,
            columns={"time": "n", "pressure": "p", "angle": "theta"},
            units={"time": "s*50", "pressure": "kpa", "angle": "rad"},
            scale={"pressure": [[1, 0], [5, 100]]},
            setup={"tilt_deg": 90},
        )
    again = pickle.loads(pickle.dumps(recording))
    assert again.metadata == recording.metadata == {"setup": {"tilt_deg": 90}}
    pd.testing.assert_frame_equal(again.to_pandas(), recording.to_pandas())
    assert pickle.dumps(again) == pickle.dumps(recording)


def test_arrays_that_are_pickled_are_still_the_same_recording(model: softrig.Model) -> None:
    first, second = softrig.example(3).recordings[:2]
    copied = pickle.loads(pickle.dumps(first))
    with pytest.raises(softrig.InputError, match="is given twice"):
        softrig.fit(model, [first, second, copied])


def test_copies_are_the_thing_itself(
    model: softrig.Model,
    recordings: list[softrig.Recording],
    diagnosis: softrig.Diagnosis,
    fit: softrig.Fit,
) -> None:
    made = softrig.example(3)
    simulation = softrig.simulate(model, recordings[0])
    parameter = next(iter(fit.parameters.values()))
    for thing in [
        *[model, recordings[0], diagnosis, diagnosis.runs[0], fit, fit.runs[0]],
        *[made, simulation, parameter],
    ]:
        assert copy.copy(thing) is thing and copy.deepcopy(thing) is thing
    both = copy.deepcopy({"model": model, "fit": fit})
    assert both["model"] is model


def test_a_model_keeps_its_file(model: softrig.Model) -> None:
    again = pickle.loads(pickle.dumps(model))
    assert again.to_toml() == model.to_toml() and again.path == model.path
    of_text = softrig.Model.from_toml(model.to_toml())
    assert pickle.loads(pickle.dumps(of_text)).path is None


def test_a_fit_comes_back_whole(fit: softrig.Fit, tmp_path: Path) -> None:
    again = pickle.loads(pickle.dumps(fit))
    assert str(again) == str(fit) and repr(again) == repr(fit)
    assert again.model.to_toml() == fit.model.to_toml()
    assert (again.rmse_deg, again.angle_zero_deg) == (fit.rmse_deg, fit.angle_zero_deg)
    for key, parameter in fit.parameters.items():
        other = again.parameters[key]
        assert (other.value, other.interval95) == (parameter.value, parameter.interval95)
        assert repr(pickle.loads(pickle.dumps(parameter))) == repr(parameter)
    for run, other in zip(fit.runs, again.runs, strict=True):
        pd.testing.assert_frame_equal(other.to_pandas(), run.to_pandas())
    fit.plot(tmp_path / "a.svg")
    again.plot(tmp_path / "b.svg")
    assert (tmp_path / "a.svg").read_text() == (tmp_path / "b.svg").read_text()


def test_curves_and_examples_come_back(
    diagnosis: softrig.Diagnosis, model: softrig.Model, recordings: list[softrig.Recording]
) -> None:
    curves: list[softrig.Run | softrig.Simulation] = list(diagnosis.runs)
    curves.append(softrig.simulate(model, recordings[0]))
    for thing in curves:
        again = pickle.loads(pickle.dumps(thing))
        assert repr(again) == repr(thing)
        pd.testing.assert_frame_equal(again.to_pandas(), thing.to_pandas())
    made = softrig.example(3, effect="coulomb_friction", noise_deg=0.3)
    again = pickle.loads(pickle.dumps(made))
    assert again.truth.to_toml() == made.truth.to_toml()
    np.testing.assert_array_equal(again.recordings[4].angle_deg, made.recordings[4].angle_deg)
    verdict = pickle.loads(pickle.dumps(diagnosis.verdict))
    assert verdict == diagnosis.verdict and verdict.effects[0].kind == "coulomb_friction"


def test_what_cannot_be_pickled_says_what_to_keep(
    diagnosis: softrig.Diagnosis, model: softrig.Model, recordings: list[softrig.Recording]
) -> None:
    with pytest.raises(TypeError, match=r"Diagnosis cannot be pickled.*keep \.model, \.runs") as said:
        pickle.dumps(diagnosis)
    assert ".json()" in str(said.value)
    kept = pickle.loads(pickle.dumps((diagnosis.model, diagnosis.runs, diagnosis.json())))
    assert kept[2] == diagnosis.json()


def test_a_progress_may_come_from_another_process(
    model: softrig.Model, recordings: list[softrig.Recording]
) -> None:
    told: list[bytes] = []
    softrig.diagnose(model, recordings[:2], progress=lambda it: told.append(pickle.dumps(it)))
    last = pickle.loads(told[-1])
    assert str(last) and last.fits > 0 and last.elapsed_s > 0


def test_a_fault_comes_back_from_a_process_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("time_s,pressure_kpa,angle_deg\n0,0,0\n0.01,0,nan\n")
    with pytest.raises(softrig.InputError) as raised:
        softrig.read(path)
    again = pickle.loads(pickle.dumps(raised.value))
    assert str(again) == str(raised.value)
    assert (again.line, again.column, again.advice) == (3, "angle_deg", raised.value.advice)


ELSEWHERE = """
import pickle, sys
fit, recording, model = pickle.load(sys.stdin.buffer)
assert recording.path and fit.rmse_deg > 0
print(repr(fit), len(recording), model.name, sep="|")
"""


def test_another_process_needs_no_file(
    fit: softrig.Fit, folder: Path, paths: list[Path], tmp_path: Path
) -> None:
    moved = tmp_path / paths[0].name
    moved.write_bytes(paths[0].read_bytes())
    recording = softrig.read(moved)
    text = pickle.dumps((fit, recording, softrig.Model.read(folder / "model.toml")))
    moved.unlink()
    done = subprocess.run([sys.executable, "-c", ELSEWHERE], input=text, capture_output=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.decode().split("|")[:2] == [repr(fit), str(len(recording))]


def test_a_picture_of_a_fit_is_laid_out_as_one_of_a_diagnosis(
    fit: softrig.Fit, diagnosis: softrig.Diagnosis, paths: list[Path], tmp_path: Path
) -> None:
    names = [run.name for run in fit.runs]
    fit.plot(tmp_path / "fit.svg", runs=names[:1], panels="angle", width="89mm")
    text = (tmp_path / "fit.svg").read_text()
    assert 'width="89mm"' in text and names[0] in text and names[1] not in text
    assert "fitted" in text and "nominal" in text and ">pressure" not in text
    fit.plot(tmp_path / "whole.svg", headline=False)
    whole = (tmp_path / "whole.svg").read_text()
    assert ">pressure" in whole and names[1] in whole and "RMS error" not in whole
    for end, begin in [("pdf", b"%PDF"), ("png", b"\x89PNG")]:
        fit.plot(tmp_path / f"fit.{end}", font_size=7, colours="print")
        assert (tmp_path / f"fit.{end}").read_bytes().startswith(begin)
    plots: list[Callable[..., object]] = [fit.plot, diagnosis.plot]
    for plot in plots:
        with pytest.raises(softrig.InputError, match=r"\.svg, \.pdf or \.png"):
            plot(tmp_path / "fit.jpg")
        with pytest.raises(ValueError, match="89mm"):
            plot(tmp_path / "fit.pdf", width="wide")
        with pytest.raises(ValueError, match="screen, or print"):
            plot(tmp_path / "fit.pdf", colours="grey")
        with pytest.raises(ValueError, match="from 4 to 40"):
            plot(tmp_path / "fit.pdf", font_size=1)
        with pytest.raises(softrig.InputError, match="no panel torque"):
            plot(tmp_path / "fit.pdf", panels=["torque"])
        with pytest.raises(softrig.InputError, match="there is no run nowhere"):
            plot(tmp_path / "fit.pdf", runs=["nowhere"])
        with pytest.raises(softrig.InputError, match="but no file"):
            plot(width="89mm")
        with pytest.raises(TypeError, match="colors"):
            plot(tmp_path / "fit.pdf", colors="print")
        with pytest.raises(softrig.InputError, match="is read by this command"):
            plot(paths[0])
    assert not (tmp_path / "fit.jpg").exists()
