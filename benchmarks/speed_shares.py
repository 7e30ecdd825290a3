"""Where the CPU of a run goes: its stack every two milliseconds of CPU, and the kind of the innermost frame."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any

from rpil.cli.entry import main as command

EVERY = 0.002
"""Seconds of CPU between two looks."""

KINDS = {
    "reading": ("pyarrow", "h5py", "rpil/formats", "rpil/data"),
    "rules": ("rpil/faults",),
    "arithmetic": ("rpil/numerics", "rpil/policies", "rpil/mixture"),
    "judging": ("rpil/inference", "rpil/estimators", "rpil/scale", "rpil/segments"),
}
"""Parts of paths by kind. `rpil/numerics` is arithmetic of fits, but where a rule calls it."""
COLUMNS = ("imports", *KINDS, "other")


@contextmanager
def sampled() -> Iterator[Counter[str]]:
    """Count looks by kind while the block runs; a long call of a library counts for the function that made it."""
    counts: Counter[str] = Counter()

    def look(_: int, frame: FrameType | None) -> None:
        counts[kind_of(frame)] += 1

    before = signal.signal(signal.SIGPROF, look)
    signal.setitimer(signal.ITIMER_PROF, EVERY, EVERY)
    try:
        yield counts
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def kind_of(frame: FrameType | None) -> str:
    """The kind of the innermost frame that has one; "imports" if a module is being imported."""
    kinds = []
    while frame is not None:
        path = frame.f_code.co_filename
        if path.startswith("<frozen importlib"):
            return "imports"
        kinds += [kind for kind, parts in KINDS.items() if any(part in path for part in parts)]
        frame = frame.f_back
    callers = [kind for kind in kinds if kind != "arithmetic"]
    return "rules" if callers[:1] == ["rules"] else (kinds or ["other"])[0]


def shares(counts: Counter[str]) -> dict[str, float]:
    """Shares of all looks, in the order of `COLUMNS`."""
    return {kind: counts[kind] / max(1, counts.total()) for kind in COLUMNS}


def of_run(run: Callable[[], Any]) -> dict[str, float]:
    with sampled() as counts:
        run()
    return shares(counts)


def of_command(name: str, path: Path, environment: dict[str, str]) -> dict[str, float]:
    """Shares of a command on `path`, in a process of its own, its imports included."""
    found = path.parent / "shares.json"
    words = [sys.executable, __file__, str(found), name, str(path)]
    subprocess.run(words, capture_output=True, cwd=path.parent, env=environment, check=False)
    taken: dict[str, float] = json.loads(found.read_text(encoding="utf-8"))
    return taken


def table(details: dict[str, Any]) -> list[str]:
    """Lines of Markdown: a row for each run that was looked at."""
    rows = [(f"{letter} {name}", each) for letter, of in details.items() for name, each in of.get("where", {}).items()]
    lines = [f"| row | {' | '.join(COLUMNS)} |", "|---" * (1 + len(COLUMNS)) + "|"]
    return lines + [f"| {name} | {' | '.join(f'{each[kind]:.0%}' for kind in COLUMNS)} |" for name, each in rows]


def main() -> None:
    """Run a command under the sampler: the file for the shares, then the words of the command."""
    out, sys.argv = Path(sys.argv[1]), sys.argv[1:]
    with sampled() as counts, suppress(SystemExit):
        command()
    out.write_text(json.dumps(shares(counts)), encoding="utf-8")


if __name__ == "__main__":
    main()
