"""What `softrig.pyi` says is what is there."""

import ast
import json
import subprocess
import sys
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

import softrig
from conftest import Rig

STUB = ast.parse((resources.files(softrig) / "__init__.pyi").read_text())


def test_the_stub_is_installed_and_agrees_with_the_module(tmp_path: Path) -> None:
    assert (resources.files(softrig) / "py.typed").is_file()
    allowed = tmp_path / "allowed"
    # The compiled module behind the package, which has all there is.
    allowed.write_text("softrig.softrig\n")
    command = [sys.executable, "-m", "mypy.stubtest", "softrig", "--allowlist", str(allowed)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_verdict_of_the_stub_is_that_of_the_schema(rig: Rig) -> None:
    schema = json.loads(rig("schema").stdout)
    definitions: dict[str, Any] = schema["$defs"] | {"Verdict": schema}
    structures = {
        name: definition["properties"]
        for name, definition in definitions.items()
        if "properties" in definition
    }
    stubs = {
        node.name.removeprefix("_"): [
            line.target.id
            for line in node.body
            if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name)
        ]
        for node in STUB.body
        if isinstance(node, ast.ClassDef)
    }
    for name, properties in structures.items():
        expected = ["places" if key == "where" else key for key in properties]
        assert sorted(stubs[name]) == sorted(expected), name


def test_everything_in_the_module_has_a_docstring() -> None:
    for name, item in vars(softrig).items():
        if not name.startswith("_") and callable(item):
            assert item.__doc__, name


@pytest.mark.parametrize("code", ["softrig.Recording(name='x')", "softrig.diagnose()"])
def test_arguments_are_asked_for_by_name(code: str) -> None:
    with pytest.raises(TypeError, match="missing"):
        eval(code)
