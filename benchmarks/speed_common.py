"""What the rows of `speed.py` share: fair clocks, runs that take turns, and made data with a known truth."""

from __future__ import annotations

import os
import resource
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_info, threadpool_limits

from rpil.data.demonstrations import Demonstrations
from rpil.simulation.simulate import simulate


@dataclass(frozen=True)
class Measured:
    """What a row found: `values` are ratios, seconds or GiB by key; `details` whatever explains them."""

    values: dict[str, float]
    details: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Skipped:
    """A row that could not be measured, and why."""

    why: str


def in_turns(
    repeats: int, *, quiet: bool = False, **runs: Callable[[], Any]
) -> tuple[dict[str, float], dict[str, Any]]:
    """Median seconds of each of the `runs`, which take turns so that a busy machine hurts all alike; last answers."""
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    answers = {}
    for _ in range(repeats):
        for name, run in runs.items():
            begun = time.perf_counter()
            answers[name] = run()
            seconds[name].append(time.perf_counter() - begun)
            if not quiet:
                print(f"  {name}: {seconds[name][-1]:.3g} s", file=sys.stderr, flush=True)
    return {name: statistics.median(of) for name, of in seconds.items()}, answers


@contextmanager
def one_core() -> Iterator[None]:
    """One core, and one thread of every pool, for whatever runs inside: equal terms for libraries that use more."""
    with threadpool_limits(1):
        if not hasattr(os, "sched_setaffinity"):
            yield
            return
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {max(before)})
        try:
            yield
        finally:
            os.sched_setaffinity(0, before)


def threads() -> dict[str, int]:
    """Threads of every pool that is loaded, BLAS and OpenMP, within `one_core`."""
    with one_core():
        return {f"{pool['internal_api']} {k}": pool["num_threads"] for k, pool in enumerate(threadpool_info())}


def peak_gib() -> float:
    """The most memory that this process had resident so far; `getrusage` would count that of the parent process."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 2**20


# ---- made data -------------------------------------------------------------------------------------------------------

_SURENESS = 2.0
"""Standard deviation of the expert's logits: the likeliest of six actions has about .6 on average."""
_SHARED = 0.5
"""How much neighbouring observations have in common: real ones are correlated."""


@dataclass(frozen=True, eq=False)
class Planted:
    """Demonstrations, and which are good, (M,)."""

    demonstrations: Demonstrations
    is_good: NDArray[np.bool_]


def softmax_expert(
    n_steps: int, n_features: int, n_actions: int, *, length: int = 200, random: float = 0.3, shard: int = 0
) -> Planted:
    """Demonstrations of equal length in single precision, a share of which are `random` actions throughout.

    All shards have the same expert.
    """
    weights = np.random.default_rng(0).normal(size=(n_features, n_actions)).astype(np.float32)
    weights *= _SURENESS / np.sqrt(n_features * (1 + _SHARED**2))
    rng = np.random.default_rng([1, shard])
    n_demonstrations = n_steps // length
    is_good = rng.permutation(n_demonstrations) >= round(random * n_demonstrations)
    observations = np.empty((n_demonstrations * length, n_features), np.float32)
    actions = np.empty(len(observations), np.int64)
    for m in range(n_demonstrations):  # a demonstration at a time, so that ten million steps need no copies
        rows = slice(m * length, (m + 1) * length)
        x = rng.standard_normal((length, n_features), dtype=np.float32)
        x[:, 1:] += _SHARED * x[:, :-1]
        observations[rows] = x
        # The Gumbel-max trick: the largest of logits plus Gumbel noise is a draw from their softmax.
        noise = rng.gumbel(size=(length, n_actions))
        actions[rows] = (noise + is_good[m] * (x @ weights)).argmax(axis=1)
    offsets = np.arange(n_demonstrations + 1) * length
    return Planted(Demonstrations(observations, actions, offsets), is_good)


def lander(n_good: int, n_bad: int, seed: int = 0) -> Planted:
    """LunarLander-v3: an expert's demonstrations, and others whose recorded actions are uniform draws."""
    made = simulate("LunarLander-v3", "corrupted", n_good=n_good, n_bad=n_bad, seed=seed)
    return Planted(Demonstrations.from_episodes(made.episodes), made.is_good == 1)


def wide_regression(n_steps: int, n_features: int, n_parts: int, n_demonstrations: int) -> Planted:
    """Slow observations in many columns and a linear expert with continuous actions; every fourth demonstration has
    noise alone in the place of its actions."""
    rng = np.random.default_rng(0)
    weights = rng.normal(size=(n_features, n_parts)) / np.sqrt(n_features)
    observations = rng.normal(size=(n_steps, n_features))
    for t in range(1, n_steps):
        observations[t] = 0.95 * observations[t - 1] + 0.31 * observations[t]
    offsets = np.linspace(0, n_steps, n_demonstrations + 1).astype(int)
    actions = observations @ weights + 0.1 * rng.normal(size=(n_steps, n_parts))
    is_good = np.arange(n_demonstrations) % 4 > 0
    noisy = np.repeat(~is_good, np.diff(offsets))
    actions[noisy] = actions.std(axis=0) * rng.normal(size=(int(noisy.sum()), n_parts))
    return Planted(Demonstrations(observations, actions, offsets), is_good)
