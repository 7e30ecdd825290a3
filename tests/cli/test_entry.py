"""An interruption ends the command with code 130 and one sentence, also while modules are imported."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

from command_line import npz

RUN = "from rpil.cli.entry import main\nmain()\n"
READY = "from rpil.cli.entry import main\nprint('ready', flush=True)\nmain()\n"
INTERRUPT = """
import sys

class Interrupt:
    def find_spec(self, name, *_):
        if name == {name!r}:
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupt())
"""


def check(code: int, stdout: str, stderr: str) -> None:
    assert code == 130, stderr
    assert stdout == ""
    lines = [line for line in stderr.splitlines() if line]
    assert len(lines) == 1, stderr
    assert lines[0].startswith("rpil: interrupted; ")
    assert lines[0].endswith(".")


@pytest.mark.parametrize("name", ["rpil.cli.main", "click", "rpil.data.files", "rpil.formats.columns", "numpy"])
def test_an_interruption_of_an_import_is_one_sentence(name):
    npz("data.npz")
    command = [sys.executable, "-c", INTERRUPT.format(name=name) + RUN, "info", "data.npz"]
    done = subprocess.run(command, capture_output=True, text=True)
    check(done.returncode, done.stdout, done.stderr)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sklearn", "scipy", "pyarrow", "rpil.estimators.rpil", "jinja2"])
def test_an_interruption_of_a_later_import_is_one_sentence(name):
    npz("data.npz")
    command = [sys.executable, "-c", INTERRUPT.format(name=name) + RUN, "audit", "data.npz", "--report", "r.html", "-q"]
    done = subprocess.run(command, capture_output=True, text=True)
    check(done.returncode, done.stdout, done.stderr)


def test_an_interruption_while_options_are_read_is_one_sentence():
    command = [sys.executable, "-c", INTERRUPT.format(name="importlib.metadata") + RUN, "--version"]
    done = subprocess.run(command, capture_output=True, text=True)
    check(done.returncode, done.stdout, done.stderr)


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5])
def test_a_signal_at_any_moment_is_one_sentence(seconds):
    npz("data.npz")
    command = [sys.executable, "-c", READY, "audit", "data.npz", "-q"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"
        time.sleep(seconds)
        process.send_signal(signal.SIGINT)
        stdout, stderr = process.communicate()
    check(process.returncode, stdout, stderr)


def test_the_package_is_imported_in_a_moment():
    script = "import sys, rpil.cli.entry; print({'typing', 'click', 'importlib.metadata'} & {*sys.modules})"
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True).stdout == "set()\n"
