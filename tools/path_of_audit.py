"""What one audit of a small CSV runs: ``python tools/path_of_audit.py [info]`` lists it file by file.

Counted are the functions, methods and class bodies of `rpil` that run once the command has been imported, in all
threads; lambdas, comprehensions and generator expressions belong to the function that has them, and the body of a
module is not counted: so version 0.2 has 853 in 164 files. `tests/test_budget.py` has the budgets, which only fall.
"""

from __future__ import annotations

import contextlib
import io
import os
import random
import sys
import tempfile
import threading
from collections import defaultdict
from pathlib import Path
from types import CodeType, FrameType

import rpil

ROOT = Path(rpil.__file__).parent


def write_demonstrations(path: Path, n_demonstrations: int = 12, n_steps: int = 20) -> None:
    """Write a CSV of demonstrations that follow one rule, with noise, of which every fourth has ten times the noise."""
    draws = random.Random(0)
    lines = ["episode_index,frame_index,observation.x,observation.y,action.x,action.y"]
    for demonstration in range(n_demonstrations):
        noise = 0.03 if demonstration % 4 else 0.3
        x, y = draws.gauss(0, 1), draws.gauss(0, 1)
        for step in range(n_steps):
            actions = draws.gauss(-x / 2, noise), draws.gauss(-y / 2, noise)
            lines.append(",".join(f"{value:.6g}" for value in (demonstration, step, x, y, *actions)))
            x, y = x + actions[0] / 5, y + actions[1] / 5
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def codes_of(command: str, path: Path) -> set[CodeType]:
    """The functions and class bodies of rpil that a command runs on a file."""
    from rpil.cli.main import main as run

    codes: set[CodeType] = set()

    def note(frame: FrameType, event: str, argument: object) -> None:
        if event == "call":
            codes.add(frame.f_code)

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
            run([command, str(path)])
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return {code for code in codes if code.co_filename.startswith(f"{ROOT}{os.sep}") and code.co_name[0] != "<"}


def main(command: str = "audit") -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drive.csv"
        write_demonstrations(path)
        codes = codes_of(command, path)
    names = defaultdict(list)
    for code in sorted(codes, key=lambda code: (code.co_filename, code.co_firstlineno)):
        names[Path(code.co_filename).relative_to(ROOT)].append(code.co_qualname)
    for file, functions in names.items():
        print(f"{file}: {', '.join(functions)}")
    print(f"{len(codes)} functions in {len(names)} files")


if __name__ == "__main__":
    main(*sys.argv[1:])
