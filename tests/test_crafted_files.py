"""`tools/crafted_files.py`: some of its cases, and that it says what differs and where."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

TOOL = Path(__file__).parents[1] / "tools" / "crafted_files.py"
FAST_CASES = ("tiny observations", "very long label quoted")
OF_FILES = ("damaged files", "ids with white space", "video times that are no numbers")
"""Cases that read files, and start no process."""

MOST_BYTES, MOST_SECONDS = 2**30, 5
"""That these take, beyond the address space of the libraries that they import, and of computing."""

LIMITED = """
import os, resource, runpy, sys
sys.path.insert(0, os.path.dirname(sys.argv[1]))
tool = runpy.run_path(sys.argv[1])
import rpil.estimators.rpil, h5py, pyarrow.compute, scipy.special, av, jinja2
page = resource.getpagesize()
size, resident = (page * int(n) for n in open("/proc/self/statm").read().split()[:2])
resource.setrlimit(resource.RLIMIT_AS, (size + {most}, size + {most}))
begun = os.times()
codes = [tool["main"](["--only", name]) for name in sys.argv[2:]]
ended = os.times()
print("took", ended.user + ended.system - begun.user - begun.system)
peak = next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM:"))
print("grew", 1024 * int(peak) - resident)  # ru_maxrss would be that of the process that starts this one
sys.exit(max(codes))
"""


@pytest.fixture
def tool(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "tools"))
    return import_module("crafted_files")


@pytest.mark.parametrize("name", FAST_CASES)
def test_a_case_is_as_it_should_be(tool, capsys, name):
    assert tool.main(["--only", name]) == 0
    assert capsys.readouterr().out.startswith(f"{name}: as it should be (")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="Linux limits the address space")
def test_cases_of_files_take_little_memory_and_time():
    """In the process that reads: no other one stands between the file and the user."""
    command = [sys.executable, "-c", LIMITED.format(most=MOST_BYTES), str(TOOL), *OF_FILES]
    # Or each thread reserves 64 MB, and the allocator of Arrow 1 GiB, which they do not use.
    environment = os.environ | {"MALLOC_ARENA_MAX": "1", "ARROW_DEFAULT_MEMORY_POOL": "system"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    said = dict(line.split(" ", 1) for line in done.stdout.splitlines()[-2:])
    assert float(said["took"]) < MOST_SECONDS
    assert float(said["grew"]) < MOST_BYTES
