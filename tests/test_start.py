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


NO_MODEL = {"scipy", "threadpoolctl", "rpil.estimators"}


@pytest.mark.parametrize(("command", "also_absent"), [("audit", set()), ("info", NO_MODEL), ("check", NO_MODEL)])
def test_libraries_that_take_long_are_not_imported(command, also_absent, tmp_path):
    path = tmp_path / "drive.csv"
    TOOL["write_demonstrations"](path)
    words = [sys.executable, "-c", CODE, command, str(path)]
    run = subprocess.run(words, check=True, capture_output=True, text=True)
    imported = set(run.stdout.rpartition("modules:")[2].split())
    assert {"numpy", "pyarrow", "rpil.formats"} <= imported
    assert imported & (ABSENT | also_absent) == set()


WITHOUT = """
import sys
absent = "scipy", "sklearn", "threadpoolctl", "joblib", "jinja2", "markupsafe"
sys.modules.update(dict.fromkeys(absent))  # as if not installed
import rpil
from rpil.cli.main import main
rpil.Demonstrations
assert "pyarrow" not in sys.modules
path = sys.argv[1]
print(rpil.check(path).headline)
rpil.write("copy.npz", rpil.read(path))
rpil.open(path).keep(rpil.open(path).ids[:5], "kept.csv")
for form in ("sarif", "markdown", "json", "text"):
    main(["check", path, "--format", form], standalone_mode=False)
"""


def test_check_needs_numpy_pyarrow_click_and_rich_alone(tmp_path):
    path = tmp_path / "drive.csv"
    TOOL["write_demonstrations"](path)
    words = [sys.executable, "-c", WITHOUT, str(path)]
    run = subprocess.run(words, cwd=tmp_path, check=False, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "recording fault" in run.stdout
    assert {"copy.npz", "kept.csv"} <= {each.name for each in tmp_path.iterdir()}
