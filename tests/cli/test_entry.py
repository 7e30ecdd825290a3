"""An interruption ends the command with code 130 and one sentence; streams may be closed or full."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
import time

import pytest

from command_line import npz

RUN = "from rpil.cli.entry import main\nmain()\n"
AT_IMPORT = """
import sys

class AtImport:
    def find_spec(self, name, *_):
        if name == {name!r}:
            {what}

sys.meta_path.insert(0, AtImport())
"""


def interrupt(name, what="raise KeyboardInterrupt"):
    return AT_IMPORT.format(name=name, what=what)


READY = interrupt("rpil.cli.main", "print('ready', flush=True)") + RUN
"""After "ready" an interruption meets the command, and not what Python does before."""


def check(code: int, stdout: str, stderr: str) -> None:
    assert code == 130, stderr
    assert stdout == ""
    lines = [line for line in stderr.splitlines() if line]
    assert len(lines) == 1, stderr
    assert lines[0] == "rpil: interrupted."


def interrupted(seconds, script=READY):
    """The code, stdout and stderr of an audit of "data.npz" that gets SIGINT some seconds after it prints "ready"."""
    command = [sys.executable, "-c", script, "audit", "data.npz", "-q"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"
        time.sleep(seconds)
        process.send_signal(signal.SIGINT)
        stdout, stderr = process.communicate()
    return process.returncode, stdout, stderr


@pytest.mark.slow
def test_a_signal_is_one_sentence(interruptible):
    npz("data.npz")
    busy = interrupt("rpil.inference.scores", "import time; print('ready', flush=True); time.sleep(60)") + RUN
    check(*interrupted(0.1, busy))


@pytest.mark.slow
def test_where_the_shell_ignores_interruptions_so_does_the_command(interruptible):
    npz("data.npz")
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # as of `rpil audit ... &` in a script
    code, stdout, stderr = interrupted(0.1)
    assert (code, stderr) == (0, "")
    assert "6 demonstrations" in stdout


@pytest.mark.parametrize(
    ("streams", "words", "code", "unbuffered"),
    [
        (">&- 2>&- <&-", "info nowhere.npz", 2, ""),
        ("> /dev/full", "info data.npz", 2, ""),
        ("> /dev/full", "--help", 2, "1"),
        ("> /dev/full 2> /dev/full", "--help", 2, "1"),
        ("2> /dev/full", "info nowhere.npz", 2, ""),
    ],
)
def test_streams_that_are_closed_or_full_are_no_fault_of_the_data(streams, words, code, unbuffered):
    npz("data.npz")
    shell = ["bash", "-c", f"{shlex.quote(sys.executable)} -m rpil {words} {streams}"]
    environment = os.environ | {"PYTHONUNBUFFERED": unbuffered}
    done = subprocess.run(shell, capture_output=True, text=True, env=environment)
    full = "rpil: stdout: No space left on device; check the path.\n" if streams == "> /dev/full" else ""
    assert (done.returncode, done.stdout, done.stderr) == (code, "", full)


def test_a_pipe_that_nobody_reads_finds_no_faults():
    npz("data.npz")
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([sys.executable, "-m", "rpil", "info", "data.npz"], stdout=writing, stderr=subprocess.PIPE)
    os.close(writing)
    assert (done.returncode, done.stderr) == (2, b"")


def test_an_environment_may_import_pandas(tmp_path):
    pytest.importorskip("pandas")
    (tmp_path / "world.py").write_text("import pandas")
    script = "from rpil.cli.entry import WithoutPandas\nimport sys\nsys.meta_path.insert(0, WithoutPandas)\n"
    script += "import pyarrow\npyarrow.array([1])\nimport world\nprint(world.pandas.__name__)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=tmp_path)
    assert done.stdout == "pandas\n", done.stderr


def test_the_package_is_imported_in_a_moment():
    script = "import sys, rpil.cli.entry; print({'typing', 'click', 'importlib.metadata'} & {*sys.modules})"
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True).stdout == "set()\n"
