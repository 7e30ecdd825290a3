"""Weights of steps for training a policy, from what is known of their demonstrations and of the steps themselves.

    w_n = W_m [1 + c (2 s_n - 1)]

s_n is the share of step n in its demonstration (`rpil.inference.step_trust`), whose mean over every demonstration is
1/2. So W_m is the mean weight of a step of demonstration m, and c in [-1, 1] says for which policy the steps are
evidence: 1 for that of the training group T, -1 for that of the others R, 0 where nothing says which is better.

    without answers    W_m = P(similar), where m is an outlier;  W_m = 1, elsewhere
                       c = 1;  0 where two groups have policies of their own
    two answers        W_m = P(good),    c = mean of P(good) over T - mean of P(good) over R

Where T or R has no members, c = 0. One answer alone changes the weight of its own demonstration.
"""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from rpil.numerics.types import Array, Float, Int
from rpil.results.judged import Judged
from rpil.results.vocabulary import SIDES


def weights_of(audit: Judged) -> Float[Array, " N"]:
    """The weights of the steps of an audit."""
    return step_weight(audit.lengths, *of_demonstrations(audit), audit.step_share)


def step_weight(
    lengths: Int[Array, " M"], weight: Float[Array, " M"], sign: Float[Array, " M"], share: Float[Array, " N"]
) -> Float[Array, " N"]:
    """Weight of each step, in [0, 2]: from `weight` W_m and `sign` c of its demonstration, and its `share` s_n.

    Empty where steps are not kept.
    """
    if not len(share):
        return share
    return np.asarray(np.repeat(weight, lengths) * (1 + np.repeat(sign, lengths) * (2 * share - 1)))


def of_demonstrations(audit: Judged) -> tuple[Float[Array, " M"], Float[Array, " M"]]:
    """W_m and c of each demonstration."""
    proba, known = audit.expert_proba, audit.answers
    if audit.anchor == "named adversary":
        return proba, np.zeros(len(proba))
    labels = known.shared(audit.copy_of).labels
    if known.once(audit.copy_of).count >= audit.settings.keep.min_answers:
        groups = [proba[audit.from_actions > 0], proba[audit.from_actions <= 0]]
        sign = groups[0].mean() - groups[1].mean() if all(map(len, groups)) else 0.0
        return proba, np.full(len(proba), sign)
    is_lower = np.array([SIDES[verdict] == "lower" for verdict in audit.verdicts])
    proba = np.where(labels, proba, expit(audit.from_actions))
    weighs_less = is_lower & (audit.identifiable | (labels < 0))
    return np.where(weighs_less, proba, 1.0), np.full(len(proba), float(audit.identifiable))


def why_equal(audit: Judged) -> str:
    """One sentence that says why all demonstrations have the same mean weight, within 5 %; "" where they have not."""
    mean = np.add.reduceat(audit.step_weight, audit.offsets[:-1]) / audit.lengths
    if np.ptp(mean) > 0.05 * mean.max():
        return ""
    return (
        f'all demonstrations have the same mean weight, because the finding is "{audit.finding}"; answers to the '
        "questions change that."
    )
