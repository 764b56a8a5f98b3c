"""Recordings come in whole, or not at all."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import softrig

TIME = np.arange(100) * 0.01
PRESSURE = 20 * np.sin(TIME) ** 2
ANGLE = 2.5 * PRESSURE


def of(**other: Any) -> softrig.Recording:
    columns: dict[str, Any] = {"time_s": TIME, "pressure_kpa": PRESSURE, "angle_deg": ANGLE}
    return softrig.Recording(**(columns | other))


def test_arrays_come_back() -> None:
    recording = of(name="sine", metadata={"setpoint_deg": 50.0, "repeat": 2})
    assert len(recording) == 100 and recording.name == "sine" and recording.path is None
    assert recording.duration_s == pytest.approx(0.99)
    np.testing.assert_array_equal(recording.time_s, TIME)
    np.testing.assert_allclose(recording.pressure_kpa, PRESSURE, rtol=1e-14)
    np.testing.assert_allclose(recording.angle_deg, ANGLE, rtol=1e-14)
    assert recording.metadata == {"setpoint_deg": 50.0, "repeat": 2}


def test_whatever_holds_numbers_is_an_array() -> None:
    whole = of(time_s=list(range(100)), pressure_kpa=pd.Series(PRESSURE))
    assert whole.time_s[-1] == 99.0
    strided = np.column_stack([ANGLE, ANGLE]).astype(np.float32)[:, 1]
    np.testing.assert_allclose(of(angle_deg=strided).angle_deg, ANGLE, rtol=1e-6)


def test_units_are_those_of_the_command_line() -> None:
    recording = of(
        time_s=1000 * TIME,
        pressure_kpa=1.01325 + PRESSURE / 100,
        angle_deg=-np.radians(ANGLE),
        units={"time": "ms", "pressure": "bar", "angle": "rad"},
        absolute_pressure=True,
        flip_angle=True,
    )
    np.testing.assert_allclose(recording.time_s, TIME, rtol=1e-14)
    np.testing.assert_allclose(recording.pressure_kpa, PRESSURE, atol=1e-9)
    np.testing.assert_allclose(recording.angle_deg, ANGLE, rtol=1e-12)


def wrong(name: str, place: int, value: float) -> dict[str, object]:
    values = {"time_s": TIME, "pressure_kpa": PRESSURE, "angle_deg": ANGLE}[name].copy()
    values[place] = value
    return {name: values}


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (wrong("angle_deg", 17, np.nan), r"angle_deg\[17\]: NaN is not a number"),
        (wrong("pressure_kpa", 0, np.inf), r"pressure_kpa\[0\]: inf is not a number"),
        ({"time_s": TIME[::-1]}, r"time_s\[1\]: time 0.98 s does not follow 0.99 s"),
        # It starts again every ten samples, which show no motion.
        ({"time_s": np.tile(TIME[:10], 10)}, r"time_s\[10\]: time 0 s does not follow 0.09 s"),
        ({"angle_deg": ANGLE[1:]}, "100 in time_s, 100 in pressure_kpa, 99 in angle_deg"),
        ({"angle_deg": ANGLE.reshape(10, 10)}, "angle_deg has 2 dimensions"),
        ({"angle_deg": ["a"] * 100}, "angle_deg holds <U1"),
        ({"angle_deg": [None] * 100}, r"angle_deg\[0\]: NaN is not a number"),
        ({"angle_deg": ANGLE + 1j}, "angle_deg holds complex128"),
        ({"time_s": pd.date_range("2026", periods=100)}, "time_s holds datetime64"),
        ({"angle_deg": np.ma.masked_less(ANGLE, 9)}, "angle_deg is a masked array"),
        ({"units": {"pressure": "volt"}}, "known: kpa, psi, bar, mbar, mpa, pa, mmhg"),
        ({"units": {"mass": "kg"}}, '"mass" is none of time, pressure and angle'),
        ({"absolute_pressure": 1e9}, "from 0 to 110 kPa"),
        ({"metadata": {"setpoint": 60}}, 'there is no key "setpoint"'),
        ({"metadata": {"repeat": -1}}, "metadata: "),
        ({"metadata": {"repeat": object()}}, "metadata cannot be read"),
    ],
)
def test_what_cannot_be_used_is_refused(given: dict[str, object], says: str) -> None:
    with pytest.raises(softrig.InputError, match=says):
        of(**given)


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    """A time that fits nowhere takes its row along, in all columns."""
    late = wrong("time_s", 50, 0.1)["time_s"]
    columns = {"time_s": late, "pressure_kpa": PRESSURE, "angle_deg": ANGLE}
    frame = pd.DataFrame(columns | {"row": np.arange(100.0)})
    frame.to_csv(tmp_path / "run.csv", index=False)
    with pytest.warns(softrig.InputWarning, match=r"\(sample 51\): left out"):
        of(time_s=late)
    with pytest.warns(softrig.InputWarning, match=r"\(sample 51\): left out"):
        of_frame = softrig.Recording.from_pandas(frame)
    with pytest.warns(softrig.InputWarning, match=r"\(line 52\): left out"):
        of_file = softrig.read(tmp_path / "run.csv")
    for recording in [of_frame, of_file]:
        kept = recording.to_pandas()
        assert kept["row"].tolist() == [row for row in range(100) if row != 50]
        np.testing.assert_allclose(kept["angle_deg"], ANGLE[kept["row"].astype(int)], rtol=1e-12)


def test_a_fault_in_a_file_has_a_place(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("time_s,pressure_kpa,angle_deg\n0,0,0\n0.01,0,nan\n")
    with pytest.raises(ValueError) as raised:
        softrig.read(path)
    error = raised.value
    assert isinstance(error, softrig.InputError)
    assert (error.file, error.line, error.column) == (str(path), 3, "angle_deg")
    assert "nan is not a number" in error.found and "delete" in error.advice
    assert str(error) == f"{path}, line 3, column angle_deg: {error.found}; {error.advice}"
    with pytest.raises(softrig.InputError, match="cannot be read"):
        softrig.read(tmp_path / "absent.csv")
    path.write_text("time_s,pressure_kpa,angle_deg\n0,0,0\n0.01,0")
    with pytest.raises(softrig.InputError, match="cut off"):
        softrig.read(path)


def test_what_is_unusual_is_a_warning() -> None:
    with pytest.warns(softrig.InputWarning, match=r"recording, pressure_kpa\[\d+\]"):
        of(pressure_kpa=100 * PRESSURE)


def test_files_are_read_one_or_several(paths: list[Path]) -> None:
    one = softrig.read(str(paths[0]))
    several = softrig.read(iter(paths[:2]))
    assert [recording.path for recording in several] == paths[:2]
    np.testing.assert_array_equal(one.angle_deg, several[0].angle_deg)
    assert one.metadata["simulated"] is True
    with pytest.raises(softrig.InputError, match="is given twice"):
        softrig.read([paths[0], paths[0]])
    beside = paths[0].with_suffix(".blackbox.csv")
    with pytest.warns(softrig.InputWarning, match="left out"):
        assert len(softrig.read([paths[0], beside])) == 1
    with pytest.raises(TypeError, match="absolute_pressure"):
        softrig.read(paths[0], unit="ms")  # type: ignore[call-overload]


def lab(path: Path) -> Path:
    """A file of another tool."""
    rows = zip(1000 * TIME, PRESSURE / 6.894757, np.radians(ANGLE), strict=True)
    lines = [";".join(f"{value:.9f}" for value in row) for row in rows]
    path.write_text("t;p_psi;theta\n" + "\n".join(lines) + "\n")
    return path


def test_columns_and_units_of_other_tools_are_said(tmp_path: Path) -> None:
    path = lab(tmp_path / "lab.csv")
    with pytest.raises(softrig.InputError, match="has no column time_s"):
        softrig.read(path)
    recording = softrig.read(
        path,
        columns={"time": "t", "pressure": "p_psi", "angle": "theta"},
        units={"time": "ms", "pressure": "psi", "angle": "rad"},
    )
    np.testing.assert_allclose(recording.time_s, TIME, atol=1e-9)
    np.testing.assert_allclose(recording.pressure_kpa, PRESSURE, atol=1e-6)
    np.testing.assert_allclose(recording.angle_deg, ANGLE, atol=1e-6)
    with pytest.raises(softrig.InputError, match="none of time, pressure, angle, setpoint"):
        softrig.read(path, columns={"zeit": "t"})  # type: ignore[call-overload]
    # Arrays have no names.
    with pytest.raises(TypeError, match="columns"):
        of(columns={"time": "t"})


def test_a_model_says_where_its_recordings_stand(tmp_path: Path, model: softrig.Model) -> None:
    path = lab(tmp_path / "lab.csv")
    text = model.to_toml() + (
        "\n[recording]\n"
        'columns = { time = "t", pressure = "p_psi", angle = "theta" }\n'
        'units = { time = "s", pressure = "psi", angle = "rad" }\n'
    )
    # What is said in the call wins.
    recording = softrig.read(path, model=softrig.Model.from_toml(text), units={"time": "ms"})
    np.testing.assert_allclose(recording.time_s, TIME, atol=1e-9)
    np.testing.assert_allclose(recording.angle_deg, ANGLE, atol=1e-6)


def test_scales_and_the_file_of_the_folder_are_as_for_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "lab.csv"
    rows = zip(50 * TIME, 101 + 4 * PRESSURE, 100 * ANGLE, strict=True)
    path.write_text("n,counts,w\n" + "".join(f"{n:.9f},{p:.9f},{a:.9f}\n" for n, p, a in rows))
    columns: Any = {"time": "n", "pressure": "counts", "angle": "w"}
    said = softrig.read(
        path,
        columns=columns,
        units={"time": "s*50", "angle": "deg*100"},
        scale={"pressure": [[101, 0], [501, 100]]},
    )
    for wrong in [{"pressure": [[1, 0], [1, 5]]}, {"mass": [[0, 0], [1, 1]]}]:
        with pytest.raises(softrig.InputError, match="scale: "):
            softrig.read(path, columns=columns, scale=wrong)
    (tmp_path / "softrig.toml").write_text(
        "schema = 1\n[recording]\n"
        'columns = { time = "n", pressure = "counts", angle = "w" }\n'
        'units = { time = "s", angle = "deg" }\n'
        "scale = { time = [[0, 0], [50, 1]], pressure = [[101, 0], [501, 100]],"
        " angle = [[0, 0], [100, 1]] }\n"
    )
    monkeypatch.chdir(tmp_path)
    for recording in [said, softrig.read(path)]:
        np.testing.assert_allclose(recording.time_s, TIME, atol=1e-9)
        np.testing.assert_allclose(recording.pressure_kpa, PRESSURE, atol=1e-6)
        np.testing.assert_allclose(recording.angle_deg, ANGLE, atol=1e-6)


def test_a_recording_says_how_its_rig_stood(tmp_path: Path, model: softrig.Model) -> None:
    path = lab(tmp_path / "lab.csv")

    def read(setup: dict[str, Any], model: softrig.Model) -> softrig.Recording:
        return softrig.read(
            path,
            columns={"time": "t", "pressure": "p_psi", "angle": "theta"},
            units={"time": "ms", "pressure": "psi", "angle": "rad"},
            setup=setup,
            model=model,
        )

    beside = softrig.Model.from_toml(
        model.to_toml() + "\n[recording.setup]\ntilt_deg = 45\ntube_mm = 300\n"
    )
    recording = read({"tilt_deg": 90}, beside)
    assert recording.metadata["setup"] == {"tilt_deg": 90, "tube_mm": 300}
    for setup, says in [({"tilt": 90}, "tilt"), ({"tip_load_g": -1}, "tip_load_g = -1 g")]:
        with pytest.raises(softrig.InputError, match=says):
            read(setup, model)
        with pytest.raises(softrig.InputError, match=says):
            of(metadata={"setup": setup})


def test_a_frame_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(
        "time_s,pressure_kpa,angle_deg,setpoint_deg,state\n"
        "0,0,0,,Idle\n0.01,1.5,2.5,60,Running\n0.02,2,3,60,Running\n"
    )
    recording = softrig.read(path)
    frame = recording.to_pandas()
    assert list(frame.columns[3:]) == ["setpoint_deg", "state"]
    assert np.isnan(frame["setpoint_deg"][0]) and frame["setpoint_deg"][1] == 60
    assert list(frame["state"]) == ["Idle", "Running", "Running"]
    again = softrig.Recording.from_pandas(frame, name="again").to_pandas()
    pd.testing.assert_frame_equal(frame, again, rtol=1e-14)


def test_a_frame_may_have_its_own_names() -> None:
    frame = pd.DataFrame({"p": PRESSURE, "theta": ANGLE}, index=pd.Index(TIME, name="t"))
    recording = softrig.Recording.from_pandas(
        frame, time_s="t", pressure_kpa="p", angle_deg="theta"
    )
    np.testing.assert_array_equal(recording.time_s, TIME)
    assert list(recording.to_pandas().columns) == ["time_s", "pressure_kpa", "angle_deg"]
    with pytest.raises(softrig.InputError, match=r"no column angle_deg \(it has p, theta\)"):
        softrig.Recording.from_pandas(frame, time_s="t", pressure_kpa="p")
    gaps = frame.assign(theta=frame["theta"].where(frame["theta"] > 1))
    with pytest.raises(softrig.InputError, match=r"angle_deg\[0\]: NaN"):
        softrig.Recording.from_pandas(
            gaps, time_s="t", pressure_kpa="p", angle_deg="theta"
        )


def test_a_frame_has_dates_where_they_are_known() -> None:
    started = "2024-05-01T12:00:00Z"
    recording = of(metadata={"started": started, "setpoint_deg": 50.0})
    frame = recording.to_pandas()
    first = pd.Timestamp(started)
    assert isinstance(frame["time_utc"].dtype, pd.DatetimeTZDtype)
    assert frame["time_utc"].iloc[0] == first
    assert frame["time_utc"].iloc[99] == first + pd.Timedelta("990ms")
    assert frame.attrs == recording.metadata
    # As one would: by the clock on the wall.
    by_clock = frame.set_index("time_utc")["angle_deg"].resample("100ms").mean()
    assert len(by_clock) == 10
    again = softrig.Recording.from_pandas(frame)
    assert again.metadata["started"] == "2024-05-01T12:00:00.000000Z"
    pd.testing.assert_series_equal(again.to_pandas()["time_utc"], frame["time_utc"])
    said = softrig.Recording.from_pandas(frame, metadata=frame.attrs)
    assert said.metadata == recording.metadata
    # A part that was cut out later counts from where it began.
    part = of(metadata={"started": started, "part_of": "whole.csv", "begins_s": 60.0})
    assert part.to_pandas()["time_utc"].iloc[0] == first + pd.Timedelta("60s")
    assert "time_utc" not in of().to_pandas()


def test_a_file_with_dates_has_them_in_its_frame(tmp_path: Path, model: softrig.Model) -> None:
    path = tmp_path / "run.csv"
    dates = pd.date_range("2024-05-01T12:00:00Z", periods=200, freq="10ms")
    rows = [f"{date.isoformat()},{k % 9},{k % 5}" for k, date in enumerate(dates)]
    path.write_text("time,pressure_kpa,angle_deg\n" + "\n".join(rows) + "\n")
    recording = softrig.read(path, columns={"time": "time"})
    column = recording.to_pandas()["time_utc"]
    off = (column - dates.to_series(index=column.index)).abs().max()
    assert off < pd.Timedelta("2us")


def test_curves_have_the_dates_of_their_recording(
    model: softrig.Model, recordings: list[softrig.Recording]
) -> None:
    started = pd.Timestamp("2024-05-01T12:00:00Z")
    dated = [
        softrig.Recording.from_pandas(
            recording.to_pandas(),
            name=recording.name,
            metadata=recording.metadata | {"started": f"2024-05-01T12:0{minute}:00Z"},
        )
        for minute, recording in enumerate(recordings[:2])
    ]
    found = softrig.diagnose(model, dated, budget_s=0)
    with pytest.warns(softrig.InputWarning):
        fit = softrig.fit(model, dated)
    for minute in range(2):
        for frame in [
            found.runs[minute].to_pandas(),
            fit.runs[minute].to_pandas(),
            softrig.simulate(model, dated[minute]).to_pandas(),
        ]:
            first = frame["time_utc"].iloc[0] - pd.Timedelta(frame["time_s"].iloc[0], "s")
            assert first == started + pd.Timedelta(minutes=minute)
    assert "time_utc" not in softrig.simulate(model, protocol="step").to_pandas()


def test_an_output_in_millimetres_stays_one(tmp_path: Path, model: softrig.Model) -> None:
    frame = pd.DataFrame({"t": TIME, "p": PRESSURE, "position_mm": ANGLE})
    path = tmp_path / "run.csv"
    frame.to_csv(path, index=False)
    columns: Any = {"time": "t", "pressure": "p", "angle": "position_mm"}
    with pytest.raises(softrig.InputError, match="angle=mm"):
        softrig.read(path, columns=columns)
    recording = softrig.read(path, columns=columns, units={"angle": "mm"})
    np.testing.assert_allclose(recording.angle_deg, ANGLE, rtol=1e-12)
    assert list(recording.to_pandas().columns) == ["time_s", "pressure_kpa", "position_mm"]
    again = softrig.Recording.from_pandas(
        recording.to_pandas(), angle_deg="position_mm", units={"angle": "mm"}
    )
    assert list(again.to_pandas().columns) == ["time_s", "pressure_kpa", "position_mm"]
    simulation = softrig.simulate(model, again)
    assert list(simulation.to_pandas().columns[:4]) == [
        *["time_s", "pressure_kpa", "position_mm", "measured_mm"]
    ]
    assert " mm" in repr(simulation) and "°" not in repr(simulation)
