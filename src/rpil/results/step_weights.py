"""Weights of steps for training a policy: those for any training, and those of the learner, `RPIL`.

For any training they are 1 until two answers contrast, one good or better and one bad or worse; then P(good) of the
demonstration, times what makes their mean over all steps 1. With a named adversary they are P(expert). Those of the
learner, 1 or 0, say who is of the part that it trusts (`rpil.inference.two_parts`), also where labels and pairs call
one part good and the other bad; where answers predict others in another way, they are P(good). A label, or a flag of 0,
decides about its own demonstration. Rows that an answer calls bad weigh 0, and the others more, so that the mean stays.
In all, where a person took over from a policy, weights move within a demonstration of weight W_m, with z_n = 1 in the
steps of the person, -1 just before, else 0, and b_m such that their mean stays W_m:

    w_n = 2 W_m sigmoid(2 z_n + b_m)
"""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from rpil.numerics.types import Array, Bool, Float, Int
from rpil.results.judged import Judged

OF_TAKEOVER = 2.0
"""Log-odds by which a step of a person weighs more, and one just before less; chosen by benchmarks/sequences.py."""

_BISECTIONS = 30
"""Halvings of an interval of 4 nats: to 4e-9 nats."""


def weights_of(audit: Judged) -> Float[Array, " N"]:
    """The weights of the steps of an audit; empty where steps are not kept."""
    if not len(audit.step_log_ratio):
        return audit.step_log_ratio
    weight = np.repeat(of_demonstrations(audit), audit.lengths)
    if audit.taken_over is not None:
        told = np.repeat(np.maximum.reduceat(np.abs(audit.taken_over), audit.offsets[:-1]) > 0, audit.lengths)
        weight = np.where(told, 2 * weight * balanced(OF_TAKEOVER * audit.taken_over, audit.lengths), weight)
    return without_bad_rows(audit, weight)


def without_bad_rows(audit: Judged, weight: Float[Array, " N"]) -> Float[Array, " N"]:
    """The weights, 0 in rows that were called bad, and the others such that the mean stays."""
    if not len(audit.answers.marks) or not len(weight):
        return weight
    kept = np.where(audit.answers.bad_rows(audit.offsets), 0.0, weight)
    return kept * (weight.mean() / kept.mean()) if kept.any() else kept


def balanced(log_odds: Float[Array, " N"], lengths: Int[Array, " M"]) -> Float[Array, " N"]:
    """sigmoid(`log_odds` + b_m), with b_m by bisection such that its mean over each demonstration is 1/2."""
    first = np.cumsum(lengths) - lengths
    low, high = -np.maximum.reduceat(log_odds, first), -np.minimum.reduceat(log_odds, first)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        mean = np.add.reduceat(expit(log_odds + np.repeat(middle, lengths)), first) / lengths
        low, high = np.where(mean < 0.5, middle, low), np.where(mean < 0.5, high, middle)
    return np.asarray(expit(log_odds + np.repeat((low + high) / 2, lengths)))


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


def of_demonstrations(audit: Judged) -> Float[Array, " M"]:
    """The weight W_m of each demonstration."""
    proba, once = audit.expert_proba, audit.answers.once(audit.copy_of)
    if audit.anchor == "named adversary":
        return proba
    if not audit.settings.weighs_for_learner:
        acts = audit.anchor == "answers" and once.contrast
        return proba / np.average(proba, weights=audit.lengths) if acts else np.ones(len(proba))
    said, verdicts = audit.answers.shared(audit.copy_of).said(audit.log_odds), np.array(audit.verdicts)
    side, known, (better, worse) = np.zeros(len(proba)), audit.answers, audit.answers.pairs.T
    good, bad = np.append(np.flatnonzero(known.labels > 0), better), np.append(np.flatnonzero(known.labels < 0), worse)
    task = np.zeros(len(proba)) if audit.task_of is None else audit.task_of  # each has parts of its own
    for number in np.intersect1d(task[good], task[bad]) if once.contrast else ():
        # 1 where labels and pairs call the part good that the learner trusts without them, -1 where the other one.
        votes = {*np.sign(audit.part[good[task[good] == number]]), *np.sign(-audit.part[bad[task[bad] == number]])}
        side[task == number] = votes.pop() if len(votes) == 1 else 0
    trusted = np.where(side, audit.part * side > 0, audit.part > -1)
    weight = np.where(said == 0, trusted, said > 0).astype(float)
    if once.contrast and np.isin(verdicts[said == 0], ["good", "bad"]).any():
        weight = np.where(side, weight, proba)
    return weight if weight.any() else proba
