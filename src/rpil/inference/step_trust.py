"""Which steps of a demonstration are an expert's: a_n ~ rho_m pi + (1 - rho_m) q, given held-out log-ratios.

rho_m, the reliability of demonstration m, is the share of its steps that are the expert's. It lives on a grid, with a
prior that is uniform; everything else is a sum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.data.fit_data import FitData
from rpil.numerics.types import Array

N_NODES = 21

_NODES = (np.arange(N_NODES) + 0.5) / N_NODES


@dataclass(frozen=True, eq=False)
class StepTrust:
    """Reliability of M demonstrations and trust in N steps.

    Attributes
    ----------
    reliability : (M,) array
        Posterior mean of the share of a demonstration's steps that are an expert's.
    interval : (M, 2) array
        Its 95 % interval.
    step : (N,) array
        P(step n is an expert's).
    """

    reliability: Array
    interval: Array
    step: Array


def step_trust(data: FitData, log_ratio: Array, power: Array) -> StepTrust:
    """Trust in steps with `log_ratio` log pi - log q (N,).

    A step of demonstration m is worth `power` (M,) independent steps, which widens the interval.
    """
    log_odds = np.log(_NODES) - np.log1p(-_NODES)
    evidence = np.empty((data.n_demonstrations, N_NODES))
    clipped = np.clip(log_ratio, -50.0, 50.0)
    for j, rho in enumerate(_NODES):
        mixture = np.logaddexp(np.log(rho) + clipped, np.log1p(-rho))
        evidence[:, j] = data.sum_steps(mixture)
    posterior, with_temperature = (_normalised(log) for log in (evidence, power[:, None] * evidence))
    cumulated = with_temperature.cumsum(axis=1)
    ends = [_NODES[np.minimum((cumulated < q).sum(axis=1), N_NODES - 1)] for q in (0.025, 0.975)]
    reliability = posterior @ _NODES
    at = data.per_step(np.interp(reliability, _NODES, log_odds))
    step = 1 / (1 + np.exp(-np.clip(at + clipped, -50.0, 50.0)))
    return StepTrust(reliability, np.stack(ends, axis=1), step)


def _normalised(evidence: Array) -> Array:
    """Probabilities, from their logarithms up to a constant in each row."""
    proba = np.exp(evidence - evidence.max(axis=1, keepdims=True))
    found: Array = proba / proba.sum(axis=1, keepdims=True)
    return found
