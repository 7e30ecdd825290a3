"""Recorded demonstrations with a truth for scoring: NPZ files as `real.py` describes them."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rpil.data import formats
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.simulation.simulate import simulate

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Truth:
    """The truth about M demonstrations: masks of the `good` and the `bad` (some are neither), and their `quality`."""

    good: Array
    bad: Array
    quality: Array


def add_data_options(parser: argparse.ArgumentParser, sets: str) -> None:
    """The options --data, --sets and --seed; `sets` is the default of --sets in words."""
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder of the NPZ files")
    parser.add_argument("--sets", action="append", metavar="NAME", help=f"may be repeated; default all {sets}")


def check_data_options(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with a message where neither --data nor --quick was given."""
    if not (options.data or options.quick):
        parser.error("say where the NPZ files are: --data DIR.")


def npz_files(folder: Path, names: list[str] | None = None) -> list[Path]:
    """The NPZ files in a folder, or those of `names`."""
    found = {path.stem: path for path in sorted(folder.glob("*.npz"))}
    missing = [name for name in names or () if name not in found]
    if missing or not found:
        raise DataError(f"{folder.name}: no file {(*missing, '*')[0]}.npz; found {', '.join(found) or 'none at all'}.")
    return [found[name] for name in names or found]


def read_set(path: Path) -> tuple[Demonstrations, Truth]:
    """Demonstrations and their truth. Methods see the first; the second is for scores, the oracle and RM-ENT."""
    demonstrations = formats.read(path)
    with np.load(path, allow_pickle=False) as stored:
        if "episode_quality" not in stored.files:
            raise DataError(f"{path.name}: no array is called 'episode_quality'; save one number an episode under it.")
        quality = stored["episode_quality"].astype(float)
        is_good = stored["is_good"] if "is_good" in stored.files else np.ones(len(quality), dtype=int)
    size = len(demonstrations)
    if sorted(demonstrations.ids) != list(range(size)) or not quality.shape == is_good.shape == (size,):
        raise DataError(
            f"{path.name}: truth is by episode, 0 to {size - 1}; number the episodes so and give a value for each."
        )
    order = list(demonstrations.ids)
    return demonstrations, Truth(is_good[order] == 1, is_good[order] == 0, quality[order])


def write_simulated(path: Path, kind: str, n_good: int, n_bad: int, seed: int, **columns: ArrayLike) -> None:
    """Demonstrations of Mountain Car as such a file, the good first, with more columns for each demonstration."""
    made = simulate("MountainCar-v0", kind, n_good=n_good, n_bad=n_bad, seed=seed)
    order = np.argsort(-made.is_good, kind="stable")
    truth = {"is_good": made.is_good[order], "episode_quality": made.is_good[order].astype(float)}
    formats.write(path, Demonstrations.from_episodes(made.episodes[m] for m in order), truth | columns)


def sets_with_both(paths: Iterable[Path]) -> Iterator[tuple[Path, Demonstrations, Truth]]:
    """The data sets that have good and bad demonstrations; prints how long the caller takes for each."""
    for path in paths:
        demonstrations, truth = read_set(path)
        if truth.good.any() and truth.bad.any():
            begun = time.perf_counter()
            yield path, demonstrations, truth
            print(f"{path.stem}: {time.perf_counter() - begun:.0f} s", file=sys.stderr, flush=True)
