"""The Python of the pages runs, and shows what the pages say.

Sybil finds the blocks; those of a page run one after the other, in a folder with the files that
the pages suppose. Two things that a page shows are compared:

- a block of ``text`` after a block is what that one prints, where ``…`` stands for anything;
- a remark after an expression that is a literal of Python is its value, a number to the digits
  that are shown: ``fit.rmse_deg  # 0.41``.

A block that cannot run here has ``<!-- skip: next "why" -->`` before it.
"""

import ast
import contextlib
import doctest
import io
import re
import shutil
import tokenize
from collections.abc import Iterator
from pathlib import Path
from unittest import SkipTest

import pytest
from sybil import Document, Example, Sybil
from sybil.evaluators.python import pad
from sybil.parsers.markdown import CodeBlockParser, SkipParser

import softrig

ROOT = Path(__file__).parents[3]
#: In the namespace of a page: where its last block ends, and what that printed.
PRINTED = "__printed__"


def remarks(source: str) -> dict[int, str]:
    """The remarks of a text, by their lines."""
    found = tokenize.generate_tokens(io.StringIO(source).readline)
    return {
        token.start[0]: token.string.lstrip("# ").rstrip()
        for token in found
        if token.type == tokenize.COMMENT
    }


def literal(remark: str | None) -> tuple[object] | None:
    """The value that a remark shows; none if it is words."""
    try:
        return None if remark is None else (ast.literal_eval(remark),)
    except (SyntaxError, ValueError):
        return None


def differs(remark: str, shown: object, value: object) -> bool:
    """Whether a value is not the one that is shown."""
    if isinstance(shown, float) and isinstance(value, float):
        return f"{value:.{len(remark.partition('.')[2])}f}" != remark
    return shown != value


def run(example: Example) -> str | None:
    """Runs a block. What it prints is kept for a block of text; the answer is what differs."""
    source = pad(example.parsed, example.line + example.parsed.line_offset)
    said = remarks(source)
    printed = io.StringIO()
    example.namespace[PRINTED] = example.region.end, printed
    with contextlib.redirect_stdout(printed):
        for statement in ast.parse(source).body:
            shown = literal(remark := said.get(statement.end_lineno or 0))
            if isinstance(statement, ast.Expr) and remark is not None and shown is not None:
                code = compile(ast.Expression(statement.value), example.path, "eval")
                value = eval(code, example.namespace)
                if differs(remark, shown[0], value):
                    return f"{ast.unparse(statement)} is {value!r}, and the page shows {remark}"
            else:
                module = ast.Module([statement], type_ignores=[])
                exec(compile(module, example.path, "exec"), example.namespace)
    return None


def compare(example: Example) -> str | None:
    """Compares a block of text with what the block before it printed, if that is of Python."""
    end, printed = example.namespace.pop(PRINTED, (0, None))
    between = example.document.text[end : example.region.start]
    if printed is None or "```" in between:
        return None
    # Here, and not by doctest, which knows the spaces of ASCII alone.
    wanted, got = (" ".join(text.split()) for text in [example.parsed, printed.getvalue()])
    if doctest.OutputChecker().check_output(wanted.replace("…", "..."), got, doctest.ELLIPSIS):
        return None
    return f"the page shows\n{example.parsed}\nbut it prints\n{printed.getvalue()}"


SYBIL = Sybil(
    parsers=[
        CodeBlockParser("python", run),
        CodeBlockParser("text", compare),
        SkipParser(),
    ]
)


def blocks(page: Path) -> Document:
    return SYBIL.parse(page)


def pages() -> list[Path]:
    """Every page with Python on it."""
    every = [ROOT / "README.md", ROOT / "lab" / "python" / "README.md", *(ROOT / "docs").rglob("*.md")]
    return [page for page in sorted(every) if "```python\n" in page.read_text()]


@pytest.fixture(scope="module")
def stock(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that the pages suppose: an actuator with a nominal model, and runs of it under
    the names of the pages."""
    folder = tmp_path_factory.mktemp("pages")
    made = softrig.example(2, effect="maxwell_branch")
    made.write(folder / "stock")
    made.model.write(folder / "model.toml")
    made.truth.write(folder / "repaired.toml")
    made.model.export(folder / "finger.py")
    made.model.export(folder / "finger.fmu")
    names = {
        "step60_1": ["monday", "run", "data/02_steps"],
        "step90_1": ["tuesday", "data/01_sines"],
        "step60_2": ["data/01_steps"],
        "step90_2": ["data/02_sines"],
        "step30_1": ["data/01_check"],
    }
    (folder / "data").mkdir()
    (folder / "models").mkdir()
    shutil.copy(folder / "model.toml", folder / "models" / "finger.toml")
    for run, copies in names.items():
        for name in copies:
            for kind in ["csv", "meta.toml"]:
                shutil.copy(folder / f"stock/recordings/{run}.{kind}", folder / f"{name}.{kind}")
    for name, text in of_other_columns(softrig.read(folder / "run.csv")):
        (folder / name).write_text(text)
    cases = re.search("```csv\n(case,.*?)```", (ROOT / "docs/batch.md").read_text(), re.DOTALL)
    assert cases is not None
    (folder / "cases.csv").write_text(cases[1])
    return folder


def of_other_columns(run: softrig.Recording) -> Iterator[tuple[str, str]]:
    """A run in the columns and units of a laboratory."""
    rows = zip(run.time_s, run.pressure_kpa, run.angle_deg, strict=True)
    lines = [f"{1e3 * t:.3f},{p / 6.894757:.5f},{angle}" for t, p, angle in rows]
    yield "lab.csv", "\n".join(["Time (ms),p_psi,theta", *lines, ""])


def follow(page: Path) -> None:
    """Runs the blocks of a page."""
    skipped = []
    for example in blocks(page):
        try:
            example.evaluate()
        except SkipTest as why:
            skipped.append(f"{page.name}, line {example.line}: {why}")
    if skipped:
        print("\n".join(skipped))


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
@pytest.mark.filterwarnings("ignore::softrig.InputWarning")
def test_the_python_of_a_page_is_true(
    page: Path, stock: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(stock, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    follow(page)


def test_the_number_of_blocks_is_what_is_said() -> None:
    examples = [example for page in pages() for example in blocks(page)]
    sources = [str(it.parsed) for it in examples if it.region.evaluator is run]
    lines = sum(len([line for line in source.splitlines() if line.strip()]) for source in sources)
    skipped = sum(it.region.evaluator is not run and isinstance(it.parsed, tuple) for it in examples)
    said = (
        f"Of {len(sources)} blocks of Python with {lines} lines, {len(sources) - skipped} are run"
    )
    print(said)
    assert said in " ".join((ROOT / "CONTRIBUTING.md").read_text().split())


def test_what_a_page_shows_is_compared(tmp_path: Path) -> None:
    def faults(text: str) -> str | None:
        page = tmp_path / "page.md"
        page.write_text(text)
        try:
            follow(page)
        except Exception as error:
            return str(error)
        return None

    block = "```python\nprint('one', 1.25)\n[1, 2][1]   # 2\n1 / 8  # 0.12\n'a'  # of words\n```\n"
    assert faults(block) is None
    assert faults(f"{block}\n```text\none …\n```\n") is None
    assert "it prints\none 1.25" in str(faults(f"{block}\n```text\ntwo\n```\n"))
    assert "is 2, and the page shows 3" in str(faults(block.replace("# 2", "# 3")))
    assert "and the page shows 0.13" in str(faults(block.replace("0.12", "0.13")))
    assert faults("<!-- skip: next \"a rig\" -->\n\n```python\nboard.run()\n```\n") is None
    assert "board" in str(faults("```python\nboard.run()\n```\n"))
