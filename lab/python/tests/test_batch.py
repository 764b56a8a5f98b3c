"""`softrig.batch`: many cases from Python, as the command diagnoses them."""

import shutil
from pathlib import Path

import pandas as pd
import pytest

import softrig
from conftest import Rig

#: Of both, and different each time.
TIMES = ["seconds"]


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A manifest of three cases that are decided at once; the recording of the second is not
    there."""
    folder = tmp_path_factory.mktemp("cases")
    softrig.example(3, effect="none", noise_deg=0.02).write(folder / "demo")
    steps = sorted((folder / "demo" / "recordings").glob("step*_1.csv"))
    for number, step in enumerate(steps):
        shutil.copy(step, folder / f"{number}.csv")
    (folder / "cases.csv").write_text(
        "case,model,recordings\n"
        "one,demo/model.toml,0.csv\ntwo,demo/model.toml,gone.csv\nthree,demo/model.toml,1.csv\n"
    )
    return folder / "cases.csv"


def test_a_batch_is_that_of_the_command(rig: Rig, cases: Path, tmp_path: Path) -> None:
    done = rig("diagnose", "--batch", cases, "-o", tmp_path / "softrig")
    assert done.returncode == 1
    said: list[softrig.Progress] = []
    with pytest.warns(softrig.InputWarning, match="1 of 3 cases could not be diagnosed"):
        found = softrig.batch(cases, out=tmp_path / "python", progress=said.append)
    assert (len(found), found.failed) == (3, ["two"])
    assert [row["status"] for row in found.rows] == ["diagnosed", "failed", "diagnosed"]
    assert "gone.csv" in str(found.rows[1]["error"])

    expected = pd.read_parquet(tmp_path / "softrig" / "results.parquet")
    written = pd.read_parquet(tmp_path / "python" / "results.parquet")
    pd.testing.assert_frame_equal(plain(found.to_pandas()), plain(written))
    assert plain(written).to_dict("records") == found.rows
    # The error names the folder.
    differ = [*TIMES, "error"]
    pd.testing.assert_frame_equal(written.drop(columns=differ), expected.drop(columns=differ))
    assert found.to_pandas()["rmse_refit_deg"].dtype == float
    for name in ["one/verdict.json", "three/repaired.toml"]:
        of_softrig, of_python = [(tmp_path / by / name).read_text() for by in ["softrig", "python"]]
        assert without_time(of_softrig) == without_time(of_python)

    assert {progress.planned for progress in said} <= {0, 3}
    assert any(" of 3 cases, " in progress.line for progress in said)


def plain(frame: pd.DataFrame) -> pd.DataFrame:
    """A frame in which nothing is None, whatever kind of gap pandas has for a column."""
    return frame.astype(object).where(frame.notna(), None)


def without_time(text: str) -> str:
    return "\n".join(line for line in text.splitlines() if '"seconds"' not in line)


def test_a_list_of_cases_is_a_manifest(cases: Path, tmp_path: Path) -> None:
    folder = cases.parent
    listed = [
        {"case": "one", "model": folder / "demo/model.toml", "recordings": folder / "0.csv"},
        {"case": "three", "model": folder / "demo/model.toml", "recordings": [folder / "1.csv"]},
    ]
    one = softrig.batch(listed, out=tmp_path / "one")
    two = softrig.batch(listed, out=tmp_path / "two", jobs=2)
    drop = {key: None for key in TIMES}
    assert [{**row, **drop} for row in one.rows] == [{**row, **drop} for row in two.rows]

    verdict = tmp_path / "one" / "one" / "verdict.json"
    before = verdict.stat().st_mtime_ns
    softrig.batch(listed, out=tmp_path / "one")
    assert verdict.stat().st_mtime_ns == before
    softrig.batch(listed[:1], out=tmp_path / "one", resume=False)
    assert verdict.stat().st_mtime_ns > before


def test_a_faulty_list_is_refused_with_its_place(tmp_path: Path) -> None:
    good = {"case": "a", "model": "m.toml", "recordings": "x.csv"}
    for cases, part in [
        ([good, good], r"cases\[1\], case: a is repeated"),
        ([good, {**good, "case": "../b"}], r"cases\[1\], case: "),
        ([{**good, "recordings": []}], r"cases\[0\], recordings: no recording"),
        ([{"case": "a", "recordings": "x.csv"}], r"cases\[0\] has no model"),
        ([{**good, "hold_out": "y.csv"}], "hold_out"),
        ([{**good, "units": {"time": "weeks"}}], "units"),
        (["a"], r"cases\[0\] is of"),
        ([], "no cases"),
    ]:
        with pytest.raises(softrig.InputError, match=part):
            softrig.batch(cases, out=tmp_path / "out")  # type: ignore[arg-type]
    with pytest.raises(softrig.InputError, match="jobs is 0"):
        softrig.batch([good], out=tmp_path / "out", jobs=0)
    with pytest.raises(softrig.InputError, match="none.csv"):
        softrig.batch("none.csv", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_interrupted_batch_writes_no_half_case_and_goes_on(
    cases: Path, tmp_path: Path
) -> None:
    class Enough(Exception):
        pass

    def after_one(progress: softrig.Progress) -> None:
        if progress.done:
            raise Enough

    with pytest.raises(Enough):
        softrig.batch(cases, out=tmp_path, progress=after_one)
    assert (tmp_path / "one" / "verdict.json").exists()
    assert not (tmp_path / "results.parquet").exists()
    with pytest.warns(softrig.InputWarning, match="could not be diagnosed"):
        assert len(softrig.batch(cases, out=tmp_path)) == 3
