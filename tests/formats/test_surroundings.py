"""Sound files are read in odd surroundings: nothing here starts a process, nor waits for those of others."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

import rpil
from samples import SAMPLES

pytestmark = pytest.mark.skipif(os.name != "posix", reason="elsewhere a process cannot be forked")


@pytest.mark.parametrize("name", SAMPLES)
def test_no_process_is_started(tmp_path, monkeypatch, name):
    path = SAMPLES[name](tmp_path)

    def fail(*_, **__):
        raise AssertionError("a process is started")

    for starts in ("fork", "posix_spawn"):
        monkeypatch.setattr(os, starts, fail)
    assert len(rpil.open(path).demonstrations)


def test_the_command_reads_it_with_stdin_and_stderr_closed(tmp_path):
    command = f'"{sys.executable}" -m rpil info "{SAMPLES["Parquet"](tmp_path)}" <&- 2>&-'
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True)
    assert done.returncode == 0
    assert "demonstrations" in done.stdout


def test_a_crash_of_a_library_prints_where_it_happened(tmp_path):
    np.savez(tmp_path / "a.npz", observations=np.eye(4), actions=[0, 1, 0, 1], episode_ids=[0, 0, 1, 1])
    crash = "import os, rpil.data.archive as npy\nnpy.read_arrays = lambda *_: os.abort()\n"
    script = f"import sys\nsys.argv = ['rpil', 'info', {str(tmp_path / 'a.npz')!r}]\n{crash}"
    script += "from rpil.cli.entry import main\nmain()\n"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode < 0
    assert "Fatal Python error: Aborted" in done.stderr
    assert "array_files.py" in done.stderr
