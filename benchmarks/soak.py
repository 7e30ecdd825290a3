"""Many audits and answers in one process: memory stays, and no file stays open.

    python benchmarks/soak.py                    # 1,000 audits and 2,000 answers: three minutes of one core
    python benchmarks/soak.py --quick            # 30 and 60: ten seconds

Audits read a CSV, a Parquet file, and the CSV from disk, in turn; a damaged file is tried each time, so that errors are
soaked, too. Answers are those of `Audit.answered` on what was found before. The process is measured after each fiftieth
of the work. A fifth of the work fills caches. Of the points after it, the medians of the first and of the last third
are compared: resident memory goes up and down by 3 % from one point to the next, because pyarrow's pool keeps and
returns pages. It may grow by 2 %, and so may the number of live blocks of Python, which a leak of objects raises and no
pool does. The numbers of open descriptors and threads may not. The exit code is 1 where there is more.
"""

from __future__ import annotations

import argparse
import gc
import os
import statistics
import sys
import tempfile
import threading
import time
import warnings
from pathlib import Path

import numpy as np

import rpil
from options import at_least
from rpil.data.errors import DataError

MOST_GROWTH = 0.02
SETTLED = 0.2
"""Share of the work after which caches and arenas are full."""
N_POINTS = 50


def write_sets(folder: Path) -> list[tuple[Path, bool]]:
    """Sets of demonstrations, and whether each stays on disk."""
    rng = np.random.default_rng(0)
    ids = np.repeat(np.arange(16), 60)
    states = rng.normal(size=(len(ids), 3))
    actions = states[:, :1] - states[:, 1:2] + np.where(ids < 12, 0.1, 1.0)[:, None] * rng.normal(size=(len(ids), 1))
    data = rpil.Demonstrations.from_groups(states, actions, ids)
    for name in ("set.csv", "set.parquet"):
        rpil.write(folder / name, data)
    (folder / "damaged.parquet").write_bytes((folder / "set.parquet").read_bytes()[:-200])
    return [(folder / "set.csv", False), (folder / "set.parquet", False), (folder / "set.csv", True)]


def audited(path: Path, on_disk: bool) -> rpil.Audit:
    audit = rpil.audit(rpil.open(path, on_disk=on_disk))
    rpil.check(path)
    return audit


def answer(audit: rpil.Audit, number: int) -> rpil.Audit:
    """The audit with one answer more, as a page has it: good ones come first."""
    m = number % len(audit.ids)
    return audit.answered(labels={audit.ids[m]: "good" if m < 12 else "bad"})


def size() -> dict[str, float]:
    """Resident megabytes, live blocks of Python, open descriptors, and threads."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return {
        "MB": pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
        "blocks": sys.getallocatedblocks(),
        "files": len(os.listdir("/proc/self/fd")),
        "threads": threading.active_count(),
    }


def soak(n_audits: int, per_audit: int, show: bool) -> list[dict[str, float]]:
    """Sizes of the process after each part of the audits."""
    points: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sets, started = write_sets(Path(folder)), time.perf_counter()
        for number in range(n_audits):
            audit = audited(*sets[number % len(sets)])
            for k in range(per_audit):
                audit = answer(audit, 5 * (number + k) + k)
            try:
                rpil.read(Path(folder) / "damaged.parquet")
            except DataError:
                pass
            else:
                raise AssertionError("a damaged file was read")
            if (number + 1) % max(1, n_audits // N_POINTS) == 0:
                points.append(size())
                if show:
                    print(f"{number + 1} audits, {time.perf_counter() - started:.0f} s: {points[-1]}", flush=True)
    return points


def compared(points: list[dict[str, float]]) -> tuple[dict[str, float], dict[str, float]]:
    """Medians of the first and of the last third of the points after caches are full."""
    settled = points[round(SETTLED * len(points)) :]
    third = max(1, len(settled) // 3)
    first, last = (
        {name: statistics.median(point[name] for point in part) for name in part[0]}
        for part in (settled[:third], settled[-third:])
    )
    return first, last


def faults(first: dict[str, float], last: dict[str, float], most_growth: float = MOST_GROWTH) -> list[str]:
    limits = {"MB": most_growth, "blocks": most_growth, "files": 0.0, "threads": 0.0}
    return [
        f"{name}: {first[name]:,.0f}, then {last[name]:,.0f}"
        for name, limit in limits.items()
        if last[name] > (1 + limit) * first[name]
    ]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--audits", type=at_least(5), default=1000)
    parser.add_argument("--answers", type=at_least(1), default=2, help="after each audit")
    parser.add_argument("--quick", action="store_true", help="30 audits")
    given = parser.parse_args(arguments)
    n = 30 if given.quick else given.audits
    first, last = compared(soak(n, given.answers, show=not given.quick))
    wrong = faults(first, last)
    print(f"{n:,} audits, {n * given.answers:,} answers: {first} after a fifth, {last} at the end.")
    print("\n".join(wrong) or "Nothing grew.")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
