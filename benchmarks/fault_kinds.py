"""Recording faults that `faults.py` plants into clean demonstrations, each in three sizes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpil.audit.faults.clock import Clock
from rpil.data.demonstrations import Demonstrations

Array = NDArray[Any]

FPS = 30.0


@dataclass(eq=False)
class Clean:
    """Clean demonstrations, and how their columns usually move: observations first, then actions.

    Attributes
    ----------
    episodes : list of (T, C) arrays
    n_observations : int
    spread, leap : (C,) arrays
        Standard deviation, and 99.9 % quantile of the changes from one step to the next.
    low, high : (C,) arrays
    moving : (C,) bool array
        Columns that change at 80 % of the steps, at least.
    """

    demonstrations: Demonstrations
    episodes: list[Array] = field(init=False)
    n_observations: int = field(init=False)

    def __post_init__(self) -> None:
        demonstrations = self.demonstrations
        self.n_observations = demonstrations.n_observations
        self.episodes = [
            np.column_stack([x] if demonstrations.is_discrete else [x, a]).astype(float) for x, a in demonstrations
        ]
        rows = np.concatenate(self.episodes)
        changes = np.concatenate([np.abs(np.diff(e, axis=0)) for e in self.episodes])
        self.spread, self.low, self.high = rows.std(axis=0), rows.min(axis=0), rows.max(axis=0)
        self.leap = np.quantile(changes, 0.999, axis=0)
        shares = [(np.diff(e, axis=0) != 0).mean(axis=0) for e in self.episodes if len(e) > 1]
        distinct = np.array([len(np.unique(column)) >= 20 for column in rows.T])
        self.moving = distinct & (np.median(shares, axis=0) >= 0.8)

    def columns(self, observations: bool = True, actions: bool = True) -> Array:
        """Numbers of the columns that move."""
        chosen = np.flatnonzero(self.moving)
        is_observation = chosen < self.n_observations
        return chosen[(is_observation & observations) | (~is_observation & actions)]


Fault = Callable[[Array, Clean, float, np.random.Generator], Array | None]
"""A demonstration (T, C + 1) whose last column is time, the clean data, a size: the demonstration with the fault, or
None where it is too short or nothing in it moves."""


def _place(episode: Array, steps: int, rng: np.random.Generator) -> int | None:
    """A random first step for a fault of so many steps, which leaves at least two before and after."""
    room = len(episode) - steps - 4
    return int(2 + rng.integers(room + 1)) if room >= 0 else None


def _pick(columns: Array, rng: np.random.Generator) -> int | None:
    return int(rng.choice(columns)) if len(columns) else None


def drop(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
    """Frames are missing."""
    start = _place(episode, int(size), rng)
    return None if start is None else np.delete(episode, slice(start, start + int(size)), axis=0)


def repeat(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
    """A frame is written several times, where the demonstration moves at its usual speed."""
    columns = clean.columns(actions=False)
    if not len(columns) or len(episode) < 8:
        return None
    motion = (np.abs(np.diff(episode[:, columns], axis=0)) / clean.leap[columns]).mean(axis=1)
    fast = np.flatnonzero(np.minimum(motion[:-1], motion[1:]) >= np.median(motion))[1:-1]
    if not len(fast):
        return None
    at = int(rng.choice(fast)) + 1
    again = np.insert(episode, [at + 1] * int(size), episode[at], axis=0)
    again[:, -1] = np.arange(len(again)) / FPS  # the clock goes on
    return again


def _hold(columns: Callable[[Clean], Array], value: str) -> Fault:
    def hold(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
        start, column = _place(episode, int(size), rng), _pick(columns(clean), rng)
        if start is None or column is None:
            return None
        held = episode.copy()
        limits = {"own": episode[start, column], "limit": clean.high[column]}
        held[start : start + int(size), column] = limits[value]
        return held

    return hold


def spike(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
    """One value is off by so many times the largest usual change of its column."""
    start, column = _place(episode, 1, rng), _pick(clean.columns(), rng)
    if start is None or column is None:
        return None
    off = episode.copy()
    off[start, column] += size * clean.leap[column] * rng.choice([-1.0, 1.0])
    return off


def jump(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
    """All values of a column after a step are off by so many times its largest usual change."""
    start, column = _place(episode, 1, rng), _pick(clean.columns(), rng)
    if start is None or column is None:
        return None
    off = episode.copy()
    off[start:, column] += size * clean.leap[column] * rng.choice([-1.0, 1.0])
    return off


def scale(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
    """A column is in another unit, larger or smaller."""
    column = _pick(clean.columns(), rng)
    if column is None:
        return None
    other = episode.copy()
    other[:, column] *= size ** rng.choice([-1.0, 1.0])
    return other


def delay(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
    """Actions are written so many steps late, or early."""
    n = clean.n_observations
    if episode.shape[1] == n + 1 or len(episode) < 4 * size:
        return None
    late = episode.copy()
    steps = np.clip(np.arange(len(episode)) - int(size) * rng.choice([-1, 1]), 0, len(episode) - 1)
    late[:, n:-1] = episode[steps, n:-1]
    return late


def _idle(at_head: bool) -> Fault:
    def idle(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
        row = episode[:1] if at_head else episode[-1:]
        still = np.repeat(row, int(size), axis=0)
        longer = np.concatenate([still, episode] if at_head else [episode, still])
        longer[:, -1] = np.arange(len(longer)) / FPS
        return longer

    return idle


def cut(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
    """Only the first 1 / size of the demonstration is there."""
    steps = int(len(episode) / size)
    return episode[:steps] if steps >= 3 else None


def lengthen(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
    """The recording was not stopped: the demonstration is played back and forth until it is so many times as long."""
    back = np.concatenate([episode, episode[::-1]])
    longer = np.concatenate([back] * int(np.ceil(size / 2)))[: int(size * len(episode))].copy()
    longer[:, -1] = np.arange(len(longer)) / FPS
    return longer


@dataclass(frozen=True)
class Kind:
    """A kind of fault: how it is made, its sizes with their unit, and the rule that should find it."""

    make: Fault
    sizes: tuple[float, float, float]
    unit: str
    rule: str
    alike: tuple[str, ...] = ()  # rules that name the same fault as well


HELD = ("frozen sensor", "frozen action", "saturation")
KINDS: dict[str, Kind] = {
    "dropped frames": Kind(drop, (1, 3, 10), "frames", "dropped frames"),
    "repeated frames": Kind(repeat, (1, 3, 10), "frames, without timestamps", "repeated frames"),
    "frozen sensor": Kind(_hold(lambda c: c.columns(actions=False), "own"), (15, 25, 40), "steps", "frozen sensor", HELD),
    "frozen action": Kind(
        _hold(lambda c: c.columns(observations=False), "own"), (15, 25, 40), "steps", "frozen action", HELD
    ),
    "saturation": Kind(_hold(lambda c: c.columns(), "limit"), (15, 25, 40), "steps", "saturation", HELD),
    "spike": Kind(spike, (3, 6, 12), "times the 99.9 % quantile of changes", "spike"),
    "jump": Kind(jump, (3, 6, 12), "times the 99.9 % quantile of changes", "jump"),
    "scale": Kind(scale, (25.4, 57.3, 1000), "times or the inverse", "scale"),
    "lag": Kind(delay, (3, 5, 8), "steps late or early", "lag"),
    "idle head": Kind(_idle(True), (15, 30, 60), "steps", "idle head"),
    "idle tail": Kind(_idle(False), (15, 30, 60), "steps", "idle tail"),
    "length, cut": Kind(cut, (4, 7, 10), "times shorter", "length"),
    "length, run on": Kind(lengthen, (4, 7, 10), "times longer", "length"),
}


@dataclass(frozen=True, eq=False)
class Planted:
    """Demonstrations with faults in some, their clock, and a mask of those."""

    demonstrations: Demonstrations
    clock: Clock
    has_fault: Array


def rebuild(clean: Clean, rows: list[Array], has_fault: Array, with_clock: bool, extra_actions: list[Array]) -> Planted:
    """`Planted` from demonstrations (T, C + 1), whose last column is time, and their discrete actions, if any."""
    n = clean.n_observations
    actions = extra_actions if clean.demonstrations.is_discrete else [e[:, n:-1] for e in rows]
    made = Demonstrations.from_episodes(list(zip((e[:, :n] for e in rows), actions, strict=True)))
    clock = Clock(np.concatenate([e[:, -1] for e in rows]), FPS) if with_clock else Clock()
    return Planted(made, clock, has_fault)


def plant(clean: Clean, name: str, size: float, share: float, rng: np.random.Generator) -> Planted | None:
    """Plant a fault into a share of the demonstrations, at least one; None where it fits into none."""
    kind, n = KINDS[name], len(clean.episodes)
    wanted, has_fault = max(round(share * n), 1), np.zeros(n, dtype=bool)
    timed = [np.column_stack([e, np.arange(len(e)) / FPS]) for e in clean.episodes]
    for m in rng.permutation(n).tolist():
        changed = kind.make(timed[m], clean, size, rng) if has_fault.sum() < wanted else None
        if changed is not None:
            timed[m], has_fault[m] = changed, True
    actions = [np.resize(a, len(rows)) for (_, a), rows in zip(clean.demonstrations, timed, strict=True)]
    return rebuild(clean, timed, has_fault, name == "dropped frames", actions) if has_fault.any() else None


def copies(clean: Clean, noise: float, share: float, rng: np.random.Generator) -> Planted:
    """Some demonstrations are written again, with noise of a share of the standard deviation of each column; the mask
    marks both."""
    n = len(clean.episodes)
    chosen = rng.choice(n, max(round(share * n), 1), replace=False)
    rows = [np.column_stack([e, np.arange(len(e)) / FPS]) for e in clean.episodes]
    actions = [a for _, a in clean.demonstrations]
    for m in chosen.tolist():
        again = rows[m].copy()
        again[:, :-1] += noise * clean.spread * rng.normal(size=clean.episodes[m].shape)
        rows.append(again)
        actions.append(actions[m])
    marked = np.isin(np.arange(len(rows)), np.append(chosen, np.arange(n, len(rows))))
    return rebuild(clean, rows, marked, False, actions)
