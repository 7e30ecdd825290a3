"""Reading of hostile files in a process of its own: how each ends, and how much memory all of them take."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

MAX_BYTES = 2**30

_SCRIPT = """
import json, re, resource, sys
from pathlib import Path
from pkgutil import resolve_name
from rpil.data.errors import DataError
from rpil.data.memory import limited

resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))  # a fault is to end this process, not the machine
ends = {}
for path, function in json.loads(sys.stdin.read()).items():
    try:
        with limited("300MB"):
            ends[path] = ["read", repr(resolve_name(function)(path))]
    except DataError as error:
        ends[path] = ["refused", str(error)]
    except BaseException as error:
        ends[path] = [type(error).__name__, str(error)]
peak = 1024 * int(re.search(r"VmHWM:\\s*(\\d+)", Path("/proc/self/status").read_text())[1])
print(json.dumps({"ends": ends, "peak": peak}))
"""


@contextmanager
def full_disk(n_bytes: int) -> Iterator[None]:
    """A disk on which no file can have more than `n_bytes`."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


Maker = Callable[[Path], None]


def read_all(folder: Path, files: Mapping[str, tuple[Maker, str]]) -> tuple[dict[str, list[str]], int]:
    """How the reading of each of the `files` by name, (what writes it, what reads it), ends; and the peak in bytes."""
    for name, (make, _) in files.items():
        make(folder / name)
    calls = {str(folder / name): function for name, (_, function) in files.items()}
    done = subprocess.run([sys.executable, "-c", _SCRIPT], input=json.dumps(calls), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    return {Path(path).name: end for path, end in found["ends"].items()}, found["peak"]


def assert_refused(end: list[str], name: str) -> None:
    """Reading ended with one sentence that names the file."""
    kind, message = end
    assert kind == "refused", end
    assert name in message
    assert message.endswith(".")
    assert ". " not in message
    assert "\n" not in message
    assert len(message) < 500
