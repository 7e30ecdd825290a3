"""Recorded demonstrations: NPZ files with `observations`, `actions` and `episode_ids` for every step.

For every demonstration, in ascending order of its id, there may be `is_good` (1 good, 0 bad, -1 in between; by default
all are good), `episode_quality` (higher is better) and `demonstrator_ids`. All else is left alone.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

import rpil
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from worlds import Array, World

STEPS = ("observations", "actions", "episode_ids")
TRUTH = ("is_good", "episode_quality", "demonstrator_ids")


def npz_files(folder: Path, names: list[str] | None = None) -> list[Path]:
    """The NPZ files in a folder, or those of `names`."""
    found = {path.stem: path for path in sorted(folder.glob("*.npz"))}
    missing = [name for name in names or () if name not in found]
    if missing or not found:
        raise DataError(f"{folder.name}: no file {(*missing, '*')[0]}.npz; found {', '.join(found) or 'none at all'}.")
    return [found[name] for name in names or found]


def recorded_sets(folder: Path) -> list[Path]:
    """The files of a folder with good and bad demonstrations."""
    return [path for path in npz_files(folder) if {0, 1} <= set(read(path).is_good.tolist())]


def read(path: Path) -> World:
    """The demonstrations of a file, in ascending order of their ids, which become 0 to M - 1."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            held = {name: stored[name] for name in (*STEPS, *TRUTH) if name in stored.files}
    except (OSError, ValueError, EOFError, BadZipFile):
        raise DataError(f"{path.name}: it cannot be read as an NPZ file of plain arrays; mend it or move it.") from None
    for name in STEPS:
        if name not in held:
            raise DataError(f"{path.name}: no array is called {name!r}; save one under that name.")
    ids, index = np.unique(held["episode_ids"], return_inverse=True)
    order = np.argsort(index, kind="stable")
    steps = held["observations"][order], held["actions"][order], index[order]
    good = of_each(path, held, "is_good", np.ones(len(ids))).astype(int)
    quality = of_each(path, held, "episode_quality", good).astype(float)
    people = tuple(map(str, of_each(path, held, "demonstrator_ids", np.empty(len(ids))).tolist()))
    known = people if "demonstrator_ids" in held else ()
    return World(Demonstrations.from_groups(*steps, source=path.stem), good, quality, known)


def read_table(folder: Path) -> World:
    """The demonstrations of `data.csv` in a folder, as a user opens it, and `good` of each in `truth.json`."""
    demonstrations = rpil.open(folder / "data.csv").demonstrations
    assert isinstance(demonstrations, Demonstrations)
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))["good"]
    return World.of(demonstrations, np.array([truth[str(name)] for name in demonstrations.ids]))


def of_each(path: Path, held: dict[str, Array], name: str, missing: Any) -> Array:
    """One value for each demonstration, or `missing`."""
    found = held.get(name, missing)
    if np.shape(found) != np.shape(missing):
        raise DataError(
            f"{path.name}: {name!r} has shape {np.shape(found)} for {len(missing)} demonstrations; give one for each."
        )
    return found


# ---- changes that are not behaviour ----------------------------------------------------------------------------------

Steps = tuple[Array, Array, Array]
"""Observations (N, D), actions, and the number of the demonstration of each step, (N,)."""


def changed(path: Path, change: str) -> World:
    """A recorded set after a change; its demonstrations keep their numbers as ids, copies have higher ones."""
    world, rng = read(path), np.random.default_rng(0)
    given = world.demonstrations
    steps = CHANGES[change](given.observations.astype(float), given.actions, given.groups, rng)
    made = Demonstrations.from_groups(*steps)
    return World.of(made, world.is_good[np.array(made.ids) % len(world.is_good)])


def unchanged(states: Array, actions: Array, ids: Array, rng: np.random.Generator) -> Steps:
    return states, actions, ids


def noise_columns(states: Array, actions: Array, ids: Array, rng: np.random.Generator) -> Steps:
    return np.column_stack([states, rng.normal(size=(len(states), 5))]), actions, ids


def wild(states: Array, actions: Array, ids: Array, rng: np.random.Generator) -> Steps:
    """The shortest demonstration is off by 1,000 standard deviations."""
    shortest = ids == np.bincount(ids).argmin()
    return states + 1000 * states.std(axis=0) * shortest[:, None], actions, ids


def twice(states: Array, actions: Array, ids: Array, rng: np.random.Generator) -> Steps:
    return np.tile(states, (2, 1)), np.concatenate([actions, actions]), np.concatenate([ids, ids + ids.max() + 1])


def copied(states: Array, actions: Array, ids: Array, rng: np.random.Generator) -> Steps:
    """The shortest demonstration ten times more, under ids that leave its number by the number of demonstrations."""
    rows = np.flatnonzero(ids == np.bincount(ids).argmin())
    more = np.tile(rows, 10)
    new = np.repeat(ids[rows[0]] + (ids.max() + 1) * np.arange(1, 11), len(rows))  # see `changed`
    return np.concatenate([states, states[more]]), np.concatenate([actions, actions[more]]), np.append(ids, new)


def rotated(states: Array, actions: Array, ids: Array, rng: np.random.Generator) -> Steps:
    scaled = (states - states.mean(axis=0)) / (states.std(axis=0) + 1e-9)
    return scaled @ np.linalg.qr(rng.normal(size=(states.shape[1],) * 2))[0], actions, ids


def halved(states: Array, actions: Array, ids: Array, rng: np.random.Generator) -> Steps:
    """A random half of the demonstrations."""
    rows = np.isin(ids, rng.permutation(ids.max() + 1)[: ids.max() // 2 + 1])
    return states[rows], actions[rows], ids[rows]


AS_IT_IS = "as it is"
CHANGES = {
    AS_IT_IS: unchanged,
    **{f"seed {seed}": unchanged for seed in range(1, 4)},
    "five columns of noise": noise_columns,
    "one off by 1,000 sd": wild,
    "all twice": twice,
    "one copied ten times": copied,
    "states rotated": rotated,
    "a random half": halved,
}
