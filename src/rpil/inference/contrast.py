"""How two groups differ that each have a policy of their own: a description, which judges neither.

The evidence that tells the groups apart is the log-ratio of their policies, log pi_A - log pi_B in the steps of A and
log pi_B - log pi_A in those of B, summed over each part of a continuous action, or over the steps with each discrete
action. A part's share of it is

    e_j / sum_j e_j,    e_j = max(0, median over B of mean_n d_nj - median over A of mean_n d_nj),
    d_nj = log pi_B(a_nj|s_n) - log pi_A(a_nj|s_n)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.data.spaces import Discrete
from rpil.inference.rivals import Lower
from rpil.inference.scores import Scoring
from rpil.numerics.types import Array, Float


@dataclass(frozen=True, eq=False)
class Contrast:
    """How two groups A and B differ; J parts of a continuous action, or J discrete actions."""

    share: Float[Array, " J"]
    """Share of the evidence; all 0 where the policy has no parts."""
    use: Float[Array, "2 J"]
    """The median of each part in the steps of A and of B, or how often each action is taken there."""
    spread: Float[Array, " J"]
    """The median distance of each part from the median of its group; 0 for discrete actions."""
    length: Float[Array, " 2"]
    """Steps of the median demonstration of A and of B."""


def contrast(scoring: Scoring, lower: Lower, ridge: float) -> Contrast:
    """The contrast of the upper group, A, with its rival, B, by policies with a `ridge` a step."""
    data, groups = scoring.data, (lower.upper, lower.rival)
    length = np.array([np.median(data.lengths[group]) for group in groups])
    evidence = _evidence(scoring, lower, ridge)
    share = evidence / max(float(evidence.sum()), 1e-12)
    inside = [np.repeat(np.isin(np.arange(data.n_demonstrations), group), data.lengths) for group in groups]
    if isinstance(data.space, Discrete):
        use = [np.bincount(data.actions[own], minlength=data.space.n) / own.sum() for own in inside]
        return Contrast(share, np.stack(use), np.zeros(data.space.n), length)
    use = [np.median(data.actions[own], axis=0).astype(float) for own in inside]
    away = [np.abs(data.actions[own] - middle) for own, middle in zip(inside, use, strict=True)]
    return Contrast(share, np.stack(use), np.median(np.concatenate(away), axis=0), length)


def _evidence(scoring: Scoring, lower: Lower, ridge: float) -> Float[Array, " J"]:
    """e_j, nats a step; 0 where the policy has no parts."""
    data, every = scoring.data, np.arange(scoring.data.n_demonstrations)
    weights = [data.per_step(np.isin(every, group).astype(float)) for group in (lower.upper, lower.rival)]
    if isinstance(data.space, Discrete):
        log_pi_a, log_pi_b = (scoring.model.cold_copy().evaluate(weight, ridge) for weight in weights)
        cell = data.per_step(every) * data.space.n + data.actions
        sums = np.bincount(cell, log_pi_b - log_pi_a, len(every) * data.space.n).reshape(-1, data.space.n)
    else:
        of_upper, of_rival = (scoring.model.log_prob_of_parts(weight, ridge) for weight in weights)
        if of_upper is None or of_rival is None:
            return np.zeros(data.actions.shape[1])
        sums = data.sum_steps(of_rival - of_upper)
    means = sums / data.lengths[:, None]
    return np.maximum(np.median(means[lower.rival], axis=0) - np.median(means[lower.upper], axis=0), 0.0)
