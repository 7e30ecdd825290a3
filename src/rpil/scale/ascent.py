"""Fit the final policy to all weighted steps, wherever they are, by passes.

Each iteration is a Newton step with the Hessian of a sample, scaled to all data. A sample of fifty steps a coefficient
has most of the curvature right, so that each pass removes most of the remaining error.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from rpil.numerics.blocks import Sums
from rpil.numerics.newton import Preconditioner
from rpil.numerics.types import Array
from rpil.policies.protocol import AdditivePolicy
from rpil.scale.fit import WeightedBlock
from rpil.scale.protocol import Shards
from rpil.scale.settings import AscentSettings


def block_statistics(block: WeightedBlock, policy: AdditivePolicy) -> Sums:
    """Log-likelihood, sufficient statistics and weight of the steps of a block."""
    log_prob, statistics = policy.collect_suff_stats(block.features, block.actions, block.weight)
    return block.weight @ log_prob, statistics, block.weight.sum()


def ascend(
    shards: Shards[WeightedBlock],
    policy: AdditivePolicy,
    hessian: Preconditioner | None,
    settings: AscentSettings,
    progress: Callable[[str], None],
) -> AdditivePolicy:
    """Maximise the penalised log-likelihood of all weighted steps, from a `policy` on; returns the policy.

    A step that lowers the objective, because the `hessian` of the sample (`AdditivePolicy.with_preconditioner`) is too
    small somewhere, is taken again within a radius (Levenberg and Marquardt), which grows with every success.
    """

    def objective(policy: AdditivePolicy) -> tuple[float, Sums]:
        sums = shards.total(partial(block_statistics, policy=policy))
        return float(sums[0]) - policy.penalty(), sums

    history = np.empty((0, 2))  # objective and gradient norm of each pass
    radius, curvature = np.inf, np.empty((0, 2, 0, 0))
    value, sums = objective(policy)
    while len(history) < settings.max_passes:
        history = np.vstack([history, [value, policy.gradient_norm(sums[1])]])
        goal = settings.tol * sums[2]
        progress(f"pass {len(history)} over everything, objective {value:.6g}")
        if history[-1, 1] <= goal or _is_stuck(history, settings):
            break
        before = curvature
        candidate, curvature = policy.m_step(sums[1], radius, hessian, before)
        new_value, new_sums = objective(candidate)
        while not new_value >= value - settings.rounding * abs(value):
            radius = min(settings.radius, radius / 8)
            if radius < settings.min_radius:
                return policy
            candidate, curvature = policy.m_step(sums[1], radius, hessian, before)
            new_value, new_sums = objective(candidate)
        policy, value, sums = candidate, new_value, new_sums
        radius = 2.0 * radius if radius < settings.radius else np.inf
    return policy


def _is_stuck(history: Array, settings: AscentSettings) -> bool:
    """Whether the gradient no longer shrinks and the objective no longer grows."""
    n = settings.patience
    if len(history) <= n:
        return False
    values, gradients = history.T
    shrinks = gradients[-n:].min() <= 0.5 * gradients[:-n].min()
    return not shrinks and bool(values[-1] - values[-n] < n * settings.rounding * abs(values[-1]))
