"""How two groups differ that each have a policy of their own: a description, which judges neither.

The evidence that tells the groups apart is the log-ratio of their policies, log pi_A - log pi_B in the steps of A and
log pi_B - log pi_A in those of B, summed over each part of a continuous action, or over the steps with each discrete
action. That of part j, in nats a step, is

    e_j = max(0, median over B of mean_n d_nj - median over A of mean_n d_nj),
    d_nj = log pi_B(a_nj|s_n) - log pi_A(a_nj|s_n)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.data.spaces import Discrete
from rpil.inference.rivals import Lower
from rpil.inference.scores import Scoring
from rpil.numerics.types import Array, Float

MAX_PARTS = 3
"""Parts of the action that are named or drawn."""
MIN_NATS = 1e-6
"""Evidence that is more than rounding."""


@dataclass(frozen=True, eq=False)
class Contrast:
    """How two groups A and B differ; J parts of a continuous action, or J discrete actions."""

    parts: tuple[tuple[int, float], ...]
    """The parts with most of the evidence and their shares of it; none where the policy has no parts."""
    use: Float[Array, "2 J"]
    """The median of each part in the steps of A and of B, or how often each action is taken there."""
    spread: Float[Array, " J"]
    """The median distance of each part from the median of its group; 0 for discrete actions."""
    length: Float[Array, " 2"]
    """Steps of the median demonstration of A and of B."""


def evidence_by_part(nats: Float[Array, " J"]) -> tuple[tuple[int, float], ...]:
    """The parts of the action with most of the evidence, the largest first, and their shares of it.

    The shares are among the parts that point where the sum of the `nats` points. There are `MAX_PARTS` at most, and
    none where there is nothing but rounding.
    """
    toward = np.maximum(nats if nats.sum() > 0 else -nats, 0.0)
    total = float(toward.sum())
    order = np.argsort(-toward, kind="stable")[:MAX_PARTS].tolist()
    return tuple((j, float(toward[j]) / total) for j in order if total > MIN_NATS and toward[j] > 0)


def contrast(scoring: Scoring, lower: Lower, ridge: float) -> Contrast:
    """The contrast of the upper group, A, with its rival, B, by policies with a `ridge` a step."""
    data, groups, every = scoring.data, (lower.upper, lower.rival), np.arange(scoring.data.n_demonstrations)
    inside = [data.per_step(np.isin(every, group)) for group in groups]
    weights = [steps.astype(float) for steps in inside]
    if isinstance(data.space, Discrete):
        taken = data.actions[:, None] == np.arange(data.space.n)
        log_pi_a, log_pi_b = (scoring.model.cold_copy().evaluate(weight, ridge)[:, None] * taken for weight in weights)
        use, spread = [taken[steps].mean(axis=0) for steps in inside], np.zeros(data.space.n)
    else:
        parts = [scoring.model.log_prob_of_parts(weight, ridge) for weight in weights]
        log_pi_a, log_pi_b = (np.zeros(data.actions.shape) if each is None else each for each in parts)
        use = [np.median(data.actions[steps], axis=0) for steps in inside]
        away = [np.abs(data.actions[steps] - middle) for steps, middle in zip(inside, use, strict=True)]
        spread = np.median(np.concatenate(away), axis=0)
    means = data.sum_steps(log_pi_b - log_pi_a) / data.lengths[:, None]
    nats = np.maximum(np.median(means[lower.rival], axis=0) - np.median(means[lower.upper], axis=0), 0.0)
    length = np.array([np.median(data.lengths[group]) for group in groups])
    return Contrast(evidence_by_part(nats), np.stack(use).astype(float), spread, length)
