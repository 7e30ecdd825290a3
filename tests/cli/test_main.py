"""The commands: what they print and write."""

import errno
import subprocess
import sys
import types
import warnings
from pathlib import Path
from unittest.mock import Mock

import rpil
from command_line import call, ok, refused

HELP = """
import sys
from click.testing import CliRunner
from rpil.cli.main import main

for command in main.commands:
    assert CliRunner().invoke(main, [command, "--help"]).exit_code == 0, command
sys.exit(str({"numpy", "scipy", "sklearn", "rich", "pyarrow", "matplotlib", "jinja2", "gymnasium"} & {*sys.modules}))
"""


def test_an_unknown_option_names_those_that_are_near():
    """In the words of click, which differ by its version."""
    refused("No such option.*--tasc.*--task.*; see rpil audit --help", "audit", "d.parquet", "--tasc", "1")


def test_version_and_help_which_imports_no_slow_module():
    assert call().stdout == ok("--help").stdout == ok("-h").stdout
    for command in ("audit", "fit", "demo"):
        assert command in ok("--help").stdout
        assert "--quiet" in ok(command, "--help").stdout
    assert rpil.__version__ in ok("--version").stdout
    assert subprocess.run([sys.executable, "-c", HELP], capture_output=True, text=True).stderr == "set()\n"


def fake_demo(path, progress):
    """Stands for the real one, which takes a minute and has tests of its own."""
    progress("working")
    Path(path).write_text("report")
    return "It works."


def test_demo(monkeypatch):
    monkeypatch.setitem(sys.modules, "rpil.cli.demo", types.SimpleNamespace(run=fake_demo))
    assert ok("demo").stdout.splitlines() == ["It works.", "Report: rpil-demo.html"]
    assert Path("rpil-demo.html").read_text() == "report"
    refused("no folder nowhere", "demo", "--output", "nowhere/r.html")


def test_warnings_are_printed_once_as_notes(monkeypatch):
    def warn(*arguments):
        warnings.warn("\x1b[33mWatch\nout.\x1b[0m", UserWarning, stacklevel=1)
        warnings.warn("\x1b[33mWatch\nout.\x1b[0m", UserWarning, stacklevel=1)
        return fake_demo(*arguments)

    monkeypatch.setitem(sys.modules, "rpil.cli.demo", types.SimpleNamespace(run=warn))
    assert ok("demo").stderr == "note: Watch out.\n"


def test_an_error_of_the_system_that_names_a_file_is_a_sentence(monkeypatch):
    errors = [OSError(errno.EACCES, "Permission denied", *names) for names in (["a.csv"], [])]
    monkeypatch.setitem(sys.modules, "rpil.cli.demo", types.SimpleNamespace(run=Mock(side_effect=errors)))
    refused("a.csv: Permission denied; check the path", "demo")
    assert call("demo").exception is errors[1]
