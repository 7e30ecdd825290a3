"""Rival groups and styles: whether a second group of demonstrations has a policy of its own, in the same states.

Where the scores tell two groups A and B apart, B is a rival of A if it has a policy of its own. Noise has none: a
policy fitted to it explains little. Demonstrations that are simply bad often have one, but in other states: they fall,
give up, or never arrive. A rival group has a policy that explains it about as well as that of A explains A, in states
that A visits, too:

    gain_A = median over A of  mean_n [log pi_A - log q_A],     gain_B the same of B,    gain_B >= min_gain gain_A
    median over A of  mean_n [log pi_B - log q_A] <= gain_B:  a noisy version of pi_A explains A better than B
    median over A of  sum_n [log pi_A - log pi_B] >= min_log_ratio,      and the same of B
    overlap = mean over the steps of B of  min(1, p(s | A) / p(s | B)) >= min_overlap

pi_A and pi_B are fitted to one of the groups, and held out; q_A and q_B are the distributions of their actions whatever
the state. Then nothing tells which of the two groups is the expert's.

Where the scores are one group, it may hold two styles. At first the demonstrations are divided along the direction in
which their gradients differ most:

    g_m = sum_n  L^-1 x_n (y_n - f(s_n))^T / sqrt(N_m),   L L^T = X^T X + ridge,   the first principal component of g

y are the actions (standardised, or one column a class), f is their ridge regression on all steps. Then in turn two
policies are fitted, each to one group and to the other with weight `shared_weight`, and every demonstration goes to the
policy that explains it better. Besides min_log_ratio and min_overlap, styles need gains, by policies of their own group
alone, of which neither is below min_gain times the other. They are opposed if either policy gains on the other group at
most max_shared_gain times as much as that group's own. All limits are `RivalSettings`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.special import expit

from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference.held_out import HeldOutModel, fit_weighted, log_reference, n_actions
from rpil.inference.settings import HeldOutSettings, JudgeSettings, RivalSettings
from rpil.numerics.blocks import linear
from rpil.numerics.regression import normal_equations, solve_ridge, standardise
from rpil.numerics.types import Array, Bool, Float, Int
from rpil.policies.folds import deal, out_of_fold
from rpil.policies.softmax import one_hot


@dataclass(frozen=True, eq=False)
class Rival:
    """Two groups of demonstrations, each with a policy of its own."""

    trusted: Int[Array, " A"]
    rival: Int[Array, " B"]
    """Indices of the demonstrations."""
    log_ratio: Float[Array, " N"]
    """Held-out log-ratio of each step: the policy of the trusted against that of the rival group. Empty where the
    policies were not compared."""
    opposed: bool = True
    """Whether only one of the groups can be the expert's, because either policy explains little of the other group."""


def find_rival(
    data: FitData, model: HeldOutModel, trusted: Bool[Array, " M"], ridge: float, settings: JudgeSettings, seed: int
) -> Rival | None:
    """The rival group of the `trusted` demonstrations, which scores told apart from the others; None without one."""
    limits = settings.rivals
    if not limits.min_group <= trusted.sum() <= len(trusted) - limits.min_group:
        return None
    log_pi = model.evaluate(data.per_step(trusted.astype(float)), ridge).log_prob
    rival_model, score = model.cold_copy(), data.mean_steps(log_pi)
    rival = ~trusted & (score <= np.median(score[~trusted]))
    for _ in range(limits.max_iter):
        log_pi_rival = rival_model.evaluate(data.per_step(rival.astype(float)), ridge).log_prob
        closer = ~trusted & (data.mean_steps(log_pi_rival) > score)
        if closer.sum() < limits.min_group:
            return None
        if (closer == rival).all():
            break
        rival = closer
    gain = partial(_gain, data, settings.held_out)
    gain_trusted, gain_rival = gain(log_pi, trusted), gain(log_pi_rival, rival)
    if gain_trusted <= 0 or gain_rival < limits.min_gain * gain_trusted or gain(log_pi_rival, trusted) > gain_rival:
        return None
    return _rival_if_distinct(data, trusted, rival, log_pi - log_pi_rival, settings, seed)


def find_style(data: FitData, model: HeldOutModel, ridge: float, settings: JudgeSettings, seed: int) -> Rival | None:
    """The smaller of two styles where the scores are one group; None without one."""
    limits = settings.rivals
    if data.n_demonstrations < 2 * limits.min_group:
        return None
    second = split_by_gradients(data, ridge, limits)
    models = model.cold_copy(), model.cold_copy()
    for _ in range(limits.max_iter):
        if not limits.min_group <= second.sum() <= len(second) - limits.min_group:
            return None
        weights = (data.per_step(np.where(group, 1.0, limits.shared_weight)) for group in (~second, second))
        log_first, log_second = (m.evaluate(weight, ridge).log_prob for m, weight in zip(models, weights, strict=True))
        log_ratio = log_first - log_second
        closer = data.sum_steps(log_ratio) < 0
        if (closer == second).all():
            break
        second = closer
    if 2 * second.sum() > len(second):
        second, log_ratio = ~second, -log_ratio
    styles = _rival_if_distinct(data, ~second, second, log_ratio, settings, seed)
    if styles is None:
        return None
    groups = ~second, second
    alone = [model.cold_copy().evaluate(data.per_step(group.astype(float)), ridge).log_prob for group in groups]
    gain = partial(_gain, data, settings.held_out)
    own, shared = (np.array([gain(alone[k], ~second), gain(alone[1 - k], second)]) for k in (0, 1))
    if not own.min() > limits.min_gain * own.max():
        return None
    return replace(styles, opposed=bool((shared <= limits.max_shared_gain * own).all()))


def split_by_gradients(data: FitData, ridge: float, settings: RivalSettings) -> Bool[Array, " M"]:
    """Two groups of demonstrations: those above and below the best cut of the first principal component of g."""
    features, ones = np.asarray(data.features, dtype=float), np.ones(len(data.features))
    if not ridge:  # columns of a user's policy are neither scaled nor followed by a constant
        features, ridge = np.column_stack([standardise(features), ones]), settings.gradient_ridge
    if isinstance(data.space, Discrete):
        actions = one_hot(data.actions, ones, n_actions(data))
    else:
        actions = standardise(data.actions)
    gram, product, total = normal_equations(features, actions, ones)
    errors = actions - linear(features, solve_ridge(gram, product, total, ridge))
    if not isinstance(data.space, Discrete):  # the score function of Student's errors
        errors = errors / (1 + (errors / (errors.std(axis=0) + 1e-12)) ** 2)
    gram[np.diag_indices_from(gram)] += ridge * total
    slices = zip(data.offsets[:-1], data.offsets[1:], strict=True)
    gradients = np.stack([features[a:b].T @ errors[a:b] for a, b in slices], axis=1) / np.sqrt(data.lengths)[:, None]
    white = solve_triangular(cholesky(gram, lower=True), gradients.reshape(len(gram), -1), lower=True)
    white = white.reshape(gradients.shape).transpose(1, 0, 2).reshape(data.n_demonstrations, -1)
    component = np.linalg.svd(white - white.mean(axis=0), full_matrices=False)[0][:, 0]
    order = np.sort(component)
    within = [order[:k].var() * k + order[k:].var() * (len(order) - k) for k in range(1, len(order))]
    return np.asarray(component > order[int(np.argmin(within))])


def _gain(data: FitData, settings: HeldOutSettings, log_prob: Array, group: Array) -> float:
    """Median over a `group` (M,) bool of the mean log-ratio against its reference, in nats a step."""
    return float(np.median(data.mean_steps(log_prob - log_reference(data, group, settings))[group]))


def _rival_if_distinct(
    data: FitData, trusted: Array, rival: Array, log_ratio: Array, settings: JudgeSettings, seed: int
) -> Rival | None:
    """Two groups (M,) bool, if each is explained better by its own policy and they are in the same states."""
    limits, nats = settings.rivals, data.sum_steps(log_ratio)
    if min(trusted.sum(), rival.sum()) < limits.min_group:
        return None
    if min(np.median(nats[trusted]), np.median(-nats[rival])) < limits.min_log_ratio:
        return None
    groups = np.flatnonzero(trusted), np.flatnonzero(rival)
    overlap = state_overlap(data, *groups, seed, limits, settings.held_out)
    return Rival(*groups, log_ratio) if overlap >= limits.min_overlap else None


def state_overlap(
    data: FitData,
    first: Int[Array, " A"],
    second: Int[Array, " B"],
    seed: int,
    settings: RivalSettings,
    held_out: HeldOutSettings,
) -> float:
    """Mean over the steps of the demonstrations `second` of min(1, p(s | first) / p(s | second)), by the held-out
    log-odds of a logistic regression that tells the steps of `first` and `second` (indices) apart."""
    indices = np.sort(np.concatenate([first, second]))
    both = data.select(indices, unlabelled=True)
    is_first = both.per_step(np.isin(indices, first))
    columns = np.column_stack([standardise(np.asarray(both.features, dtype=float)), np.ones(len(is_first))])
    states = FitData(columns, is_first.astype(int), both.offsets, Discrete(2), both.labels)
    fold = both.per_step(deal(states, min(settings.overlap_folds, states.n_demonstrations), seed))
    balance = np.where(is_first, 0.5 / is_first.sum(), 0.5 / (~is_first).sum()) * len(is_first)

    def density_ratio(_: int, test: Array) -> Array:
        train = np.flatnonzero(~test)
        if len(np.unique(is_first[train])) < 2:
            return np.ones(test.sum())
        logits = columns[test] @ fit_weighted(states, train, balance[train], settings.overlap_ridge, held_out)[0]
        proba = expit(logits[:, 1] - logits[:, 0])
        return np.asarray(np.minimum(1.0, proba / np.maximum(1 - proba, 1e-12)))

    return float(out_of_fold(fold, density_ratio)[~is_first].mean())
