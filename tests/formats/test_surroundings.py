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
BINARY = ["NPZ", "Parquet", "robomimic"]

READ = """
import {before}
import rpil
print(len(rpil.read({path!r})))
"""
IGNORED = "signal\nsignal.signal(signal.SIGCHLD, signal.SIG_IGN)"
REAPED = """os, threading, time
def reap():
    while True:
        try:
            os.waitpid(-1, 0)
        except ChildProcessError:
            time.sleep(.001)
threading.Thread(target=reap, daemon=True).start()"""
SMALL_FILES = "resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))"


@pytest.mark.parametrize("name", BINARY)
@pytest.mark.parametrize(
    ("before", "streams"),
    [(IGNORED, ""), (REAPED, ""), (SMALL_FILES, ""), ("os", "2>&-"), ("os", "<&- 2>&-")],
    ids=["SIGCHLD ignored", "children reaped", "no file written", "stderr closed", "stdin and stderr closed"],
)
def test_a_sound_file_is_read(tmp_path, name, before, streams):
    path = SAMPLES[name](tmp_path)
    (tmp_path / "read.py").write_text(READ.format(before=before, path=str(path)))
    command = f'exec "{sys.executable}" "{tmp_path}/read.py" {streams}'
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True)
    assert (done.stdout.strip(), done.returncode) == (str(len(rpil.read(path))), 0), done.stderr


@pytest.mark.parametrize("name", BINARY)
def test_the_command_reads_it_with_stderr_closed(tmp_path, name):
    path = SAMPLES[name](tmp_path)
    done = subprocess.run(
        ["sh", "-c", f'"{sys.executable}" -m rpil info "{path}" 2>&-'], capture_output=True, text=True
    )
    assert done.returncode == 0
    assert "demonstrations" in done.stdout


FORKING = """
import os, threading, time
import rpil
paths, children, stop = {paths!r}, [], threading.Event()
def fork():
    while not stop.is_set():
        child = os.fork()
        if child == 0:
            time.sleep(60)
            os._exit(0)
        children.append(child)
        time.sleep(.01)
for path in paths:  # h5py starts a process when it is imported
    rpil.read(path)
thread = threading.Thread(target=fork)
thread.start()
took = 0.0
for _ in range(5):
    for path in paths:
        begun = time.monotonic()
        rpil.read(path)
        took = max(took, time.monotonic() - begun)
stop.set()
thread.join()
for child in children:
    os.kill(child, 9)
    os.waitpid(child, 0)
print(len(children), took)
"""


@pytest.mark.slow
def test_a_read_does_not_wait_for_processes_that_other_threads_start(tmp_path):
    paths = [str(SAMPLES[name](tmp_path)) for name in BINARY]
    done = subprocess.run([sys.executable, "-c", FORKING.format(paths=paths)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    n_children, took = map(float, done.stdout.split())
    assert n_children > 3
    assert took < 20  # of the 60 that each of the other processes lives


@pytest.mark.parametrize("name", SAMPLES)
def test_no_process_is_started(tmp_path, monkeypatch, name):
    path = SAMPLES[name](tmp_path)

    def fail(*_, **__):
        raise AssertionError("a process is started")

    for starts in ("fork", "posix_spawn"):
        monkeypatch.setattr(os, starts, fail)
    assert len(rpil.open(path).demonstrations)


def test_too_many_open_files_are_no_damage(tmp_path):
    rest = "resource, os, numpy\nresource.setrlimit(resource.RLIMIT_NOFILE, (60, 60))"
    path = SAMPLES["NPZ"](tmp_path)
    script = READ.format(before=rest, path=str(path)) + FILLED.format(path=str(path))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "Too many open files" in done.stdout
    assert "damaged" not in done.stdout


FILLED = """
full = []
try:
    while True:
        full.append(open({path!r}))
except OSError:
    pass
try:
    rpil.read({path!r})
except rpil.DataError as error:
    print(error)
"""


def test_a_crash_of_a_library_prints_where_it_happened(tmp_path):
    np.savez(tmp_path / "a.npz", observations=np.eye(4), actions=[0, 1, 0, 1], episode_ids=[0, 0, 1, 1])
    crash = "import os, rpil.data.npy as npy\nnpy.read_arrays = lambda *_: os.abort()\n"
    script = f"import sys\nsys.argv = ['rpil', 'info', {str(tmp_path / 'a.npz')!r}]\n{crash}"
    script += "from rpil.cli.entry import main\nmain()\n"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode < 0
    assert "Fatal Python error: Aborted" in done.stderr
    assert "npz.py" in done.stderr
