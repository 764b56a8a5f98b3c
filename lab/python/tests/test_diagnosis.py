"""A diagnosis as an object: its curves, its files, and how it is watched and stopped."""

import hashlib
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import softrig


def test_it_finds_what_was_hidden(diagnosis: softrig.Diagnosis) -> None:
    assert diagnosis.answer == diagnosis.verdict.verdict == "effect_found"
    assert diagnosis.effects == ["coulomb_friction"]
    assert "Coulomb friction" in diagnosis.sentence
    assert diagnosis.model.effects == ["coulomb_friction"]
    verdict = diagnosis.verdict
    named = verdict.effects[0]
    low, high = named.interval95["force_n"]
    assert low < named.parameters["force_n"] < high
    assert verdict.family is None and verdict.repair is None
    assert verdict.ended is None and verdict.not_tried == [] and verdict.left_out == []
    assert verdict.closure is not None and verdict.closure.overall > 0.5
    assert verdict.places[0].share_of_gap > 0
    assert verdict.holdout_rmse_deg.repaired < verdict.holdout_rmse_deg.refit


def test_curves_add_up(
    diagnosis: softrig.Diagnosis, recordings: list[softrig.Recording]
) -> None:
    assert [run.name for run in diagnosis.runs] == [r.name for r in recordings]
    assert diagnosis.runs is diagnosis.runs
    squares = 0.0
    samples = 0
    for run, recording in zip(diagnosis.runs, recordings, strict=True):
        assert not run.held_out and run.compared.all()
        np.testing.assert_array_equal(run.measured_deg, recording.angle_deg)
        np.testing.assert_array_equal(run.time_s, recording.time_s)
        for name in ["nominal", "refit", "repaired"]:
            angle = getattr(run, f"{name}_deg")
            residual = getattr(run, f"{name}_residual_deg")
            np.testing.assert_allclose(angle - run.measured_deg, residual, atol=1e-9)
        squares += float(np.sum(run.refit_residual_deg**2))
        samples += len(run.time_s)
        assert run.missing_force_n is not None and run.missing_force_sd_n is not None
        assert len(run.missing_force_n) == len(run.time_s)
        assert np.all(run.missing_force_sd_n > 0)
        frame = run.to_pandas()
        assert frame["compared"].dtype == bool and len(frame) == len(recording)
    expected = diagnosis.verdict.rmse_deg.refit
    assert np.sqrt(squares / samples) == pytest.approx(expected, rel=1e-6)


def test_the_missing_force_is_the_one_that_was_taken_away(folder: Path) -> None:
    """A model with nothing wrong but that its dry friction is missing, and with nothing free
    that could make up for it, lacks just that force: against the motion, in both directions.
    What is alike in both is a zero, which the same fit estimates."""
    truth = softrig.Model.read(folder / "truth.toml")
    text = truth.to_toml().split("[[effect]]")[0]
    without = softrig.Model.from_toml(re.sub(r"free = \[.*\]", "free = []", text))
    steps = sorted((folder / "recordings").glob("step90_*.csv"))
    found = softrig.diagnose(without, softrig.read(steps))
    assert found.effects == ["coulomb_friction"]
    bending, straightening = [], []
    for run in found.runs:
        rate = np.gradient(run.repaired_deg, run.time_s)
        fast = 0.5 * np.abs(rate).max()
        assert run.missing_force_n is not None
        bending.append(run.missing_force_n[rate > fast])
        straightening.append(run.missing_force_n[rate < -fast])
    up, down = np.median(np.concatenate(bending)), np.median(np.concatenate(straightening))
    assert down < 0 < up
    expected = truth.parameters["coulomb_friction.force_n"]
    assert 0.5 * (up - down) == pytest.approx(expected, rel=0.15)


def test_runs_can_be_held_out(
    model: softrig.Model, recordings: list[softrig.Recording]
) -> None:
    fitted, held_out = recordings[::2], recordings[1::2]
    found = softrig.diagnose(model, fitted, holdout=held_out, seed=2, threads=1)
    roles = [run.held_out for run in found.runs]
    assert roles == [False] * len(fitted) + [True] * len(held_out)
    assert found.runs[-1].missing_force_n is None
    assert found.verdict.seed == 2
    assert found.effects == ["coulomb_friction"]


def test_the_same_recording_twice_proves_nothing(
    model: softrig.Model, recordings: list[softrig.Recording], paths: list[Path]
) -> None:
    with pytest.raises(softrig.InputError, match="is given twice"):
        softrig.diagnose(model, recordings, holdout=recordings[0])
    with pytest.raises(softrig.InputError, match="is given twice"):
        softrig.diagnose(model, recordings, holdout=softrig.read(paths[:1]))
    in_memory = softrig.example(3).recordings[0]
    with pytest.raises(softrig.InputError, match="is given twice"):
        softrig.fit(model, [in_memory, in_memory])
    with pytest.raises(softrig.InputError, match="two runs or more"):
        softrig.diagnose(model, [])
    with pytest.raises(TypeError, match=r"expected a softrig\.Recording"):
        softrig.fit(model, paths)  # type: ignore[arg-type]


def test_arrays_with_one_name_are_told_apart(
    model: softrig.Model, recordings: list[softrig.Recording], tmp_path: Path
) -> None:
    arrays = [
        softrig.Recording(time_s=r.time_s, pressure_kpa=r.pressure_kpa, angle_deg=r.angle_deg)
        for r in recordings[:3]
    ]
    # Without the friction of the example, zeros make up for a part of it.
    with pytest.warns(softrig.InputWarning, match="from the calibration"):
        fit = softrig.fit(model, arrays)
    assert [run.name for run in fit.runs] == ["recording", "recording 2", "recording 3"]
    with pytest.warns(softrig.InputWarning, match="from the calibration"):
        of_files = softrig.fit(model, recordings[:3])
    assert fit.rmse_deg == pytest.approx(of_files.rmse_deg, rel=1e-6)
    assert fit.rmse_deg < fit.nominal_rmse_deg
    run = fit.runs[0]
    np.testing.assert_allclose(run.fitted_deg - run.measured_deg, run.residual_deg)
    assert run.rmse_deg == pytest.approx(np.sqrt(np.mean(run.residual_deg**2)))
    assert len(fit.pressure_zero_kpa) == len(fit.angle_zero_deg) == 3
    for key, parameter in fit.parameters.items():
        assert parameter.value == fit.model.parameters[key]
        assert parameter.nominal == model.parameters[key]
        assert parameter.interval95 is not None
        low, high = parameter.interval95
        assert low < parameter.value < high


def test_the_report_says_what_it_was_made_from(
    diagnosis: softrig.Diagnosis, paths: list[Path], folder: Path, tmp_path: Path
) -> None:
    page = tmp_path / "report.html"
    diagnosis.report(page)
    text = page.read_text()
    for path in [*paths, folder / "model.toml"]:
        assert hashlib.sha256(path.read_bytes()).hexdigest() in text
    assert "softrig.diagnose(softrig.Model.read(" in text
    diagnosis.plot(tmp_path / "gap.svg")
    assert (tmp_path / "gap.svg").read_text().startswith("<svg")
    diagnosis.plot(tmp_path / "gap.pdf", width="89mm", panels=["angle"])
    assert (tmp_path / "gap.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(softrig.InputError, match=r"\.svg, \.pdf or \.png"):
        diagnosis.plot(tmp_path / "gap.jpg")
    with pytest.raises(ValueError, match="89mm"):
        diagnosis.plot(tmp_path / "gap.pdf", width="wide")
    before = paths[0].read_bytes()
    writers: list[Callable[[Path], object]] = [diagnosis.report, diagnosis.plot]
    for write in writers:
        with pytest.raises(softrig.InputError, match="is read by this command"):
            write(paths[0])
        with pytest.raises(softrig.InputError, match="there is no folder"):
            write(tmp_path / "absent" / "x.html")
    assert paths[0].read_bytes() == before


def test_a_report_of_arrays_has_a_hash_that_can_be_made_again(tmp_path: Path) -> None:
    made = softrig.example(3, effect="none")
    found = softrig.diagnose(made.model, made.recordings[:6])
    assert found.answer in ("parameters_only", "no_discrepancy") and found.effects == []
    found.report(tmp_path / "report.html")
    first = made.recordings[0]
    columns = [first.time_s, first.pressure_kpa, first.angle_deg]
    digest = hashlib.sha256(np.concatenate(columns).astype("<f8").tobytes()).hexdigest()
    text = (tmp_path / "report.html").read_text()
    assert digest in text and "step30_1, in memory" in text


def test_it_shows_itself(diagnosis: softrig.Diagnosis) -> None:
    assert str(diagnosis).startswith(diagnosis.sentence)
    assert repr(diagnosis) == "<softrig.Diagnosis: effect_found, coulomb_friction>"
    html = diagnosis._repr_html_()
    assert diagnosis.sentence in html and "<script" not in html and len(html) < 4000


def test_names_of_recordings_are_no_markup(model: softrig.Model) -> None:
    made = softrig.example(3, effect="none")
    short = [
        softrig.Recording(
            time_s=r.time_s,
            pressure_kpa=r.pressure_kpa,
            angle_deg=np.minimum(r.angle_deg, 25),
            name=f"<img src=x onerror=alert({n})>",
        )
        for n, r in enumerate(made.recordings[:3])
    ]
    found = softrig.diagnose(made.model, short)
    assert any("<img" in note for note in found.notes)
    assert "<img" not in found._repr_html_()


def test_progress_is_reported_and_may_end_it(
    model: softrig.Model, recordings: list[softrig.Recording]
) -> None:
    told: list[softrig.Progress] = []
    softrig.diagnose(model, recordings, progress=told.append)
    assert told and all(report.done <= report.fits for report in told)
    fits = [report.fits for report in told]
    assert fits == sorted(fits) and fits[-1] > 10
    assert told[-1].stage in str(told[-1]) and told[-1].elapsed_s > 0

    def enough(report: softrig.Progress) -> None:
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        softrig.diagnose(model, recordings, progress=enough)
    with pytest.raises(TypeError):
        softrig.diagnose(model, recordings, progress=1)  # type: ignore[arg-type]


def test_fits_are_kept(
    model: softrig.Model, recordings: list[softrig.Recording], tmp_path: Path
) -> None:
    folder = tmp_path / "fits"
    first = softrig.diagnose(model, recordings, resume=folder)
    assert any(folder.iterdir())
    again = softrig.diagnose(model, recordings, resume=folder)
    assert again.model.to_toml() == first.model.to_toml()


OWN = """\
schema = 1

[[effect]]
kind = "custom"
name = "my_friction"
force = "a*tanh(w/b)"

[effect.parameters]
a = { value = 0.02, min = 0.0, max = 1.0, unit = "N" }
b = { value = 0.05, min = 0.001, max = 1.0, unit = "rad/s" }
"""


def test_effects_of_ones_own_are_tried(
    model: softrig.Model, recordings: list[softrig.Recording], tmp_path: Path
) -> None:
    effects = tmp_path / "mine.toml"
    effects.write_text(OWN)
    found = softrig.diagnose(model, recordings, effects=effects)
    # It is a dry friction like the one that is hidden: one of the two is named, or both are
    # rivals.
    named = found.effects + [kind for rival in found.verdict.alternatives for kind in rival.kinds]
    assert "my_friction" in named
    found.report(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert hashlib.sha256(OWN.encode()).hexdigest() in text and "effects=" in text
    with pytest.raises(softrig.InputError, match="is read by this command"):
        found.plot(effects)
    effects.write_text(OWN.replace("tanh", "tanz"))
    with pytest.raises(softrig.InputError, match="there is no function") as raised:
        softrig.diagnose(model, recordings, effects=effects)
    assert raised.value.line == 6


def test_a_budget_ends_the_search_with_an_answer(
    model: softrig.Model, recordings: list[softrig.Recording]
) -> None:
    found = softrig.diagnose(model, recordings, budget_s=0)
    assert found.verdict.ended == "budget" and found.verdict.not_tried
    assert "The time of 0 ms ran out" in str(found)
    for seconds in [-1.0, float("nan"), 1e300]:
        with pytest.raises(softrig.InputError, match="budget_s is"):
            softrig.diagnose(model, recordings, budget_s=seconds)


def test_other_threads_go_on_meanwhile(
    model: softrig.Model, recordings: list[softrig.Recording]
) -> None:
    """Another thread of Python counts while the fits run. With the interpreter held it would
    count nothing; without, it misses a beat only where processors are short."""
    beats = 0
    done = threading.Event()

    def beat() -> None:
        nonlocal beats
        while not done.wait(0.005):
            beats += 1

    thread = threading.Thread(target=beat)
    thread.start()
    began = time.monotonic()
    softrig.diagnose(model, recordings)
    seconds = time.monotonic() - began
    done.set()
    thread.join()
    assert beats > 0.1 * seconds / 0.005, f"{beats} beats in {seconds:.1f} s"


@pytest.mark.parametrize("threads", [1, 2])
def test_several_diagnoses_at_once(
    model: softrig.Model,
    recordings: list[softrig.Recording],
    diagnosis: softrig.Diagnosis,
    threads: int,
) -> None:
    """They share nothing, and the number of threads changes no bit of the result."""
    found: list[str] = []

    def work() -> None:
        made = softrig.diagnose(model, recordings, threads=threads)
        found.append(made.model.to_toml())

    workers = [threading.Thread(target=work) for _ in range(2)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert found == [diagnosis.model.to_toml()] * 2


def fitted_rmse(seed: int) -> float:
    made = softrig.example(seed, effect="none")
    return softrig.fit(made.model, made.recordings[:2]).rmse_deg


@pytest.mark.skipif(sys.platform != "linux", reason="forks are safe on Linux only")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_it_works_in_a_process_that_was_forked() -> None:
    expected = fitted_rmse(1)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(fitted_rmse, (1,)).get(timeout=60) == expected


INTERRUPTED = """
import resource, signal, time
import softrig

# Whatever started the tests in the background may have it ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)

made = softrig.example(3)
everything = [r for n in range(6) for r in softrig.example(n, effect="coulomb_friction").recordings]

def report(progress):
    print(progress.stage, flush=True)

try:
    softrig.diagnose(made.model, everything, progress=report)
except KeyboardInterrupt:
    raised = time.monotonic()
    print("interrupted", flush=True)
    # The work has ended once a second goes by without work.
    used = lambda: sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    while time.monotonic() - raised < 60:
        before = used()
        time.sleep(1)
        if used() - before < 0.2:
            print("ended", flush=True)
            break
    # The interpreter is as good as before.
    print(softrig.simulate(made.model, made.recordings[0]).rmse_deg, flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="a signal to a process")
def test_ctrl_c_raises_soon_and_ends_the_work() -> None:
    process = subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", INTERRUPTED],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    until(process.stdout.readline, "refit of the nominal structure")
    process.send_signal(signal.SIGINT)
    began = time.monotonic()
    until(process.stdout.readline, "interrupted")
    seconds = time.monotonic() - began
    rest, said = process.communicate(timeout=120)
    assert seconds < 2, f"{seconds:.1f} s"
    assert process.returncode == 0, said
    assert re.fullmatch(r"ended\n[\d.]+\n", rest), rest
    assert "panicked" not in said


def until(lines: Callable[[], str], wanted: str) -> None:
    while line := lines():
        if wanted in line:
            return
    raise AssertionError(f"{wanted!r} was never said")
