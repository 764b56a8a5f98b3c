"""What docs/peers.md shows of PySINDy, where that is installed: pip install pysindy."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[3] / "docs"


def test_the_table_of_the_page_is_what_the_script_prints() -> None:
    pysindy = pytest.importorskip("pysindy")
    page = (DOCS / "peers.md").read_text()
    shown = re.search(r"python3 sindy.py\n```\n\n```text\n(.*?)```", page, re.DOTALL)
    assert shown is not None and f"PySINDy ({pysindy.__version__})" in page
    script = DOCS / "peers" / "sindy.py"
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == shown[1].splitlines()
