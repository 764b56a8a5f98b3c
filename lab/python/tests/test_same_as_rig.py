"""The package and the command are one program: on the same files they say the same."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import softrig
from conftest import SEED, Rig


def test_the_verdict_is_that_of_the_command(
    rig: Rig,
    folder: Path,
    paths: list[Path],
    diagnosis: softrig.Diagnosis,
    tmp_path: Path,
) -> None:
    verdict = tmp_path / "verdict.json"
    repaired = tmp_path / "repaired.toml"
    expected = rig.json(
        verdict,
        *["diagnose", "--model", folder / "model.toml", *paths],
        *["--json", verdict, "-o", repaired],
    )
    found = json.loads(diagnosis.json())
    assert found.pop("seconds") > 0 and expected.pop("seconds") > 0
    assert found == expected
    assert diagnosis.model.to_toml() == repaired.read_text()
    # To the byte, but for the time that it took.
    without_time = re.compile(r'"seconds": .*')
    text = without_time.sub("", verdict.read_text())
    assert without_time.sub("", diagnosis.json()) == text


def test_a_simulation_is_that_of_the_command(
    rig: Rig, folder: Path, paths: list[Path], model: softrig.Model, tmp_path: Path
) -> None:
    recording = softrig.read(paths[0])
    cases: list[tuple[list[str], dict[str, Any]]] = [
        ([], {}),
        (["--linear"], {"linear": True}),
        (["--arithmetic", "board"], {"arithmetic": "board"}),
    ]
    for number, (flags, options) in enumerate(cases):
        out = tmp_path / f"{number}.csv"
        done = rig(
            *["simulate", "--model", folder / "model.toml"],
            *["--recording", paths[0], "-o", out, *flags],
        )
        assert done.returncode == 0, done.stderr
        simulation = softrig.simulate(model, recording, **options)
        expected = softrig.read(out).to_pandas()
        # The file has four decimals.
        np.testing.assert_allclose(
            simulation.angle_deg, expected["predicted_deg"], rtol=0, atol=5.1e-5
        )
        said = re.search(r"RMS error against the recording: ([\d.]+)°", done.stdout)
        assert said and f"{simulation.rmse_deg:.3f}" == said[1]


def test_a_protocol_is_that_of_the_command(
    rig: Rig, folder: Path, model: softrig.Model, tmp_path: Path
) -> None:
    out = tmp_path / "steps.csv"
    for protocol in ["staircase", "board:steps"]:
        done = rig(
            *["simulate", "--model", folder / "model.toml"],
            *["--protocol", protocol, "--angle-deg", 40, "-o", out],
        )
        assert done.returncode == 0, done.stderr
        simulation = softrig.simulate(model, protocol=protocol, angle_deg=40)
        expected = softrig.read(out).to_pandas()
        for name in ["angle_deg", "setpoint_deg", "pressure_kpa"]:
            np.testing.assert_allclose(
                simulation.to_pandas()[name], expected[name], rtol=0, atol=5.1e-5
            )


def test_a_fit_is_that_of_the_command(
    rig: Rig,
    folder: Path,
    paths: list[Path],
    model: softrig.Model,
    recordings: list[softrig.Recording],
    tmp_path: Path,
) -> None:
    out = tmp_path / "fitted.toml"
    done = rig("fit", "--model", folder / "model.toml", *paths, "-o", out)
    assert done.returncode == 0, done.stderr
    with pytest.warns(softrig.InputWarning) as warned:
        fit = softrig.fit(model, recordings)
    said = " ".join(done.stderr.split())
    assert all(str(warning.message) in said for warning in warned)
    assert fit.model.to_toml() == out.read_text()
    last = re.search(r"^all +([\d.]+) +([\d.]+)$", done.stdout, re.MULTILINE)
    assert last is not None
    assert [f"{fit.nominal_rmse_deg:.3g}", f"{fit.rmse_deg:.3g}"] == list(last.groups())


def test_an_example_is_that_of_the_command(rig: Rig, tmp_path: Path) -> None:
    done = rig("example", "-o", tmp_path, "--hide", SEED)
    assert done.returncode == 0, done.stderr
    made = softrig.example(SEED)
    assert made.model.to_toml() == (tmp_path / "model.toml").read_text()
    assert made.truth.to_toml() == (tmp_path / "truth.toml").read_text()
    for recording in made.recordings:
        read = softrig.read(tmp_path / "recordings" / f"{recording.name}.csv")
        assert read.metadata == recording.metadata
        np.testing.assert_array_equal(read.angle_deg, recording.angle_deg)
        np.testing.assert_array_equal(read.pressure_kpa, recording.pressure_kpa)


def test_an_error_has_the_words_of_the_command(
    rig: Rig, folder: Path, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.csv"
    broken.write_text("time_s,pressure_kpa,angle_deg\n0,0,0\n0.01,zero,0\n")
    with pytest.raises(softrig.InputError) as raised:
        softrig.read(broken)
    done = rig("simulate", "--model", folder / "model.toml", "--recording", broken)
    assert done.returncode == 2
    assert done.stderr.strip() == f"error: {raised.value}"


def test_a_comparison_is_that_of_the_command(
    rig: Rig,
    folder: Path,
    paths: list[Path],
    model: softrig.Model,
    recordings: list[softrig.Recording],
    tmp_path: Path,
) -> None:
    table = tmp_path / "table.csv"
    models = ["--model", folder / "model.toml", "--model", folder / "truth.toml"]
    done = rig("compare", *models, "--linear", *paths, "-o", table)
    assert done.returncode == 0, done.stderr
    expected = pd.read_csv(table)
    both = [model, softrig.Model.read(folder / "truth.toml")]
    found = softrig.compare(both, recordings, linear=True)
    pd.testing.assert_frame_equal(found, expected, check_exact=False, atol=6e-4)
    assert softrig.compare(model, recordings)["model"].unique().tolist() == [model.name]
    with pytest.raises(TypeError):
        softrig.compare([folder], recordings)  # type: ignore[list-item]


def test_a_gap_is_that_of_the_command(rig: Rig, tmp_path: Path) -> None:
    head = "time_s,pressure_kpa,angle_deg,predicted_deg\n"
    before, after = tmp_path / "before.csv", tmp_path / "after.csv"
    before.write_text(head + "0,0,1,4\n0.01,0,2,\n0.02,0,5,1\n")
    after.write_text(head + "0,0,1,1.5\n0.01,0,2,2\n0.02,0,5,5.5\n")
    out = tmp_path / "gap.json"
    expected = rig.json(out, "gap", before, "--after", after, "--json", out)
    [first, second] = softrig.read([before, after])
    assert softrig.gap(first, second) == expected
    alone = softrig.gap(first)
    assert alone["after"] is None and alone["before"] == expected["before"]
    with pytest.raises(softrig.InputError, match="predicted_deg"):
        softrig.gap(softrig.example(1).recordings[0])
