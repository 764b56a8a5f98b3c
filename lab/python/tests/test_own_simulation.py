"""A simulation of somebody's own, known by a column of its angles."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest

import softrig
from conftest import Rig

RUNS = ["step30_1", "step60_1", "step90_1", "step90_2", "triangle"]


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings beside whose angles stand those of the nominal model, in radians."""
    path = tmp_path_factory.mktemp("own")
    made = softrig.example(3, effect="quadratic_damping")
    made.write(path / "made")
    for name in RUNS:
        recording = softrig.read(path / f"made/recordings/{name}.csv")
        frame = recording.to_pandas()
        angles = np.radians(softrig.simulate(made.model, recording).angle_deg)
        # In the middle, before some other column.
        frame.insert(1, "theta_sim", angles.round(6))
        frame.to_csv(path / f"{name}.csv", index=False)
    return path


@pytest.fixture(scope="module")
def model(own: Path) -> softrig.Model:
    return softrig.Model.read(own / "made/model.toml")


@pytest.fixture(scope="module")
def recordings(own: Path) -> list[softrig.Recording]:
    return softrig.read([own / f"{name}.csv" for name in RUNS])


def test_it_is_compared_as_by_the_command(
    rig: Rig, own: Path, model: softrig.Model, recordings: list[softrig.Recording]
) -> None:
    both = softrig.compare(model, recordings, prediction="theta_sim:rad")
    assert list(both["model"].unique()) == [model.name, "theta_sim"]
    files = [own / f"{name}.csv" for name in RUNS]
    said = rig.json(
        own / "said.json",
        *["compare", "--model", own / "made/model.toml", "--prediction", "theta_sim:rad"],
        *[*files, "--json", own / "said.json"],
    )
    expected = [row["rms_deg"] for row in said["rows"]]
    np.testing.assert_allclose(both["rms_deg"], expected, rtol=1e-6)
    alone = softrig.compare(None, recordings, prediction="theta_sim:rad")
    ours = both[both["model"] == "theta_sim"]
    assert alone["rms_deg"].tolist() == ours["rms_deg"].tolist()
    with pytest.raises(softrig.InputError, match="theta_sim:rad"):
        softrig.compare(None, recordings, prediction="theta_sim")
    nothing: list[tuple[list[softrig.Model] | None, bool]] = [
        *[(None, False), (None, True), ([], False)]
    ]
    for models, linear in nothing:
        with pytest.raises(TypeError, match="give a model"):
            softrig.compare(models, recordings, linear=linear)


def test_its_residuals_are_those_of_the_command(
    rig: Rig, own: Path, model: softrig.Model, recordings: list[softrig.Recording]
) -> None:
    found = softrig.residuals(None, recordings[1:3], prediction="theta_sim:rad")
    expected = rig.json(
        own / "left.json",
        *["residuals", "--prediction", "theta_sim:rad"],
        *[own / "step60_1.csv", own / "step90_1.csv", "--json", own / "left.json"],
    )
    assert found == expected and found["model"] == "theta_sim"
    with pytest.raises(softrig.InputError, match="its other columns are theta_sim"):
        softrig.residuals(None, recordings, prediction="theta")
    for given, prediction in [(None, None), (model, "theta_sim:rad")]:
        with pytest.raises(TypeError, match="give a model, or None and prediction"):
            softrig.residuals(given, recordings, prediction=prediction)


def test_what_it_lacks_is_named(
    rig: Rig,
    own: Path,
    model: softrig.Model,
    recordings: list[softrig.Recording],
    tmp_path: Path,
) -> None:
    found = softrig.diagnose(model, recordings, prediction="theta_sim:rad")
    assert found.effects == ["quadratic_damping"]
    assert "The simulation in theta_sim lacks" in found.sentence
    about = found.verdict.simulation
    assert about is not None and about.column == "theta_sim"
    assert about.stand_in_rmse_deg < about.rmse_deg
    files = [own / f"{name}.csv" for name in RUNS]
    expected = rig.json(
        own / "verdict.json",
        *["diagnose", "--model", own / "made/model.toml", "--prediction", "theta_sim:rad"],
        *[*files, "--json", own / "verdict.json"],
    )
    verdict = json.loads(found.json())
    assert verdict.pop("seconds") > 0 and expected.pop("seconds") > 0
    assert verdict == expected
    with pytest.raises(AttributeError, match="theta_sim, a simulation known only by its predictions"):
        found.model  # noqa: B018
    with pytest.raises(TypeError, match=r"keep \.runs"):
        pickle.dumps(found)
    found.report(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert "theta_sim:rad" in text and "is diagnosed in its place" in text
    with pytest.raises(softrig.InputError, match="give the name of a column"):
        softrig.diagnose(model, recordings, prediction=" ")
