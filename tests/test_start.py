"""What the commands import: libraries that take long stay out of the way to an audit."""

from __future__ import annotations

import runpy
import subprocess
import sys
from pathlib import Path

import pytest

TOOL = runpy.run_path(str(Path(__file__).parents[1] / "tools" / "path_of_audit.py"))

CODE = """
import atexit, sys
from rpil.cli.entry import main
atexit.register(lambda: print("modules:", *sys.modules))
main()
"""
ABSENT = {"sklearn", "scipy.optimize", "scipy.stats", "pandas", "matplotlib", "jinja2", "jaxtyping"}


WITHOUT_SCIPY = {"scipy", "rpil.estimators"}


@pytest.mark.parametrize(
    ("command", "also_absent"), [("audit", set()), ("info", WITHOUT_SCIPY), ("check", WITHOUT_SCIPY)]
)
def test_libraries_that_take_long_are_not_imported(command, also_absent, tmp_path):
    path = tmp_path / "drive.csv"
    TOOL["write_demonstrations"](path)
    words = [sys.executable, "-c", CODE, command, str(path)]
    run = subprocess.run(words, check=True, capture_output=True, text=True)
    imported = set(run.stdout.rpartition("modules:")[2].split())
    assert {"numpy", "pyarrow", "rpil.formats"} <= imported
    assert imported & (ABSENT | also_absent) == set()
