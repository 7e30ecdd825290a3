"""A policy fitted to all weighted steps, wherever they lie: every iteration is one pass.

Policies take Newton steps with the Hessian of a sample, scaled up: a sample of fifty steps a coefficient gets most
directions right, so that each pass takes most of the error away.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from typing import Any

import numpy as np

from rpil.engines import Shards
from rpil.passes import Array, Sums, add
from rpil.problem import Problem

_ROUNDING = 1e-8
"""Share of the objective that a pass may lose to rounding: some 3e-9, with a few thousand steps in single precision."""

_RADIUS = 2.0
"""How far any coefficient may move once a step went down: the policy of a sample may think nothing of a rare action,
or the sample not know a column that is mostly zero, and so see no curvature where everything has some."""

_SHORTEST = 1e-4
"""Radius at which there is no more uphill."""

_FREE = 1.0
"""Radius from which a small gain means that there is little to gain."""

_FAR = 64.0
"""Radius from which there is none: Hessians of the sample will do again."""

_PATIENCE, _SETTLED = 10, 5
"""Passes in which the gradient must halve, or the objective gain, or rounding is all that is left; and passes that gain
little, in however narrow a region, after which there is little to gain."""

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Polished:
    """Where passes over everything ended: a policy; how far a step may go from there; where the Hessian was last made,
    if anywhere but at the start; and the path that the policy remembers, (T, D, K)."""

    state: Any
    history: Array = field(default_factory=lambda: np.empty(0))
    converged: bool = False
    radius: float = np.inf
    anchor: Any = None
    path: Array = field(default_factory=lambda: np.empty((0, 0, 0)))


def gathered(pieces: Iterator[tuple[Array, Array]], n_steps: int, on_disk: bool) -> tuple[Array, Array, float]:
    """Log-ratios and weights of all steps, (N,) each, in a temporary file where memory should not hold them; and the
    sum of the weights."""
    total = 0.0
    if not on_disk:
        log_ratio, weight = np.empty((2, n_steps))
        end = 0
        for one, other in pieces:
            begin, end = end, end + len(one)
            log_ratio[begin:end], weight[begin:end] = one, other
            total += float(other.sum())
        return log_ratio, weight, total
    with tempfile.TemporaryFile() as first, tempfile.TemporaryFile() as second:
        for both in pieces:
            total += float(both[1].sum())
            for file, values in zip((first, second), both, strict=True):
                file.write(values.astype(np.float32).tobytes())
        first.flush()
        second.flush()
        one, other = (np.memmap(file, np.float32, "r", shape=(n_steps,)) for file in (first, second))
    return one, other, total


def resumed(begun: Polished, primed: Any) -> Polished:
    """`begun`, as it was kept, with the Hessian of the policy `primed`."""
    return replace(begun, state=begun.state.like(primed, begun.path))


def clone_pass(lesson: tuple[Problem, Array, Array], policy: Any) -> Sums:
    """Log-likelihood and weight of weighted steps, and what the policy must know to improve."""
    problem, weight, _ = lesson
    log_prob, statistics = policy.study(problem, weight)
    return weight @ log_prob, statistics, weight.sum()


def clone(
    shards: Shards,
    start: Polished,
    prime: Callable[[Any], Any],
    tol: float,
    max_iter: int,
    progress: Progress = lambda _: None,
    keep: Callable[[Polished], None] = lambda _: None,
) -> Polished:
    """A policy that `prime` makes ready, fitted to weighted steps until the gradient is nowhere above `tol` a step.

    `keep` is called after every pass with what there is; it is a `start` from which the fit goes on.
    """

    def measure(at: Any) -> tuple[float, Sums]:
        sums = total(shards, partial(clone_pass, policy=at))
        return float(sums[0]) - at.penalty(), sums

    slopes: list[float] = []
    values: list[float] = []

    def done(at: Any, sums: Sums) -> bool:
        slopes.append(at.slope(sums[1]))
        values.append(float(sums[0]) - at.penalty())
        stuck = len(slopes) > _PATIENCE and min(slopes[-_PATIENCE:]) > 0.5 * min(slopes[:-_PATIENCE])
        stuck = stuck and values[-1] - values[-_PATIENCE] < _PATIENCE * _ROUNDING * abs(values[-1])
        return bool(stuck or slopes[-1] <= tol * sums[2])

    def better(at: Any, sums: Sums, radius: float) -> Any:
        return at.improved(sums[1], radius)

    def again(at: Any) -> Any:
        return at if at.experienced else at.like(prime(at))

    return _climb(start, measure, better, again, -np.inf, max_iter, progress, keep, done)


def total(shards: Shards, one_pass: Callable[[Any], Sums]) -> Sums:
    """The sums over all shards, always added up in the same order."""
    return reduce(add, shards.map(one_pass))


def _climb(
    start: Polished,
    measure: Callable[[Any], tuple[float, Sums]],
    better: Callable[[Any, Sums, float], Any],
    again: Callable[[Any], Any],
    goal: float,
    max_iter: int,
    progress: Progress,
    keep: Callable[[Polished], None] = lambda _: None,
    done: Callable[[Any, Sums], bool] = lambda _, __: False,
) -> Polished:
    """Steps until one gains no more than `goal`, or it is `done`.

    Where one went down, as the Hessian of a sample may be too small somewhere, it is made `again`, and a trust region
    keeps the next steps short (Levenberg and Marquardt's); the region grows with every success.
    """
    begun = time.perf_counter()
    here, history, radius, anchor = start.state, start.history, start.radius, start.anchor
    value, sums = measure(here)
    history = history if len(history) else np.array([value])
    n_before = len(history)
    while len(history) <= max_iter and not start.converged:
        elapsed = (time.perf_counter() - begun) / (1 + len(history) - n_before)
        progress(f"pass {len(history)} over everything, objective {value:.6g}{_time_left(history, goal, elapsed)}")
        if done(here, sums):
            return Polished(here, history, True)
        there = better(here, sums, radius)
        new_value, new_sums = measure(there)
        while not new_value >= value - _ROUNDING * abs(value):
            if anchor is not here:
                here = anchor = again(here)
            radius = min(_RADIUS, radius / 8)
            if radius < _SHORTEST:
                return Polished(here, history, False)
            there = better(here, sums, radius)
            new_value, new_sums = measure(there)
        gain = new_value - value
        here, value, sums = there, new_value, new_sums
        history = np.append(history, value)
        small = bool((np.abs(np.diff(history[-1 - _SETTLED :])) <= goal).all()) and len(history) > _SETTLED
        converged = small or (radius >= _FREE and gain <= goal)
        radius = 2.0 * radius if radius < _FAR else np.inf
        keep(Polished(here, history, converged, radius, anchor, here.path))
        if converged:
            return Polished(here, history, True)
    return Polished(here, history, start.converged)


def _time_left(history: Array, goal: float, seconds: float) -> str:
    """In words, as far as two gains tell how fast they shrink."""
    gains = np.diff(history[-3:])
    if len(gains) < 2 or not 0.0 < gains[1] < gains[0] or not 0.0 < goal < gains[1]:
        return ""
    passes = np.ceil(np.log(gains[1] / goal) / np.log(gains[0] / gains[1]))
    return f", about {passes * seconds:.0f} s left"
