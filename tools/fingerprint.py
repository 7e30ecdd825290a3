"""What a zoo of small fits gives, in one file, to compare two states of the code: nothing but the public API is used.

Usage
-----
``python tools/fingerprint.py OUT.npz`` runs every case of `cases.py` and writes what it gave. ``--against OLD.npz``
runs them again and prints for each whether it is identical, or else the largest difference relative to max(1, |value|),
where it is, and whether the verdicts are equal. The exit code is 1 where anything differs by more than 1e-10, a text or
a verdict differs, or something is missing; with ``--exact``, where a bit differs. ``--only TEXT`` takes the cases with
TEXT in their names. Set PYTHONPATH to the ``src`` of the code to test, and OPENBLAS_NUM_THREADS=1.

Notes
-----
A case that raises has its error as its result. Warnings are results, too. Equal bits are to be expected of one machine
and one set of versions only.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from cases import CASES
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

import rpil

Results = dict[str, NDArray[Any]]

TOLERANCE = 1e-10
MARK = "|"
"""Between the name of a case and the name of an array."""


def run(case: Callable[[Path], Results]) -> Results:
    """The results of a case, its warnings and its error, if there is one."""
    with TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as caught, threadpool_limits(1):
        warnings.simplefilter("always")
        try:
            found = dict(case(Path(folder)))
        except Exception as error:
            message = f"{type(error).__name__}: {error}".replace(folder, "FOLDER")
            print(f"    {message}")
            found = {"error": np.array(message)}
    kinds = (UserWarning, RuntimeWarning)  # not what libraries say of their own future
    messages = sorted({f"{w.category.__name__}: {w.message}" for w in caught if issubclass(w.category, kinds)})
    return found | {"warnings": np.array(messages, dtype=str)}


def same_bits(old: NDArray[Any], new: NDArray[Any]) -> bool:
    return old.dtype == new.dtype and old.shape == new.shape and old.tobytes() == new.tobytes()


def leaves(node: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """The plain values in a tree of JSON, each with its place."""
    children = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else None
    if children is None:
        yield path, node
        return
    for key, child in children:
        yield from leaves(child, f"{path}/{key}")


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def is_sentence(path: str) -> bool:
    """Whether a result, or a leaf of one in JSON, is a sentence for users, which may be reworded."""
    return path in ("warnings", "error") or "assumptions" in path


def difference(name: str, old: NDArray[Any], new: NDArray[Any]) -> float:
    """The largest difference relative to max(1, |value|); infinite for other texts, other shapes."""
    if is_sentence(name):
        return 0.0
    if name.endswith(".json"):
        trees = (leaves(json.loads(str(text))) for text in (old, new))
        one, other = ({path: value for path, value in tree if not is_sentence(path)} for tree in trees)
        numbers = [key for key, value in one.items() if is_number(value)]
        if one.keys() != other.keys() or not all(is_number(other[key]) for key in numbers):
            return np.inf
        if any(one[key] != other[key] for key in one.keys() - set(numbers)):
            return np.inf
        old, new = (np.array([tree[key] for key in numbers], dtype=float) for tree in (one, other))
    if old.shape != new.shape:
        return np.inf
    if old.dtype.kind not in "biuf" or new.dtype.kind not in "biuf":
        return 0.0 if np.array_equal(old, new) else np.inf
    a, b = old.astype(float), new.astype(float)
    with np.errstate(invalid="ignore"):
        apart = np.abs(a - b) / np.maximum(1.0, np.abs(a))
    equal = (a == b) | (np.isnan(a) & np.isnan(b))
    return float(np.max(np.where(equal, 0.0, np.where(np.isnan(apart), np.inf, apart)), initial=0.0))


def compare(old: Results, new: Results, exact: bool) -> tuple[bool, str]:
    """Whether results are as good as the same, and what to print of them."""
    other = [name for name in old.keys() & new.keys() if not same_bits(old[name], new[name])]
    gone, more = sorted(old.keys() - new.keys()), sorted(new.keys() - old.keys())
    notes = [f"{what}: {', '.join(names)}" for what, names in (("missing", gone), ("new", more)) if names]
    if not other:
        return not gone, "; ".join(["identical", *notes])
    apart = {name: difference(name, old[name], new[name]) for name in sorted(other)}
    worst = max(apart, key=lambda name: apart[name])
    verdicts = apart.get("audit.verdicts", 0.0) == 0.0
    notes = [f"{apart[worst]:.1e} in {worst}, {len(other)} of {len(old)} differ", *notes]
    notes.append(f"verdicts {'equal' if verdicts else 'DIFFER'}")
    notes += ["sentences reworded"] if any(map(is_sentence, other)) else []
    return not gone and not exact and apart[worst] <= TOLERANCE, "; ".join(notes)


def stored(path: Path) -> dict[str, Results]:
    """Case -> results, of a file."""
    cases: dict[str, Results] = {}
    with np.load(path, allow_pickle=False) as arrays:
        for key in arrays.files:
            case, _, name = key.partition(MARK)
            cases.setdefault(case, {})[name] = arrays[key]
    return cases


def main() -> int:
    parser = argparse.ArgumentParser(description="What a zoo of small fits gives, to compare two states of the code.")
    parser.add_argument("out", type=Path, nargs="?", help="where to write it")
    parser.add_argument("--against", type=Path, metavar="OLD.npz", help="compare with this one")
    parser.add_argument("--only", default="", metavar="TEXT", help="cases with this in their names")
    parser.add_argument("--exact", action="store_true", help="demand equal bits")
    asked = parser.parse_args()
    if not (asked.out or asked.against):
        parser.error("say where to write, or what to compare with")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of the commands that cases run
    before = stored(asked.against) if asked.against else {}
    names = [name for name in {**CASES, **before} if asked.only in name]
    print(f"{Path(rpil.__file__).parent}: {len(names)} cases", flush=True)
    wrong, identical, found, begun = [], 0, {}, time.perf_counter()
    for name in names:
        start = time.perf_counter()
        if name not in CASES:
            print(f"{name}: no longer a case")
            wrong.append(name)
            continue
        new = run(CASES[name])
        found |= {f"{name}{MARK}{key}": value for key, value in new.items()}
        outcome = f"{len(new)} results"
        if asked.against:
            fine, outcome = compare(before[name], new, asked.exact) if name in before else (True, "a new case")
            wrong += [] if fine else [name]
            identical += outcome == "identical"
        print(f"{name}: {outcome} ({time.perf_counter() - start:.1f} s)", flush=True)
    if asked.out:
        np.savez_compressed(asked.out, **found)
    summary = f"{len(names)} cases in {time.perf_counter() - begun:.0f} s"
    if asked.against:
        summary += f": {identical} identical, {len(names) - identical - len(wrong)} alike, {len(wrong)} WRONG"
        summary += "".join(f"\n    {name}" for name in wrong)
    print(summary)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
