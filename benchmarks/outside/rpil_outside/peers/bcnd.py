"""BCND: behavioural cloning from noisy demonstrations (Sasaki and Yamashina, ICLR 2021).

As published: K policies, each of a part of the steps; then the steps are weighted by the mean probability of their
actions under the policies of the round before, and the policies are fitted again. It takes most demonstrations to be
good. Adapted: the policies are trees, and densities of numbers have the spread of all errors, one for each column:
with that of the weighted ones hardly a step is left after some rounds.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from .common import likelihood, mean_of, predicted, states, targets

if TYPE_CHECKING:
    from ..world import Made

POLICIES, ROUNDS = 5, 5


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    return mean_of(made.demonstrations, fitted(made, seed))


def weights(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    return fitted(made, seed)


@lru_cache(maxsize=1)
def fitted(made: Made, seed: int) -> np.ndarray:  # the weight of each step
    data, seen, Y = made.demonstrations, states(made.demonstrations), targets(made.demonstrations)
    part = np.random.default_rng(seed).permutation(data.n_steps) % POLICIES
    weight = np.ones(data.n_steps)
    for _ in range(ROUNDS):
        fits = [predicted(seen, Y, weight, part == k) for k in range(POLICIES)]
        weight = np.mean([likelihood(Y, fit, data.is_discrete) for fit in fits], axis=0)
        weight /= weight.mean()
    return weight
