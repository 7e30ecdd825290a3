"""The part of the demonstrations that a learner trusts: the larger of two that each have a policy of their own.

An audit must not act where nobody knows which group is good. A learner assumes more: experts are the largest part that
agrees. The parts are those of the paper's mixture (eq. 7, 9) whose adversary has a policy of its own, with held-out
policies and every demonstration on one side: a demonstration goes to the part whose policy explains it better, until
none changes sides; the best of several starts counts, if two policies explain the demonstrations better than one does
by `min_gain`, and one of them gains more than `min_rule`. Of the parts

    one without a rule is not trusted, whatever its size:  its policy gains at most `max_noise` times that of the other
    of two with rules the one is trusted that is the experts', by its size and the `prior`, by P > `max_tie`;  else all

and all are where the first step of a demonstration tells its part: then parts are situations, and no rules of people.
A gain is in nats a step above the actions of the part whatever the state, as in `rpil.inference.outliers`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import betaln, expit, logit, logsumexp

from rpil.data.fit_data import FitData
from rpil.inference.held_out import HeldOutModel, held_out_model
from rpil.inference.outliers import own_gain
from rpil.inference.scores import Scores
from rpil.inference.settings import JudgeSettings, PartSettings
from rpil.numerics.regression import mean_ranks
from rpil.numerics.types import Array, Bool, Float


def two_parts(data: FitData, scores: Scores, outlier: Bool[Array, " M"], settings: JudgeSettings) -> Float[Array, " M"]:
    """1 for members of the part that is trusted, -1 for the others; 1/2 and -1/2 where only answers can tell the parts
    apart, and 0 where there are none. Starts come from the judge's `scores` and outliers, which are the other part
    where there is no better one."""
    limits, ridge = settings.parts, scores.fit.ridge or settings.held_out.ridges[-1]  # a user's policy has none
    data = thinned(data, limits.max_steps)
    of_parts = replace(settings.held_out, max_left_out=0, tol=limits.tol)
    models = [model := held_out_model(data, of_parts), replace(model)]  # one for each part: fits begin at its last ones
    together = models[0].evaluate(np.ones(len(data.actions)), ridge).mean()
    place = np.argsort(np.argsort(scores.log_odds, kind="stable")) / data.n_demonstrations
    starts = [scores.fit.group, place >= 1 / 2, place >= 1 / 5, ~outlier]
    found = [divide(data, models, start, ridge, limits) for start in starts]
    best = max((each for each in found if each is not None), key=lambda each: each[1], default=None)
    without = np.where(outlier, -1.0, 1.0) if outlier.any() else np.zeros(data.n_demonstrations)
    if best is None:
        return without
    part, explained = best
    groups = zip(models, (part, ~part), strict=True)
    own = [own_gain(group, data, model, ridge, settings.held_out) for model, group in groups]
    if max(own) <= limits.min_rule or explained - together <= limits.min_gain * max(own):
        return without
    is_noise = min(own) <= limits.max_noise * max(own)
    proba = float(own[0] > own[1]) if is_noise else p_experts(int(part.sum()), int((~part).sum()), limits.prior)
    proba = 0.5 if are_situations(data, part) and not is_noise else proba
    return np.where(part, 1.0, -1.0) * (1.0 if proba > limits.max_tie else -1.0 if 1 - proba > limits.max_tie else 0.5)


def p_experts(n: int, m: int, prior: float | tuple[float, float] | None) -> float:
    """P(experts) of a part of `n` beside `m` others; (n + 1) / (n + m + 2) where the prior says nothing of sizes."""
    if prior is not None and np.ndim(prior) == 0 and prior != 0.5:
        return float(expit((n - m) * logit(prior)))
    a, b = prior if isinstance(prior, tuple) and prior[0] != prior[1] else (2.0, 1.0)
    return float(expit(betaln(a + n, b + m) - betaln(a + m, b + n)))


def are_situations(data: FitData, part: Bool[Array, " M"]) -> bool:
    """Whether first steps, by a linear rule that leaves each one out, order more than .85 of the pairs of a member of
    `part` and another one, and by three standard deviations of chance more than half."""
    first, n = data.features[data.offsets[:-1]].astype(float), len(part)
    z = (first - first.mean(axis=0)) / (first.std(axis=0) + 1e-9)
    aim, half = part - part.mean(), np.linalg.solve(z.T @ z + n * np.eye(z.shape[1]), z.T)
    own = np.einsum("nf,fn->n", z, half)  # the diagonal of the hat matrix
    place = mean_ranks((z @ (half @ aim) - own * aim) / (1 - own))
    n_pairs = part.sum() * (~part).sum()
    excess = (place[part].sum() - part.sum() * (part.sum() + 1) / 2) / n_pairs - 0.5
    return bool(excess > max(0.35, 3 * np.sqrt((n + 1) / (12 * n_pairs))))


def divide(
    data: FitData,
    models: Sequence[HeldOutModel],
    part: Bool[Array, " M"],
    ridge: float,
    settings: PartSettings,
) -> tuple[Bool[Array, " M"], float] | None:
    """The part that `part` ends in, and the mean log-likelihood of a step, nats; None where one is nearly empty."""
    seen = set[bytes]()
    while len(seen) < settings.max_iter and part.tobytes() not in seen:
        if min(part.sum(), (~part).sum()) < 2:
            return None
        seen.add(part.tobytes())
        weights = (data.per_step(group.astype(float)) for group in (part, ~part))
        fits = (model.evaluate(weight, ridge) for model, weight in zip(models, weights, strict=True))
        first, second = map(data.mean_steps, fits)
        part, last = first >= second, part
    log_joint = np.log([[last.mean()], [1 - last.mean()]]) + np.stack([first, second]) * data.lengths
    return last, float(logsumexp(log_joint, axis=0).sum() / data.lengths.sum())


def thinned(data: FitData, max_steps: int) -> FitData:
    """Every k-th step of each demonstration, with about `max_steps` at most."""
    k = -(-len(data.actions) // max_steps)
    if k < 2:
        return data
    rows = np.flatnonzero((np.arange(len(data.actions)) - np.repeat(data.offsets[:-1], data.lengths)) % k == 0)
    offsets = np.concatenate([[0], np.cumsum(-(-data.lengths // k))])
    return replace(data, features=data.features[rows], actions=data.actions[rows], offsets=offsets)
