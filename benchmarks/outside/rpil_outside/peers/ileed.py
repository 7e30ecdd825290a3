"""ILEED: imitation learning by estimating the expertise of demonstrators (Beliaev et al., ICML 2022, arXiv 2202.01288).

As published: i masters state s to the degree rho_i(s) = sigmoid(<f(s), w_i>); policy, embedding f and all w_i maximise
one likelihood: of the policy with probability rho, else of any other action. Adapted: every demonstration is its own
demonstrator, the embedding is linear and the policy trees, the density of all actions is that of "any other" number,
and EM takes the place of Adam. A step weighs as it probably follows the policy; the score is the mean expertise.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from .common import by_chance, likelihood, mean_of, predicted, states, targets

if TYPE_CHECKING:
    from ..world import Made

DIMENSIONS, ROUNDS, ITERATIONS = 3, 6, 15


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    return mean_of(made.demonstrations, fitted(made, seed)[0])


def weights(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    return fitted(made, seed)[1]


@lru_cache(maxsize=1)
def fitted(made: Made, seed: int) -> tuple[np.ndarray, np.ndarray]:  # expertise, and whether the policy is followed
    data, Y = made.demonstrations, targets(made.demonstrations)
    seen, owner = np.column_stack([np.ones(data.n_steps), states(data)]), np.asarray(data.groups)
    point = 0.3 * np.random.default_rng(seed).normal(size=(seen.shape[1] + len(data), DIMENSIONS)).ravel()
    follows = expertise = np.full(len(Y), 0.7)

    def embedded(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        f, w = np.split(point.reshape(-1, DIMENSIONS), [seen.shape[1]])
        return seen @ f, w[owner]

    def loss(point: np.ndarray) -> tuple[float, np.ndarray]:
        f, w = embedded(point)
        z = (f * w).sum(axis=1)
        miss = (expit(z) - follows)[:, None]
        slope = np.concatenate([seen.T @ (miss * w), np.add.reduceat(miss * f, data.offsets[:-1], axis=0)])
        return float((np.logaddexp(0, z) - follows * z).sum() + 0.5 * (point**2).sum()), slope.ravel() + point

    for _ in range(ROUNDS):
        done = predicted(seen, Y, follows)
        by_policy = likelihood(Y, done, data.is_discrete, follows)
        other = (1 - by_policy) / (Y.shape[1] - 1) if data.is_discrete else by_chance(Y, done, follows)
        follows = expertise * by_policy / (expertise * by_policy + (1 - expertise) * other + 1e-300)
        point = minimize(loss, point, jac=True, method="L-BFGS-B", options={"maxiter": ITERATIONS}).x
        expertise = expit(np.multiply(*embedded(point)).sum(axis=1))
    return expertise, follows
