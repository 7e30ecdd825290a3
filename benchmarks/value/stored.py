"""Recorded worlds that are kept in a folder: an audit that has changed is driven again without recording again."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from rpil.data.demonstrations import Demonstrations
from value.worlds import World, make_world


def recorded_world(folder: Path | None, task: str, n: int, share: float, seed: int) -> World:
    """The world of `make_world`, from `folder` where it is there, and else made and written to it."""
    if folder is None:
        return make_world(task, n, share, seed)
    path = folder / f"{task.replace(' ', '-')}_{n}_{share:g}_{seed}.npz"
    if path.exists():
        return read(path)
    world = make_world(task, n, share, seed)
    write(path, world)
    return world


def write(path: Path, world: World) -> None:
    """As NPZ; an interruption leaves no half of a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}.part")
    data = world.demonstrations
    facts = {"is_good": world.is_good, "success": world.success, "kinds": np.array(world.kinds, dtype=str)}
    with part.open("wb") as file:
        np.savez(file, observations=data.observations, actions=data.actions, offsets=data.offsets, **facts)
    part.replace(path)


def read(path: Path) -> World:
    with np.load(path) as stored:
        bounds = stored["offsets"][1:-1]
        episodes = zip(np.split(stored["observations"], bounds), np.split(stored["actions"], bounds), strict=True)
        demonstrations = Demonstrations.from_episodes(list(episodes))
        return World(demonstrations, stored["is_good"], stored["success"], tuple(stored["kinds"].tolist()))
