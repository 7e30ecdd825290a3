"""Counter-BC: what the demonstrator may have meant instead (Sagheb and Losey, arXiv 2505.10760).

As published: actions near each demonstrated one are counterfactuals; the loss is -R log pi over them, where R is pi
over its sum within the set of a step, so that the simplest policy within the sets wins. Adapted: the policy is one of
trees, R is held while it is fitted, in turns; the reach is half a deviation of each action column (the
paper sets it by hand), with ten drawn counterfactuals. It changes actions and chooses none: `corrected` gives what the
world's learner then learns from; the score, ours, is minus the mean size of the change. Numbers only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import softmax

from .common import NotMadeForIt, mean_of, predicted, states, targets

if TYPE_CHECKING:
    from rpil import Demonstrations

    from ..world import Made

REACH, DRAWS, ROUNDS = 0.5, 10, 10


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    return -mean_of(made.demonstrations, np.linalg.norm(changes(made, seed), axis=1))


def corrected(made: Made, answers: Mapping[str, bool], seed: int) -> Demonstrations:
    data = made.demonstrations
    spread = np.asarray(data.actions, dtype=float).std(axis=0)
    return replace(data, actions=(data.actions + changes(made, seed) * spread).clip(data.low, data.high))


@lru_cache(maxsize=1)
def changes(made: Made, seed: int) -> np.ndarray:
    """What is added to each scaled action, (N, K)."""
    data = made.demonstrations
    if data.is_discrete:
        raise NotMadeForIt("actions are classes, which have none near them")
    seen, Y, rng = states(data), targets(data), np.random.default_rng(seed)
    way = rng.normal(size=(DRAWS + 1, *Y.shape))
    way *= (REACH * rng.random((DRAWS + 1, len(Y))) ** (1 / Y.shape[1]) / np.linalg.norm(way, axis=2))[:, :, None]
    way[0] = 0.0
    moved = np.zeros_like(Y)
    for _ in range(ROUNDS):
        fit = predicted(seen, Y + moved, np.ones(len(Y)))
        spread = (Y + moved - fit).std(axis=0) + 0.05
        share = softmax(-0.5 * (((Y + way - fit) / spread) ** 2).sum(axis=2), axis=0)
        moved = (share[:, :, None] * way).sum(axis=0)
    return moved
