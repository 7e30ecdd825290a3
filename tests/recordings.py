"""Smooth recordings of a robot with three joints that follow its commands two steps later, and faults in them."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rpil import Demonstrations
from rpil.data.episodes import lay_end_to_end

LAG = 2


def recording(n=12, steps=(150, 200), joints=3, seed=0):
    """Episodes (positions (T, J), commands (T, J)) without a fault."""
    rng, episodes = np.random.default_rng(seed), []
    for _ in range(n):
        length = int(rng.integers(*steps))
        time = np.arange(length + LAG)[:, None]
        swing = np.sin(time / rng.uniform(12, 18, joints) + rng.uniform(0, 6, joints))
        jerk = np.cumsum(0.02 * rng.normal(size=(length + LAG, joints)), axis=0)
        path = swing + jerk - jerk.mean(axis=0)
        command, position = path[LAG:], path[:-LAG] + 1e-3 * rng.normal(size=(length, joints))
        episodes.append((position, command))
    return episodes


def demonstrations(episodes):
    return Demonstrations.from_episodes(episodes)


def with_missing(episodes):
    """Demonstrations in which values may be NaN or infinite."""
    observations, actions, offsets, *_ = lay_end_to_end(episodes, None, "the demonstrations")
    return Demonstrations(observations, actions, offsets, allows_missing=True)


def changed(episodes, m, **arrays):
    """The episodes with other observations or actions in number `m`."""
    episodes = list(episodes)
    observations, actions = episodes[m]
    episodes[m] = arrays.get("observations", observations), arrays.get("actions", actions)
    return episodes


def edited(values, rows, columns, new):
    """A copy of the values (T, C) with others in some rows and columns."""
    out = values.copy()
    out[rows, columns] = new
    return out


def spike(observations, ids):
    """Damage that `write_recording` does to the fifth demonstration."""
    observations[np.flatnonzero(ids == 4)[60], 1] += 30


def write_recording(path, damage=None, timestamps=True):
    """A recording at 30 frames a second; `damage` changes its observations (N, 3), and may be given NaN."""
    episodes = recording()
    ids = np.repeat(np.arange(len(episodes)), [len(x) for x, _ in episodes])
    observations, actions = (np.concatenate(part) for part in zip(*episodes, strict=True))
    if damage:
        damage(observations, ids)
    columns = {"episode_index": ids, "observation": list(observations), "action": list(actions)}
    if timestamps:
        columns["timestamp"] = np.concatenate([np.arange(len(x)) / 30 for x, _ in episodes])
    pq.write_table(pa.table(columns), path)
