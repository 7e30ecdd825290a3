"""Imitation learning by estimating the expertise of demonstrators: ILEED."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit
from threadpoolctl import threadpool_limits

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.numerics.blocks import log_softmax, one_hot
from rpil.policies.features import FeatureMap, FeatureSettings, ridge_of
from rpil.policies.softmax import SoftmaxPolicy
from worlds import Array

ILEED_STARTS, ILEED_DIMENSIONS = 5, 2


def ileed(data: Demonstrations, seed: int) -> Array:
    """Imitation learning by estimating the expertise of demonstrators (Beliaev et al., ICML 2022).

    As published: demonstrator i masters state s to the degree rho_i(s) = sigmoid(<f(s), w_i>), and the policy, the
    embedding f and all w_i maximise one likelihood; of several random starts the likeliest wins. For discrete actions
    in the form of the authors' code: the action pi means with probability rho, else one of the other K - 1, which is
    rho' pi + (1 - rho') / K with rho' = (K rho - 1) / (K - 1). Adapted: every demonstration is its own demonstrator,
    policy and embedding (of 2 dimensions) are linear in the features, L-BFGS takes the place of Adam, a weak ridge and
    w_i ~ N(0, 1) keep the optimum finite, 5 starts instead of 20 and each from the pooled policy. The score, the mean
    expertise of a demonstration over its own states, is ours.
    """
    if not data.is_discrete:
        raise DataError(f"{data.source}: the actions are continuous, which it is not made for; give discrete ones.")
    classes, codes = np.unique(data.actions, return_inverse=True)
    features = FeatureMap.fit("raw", data.observations, settings=FeatureSettings())
    design, no_labels = features.design(data.observations), np.zeros(len(data), dtype=int)
    problem = FitData(design, codes, data.offsets, Discrete(len(classes)), no_labels)
    rng = np.random.default_rng(seed)
    ridge = ridge_of(features, None, data.n_steps, problem.space)
    shapes = ileed_shapes(problem)
    with threadpool_limits(1, "blas"):
        pooled = SoftmaxPolicy.zero(problem.space.n, ridge).fit(problem, np.ones(data.n_steps))[0]
        ends = []
        for _ in range(ILEED_STARTS):
            embedding, expertise = (rng.normal(size=shape) for shape in shapes[1:])
            start = np.concatenate([pooled.weights.ravel(), embedding.ravel() / np.sqrt(len(ridge)), expertise.ravel()])
            ends.append(minimize(ileed_loss, start, (problem, ridge), "L-BFGS-B", jac=True, options={"maxiter": 300}))
    _, embedding, expertise = unpacked(min(ends, key=lambda end: end.fun).x, shapes)
    rho = expit(((problem.features @ embedding) * problem.per_step(expertise)).sum(axis=1))
    return problem.sum_steps(rho) / data.lengths


def ileed_shapes(problem: FitData) -> list[tuple[int, int]]:
    """Of the policy's weights, of the embedding, of the expertise."""
    n_columns = problem.features.shape[1]
    return [(n_columns, problem.space.n), (n_columns, ILEED_DIMENSIONS), (problem.n_demonstrations, ILEED_DIMENSIONS)]


def unpacked(parameters: Array, shapes: list[tuple[int, int]]) -> list[Array]:
    """One vector as arrays of these shapes."""
    ends = np.cumsum([rows * columns for rows, columns in shapes])
    return [part.reshape(shape) for part, shape in zip(np.split(parameters, ends[:-1]), shapes, strict=True)]


def ileed_loss(parameters: Array, problem: FitData, ridge: Array) -> tuple[float, Array]:
    """Penalised negative log-likelihood of ILEED, and its gradient."""
    weights, embedding, expertise = unpacked(parameters, ileed_shapes(problem))
    n_others = problem.space.n - 1
    log_proba = log_softmax(problem.features @ weights)
    proba, log_pi = np.exp(log_proba), np.take_along_axis(log_proba, problem.actions[:, None], axis=1)[:, 0]
    pi, others = np.exp(log_pi), -np.expm1(log_pi)
    embedded, own = problem.features @ embedding, problem.per_step(expertise)
    rho = expit((embedded * own).sum(axis=1))
    likelihood = np.maximum(rho * pi + (1 - rho) * others / n_others, np.finfo(float).tiny)
    penalty = 0.5 * ((ridge[:, None] * weights**2).sum() + (ridge[:, None] * embedding**2).sum() + (expertise**2).sum())

    by_logit = (rho - (1 - rho) / n_others) * pi / likelihood  # d log p / d log pi
    by_skill = rho * (1 - rho) * (pi - others / n_others) / likelihood  # d log p / d <f(s), w>
    hot_by_logit = one_hot(problem.actions, by_logit, problem.space.n)
    slopes = (
        ridge[:, None] * weights - problem.features.T @ (hot_by_logit - by_logit[:, None] * proba),
        ridge[:, None] * embedding - problem.features.T @ (by_skill[:, None] * own),
        expertise - problem.sum_steps(by_skill[:, None] * embedded),
    )
    return float(penalty - np.log(likelihood).sum()), np.concatenate([slope.ravel() for slope in slopes])
