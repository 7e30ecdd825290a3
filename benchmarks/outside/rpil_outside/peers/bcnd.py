"""BCND: behavioural cloning from noisy demonstrations (Sasaki and Yamashina, ICLR 2021).

As published: K policies, each of a part of the steps; then the steps are weighted by the mean probability of their
actions under the policies of the round before, and the policies are fitted again. It takes most demonstrations to be
good. Adapted: the policies are linear in their parameters, and the densities of numbers have one spread per column.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from .common import design, likelihood, mean_of, predicted, targets

if TYPE_CHECKING:
    from ..world import Made

POLICIES, ROUNDS = 5, 5


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    return mean_of(made.demonstrations, weights(made, answers, seed))


def weights(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    data, X, Y = made.demonstrations, design(made.demonstrations), targets(made.demonstrations)
    part = np.random.default_rng(seed).permutation(data.n_steps) % POLICIES
    weight = np.ones(data.n_steps)
    for _ in range(ROUNDS):
        fits = [predicted(X, Y, data.is_discrete, weight, part == k) for k in range(POLICIES)]
        weight = np.mean([likelihood(Y, fit, data.is_discrete, weight) for fit in fits], axis=0)
        weight /= weight.mean()
    return weight
