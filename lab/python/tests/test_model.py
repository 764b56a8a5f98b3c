"""Models: text in, parameters out, and other parameters."""

from pathlib import Path

import numpy as np
import pytest

import softrig


def test_parameters_have_the_keys_of_the_file(folder: Path, model: softrig.Model) -> None:
    text = (folder / "model.toml").read_text()
    assert model.to_toml() == text and model.path == folder / "model.toml"
    for key, value in model.parameters.items():
        assert f"{key} = {value}" in text
        assert getattr(model, key) == value
    assert model.free == [
        "damping_n_s_per_rad",
        "stiffness_n_per_rad_n",
        "input_gain_n_per_kpa",
    ]
    assert model.units["input_gain_n_per_kpa"] == "N/kPa" and model.effects == []
    truth = softrig.Model.read(folder / "truth.toml")
    assert truth.effects == ["coulomb_friction"]
    assert any(key.startswith("coulomb_friction.") for key in truth.parameters)


def test_replacing_changes_numbers_and_keeps_comments(folder: Path) -> None:
    text = (folder / "truth.toml").read_text() + "# kept\n"
    model = softrig.Model.from_toml(text)
    key = next(key for key in model.parameters if "." in key)
    other = model.replace(**{"exponent": 1.25, key: 0.125, "input_gain_n_per_kpa": 0.1})
    assert (other.exponent, other.parameters[key]) == (1.25, 0.125)
    assert other.input_gain_n_per_kpa == 0.1
    assert other.damping_n_s_per_rad == model.damping_n_s_per_rad
    assert other.to_toml().endswith("# kept\n") and model.to_toml() == text
    with pytest.raises(softrig.InputError, match="use one of: inertia_kg_m"):
        model.replace(stiffness=3.0)
    for value in [-1.0, float("nan")]:
        with pytest.raises(softrig.InputError, match="inertia_kg_m"):
            model.replace(inertia_kg_m=value)


def test_faults_have_places() -> None:
    with pytest.raises(softrig.InputError, match="mine, line 3, column 12") as raised:
        softrig.Model.from_toml("schema = 1\n[dynamics]\nexponent = \n", name="mine")
    assert raised.value.line == 3
    with pytest.raises(softrig.InputError, match="is empty"):
        softrig.Model.from_toml("")


def test_a_model_is_written_and_never_over_a_recording(
    model: softrig.Model, paths: list[Path], tmp_path: Path
) -> None:
    path = tmp_path / "m.toml"
    model.write(path)
    assert softrig.Model.read(path).parameters == model.parameters
    before = paths[0].read_bytes()
    with pytest.raises(softrig.InputError, match="is a recording"):
        model.write(paths[0])
    assert paths[0].read_bytes() == before


def test_a_pressure_alone_bends_as_physics_has_it(model: softrig.Model) -> None:
    time = np.arange(0, 30, 0.01)
    pressure = np.where(time < 0.5, 0.0, 20.0)
    run = softrig.simulate(model, time_s=time, pressure_kpa=pressure)
    assert run.measured_deg is None and run.rmse_deg is None and len(run) == 3000
    # At rest K θⁿ balances the gain times the pressure.
    force = model.input_gain_n_per_kpa * 20
    rest = (force / model.stiffness_n_per_rad_n) ** (1 / model.exponent)
    assert run.angle_deg[0] == 0
    assert run.angle_deg[-1] == pytest.approx(np.degrees(rest), rel=1e-3)
    softer = model.replace(stiffness_n_per_rad_n=model.stiffness_n_per_rad_n / 2)
    bent = softrig.simulate(softer, time_s=time, pressure_kpa=pressure)
    assert bent.angle_deg[-1] > run.angle_deg[-1]


def test_what_cannot_be_simulated_is_refused(
    model: softrig.Model, recordings: list[softrig.Recording]
) -> None:
    for given in [{}, {"protocol": "step", "time_s": [0, 1]}, {"time_s": [0, 1]}]:
        with pytest.raises(TypeError, match="give a recording, or time_s"):
            softrig.simulate(model, **given)  # type: ignore[arg-type]
    for given, says in [
        ({"protocol": "stpe"}, "there is no protocol"),
        ({"protocol": "step", "angle_deg": 1e9}, "angle_deg is 1000000000"),
        ({"protocol": "step", "hold_s": float("nan")}, "hold_s is NaN"),
        ({"protocol": "step", "arithmetic": "f16"}, "arithmetic is"),
        ({"time_s": [0, 1], "pressure_kpa": [0, float("nan")]}, r"pressure_kpa\[1\]"),
    ]:
        with pytest.raises(softrig.InputError, match=says):
            softrig.simulate(model, **given)  # type: ignore[arg-type]
