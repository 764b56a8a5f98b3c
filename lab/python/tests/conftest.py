"""What the tests share: an example on disk, its diagnosis, and the `softrig` command."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

import softrig

#: Small and decided quickly; the board's tests know the larger ones.
SEED = 3


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An example with its files; two steps to each angle are enough here."""
    path = tmp_path_factory.mktemp("example")
    softrig.example(SEED, effect="coulomb_friction").write(path)
    return path


@pytest.fixture(scope="session")
def paths(folder: Path) -> list[Path]:
    return sorted((folder / "recordings").glob("step*_[12].csv"))


@pytest.fixture(scope="session")
def model(folder: Path) -> softrig.Model:
    return softrig.Model.read(folder / "model.toml")


@pytest.fixture(scope="session")
def recordings(paths: list[Path]) -> list[softrig.Recording]:
    return softrig.read(paths)


@pytest.fixture(scope="session")
def diagnosis(
    model: softrig.Model, recordings: list[softrig.Recording]
) -> softrig.Diagnosis:
    return softrig.diagnose(model, recordings)


class Rig:
    """The command of the same source."""

    def __init__(self, program: str) -> None:
        self.program = program

    def __call__(self, *words: object) -> subprocess.CompletedProcess[str]:
        command = [self.program, *map(str, words)]
        return subprocess.run(command, capture_output=True, text=True)

    def json(self, path: Path, *words: object) -> Any:
        done = self(*words)
        assert done.returncode == 0, done.stderr
        return json.loads(path.read_text())


@pytest.fixture(scope="session")
def rig() -> Rig:
    program = os.environ.get("SOFTRIG_COMMAND")
    if program is None:
        pytest.skip("SOFTRIG_COMMAND does not name the softrig command")
    return Rig(program)
