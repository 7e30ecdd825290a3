"""A rival group: whether the demonstrations that score lower have a policy of their own.

Noise has none: a policy fitted to it explains little. Let A be the upper group of the scores, and B the lower ones that
a policy fitted to B explains better than that of A. B is a rival of A if

    gain_B >= min_gain gain_A,   gain_A = median over A of  mean_n [log pi_A - log q_A],   gain_B the same of B

pi_A and pi_B are fitted to one of the groups, and held out; q_A and q_B are the distributions of their actions whatever
the state. Then two groups are described, and neither is called unlike the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.data.fit_data import FitData
from rpil.inference.held_out import HeldOutModel, log_reference
from rpil.inference.settings import HeldOutSettings, JudgeSettings
from rpil.inference.trimming import TrimmedFit
from rpil.numerics.types import Array, Bool, Float, Int


@dataclass(frozen=True, eq=False)
class Lower:
    """The demonstrations below the upper group, against those in it."""

    gain_upper: float
    """Nats a step by which the policy of the upper group explains it better than the frequencies of its actions."""
    gain_rival: float
    """The same of the rival group; minus infinity without one."""
    rival: Int[Array, " B"]
    """The lower demonstrations that their own policy explains better than that of the upper group."""
    upper: Int[Array, " A"]
    gain_all_lower: float
    """The gain of a policy of all lower demonstrations on them."""
    is_rival: bool
    """Whether the rival group has a policy of its own."""


def look_below(
    data: FitData, model: HeldOutModel, upper: Bool[Array, " M"], fit: TrimmedFit, settings: JudgeSettings
) -> Lower:
    """Look for a policy of their own among the demonstrations that are not in the `upper` group; `fit` is that of the
    scores."""
    limits, ridge, members = settings.rivals, fit.ridge, np.flatnonzero(upper)
    log_pi = fit.held_out.log_prob if (fit.group == upper).all() else _log_prob(data, model, upper, ridge)
    gain_upper = gain(data, log_pi, upper, settings.held_out)
    below, score = model.cold_copy(), data.mean_steps(log_pi)
    gain_all = gain(data, _log_prob(data, below, ~upper, ridge), ~upper, settings.held_out)
    rival = ~upper & (score <= np.median(score[~upper]))
    for _ in range(limits.max_iter):
        log_pi_rival = _log_prob(data, below, rival, ridge)
        closer = ~upper & (data.mean_steps(log_pi_rival) > score)
        if closer.sum() < limits.min_group:
            return Lower(gain_upper, -np.inf, np.flatnonzero(closer), members, gain_all, False)
        if (closer == rival).all():
            break
        rival = closer
    gain_rival = gain(data, log_pi_rival, rival, settings.held_out)
    has_policy = gain_rival > 0 and gain_rival >= limits.min_gain * gain_upper
    return Lower(gain_upper, gain_rival, np.flatnonzero(rival), members, gain_all, bool(has_policy))


def gain(data: FitData, log_prob: Float[Array, " N"], group: Bool[Array, " M"], settings: HeldOutSettings) -> float:
    """Median over a `group` of the mean log-ratio against its reference, in nats a step."""
    return float(np.median(data.mean_steps(log_prob - log_reference(data, group, settings))[group]))


def _log_prob(data: FitData, model: HeldOutModel, group: Array, ridge: float) -> Array:
    return model.evaluate(data.per_step(group.astype(float)), ridge).log_prob
