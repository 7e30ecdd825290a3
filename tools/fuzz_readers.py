"""Flips random bytes in small valid files of every format that is read, and reads them: each must end in one sentence.

Usage
-----
``python tools/fuzz_readers.py`` reads 5,000 mutants of each sample of `tests/samples.py`, and of a policy,
labels, verdicts and what is expected, and prints a line for each. ``--mutants N``, ``--seed S``,
``--only PATTERN``, ``--structure`` for shapes, types and fields instead of bytes. The exit code is 1 where anything but
a `DataError` of one sentence is raised, or a mutant takes longer than `SECONDS`, ends the process, or makes it grow
by more than `MAX_GROWTH`. Set PYTHONPATH to the ``src`` to test.

Notes
-----
Mutant k of a sample depends on the seed, the name of the sample and k alone: 1 to 8 bytes of one of its files have
another value. What is read: the description, the demonstrations, both from disk where that is possible, the times, and
what `keep` writes. A process reads the mutants of one sample, and another goes on where it dies: the libraries of
HDF5 (which copies for `keep`) and, more rarely, of Arrow do that themselves on some damage. Each is a fork of a process
that has imported the libraries, which takes longer than a hundred mutants.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
import traceback
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from subprocess import PIPE
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from structural import mutate_structure

import rpil
from rpil import formats
from rpil.data import memory
from rpil.data.errors import DataError, MissingExtraError
from rpil.data.id_values import read_answer_rows
from rpil.faults.report import read_expected
from rpil.formats.format import Dataset
from rpil.formats.registry import find, known_formats
from rpil.results.choice import read_verdicts
from samples import SAMPLES, demonstrations

SECONDS, DEADLY_SECONDS = 10, 60
"""That a mutant may take; and after which a library that does not return is ended with its process."""

MAX_GROWTH = 500e6  # bytes
MEMORY = "300MB"  # that data may take
_LIMIT = 12 << 30  # of the address space: a fault is to end a process, not the machine

LIBRARIES = (
    "h5py",
    "hdf5_files",
    "numcodecs",
    "pyarrow.compute",
    "pyarrow.csv",
    "pyarrow.parquet",
    "rpil.estimators.rpil",
    "zarr",
)
Server = subprocess.Popen[str]
Maker = Callable[[Path], Path]
Reader = Callable[[Path, Path], object]


class TooSlowError(BaseException):
    """No `Exception`, so that nothing takes it for a fault of the file."""


def read_data(path: Path, output: Path) -> None:
    """Keep demonstrations, read them from disk where that is possible, and into memory: the last decides."""
    try_out(lambda: find(path).keep(output, KEPT.get(path.name, (0, 2))))
    if path.suffix == ".parquet" or path.is_dir():
        try_out(lambda: describe(path, on_disk=True))
    describe(path)


def try_out(function: Callable[[], object]) -> None:
    """Call a function, whose errors must be sentences."""
    try:
        function()
    except (DataError, MissingExtraError) as error:
        if not is_sentence(str(error)):
            raise AssertionError(f"no sentence: {error}") from error


def describe(path: Path, on_disk: bool = False) -> None:
    """Read all that a file says."""
    recording = formats.read_recording(path, on_disk=on_disk)
    recording.description.lines()
    recording.description.to_dict()
    found = recording.demonstrations
    for shard in found.shards() if isinstance(found, Dataset) else ():
        for _ in shard:
            pass
    recording.times()


KEPT = {"robomimic.hdf5": ("demo_0", "demo_10"), "aloha": ("episode_0", "episode_2"), "texts": ("0", "2")}
KEPT |= dict.fromkeys(("c.csv", "d.tsv"), ("é0", "é2"))
"""Ids to keep of samples whose ids are text."""


def policy(folder: Path) -> Path:
    rpil.save(rpil.RPIL(features="raw").fit(demonstrations()), folder / "policy")
    return folder / "policy"


def text(name: str, content: str) -> Maker:
    def make(folder: Path) -> Path:
        (folder / name).write_text(content, encoding="utf-8")
        return folder / name

    return make


LABELS, RULES = '{"é0": "expert", "b": "bad", "c": "good"}', '{"spike": ["é0", 7], "idle head": "all"}'
CSV_LABELS = 'id,label\né0,expert\nb,bad\n"c, d",good\n'
READERS: dict[str, tuple[Maker, Reader]] = {
    **{name: (make, read_data) for name, make in SAMPLES.items()},
    "policy": (policy, lambda path, _: rpil.load(path)),
    "labels, CSV": (text("l.csv", CSV_LABELS), lambda path, _: read_answer_rows(path)),
    "verdicts, CSV": (
        text("v.csv", "id,verdict,rejected_by\né0,expert,\nb,adversary,adversary\n"),
        lambda path, _: read_verdicts(path),
    ),
    "expected, JSON": (text("e.json", RULES), lambda path, _: read_expected(path)),
}


def is_sentence(message: str) -> bool:
    """Whether a message is one sentence in one line, which may quote what is in a file."""
    words = re.sub(r"'[^']*'|\"[^\"]*\"", "''", message)
    return words.endswith(".") and ". " not in words and "\n" not in message and len(message) < 600


def mutate(path: Path, name: str, seed: int, k: int, structure: bool = False) -> None:
    """Give 1 to 8 bytes of a file, or of one of the files of a folder, other values, or change its `structure`."""
    rng = np.random.default_rng([seed, zlib.crc32(name.encode()), k])
    if structure:
        mutate_structure(path, rng)
        return
    files = [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.is_file())
    file = files[rng.integers(len(files))]
    content = np.frombuffer(file.read_bytes(), np.uint8).copy()
    if len(content):
        places = rng.integers(len(content), size=rng.integers(1, 9))
        bits, flips = 1 << rng.integers(8, size=len(places)), rng.integers(1, 256, size=len(places))
        content[places] ^= np.where(k % 2, bits, flips).astype(np.uint8)  # of single bits, more can be read
    file.write_bytes(content.tobytes())


def copy(source: Path, target: Path) -> None:
    if source.is_dir():
        shutil.copytree(source, target)
    else:
        shutil.copyfile(source, target)


@contextmanager
def hurried() -> Iterator[None]:
    """Raise `TooSlowError` after `SECONDS`; end the process after `DEADLY_SECONDS`."""

    def interrupt(*_: object) -> None:
        raise TooSlowError

    signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    faulthandler.dump_traceback_later(DEADLY_SECONDS, exit=True)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        faulthandler.cancel_dump_traceback_later()


def attempt(read: Reader, path: Path, output: Path) -> tuple[str, str]:
    """How a reading ends, in a word, and more about it."""
    try:
        with hurried():
            read(path, output)
    except (DataError, MissingExtraError) as error:
        return ("refused" if is_sentence(str(error)) else "no sentence"), str(error)
    except TooSlowError:
        return "too slow", "".join(traceback.format_exc().splitlines(keepends=True)[-6:])
    except BaseException:
        return "traceback", traceback.format_exc()
    return "read", ""


def peak() -> int:
    """The largest memory of this process so far, in bytes."""
    return 1024 * int(re.search(r"VmHWM:\s*(\d+)", Path("/proc/self/status").read_text())[1])  # type: ignore[index]


def work(name: str, seed: int, structure: bool, first: int, last: int) -> None:
    """Read the mutants ``first:last`` of a sample, and print a line of JSON for each."""
    make, read = READERS[name]
    with TemporaryDirectory() as folder:
        place, whole = Path(folder), Path(folder) / "whole"
        whole.mkdir()
        sample = make(whole)
        path, output = place / sample.name, place / f"kept{''.join(sample.suffixes)}"
        for k in range(first - 1, last):  # first the sample itself, which can be read
            copy(sample, path)
            if k >= first:
                mutate(path, name, seed, k, structure)
            before = peak()
            print(json.dumps([k, "begun", "", 0]), flush=True)
            print(json.dumps([k, *attempt(read, path, output), peak() - before]), flush=True)
            for old in place.iterdir():
                if old != whole:
                    shutil.rmtree(old) if old.is_dir() and not old.is_symlink() else old.unlink()


def serve() -> None:
    """In a process of its own: for each line of JSON, the arguments of `work`, do that in a fork and print its exit
    code."""
    faulthandler.enable()
    resource.setrlimit(resource.RLIMIT_AS, (_LIMIT, _LIMIT))
    memory.free_memory = lambda: memory.parse_size(MEMORY) / memory.FREE_SHARE
    for library in LIBRARIES:
        import_module(library)
    tuple(known_formats())  # which imports them
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            work(*json.loads(line))
            os._exit(0)  # Python takes as long to end as it takes to read twenty mutants
        print("exit code", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


@contextmanager
def server() -> Iterator[Server]:
    """Yield a process that serves."""
    with subprocess.Popen([sys.executable, __file__, "--serve"], stdin=PIPE, stdout=PIPE, text=True) as process:
        yield process


def ask(server: Server, *arguments: str | int) -> tuple[list[list[Any]], int]:
    """The lines that `work` prints of these arguments, and the exit code of its process."""
    assert server.stdin is not None
    assert server.stdout is not None
    print(json.dumps(arguments), file=server.stdin, flush=True)
    rows = []
    for line in server.stdout:
        if line.startswith("exit code "):
            return rows, int(line.split()[-1])
        if line.startswith("["):
            rows.append(json.loads(line))
    raise RuntimeError("The process that reads the mutants has ended.")


def fuzz(
    server: Server, name: str, seed: int, n_mutants: int, structure: bool = False
) -> tuple[Counter[str], list[str], int]:
    """How often the readings of mutants ended in which way, what went wrong, and the largest growth in bytes."""
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    growth, first = 0, 0
    while first < n_mutants:
        rows, code = ask(server, name, seed, structure, first, n_mutants)
        for k, end, more, grown in (row for row in rows if row[1] != "begun"):
            if k < first:  # the sample itself, which warms caches up
                wrong += [f"the sample itself: {end} {more}"] if end != "read" else []
                continue
            end = "grew" if grown > MAX_GROWTH else end
            counts[end] += 1
            growth = max(growth, grown)
            wrong += [f"mutant {k}: {end}, {grown / 1e6:,.0f} MB\n{more}"] if end not in ("read", "refused") else []
        if code == 0:
            break
        last = rows[-1][0] if rows else first
        counts["process ended"] += 1
        wrong.append(f"mutant {last}: the process ended with {code}")
        first = last + 1
    return counts, wrong, growth


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mutants", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="samples whose names this pattern finds")
    parser.add_argument("--structure", action="store_true", help="change shapes, types and fields, not bytes")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.serve:
        serve()
        return 0
    with server() as process:
        return fuzz_all(process, given.only, given.seed, given.structure, given.mutants)


def fuzz_all(server: Server, pattern: str, seed: int, structure: bool, n_mutants: int) -> int:
    """Print how the mutants of the samples that a pattern finds end; 1 where something is wrong."""
    total, faulty = Counter[str](), 0
    for name in (name for name in READERS if re.search(pattern, name)):
        begun = time.perf_counter()
        counts, wrong, growth = fuzz(server, name, seed, n_mutants, structure)
        ends = ", ".join(f"{n:,} {end}" for end, n in counts.most_common())
        print(f"{name}: {ends}; grew by {growth / 1e6:,.0f} MB, {time.perf_counter() - begun:.0f} s", flush=True)
        for one in wrong[:20]:
            print(one, flush=True)
        total, faulty = total + counts, faulty + len(wrong)
    print(f"all: {', '.join(f'{n:,} {end}' for end, n in total.most_common())}; {faulty:,} wrong")
    return int(faulty > 0)


if __name__ == "__main__":
    sys.exit(main())
