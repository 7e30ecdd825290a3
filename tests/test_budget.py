"""Lines and numbers of each room, names with two meanings, and what one audit runs: they only fall."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np

import rpil
from rpil.formats.steps import Steps

TOOLS = Path(__file__).parents[1] / "tools"
TOOL = runpy.run_path(str(TOOLS / "budget.py"))
ROOT = TOOL["ROOT"]

BUDGETS = {
    "cli": (2194, 20),
    "data": (2334, 28),
    "estimators": (1831, 18),
    "faults": (2929, 120),
    "formats": (5168, 54),
    "inference": (2155, 85),
    "mixture": (687, 11),
    "numerics": (581, 16),
    "policies": (1248, 49),
    "results": (2410, 43),
    "scale": (592, 20),
    "segments": (492, 19),
    "simulation": (426, 0),
}
"""Lines and numbers of each room at most. They only fall; what a room gains another one gives, or an issue grants."""

LINES, PAGE_LINES, TEST_LINES = 23_158, 2_069, 23_946
"""All lines of Python in the library, those of its pages (JS, HTML, CSS), and those of the tests, at most."""

TYPES, FILES, CONTEXT_VARIABLES = 0, 0, 0
"""Names of types and of files with two meanings, and context variables, at most."""

FUNCTIONS_OF_AUDIT, FILES_OF_AUDIT = 606, 67
"""Functions and files of rpil that one audit of a small CSV runs, at most."""

PASSES = {"episode": 1, "step": 2, "observation.x": 2, "action": 2}
"""How often a column is gone through between the parser and the arrays: of ids and order, kinds, scan, arrays."""


def test_rooms_keep_to_their_budgets():
    sizes = {room: TOOL["size_of"](ROOT / room) for room in BUDGETS}
    assert {room: size for room, size in sizes.items() if any(np.greater(size, BUDGETS[room]))} == {}


def test_all_lines_keep_to_their_budgets():
    root = TOOLS.parent
    pages = [path for kind in ("js", "html", "css") for path in ROOT.rglob(f"*.{kind}") if "vendor" not in path.parts]
    tests = (root / "tests").rglob("*.py")
    for paths, most in ((ROOT.rglob("*.py"), LINES), (pages, PAGE_LINES), (tests, TEST_LINES)):
        assert sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths) <= most
    assert len((root / "CHANGELOG.md").read_bytes()) <= 15_000


def test_numbers_are_those_of_constants_and_fields():
    numbers_of = TOOL["numbers_of"]
    source = (
        "LIMIT, SHARES = 4, (0.1, 1 / 3)\nclass A:\n    width: float = 2.5\n    is_new: bool = True\n    name = 'b'\n"
    )
    assert numbers_of(source) == 5
    assert numbers_of("def f(limit=3):\n    return limit + 1\n") == 0


def test_names_have_one_meaning():
    names = TOOL["two_meanings"]()
    files = [name for name in names if name.endswith(".py")]
    assert len(names) - len(files) <= TYPES, names
    assert len(files) <= FILES, names
    assert TOOL["n_context_variables"]() <= CONTEXT_VARIABLES


def test_a_name_with_two_meanings_is_seen(tmp_path):
    sources = {
        "a/one.py": "class _Rows: ...\nId = int | str\nT = TypeVar('T')\n",
        "b/one.py": "Id = int\n",
        "b/two.py": "class Rows: ...\nT = TypeVar('T')\nLIMIT = 1\n",
        "a/three.py": "LIMIT = 2\n",
    }
    for path, source in sources.items():
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(source)
    assert set(TOOL["two_meanings"](tmp_path)) == {"Rows", "Id", "one.py"}


def test_an_audit_runs_few_functions_in_few_files():
    command = [sys.executable, str(TOOLS / "path_of_audit.py")]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    functions, files = map(int, re.search(r"(\d+) functions in (\d+) files", text).groups())
    assert functions <= FUNCTIONS_OF_AUDIT, text
    assert files <= FILES_OF_AUDIT, text


def test_the_rows_of_a_csv_are_gone_through_few_times(tmp_path, monkeypatch):
    lines = [f"{k // 30},{k % 30},{k % 7 / 3:.3f},{k % 5 / 3:.3f}" for k in range(300)]
    (tmp_path / "a.csv").write_text("\n".join(["episode,step,observation.x,action", *lines]))
    passes, tables = Counter[str](), Steps.tables

    def counted(steps, columns, *rows):
        for found in tables(steps, columns, *rows):
            passes.update(dict.fromkeys(columns, len(found[1])))
            yield found

    monkeypatch.setattr(Steps, "tables", counted)
    monkeypatch.setattr("rpil.formats.steps.BATCH_ROWS", 10)
    assert len(rpil.open(tmp_path / "a.csv").demonstrations) == 10
    assert {name: n // 300 for name, n in passes.items()} == PASSES
