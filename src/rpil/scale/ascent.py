"""A policy fitted to all weighted steps, wherever they lie: every iteration is one pass.

Policies take Newton steps with the Hessian of a sample, scaled up: a sample of fifty steps a coefficient gets most
directions right, so that each pass takes most of the error away.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from rpil.data.archive import stored
from rpil.data.fit_data import FitData
from rpil.numerics.blocks import Sums
from rpil.numerics.types import Array
from rpil.scale.protocol import Shards

_ROUNDING = 1e-8
"""Share of the objective that a pass may lose to rounding: some 3e-9, with a few thousand steps in single precision."""

_RADIUS = 2.0
"""How far any coefficient may move once a step went down: the policy of a sample may give a rare action no chance,
or the sample not know a column that is mostly zero, and so see no curvature where everything has some."""

_SHORTEST = 1e-4
"""Radius at which there is no more uphill."""

_FAR = 64.0
"""Radius from which steps are no longer limited: Hessians of the sample will do again."""

_PATIENCE = 10
"""Passes in which the gradient must halve, or the objective gain, or rounding is all that is left."""


@stored(history="iterations 2", path="places 2 rows columns")
@dataclass(frozen=True, eq=False)
class AscentState:
    """How far passes over everything have come: a policy; objective and gradient at all places before, (T, 2); how far
    a step may go from here; and what the policy remembers of its path, see `rpil.numerics.newton.lbfgs_step`."""

    state: Any
    history: Array = field(default_factory=lambda: np.empty((0, 2)))
    radius: float = np.inf
    path: Array = field(default_factory=lambda: np.empty((0, 2, 0, 0)))


def gathered(blocks: Iterator[tuple[Array, Array]], n_steps: int, on_disk: bool) -> tuple[Array, Array, float]:
    """Log-ratios and weights of all steps, (N,) each, in a temporary file where memory should not hold them; and the
    sum of the weights."""
    if not on_disk:
        log_ratio, weight = zip(*blocks, strict=True)
        return np.concatenate(log_ratio), np.concatenate(weight), sum(float(one.sum()) for one in weight)
    total = 0.0
    with tempfile.TemporaryFile() as first, tempfile.TemporaryFile() as second:
        for both in blocks:
            total += float(both[1].sum())
            for file, values in zip((first, second), both, strict=True):
                file.write(values.astype(np.float32).tobytes())
        first.flush()
        second.flush()
        one, other = (np.memmap(file, np.float32, "r", shape=(n_steps,)) for file in (first, second))
    return one, other, total


def clone_pass(weighted: tuple[FitData, Array, Array], policy: Any) -> Sums:
    """Log-likelihood and weight of weighted steps, and what the policy must know to improve."""
    data, weight, _ = weighted
    log_prob, statistics = policy.collect_suff_stats(data, weight)
    return weight @ log_prob, statistics, weight.sum()


def clone(
    shards: Shards,
    start: AscentState,
    hessian: Any,
    tol: float,
    max_iter: int,
    progress: Callable[[str], None],
    keep: Callable[[AscentState], None],
) -> Any:
    """The policy fitted to weighted steps until the gradient is nowhere above `tol` a step.

    Where a step went down, as the `hessian` of a sample may be too small somewhere, a trust region keeps the next ones
    short (Levenberg and Marquardt's); it grows with every success. `keep` is called after every step with what there
    is; it is a `start` from which the fit goes on.
    """

    def measure(at: Any) -> tuple[float, Sums]:
        sums = shards.total(partial(clone_pass, policy=at))
        return float(sums[0]) - at.penalty(), sums

    begun = time.perf_counter()
    here, history, radius, path = start.state, start.history, start.radius, start.path
    value, sums = measure(here)
    while len(history) < max_iter:
        history = np.vstack([history, [value, here.gradient_norm(sums[1])]])
        seconds = (time.perf_counter() - begun) / (len(history) - len(start.history))
        left = _time_left(history[:, 1], tol * sums[2], seconds)
        progress(f"pass {len(history)} over everything, objective {value:.6g}{left}")
        if history[-1, 1] <= tol * sums[2] or _stuck(history):
            break
        before = path
        there, path = here.m_step(sums[1], radius, hessian, before)
        new_value, new_sums = measure(there)
        while not new_value >= value - _ROUNDING * abs(value):
            radius = min(_RADIUS, radius / 8)
            if radius < _SHORTEST:
                return here
            there, path = here.m_step(sums[1], radius, hessian, before)
            new_value, new_sums = measure(there)
        here, value, sums = there, new_value, new_sums
        radius = 2.0 * radius if radius < _FAR else np.inf
        keep(AscentState(here, history, radius, path))
    return here


def _stuck(history: Array) -> bool:
    """Whether neither the gradient shrinks nor the objective grows any more."""
    if len(history) <= _PATIENCE:
        return False
    values, slopes = history.T
    shrinks = slopes[-_PATIENCE:].min() <= 0.5 * slopes[:-_PATIENCE].min()
    return not shrinks and bool(values[-1] - values[-_PATIENCE] < _PATIENCE * _ROUNDING * abs(values[-1]))


def _time_left(slopes: Array, goal: float, seconds: float) -> str:
    """In words, as far as two gradients tell how fast they shrink."""
    if len(slopes) < 2 or not 0.0 < goal < slopes[-1] < slopes[-2]:
        return ""
    left = seconds * np.ceil(np.log(slopes[-1] / goal) / np.log(slopes[-2] / slopes[-1]))
    return f", about {left:.0f} s left" if left >= 1.0 else ""
