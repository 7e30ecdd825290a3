"""Recording faults that `faults.py` plants into clean demonstrations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.faults.checking import check
from rpil.faults.measured_columns import column_labels
from rpil.formats.places import Times
from rpil.numerics.types import Array

FPS = 30.0


@dataclass(eq=False)
class Clean:
    """Clean demonstrations, and how their columns usually move: observations first, then actions.

    `spread` are standard deviations, `leap` the 99.9 % quantiles of changes from one step to the next, at least .05
    spreads, and `run` and `idle` the upper quartiles of the longest run of one value and of the idle ends.
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
        self.spread, self.high = rows.std(axis=0), rows.max(axis=0)
        self.leap = np.maximum(np.quantile(changes, 0.999, axis=0), 0.05 * self.spread)
        self.run = np.quantile([_longest_runs(e) for e in self.episodes], 0.75, axis=0)
        still = [(np.abs(np.diff(e, axis=0)) <= 0.05 * self.leap).all(axis=1) for e in self.episodes]
        heads = [[np.argmin(np.append(s[::k], False)) for s in still] for k in (1, -1)]
        self.idle = tuple(np.quantile(heads, 0.75, axis=1))
        self.distinct = np.array([len(np.unique(column)) >= 20 for column in rows.T])
        self.report, self.names = check(demonstrations), column_labels(demonstrations)

    def of_rule(self, rule: str) -> Array:
        """Whether each column measures something and is one of those that the rule is about."""
        is_action = np.arange(len(self.names)) >= self.n_observations
        of_kind = {"frozen sensor": ~is_action, "frozen action": is_action}
        return self.distinct & of_kind.get(rule, True)

    def columns(self, rule: str) -> Array:
        """Numbers of the columns of which the rule says that it can know."""
        unknown = self.names if rule in self.report.not_checked else self.report.unknown.get(rule, ())
        return np.flatnonzero(self.of_rule(rule) & ~np.isin(self.names, unknown))

    def pick(self, rule: str, rng: np.random.Generator) -> int | None:
        return int(rng.choice(columns)) if len(columns := self.columns(rule)) else None

    def known(self, rule: str) -> float | None:
        """Share of the columns that measure something, or 1 or 0 for the data as a whole, about which a rule says that
        it can know; None where the rule is about actions and these are discrete."""
        if rule in ("frozen action", "lag") and self.demonstrations.is_discrete:
            return None
        if rule not in (*HELD, "spike", "jump", "scale", "sign", "offset", "never moves"):
            return float(rule not in self.report.not_checked or rule == "dropped frames")
        n_columns = int(self.of_rule(rule).sum())
        return len(self.columns(rule)) / n_columns if n_columns else None


def _longest_runs(episode: Array) -> list[int]:
    changed = np.vstack([np.ones_like(episode[:1], dtype=bool), np.diff(episode, axis=0) != 0])
    return [int(np.diff(np.flatnonzero(column), append=len(episode)).max()) for column in changed.T]


Fault = Callable[[Array, Clean, float, np.random.Generator], Array | None]
"""A demonstration (T, C + 1) whose last column is time, the clean data, a size: the same with the fault, or None."""


def _place(episode: Array, steps: int, rng: np.random.Generator) -> int | None:
    """A first step for a fault of so many steps, with at least two before and after."""
    room = len(episode) - steps - 4
    return int(2 + rng.integers(room + 1)) if room >= 0 else None


def drop(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
    start = _place(episode, int(size), rng)
    return None if start is None else np.delete(episode, slice(start, start + int(size)), axis=0)


def repeat(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
    """A frame is written several times, where the demonstration moves at its usual speed."""
    columns = np.flatnonzero(clean.distinct[: clean.n_observations])
    if not len(columns) or len(episode) < 8:
        return None
    motion = (np.abs(np.diff(episode[:, columns], axis=0)) / clean.leap[columns]).mean(axis=1)
    fast = np.flatnonzero(np.minimum(motion[:-1], motion[1:]) >= np.median(motion))[1:-1]
    at = int(rng.choice(fast)) + 1 if len(fast) else 1
    again = np.insert(episode, [at + 1] * int(size), episode[at], axis=0)
    again[:, -1] = np.arange(len(again)) / FPS  # the clock goes on
    return again


def _hold(rule: str) -> Fault:
    def hold(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
        column = clean.pick(rule, rng)
        steps = 0 if column is None else int(size * max(15, 4 * clean.run[column]))
        start = _place(episode, steps, rng)
        if start is None or column is None:
            return None
        held = episode.copy()
        held[start : start + steps, column] = clean.high[column] if rule == "saturation" else episode[start, column]
        return held

    return hold


def _leap(rule: str) -> Fault:
    """One value, or all values of a column from a step on, are off by so many times its largest usual change."""

    def leap(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
        start, column, off = _place(episode, 1, rng), clean.pick(rule, rng), episode.copy()
        if start is None or column is None:
            return None
        off[start : start + 1 if rule == "spike" else None, column] += size * clean.leap[column] * rng.choice([-1, 1])
        return off

    return leap


def _column(rule: str, change: Callable[[Array, float, float, int], Array]) -> Fault:
    """A column is changed, given the size, its standard deviation and a sign."""

    def make(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
        column, other = clean.pick(rule, rng), episode.copy()
        if column is None or not np.ptp(episode[:, column]):
            return None
        other[:, column] = change(episode[:, column], size, clean.spread[column], int(rng.choice([-1, 1])))
        return other

    return make


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
        if ("idle head" if at_head else "idle tail") in clean.report.not_checked:
            return None
        still = np.repeat(row, int(size * max(15, 4 * clean.idle[not at_head])), axis=0)
        longer = np.concatenate([still, episode] if at_head else [episode, still])
        longer[:, -1] = np.arange(len(longer)) / FPS
        return longer

    return idle


def _rows(change: Callable[[Array, int], Array]) -> Fault:
    """All rows are changed, given the number of observations; the clock goes on."""

    def make(episode: Array, clean: Clean, size: float, rng: np.random.Generator) -> Array | None:
        if clean.demonstrations.is_discrete:
            return None
        other = change(episode[:, :-1], clean.n_observations)
        return np.column_stack([other, np.arange(len(other)) / FPS])

    return make


@dataclass(frozen=True)
class Kind:
    """A kind of fault: how it is made, its sizes with their unit, and the rule that should find it."""

    make: Fault
    sizes: tuple[float, ...]
    unit: str
    rule: str
    alike: tuple[str, ...] = ()  # rules that name the same fault as well


_cut: Fault = lambda e, _, size, __: e[: int(len(e) / size)] if len(e) >= 3 * size else None  # noqa: E731
HELD = ("frozen sensor", "frozen action", "saturation")
LONG = "x long"  # 15 steps, or 4 usual longest runs or idle ends
CHANGE = "x change"  # the 99.9 % quantile of changes
KINDS: dict[str, Kind] = {
    "dropped frames": Kind(drop, (1,), "frames", "dropped frames"),
    "repeated frames": Kind(repeat, (4, 10), "frames", "repeated frames"),
    "frozen sensor": Kind(_hold("frozen sensor"), (1, 3), LONG, "frozen sensor", HELD),
    "frozen action": Kind(_hold("frozen action"), (1, 3), LONG, "frozen action", HELD),
    "saturation": Kind(_hold("saturation"), (1, 3), LONG, "saturation", HELD),
    "spike": Kind(_leap("spike"), (3, 6), CHANGE, "spike"),
    "jump": Kind(_leap("jump"), (3, 6), CHANGE, "jump"),
    "scale": Kind(_column("scale", lambda x, size, _, way: x * size**way), (25.4, 57.3), "x, or inverse", "scale"),
    "lag": Kind(delay, (3, 8), "steps late or early", "lag"),
    "idle head": Kind(_idle(True), (1,), LONG, "idle head"),
    "idle tail": Kind(_idle(False), (1,), LONG, "idle tail"),
    "length, cut": Kind(_cut, (4, 10), "times shorter", "length"),
    "sign": Kind(_column("sign", lambda x, *_: -x), (1,), "column", "sign"),
    "offset": Kind(
        _column("offset", lambda x, size, sd, way: x + size * sd * way), (0.5,), "sd of the column", "offset"
    ),
    "action early": Kind(_rows(lambda e, n: np.column_stack([e[:-1, :n], e[1:, n:]])), (1,), "step", "lag"),
    "never moves": Kind(_column("never moves", lambda x, *_: np.full_like(x, x[0])), (1,), "column", "never moves"),
}


@dataclass(frozen=True, eq=False)
class Planted:
    """Demonstrations with faults in some, their times, and a mask of those."""

    demonstrations: Demonstrations
    times: Times
    has_fault: Array


def rebuild(clean: Clean, rows: list[Array], has_fault: Array, with_times: bool, extra_actions: list[Array]) -> Planted:
    """`Planted` from demonstrations (T, C + 1), whose last column is time, and their discrete actions, if any."""
    n = clean.n_observations
    actions = extra_actions if clean.demonstrations.is_discrete else [e[:, n:-1] for e in rows]
    made = Demonstrations.from_episodes(list(zip((e[:, :n] for e in rows), actions, strict=True)))
    times = Times(np.concatenate([e[:, -1] for e in rows]), FPS) if with_times else Times()
    return Planted(made, times, has_fault)


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


def copies(clean: Clean, _: str, noise: float, share: float, rng: np.random.Generator) -> Planted:
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
