"""Which steps of a demonstration are an expert's:

    a_n ~ rho_m pi + (1 - rho_m) q,      rho_m uniform on a grid in (0, 1)

rho_m, the reliability of demonstration m, is the share of its steps that are an expert's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import softmax

from rpil.data.fit_data import FitData
from rpil.inference.settings import JudgeSettings
from rpil.numerics.types import Array, Float


@dataclass(frozen=True, eq=False)
class StepTrust:
    """Reliability of M demonstrations and trust in N steps."""

    reliability: Float[Array, " M"]
    """Posterior mean of rho_m."""
    interval: Float[Array, "M 2"]
    """Its 95 % interval."""
    step: Float[Array, " N"]
    """P(step n is an expert's); empty where steps are not kept."""


def step_trust(
    data: FitData,
    log_ratio: Float[Array, " N"],
    temperature: Float[Array, " M"],
    settings: JudgeSettings,
) -> StepTrust:
    """Reliability and trust in steps, given the held-out `log_ratio` log pi - log q of each step.

    The likelihood of demonstration m is raised to `temperature` in the interval: the independent steps that one of its
    steps is worth.
    """
    n_nodes, bound = settings.reliability_nodes, settings.max_log_ratio
    nodes = (np.arange(n_nodes) + 0.5) / n_nodes
    evidence = np.empty((data.n_demonstrations, n_nodes))
    clipped = np.clip(log_ratio, -bound, bound)
    for j, rho in enumerate(nodes):
        evidence[:, j] = data.sum_steps(np.logaddexp(np.log(rho) + clipped, np.log1p(-rho)))
    cumulated = softmax(temperature[:, None] * evidence, axis=1).cumsum(axis=1)
    ends = [nodes[np.minimum((cumulated < q).sum(axis=1), n_nodes - 1)] for q in (0.025, 0.975)]
    reliability = softmax(evidence, axis=1) @ nodes
    log_odds = data.per_step(np.interp(reliability, nodes, np.log(nodes) - np.log1p(-nodes)))
    step = 1 / (1 + np.exp(-np.clip(log_odds + clipped, -bound, bound)))
    return StepTrust(reliability, np.stack(ends, axis=1), step)
