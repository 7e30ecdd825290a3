"""Reading of hostile files in a process of its own: how each ends, and how much memory all of them take."""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

MAX_BYTES = 2**30
MAX_SECONDS = 10  # of processor time, for one file

_SCRIPT = """
import json, re, resource, sys, time
from pathlib import Path
from pkgutil import resolve_name
from rpil.data.errors import DataError
from rpil.data import memory

resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))  # a fault is to end this process, not the machine
ends = {}
if len(sys.argv) > 1:
    memory.free_memory = lambda: memory.parse_size(sys.argv[1]) / memory.FREE_SHARE
for path, function in json.loads(sys.stdin.read()).items():
    start = time.process_time()
    try:
        end = ["read", repr(resolve_name(function)(path))]
    except DataError as error:
        end = ["refused", str(error)]
    except BaseException as error:
        end = [type(error).__name__, str(error)]
    ends[path] = [*end, str(time.process_time() - start)]
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


def read_all(
    folder: Path, files: Mapping[str, tuple[Maker, str]], memory: str | None = "300MB"
) -> tuple[dict[str, list[str]], int]:
    """How the reading of each of the `files` by name, (what writes it, what reads it), ends; and the peak in bytes.

    An end is how it ended, the message, and the seconds of processor time. Without `memory` the limit is the library's.
    """
    for name, (make, _) in files.items():
        make(folder / name)
    calls = {str(folder / name): function for name, (_, function) in files.items()}
    command = [sys.executable, "-c", _SCRIPT, *([memory] if memory else [])]
    search = os.pathsep.join([str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": search}  # for functions of this file
    done = subprocess.run(command, input=json.dumps(calls), capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    return {Path(path).name: end for path, end in found["ends"].items()}, found["peak"]


def assert_refused(end: list[str], name: str) -> None:
    """Reading ended with one sentence that names the file."""
    kind, message = end[:2]
    assert kind == "refused", end
    assert name in message
    assert re.fullmatch(r"([^.\n]|\.(?! ))*\.", message), message
    assert len(message) < 500


def read_on_disk(path: str) -> None:
    """Read all but the demonstrations, which stay on disk."""
    import rpil

    rpil.open(path, on_disk=True).demonstrations  # noqa: B018


def keep_first(path: str) -> None:
    """Write the first demonstration of HDF5 of robomimic beside the file."""
    from rpil.formats.registry import find

    find(path).keep(f"{path}.kept.hdf5", ["demo_0"])


def write_letters(path: Path, n: int, column: str = "comment") -> None:
    """A text of `n` letters in one column, in `n` / 30,000 bytes, and short ones in the others."""
    columns = {"episode_index": [0, 0], "observation.x": [0.5, 1.0], "action": [0, 1], "task_index": [0, 1]}
    columns |= {"id": ["a", "b"], "verdict": ["similar", "similar"], column: ["a" * n, ""]}
    pq.write_table(pa.table(columns), path, compression="zstd", use_dictionary=False, write_statistics=False)


def write_zeros(path: Path, n: int, says: int) -> None:
    """Steps with `n` zeros in one page, of which the footer says that there are `says`."""
    table = pa.table({"episode_index": np.zeros(n, np.int8), "observation.x": np.zeros(n), "action": np.zeros(n, "i1")})
    how = {"use_dictionary": False, "data_page_size": 2**31 - 1, "max_rows_per_page": n, "row_group_size": n}
    pq.write_table(table, path, compression="zstd", write_statistics=False, **how)
    _say(path, n, says)


def varint(number: int) -> bytes:
    """A whole number as Thrift writes it."""
    number, found = 2 * number, []
    while number > 127:
        found.append(number & 127 | 128)
        number >>= 7
    return bytes([*found, number])


def write_long_list(path: Path, n: int, says: int | None = None) -> None:
    """A list of one number and one of `n`, in a kilobyte; `says` is what the footer says that both hold."""
    lists = pa.ListArray.from_arrays(pa.array([0, 1, n + 1], pa.int32()), pa.array(np.full(n + 1, 0.5)))
    pq.write_table(
        pa.table({"episode_index": [0, 0], "observation.x": lists, "action": [0, 1]}), path, compression="zstd"
    )
    if says is not None:
        _say(path, n + 1, says)
        assert pq.ParquetFile(path).metadata.row_group(0).column(1).num_values == says


def _say(path: Path, n: int, says: int) -> None:
    """Write `says` for the number `n` wherever it is in the footer."""
    content = path.read_bytes()
    size = 8 + int.from_bytes(content[-8:-4], "little")
    true = varint(n)
    false = bytes([2 * says | 128, *[128] * (len(true) - 2), 0])
    assert true in content[-size:]
    path.write_bytes(content[:-size] + content[-size:].replace(true, false))
