"""Whether a second group of demonstrations acts alike, otherwise than the first, in the same states.

Where the scores tell two groups A and B apart, B is a rival if it has a policy of its own. Noise of any kind has none:
what it teaches explains little. Demonstrations that are simply bad often have one, but in states of their own: they
fall, give up, or never arrive. A second way of acting has a policy that explains its demonstrations about as well as
that of A explains A, and it acts where A is at home, too:

    gain_A = median over A of  mean_n [log pi_A - log q_A],     gain_B the same of B,    gain_B >= GAIN gain_A
    median over A of  mean_n [log pi_B - log q_A] <= gain_B:  a noisy version of pi_A explains A better than B
    median over A of  sum_n [log pi_A - log pi_B] >= DISTINCT,      and the same of B
    overlap = mean over the steps of B of  min(1, p(s | A) / p(s | B)) >= OVERLAP

pi_A and pi_B are policies that are taught by one of the groups, held out; q_A and q_B do not look at the state. Then
nothing tells which of the two is the expert.

Where the scores are one group, two styles may be in it. The two sides of the direction in which the demonstrations
differ most divide them at first:

    g_m = sum_n  L^-1 x_n (y_n - f(s_n))^T / sqrt(N_m),   L L^T = X^T X + ridge,   the first principal component of g

y are the actions (standardised, or one column a class), f is their ridge regression on all steps. Then every
demonstration goes to the policy that explains it better, in turn with the policies, which learn from the other group,
too, with weight SHARED. Beside DISTINCT and OVERLAP, styles need gains, by policies of their own alone, of which
neither is below GAIN times the other; they are opposed if either policy gains at most OTHERWISE times as much on the
other group as that group's own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.special import expit

from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference.held_out import Scorer, deal, fit_weighted, reference
from rpil.inference.teachers import mean_steps
from rpil.numerics.blocks import linear
from rpil.numerics.regression import normal_equations, solve_ridge, standardise
from rpil.numerics.types import Array
from rpil.policies.softmax import one_hot

GAIN = 0.45
"""Of the trusted demonstrations' gain that a rival group reaches: between what noise and what flipped or shifted
actions reached in simulated worlds."""

OTHERWISE = 0.5
"""Of a group's gain, at most what the other's policy reaches on it where two styles are opposed."""

OVERLAP = 0.6
"""Of a rival group's steps that are where the trusted are at home: between flipped actions, recorded in the same
states, and robot arms that fail."""

DISTINCT = 5.0
"""Nats, for the median demonstration of either group, by which its own group's policy explains it better than the other
group's: by chance two groups divide demonstrations of one policy by one or two."""

SHARED = 0.25
"""Weight of a step of the other group for the policy of a style: two styles act alike in most states."""

FEWEST = 2
"""Demonstrations of a group."""

ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Rival:
    """Two groups of demonstrations, each of which acts alike and differently from the other.

    Attributes
    ----------
    trusted, rival : int arrays
        Indices of the demonstrations.
    log_ratio : (N,) array
        Of every step, held out: the policy of the trusted against that of the rival group.
    opposed : bool
        Whether either policy explains little of the other group, so that only one group can be the expert's.
    """

    trusted: Array
    rival: Array
    log_ratio: Array
    opposed: bool = True


def find_rival(data: FitData, scorer: Scorer, trusted: Array, ridge: float, seed: int) -> Rival | None:
    """The group that acts alike, otherwise than the `trusted` (M,) bool, which scores told apart; None without one."""
    if not FEWEST <= trusted.sum() <= len(trusted) - FEWEST:
        return None
    explained = scorer.held_out(data.per_step(trusted.astype(float)), ridge).log_prob
    second, own = scorer.anew(), mean_steps(data, explained)
    rival = ~trusted & (own <= np.median(own[~trusted]))  # those least like the trusted
    for _ in range(ROUNDS):
        explained_rival = second.held_out(data.per_step(rival.astype(float)), ridge).log_prob
        other = mean_steps(data, explained_rival)
        closer = (other > own) & ~trusted
        if closer.sum() < FEWEST:
            return None
        if (closer == rival).all():
            break
        rival = closer
    gain, gain_rival = (
        _gain(data, log_prob, group) for log_prob, group in ((explained, trusted), (explained_rival, rival))
    )
    if gain <= 0 or gain_rival < GAIN * gain or _gain(data, explained_rival, trusted) > gain_rival:
        return None
    return _compared(data, trusted, rival, explained - explained_rival, seed)


def find_style(data: FitData, scorer: Scorer, ridge: float, seed: int) -> Rival | None:
    """The smaller of two groups that act differently where scores tell nobody apart; None without one."""
    if data.n_demonstrations < 2 * FEWEST:
        return None
    second = sides(data, ridge)
    scorers = scorer.anew(), scorer.anew()
    for _ in range(ROUNDS):
        if not FEWEST <= second.sum() <= len(second) - FEWEST:
            return None
        shared = (data.per_step(np.where(group, 1.0, SHARED)) for group in (~second, second))
        first, other = (by.held_out(weight, ridge).log_prob for by, weight in zip(scorers, shared, strict=True))
        log_ratio = first - other
        closer = data.sum_steps(log_ratio) < 0
        if (closer == second).all():
            break
        second = closer
    if 2 * second.sum() > len(second):
        second, log_ratio = ~second, -log_ratio
    found = _compared(data, ~second, second, log_ratio, seed)
    if found is None:
        return None
    alone = [scorer.anew().held_out(data.per_step(group.astype(float)), ridge).log_prob for group in (~second, second)]
    own, other = (np.array([_gain(data, alone[k], ~second), _gain(data, alone[1 - k], second)]) for k in (0, 1))
    if not own.min() > GAIN * own.max():
        return None
    return replace(found, opposed=bool((other <= OTHERWISE * own).all()))


def sides(data: FitData, ridge: float) -> Array:
    """On which side of their first principal component the demonstrations' gradients are, (M,) bool."""
    features, weight = np.asarray(data.features, dtype=float), np.ones(len(data.features))
    if not ridge:  # features of the user's policy: neither scaled nor with a constant
        features, ridge = np.column_stack([standardise(features), weight]), 1e-3
    discrete = data.space.kind == "discrete"
    n_classes = getattr(data.space, "n", 0)
    actions = one_hot(data.actions, weight, n_classes) if discrete else standardise(data.actions)
    gram, product, total = normal_equations(features, actions, weight)
    errors = actions - linear(features, solve_ridge(gram, product, total, ridge))
    if not discrete:  # as Student's errors count
        errors = errors / (1 + (errors / (errors.std(axis=0) + 1e-12)) ** 2)
    gram[np.diag_indices_from(gram)] += ridge * total
    pieces = zip(data.offsets[:-1], data.offsets[1:], strict=True)
    gradients = np.stack([features[a:b].T @ errors[a:b] for a, b in pieces], axis=1) / np.sqrt(data.lengths)[:, None]
    white = solve_triangular(cholesky(gram, lower=True), gradients.reshape(len(gram), -1), lower=True)
    white = white.reshape(gradients.shape).transpose(1, 0, 2).reshape(data.n_demonstrations, -1)
    component = np.linalg.svd(white - white.mean(axis=0), full_matrices=False)[0][:, 0]
    order = np.sort(component)
    within = [order[:k].var() * k + order[k:].var() * (len(order) - k) for k in range(1, len(order))]
    return component > order[int(np.argmin(within))]


def _gain(data: FitData, log_prob: Array, group: Array) -> float:
    """Nats a step, in the median demonstration of a `group` (M,) bool, over not looking at the state."""
    return float(np.median(mean_steps(data, log_prob - reference(data, group))[group]))


def _compared(data: FitData, trusted: Array, rival: Array, log_ratio: Array, seed: int) -> Rival | None:
    """Two groups (M,) bool as trusted and rival, if each is explained better by its own policy, in the same states."""
    nats = data.sum_steps(log_ratio)
    if min(trusted.sum(), rival.sum()) < FEWEST:
        return None
    if np.median(nats[trusted]) < DISTINCT or np.median(-nats[rival]) < DISTINCT:
        return None
    found = np.flatnonzero(trusted), np.flatnonzero(rival)
    return Rival(*found, log_ratio) if state_overlap(data, *found, seed) >= OVERLAP else None


def state_overlap(data: FitData, first: Array, second: Array, seed: int) -> float:
    """Mean over the steps of the demonstrations `second` of min(1, p(s | first) / p(s | second)), held out."""
    both = data.select(np.sort(np.concatenate([first, second])), unlabelled=True)
    is_first = both.per_step(np.isin(np.sort(np.concatenate([first, second])), first))
    columns = np.column_stack([standardise(np.asarray(both.features, dtype=float)), np.ones(len(is_first))])
    states = FitData(columns, is_first.astype(int), both.offsets, Discrete(2), both.labels)
    fold = both.per_step(deal(states, min(5, states.n_demonstrations), seed))
    ratio = np.ones(len(is_first))
    balance = np.where(is_first, 0.5 / is_first.sum(), 0.5 / (~is_first).sum()) * len(is_first)
    for k in range(int(fold.max()) + 1):
        rows = np.flatnonzero(fold != k)
        if len(np.unique(is_first[rows])) < 2:
            continue
        weights, _ = fit_weighted(states, rows, balance[rows], 1e-3)
        logits = columns[fold == k] @ weights
        proba = expit(logits[:, 1] - logits[:, 0])
        ratio[fold == k] = np.minimum(1.0, proba / np.maximum(1 - proba, 1e-12))
    return float(ratio[~is_first].mean())
