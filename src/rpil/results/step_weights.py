"""Weights of steps for training a policy: those for any training, and those of the learner, `RPIL`.

For any training they are 1 until two answers contrast, one good or better and one bad or worse; then P(good) of the
demonstration, times what makes their mean over all steps 1. With a named adversary they are P(expert). Those of the
learner act without answers, and tell the steps of a demonstration apart by shares s_n (`rpil.inference.step_trust`):

    w_n = W_m [1 + c (2 s_n - 1)]

    without answers    W_m = P(similar), where m is an outlier;  W_m = 1, elsewhere
                       c = 1;  0 where two groups have policies of their own
    two answers        W_m = P(good),    c = mean of P(good) over the training group - mean of P(good) over the others

One answer alone changes the weight of its own demonstration. In both, where a person took over from a policy, weights
move within a demonstration, with z_n = 1 in the steps of the person, -1 just before, else 0:

    w_n = 2 W_m sigmoid(logit(w_n / 2 W_m) + 2 z_n + b_m)
"""

from __future__ import annotations

import numpy as np
from scipy.special import expit, logit

from rpil.inference.step_trust import LEAST_SHARE, balanced
from rpil.numerics.types import Array, Bool, Float, Int
from rpil.results.judged import Judged
from rpil.results.vocabulary import SIDES

TAKEOVER = 2.0
"""Log-odds by which a step of a person weighs more, and one just before less; chosen by benchmarks/sequences.py."""


def weights_of(audit: Judged) -> Float[Array, " N"]:
    """The weights of the steps of an audit."""
    mean, sign = of_demonstrations(audit)
    if audit.taken_over is None or not len(audit.step_share):
        return step_weight(audit.lengths, mean, sign, audit.step_share)
    share = step_weight(audit.lengths, np.full(len(mean), 0.5), sign, audit.step_share)
    log_odds = logit(np.clip(share, LEAST_SHARE, 1 - LEAST_SHARE)) + TAKEOVER * audit.taken_over
    told = np.repeat(np.maximum.reduceat(np.abs(audit.taken_over), audit.offsets[:-1]) > 0, audit.lengths)
    return 2 * np.repeat(mean, audit.lengths) * np.where(told, balanced(log_odds, audit.lengths), share)


def takeover_signs(
    flags: Bool[Array, " N"] | None, offsets: Int[Array, " _"], fps: float | None
) -> tuple[Float[Array, " T"], ...]:
    """z_n in each demonstration: 1 where a person had taken over, by the `flags`; -1 in the second before, or ten
    steps; else 0. Nothing where nobody took over."""
    if flags is None or not flags.any():
        return ()
    signs, begins, n_before = flags.astype(float), np.repeat(offsets[:-1], np.diff(offsets)), max(round(fps or 10), 1)
    starts = np.flatnonzero(flags & ~np.append(False, flags[:-1]))
    for n in starts[starts > begins[starts]].tolist():
        first = max(n - n_before, int(begins[n]))
        signs[first:n] = np.where(flags[first:n], 1.0, -1.0)
    return tuple(np.split(signs, offsets[1:-1]))


def step_weight(
    lengths: Int[Array, " M"], weight: Float[Array, " M"], sign: Float[Array, " M"], share: Float[Array, " N"]
) -> Float[Array, " N"]:
    """Weight of each step, from `weight` W_m and `sign` c of its demonstration, and its `share` s_n.

    Empty where steps are not kept.
    """
    if not len(share):
        return share
    return np.asarray(np.repeat(weight, lengths) * (1 + np.repeat(sign, lengths) * (2 * share - 1)))


def of_demonstrations(audit: Judged) -> tuple[Float[Array, " M"], Float[Array, " M"]]:
    """W_m and c of each demonstration; c is 0 for any training but that of the learner."""
    proba, known = audit.expert_proba, audit.answers
    if audit.anchor == "named adversary":
        return proba, np.zeros(len(proba))
    once = known.once(audit.copy_of)
    if not audit.settings.weighs_for_learner:
        mean = np.average(proba, weights=audit.lengths)
        acts = audit.anchor == "answers" and once.contrast
        return proba / mean if acts else np.ones(len(proba)), np.zeros(len(proba))
    labels = known.shared(audit.copy_of).labels
    if once.count > 1:
        groups = [proba[audit.from_actions > 0], proba[audit.from_actions <= 0]]
        sign = groups[0].mean() - groups[1].mean() if all(map(len, groups)) else 0.0
        return proba, np.full(len(proba), sign)
    is_lower = np.array([SIDES[verdict] == "lower" for verdict in audit.verdicts])
    proba = np.where(labels, proba, expit(audit.from_actions))
    weighs_less = is_lower & (audit.identifiable | (labels < 0))
    return np.where(weighs_less, proba, 1.0), np.full(len(proba), float(audit.identifiable))
