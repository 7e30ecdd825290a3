"""A crash of a library that reads prints where it happened."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest


@pytest.mark.skipif(os.name != "posix", reason="elsewhere a process ends otherwise")
def test_a_crash_of_a_library_prints_where_it_happened(tmp_path):
    np.savez(tmp_path / "a.npz", observations=np.eye(4), actions=[0, 1, 0, 1], episode_ids=[0, 0, 1, 1])
    crash = "import os, rpil.data.archive as npy\nnpy.read_arrays = lambda *_: os.abort()\n"
    script = f"import sys\nsys.argv = ['rpil', 'info', {str(tmp_path / 'a.npz')!r}]\n{crash}"
    script += "from rpil.cli.entry import main\nmain()\n"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode < 0
    assert "Fatal Python error: Aborted" in done.stderr
    assert "array_files.py" in done.stderr
