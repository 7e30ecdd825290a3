"""Data with a known truth: a linear softmax expert, and demonstrators with random actions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpil.data.demonstrations import Demonstrations
from rpil.simulation.simulate import simulate

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
