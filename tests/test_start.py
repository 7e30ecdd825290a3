"""What the commands import: libraries that take long stay out of the way to an audit."""

import runpy
import subprocess
import sys
from pathlib import Path

TOOL = runpy.run_path(str(Path(__file__).parents[1] / "tools" / "path_of_audit.py"))

CODE = """
import sys
from rpil.cli.entry import main
for command in ("info", "check", "audit"):
    sys.argv = ["rpil", command, "drive.csv"]
    try:
        main()
    except SystemExit as end:
        assert not end.code
    print("modules:", *sys.modules)
"""
ABSENT = {"sklearn", "scipy.optimize", "scipy.stats", "pandas", "matplotlib", "jinja2", "jaxtyping"}
NO_MODEL = {"scipy", "threadpoolctl", "rpil.estimators"}


def run(code, folder):
    """What a process prints that begins with these demonstrations."""
    TOOL["write_demonstrations"](folder / "drive.csv")
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_libraries_that_take_long_are_not_imported(tmp_path):
    imported = [set(line.split()) for line in run(CODE, tmp_path).splitlines() if line.startswith("modules:")]
    for names, absent in zip(imported, (ABSENT | NO_MODEL, ABSENT | NO_MODEL, ABSENT), strict=True):
        assert {"numpy", "pyarrow", "rpil.formats"} <= names
        assert names & absent == set()


WITHOUT = """
import sys
absent = "scipy", "sklearn", "threadpoolctl", "joblib", "jinja2", "markupsafe"
sys.modules.update(dict.fromkeys(absent))  # as if not installed
import click
import rpil
from rpil.cli.main import main
rpil.Demonstrations
assert "pyarrow" not in sys.modules
path = "drive.csv"
print(rpil.check(path).headline)
rpil.write("copy.npz", rpil.read(path))
rpil.open(path).keep(rpil.open(path).ids[:5], "kept.csv")
for form in ("sarif", "markdown", "json", "text"):
    click.Group.main(main, ["check", path, "--format", form], standalone_mode=False)
"""


def test_check_needs_numpy_pyarrow_click_and_rich_alone(tmp_path):
    assert "recording fault" in run(WITHOUT, tmp_path)
    assert {"copy.npz", "kept.csv"} <= {each.name for each in tmp_path.iterdir()}
