"""The recipes for schedulers in docs/batch, on this machine with two workers."""

import csv
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import softrig

from conftest import Rig

RECIPES = Path(__file__).parents[3] / "docs" / "batch"


@pytest.fixture(scope="module")
def batch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three cases that are decided at once; the recording of the second is not there."""
    folder = tmp_path_factory.mktemp("batch")
    softrig.example(3, effect="none", noise_deg=0.02).write(folder / "demo")
    steps = sorted((folder / "demo" / "recordings").glob("step*_1.csv"))
    for number, step in enumerate(steps):
        shutil.copy(step, folder / f"{number}.csv")
    with open(folder / "cases.csv", "w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["case", "model", "recordings"])
        rows.writerow(["one", "demo/model.toml", "0.csv"])
        rows.writerow(["two", "demo/model.toml", "gone.csv"])
        rows.writerow(["three", "demo/model.toml", "1.csv"])
    return folder


def run(batch: Path, rig: Rig, out: str, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(RECIPES / "many.py"), "cases.csv", out, *words]
    env = {**os.environ, "SOFTRIG": rig.program}
    return subprocess.run(command, cwd=batch, env=env, capture_output=True, text=True)


def has_results(batch: Path, out: str) -> None:
    done = {path.parent.name for path in (batch / out).glob("*/verdict.json")}
    assert done == {"one", "three"}
    assert "gone.csv" in (batch / out / "two" / "error.txt").read_text()
    assert (batch / out / "results.parquet").exists()


@pytest.mark.parametrize("engine", ["local", "dask", "ray"])
def test_an_engine_runs_every_case_and_says_what_failed_where(
    batch: Path, rig: Rig, engine: str
) -> None:
    module = {"local": "csv", "dask": "distributed", "ray": "ray"}[engine]
    pytest.importorskip(module)
    done = run(batch, rig, engine, "--engine", engine, "--workers", "2")
    assert done.returncode == 1, done.stderr
    has_results(batch, engine)
    (said,) = [line for line in done.stdout.splitlines() if ": two: " in line]
    assert said.startswith("job 1 of 3 on ") and "gone.csv" in said
    assert "3 cases, 1 failed; 3 jobs, 0 without all of their results" in done.stdout


def test_a_program_that_is_missing_is_said_of_each_job(batch: Path) -> None:
    done = run(batch, Rig("no-such-rig"), "none")
    assert done.returncode != 0
    assert done.stdout.count("exit 127: no-such-rig") == 3


def test_an_array_of_slurm_covers_all_cases(batch: Path, rig: Rig) -> None:
    script = RECIPES / "slurm.sh"
    subprocess.run(["bash", "-n", script], check=True)
    codes = []
    for task in range(2):
        env = {
            **os.environ,
            "SOFTRIG": rig.program,
            "SLURM_ARRAY_TASK_ID": str(task),
            "SLURM_CPUS_PER_TASK": "1",
        }
        job = subprocess.run(
            ["bash", script, "cases.csv", "slurm", "2"],
            cwd=batch,
            env=env,
            capture_output=True,
            text=True,
        )
        codes.append(job.returncode)
        assert (f"job {task} of 2 on " in job.stderr) == (job.returncode != 0)
    assert codes == [0, 1]
    rig_again = rig("diagnose", "--batch", batch / "cases.csv", "-o", batch / "slurm")
    assert rig_again.returncode == 1
    has_results(batch, "slurm")
