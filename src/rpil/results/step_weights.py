"""Weights of steps for training a policy, from the probabilities and the reliability of their demonstrations."""

from __future__ import annotations

import numpy as np

from rpil.numerics.types import Array, Float, Int
from rpil.results.settings import AuditSettings


def step_weight(
    lengths: Int[Array, " M"],
    expert_proba: Float[Array, " M"],
    reliability: Float[Array, " M"],
    step_proba: Float[Array, " N"],
    settings: AuditSettings,
    typical: float | None = None,
) -> Float[Array, " N"]:
    """Weight of each step for training.

        w_n = P(expert_m),                                where reliability_m >= full_weight_reliability * typical
        w_n = P(expert_m) P(step n is an expert's),       elsewhere

    `step_proba` is P(the step is an expert's), empty where steps are not kept, and then so are the weights; `typical`
    is the reliability of a typical expert, by default `typical_reliability`.
    """
    if not len(step_proba):
        return step_proba
    if typical is None:
        typical = typical_reliability(reliability, expert_proba, lengths)
    has_full_weight = np.repeat(reliability >= settings.full_weight_reliability * typical, lengths)
    return np.asarray(np.repeat(expert_proba, lengths) * np.where(has_full_weight, 1.0, step_proba))


def is_anyone_trusted(expert_proba: Float[Array, " M"], lengths: Int[Array, " M"]) -> bool:
    """Whether at least one step is expected to be in an expert's demonstration: sum_m P(expert_m) N_m >= 1.

    Where this is false no demonstration is trusted, and policies learn from single steps instead.
    """
    return bool(expert_proba @ lengths >= 1.0)


def typical_reliability(
    reliability: Float[Array, " M"], expert_proba: Float[Array, " M"], lengths: Int[Array, " M"]
) -> float:
    """Median reliability, weighted by P(expert), or 1 where no demonstration is trusted."""
    if not is_anyone_trusted(expert_proba, lengths):
        return 1.0
    order = np.argsort(reliability)
    return float(reliability[order][np.searchsorted(np.cumsum(expert_proba[order]), 0.5 * expert_proba.sum())])
