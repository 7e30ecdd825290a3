"""The training group, and scores of demonstrations: means of held-out log-ratios, with their variances and groups.

A policy of all demonstrations follows the majority. So the demonstrations are ranked by their mean held-out
log-likelihood of a step, the best share h of them is the next training group T, and so on:

    T <- the share h of the demonstrations with the largest  (1 / N_m) sum_n log pi_T(a_n | s_n) - monotony

This is trimmed likelihood with concentration steps (Rousseeuw and Van Driessen 1999), and the paper's robust maximum
entropy (eq. 2) with held-out likelihoods. h is `TrimmingSettings.share`. Labels are not read: they are evidence about
demonstrations (`rpil.inference.answers`), and not about what most of them do. The scores are

    discrete      y_m = mean of log pi(a_n | s_n) - log q(a_n)
    continuous    y_m = mean of log pi(a_n | s_n), less the monotony  max(0, o_m - median of o) / 3

o_m is the mean log-density of the actions of demonstration m by their own distribution, whatever the state. To hold
still, or to do little, is easy to predict by any policy with wide errors; so actions that are easier to predict without
the state than those of most demonstrations must be explained better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rpil.data.fit_data import FitData
from rpil.inference.channels import own_log_prob
from rpil.inference.groups import Groups, fit_groups
from rpil.inference.held_out import HeldOutModel, indicators, log_reference
from rpil.inference.settings import JudgeSettings
from rpil.numerics.types import Array, Bool, Float, Int

N_BATCHES = 8  # chosen by hand, not tuned


@dataclass(frozen=True, eq=False)
class TrimmedFit:
    """Policies fitted to a training group."""

    log_prob: Float[Array, " N"]
    """Held-out log pi(a_n|s_n) of all steps, nats, under policies fitted to the training group."""
    group: Bool[Array, " M"]
    """The training group."""
    ridge: float
    """A step."""
    history: Float[Array, " T"]
    """Mean held-out log-likelihood of a demonstration of the training group after each concentration step, in nats a
    step."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of M demonstrations."""

    score: Float[Array, " M"]
    variance: Float[Array, " M"]
    """y_m, in nats a step, and its variance v_m."""
    excess: Float[Array, " M"]
    """Variance of y_m because steps depend on their neighbours (`dependence`), and because they are few
    (`fewer_steps`)."""
    groups: Groups
    step_variance: float
    """Variance of the log-ratio of a step within a demonstration, pooled over demonstrations."""
    state_predicts_action: bool
    """Whether the policies of the training group predict its held-out actions better than their frequencies do, by
    `JudgeSettings.min_gain`."""
    fit: TrimmedFit
    """The policies of the training group."""
    typical_own: float = np.inf
    """Value of the `Scoring`."""

    @property
    def log_odds(self) -> Float[Array, " M"]:
        """Log-odds of the upper group of the scores against the lower, nats, by the scores alone: the ranking."""
        return self.groups.log_odds(self.score, self.variance)


@dataclass(frozen=True, eq=False)
class Scoring:
    """How demonstrations are scored: everything that stays the same while the training group changes."""

    data: FitData
    model: HeldOutModel
    settings: JudgeSettings
    ridge: float
    """A step, chosen once (`choose_ridge`)."""
    log_q: Float[Array, " N"]
    """log q(a) of each step, the reference."""
    log_q_best: Float[Array, " N"]
    """The same of the best reference, which a policy that learned something exceeds."""
    own: Float[Array, " M"]
    """Mean log-probability of the actions of each demonstration by their own distribution, whatever the state, nats."""
    typical_own: float = np.inf
    """The median of `own`, above which it is subtracted in part; infinite where actions are discrete."""

    @classmethod
    def of(cls, data: FitData, model: HeldOutModel, settings: JudgeSettings) -> Scoring:
        """Choose the ridge by policies of all demonstrations."""
        group = np.ones(data.n_demonstrations, dtype=bool)
        log_q, best = (log_reference(data, group, settings.held_out, best) for best in (False, True))
        ridge = choose_ridge(data, model, group)
        own = own_log_prob(data, indicators(data), settings.held_out.errors)
        typical = float(np.median(own)) if data.space.has_density else np.inf
        return cls(data, model, settings, ridge, log_q, best, own, typical)

    def fit(self, group: Bool[Array, " M"], history: Sequence[float] = ()) -> TrimmedFit:
        """Policies fitted to `group`, after concentration steps with this `history`."""
        log_prob = self.model.evaluate(self.data.per_step(group.astype(float)), self.ridge)
        explained = self.data.mean_steps(log_prob)[group].mean()
        return TrimmedFit(log_prob, group, self.ridge, np.array([*history, explained]))

    def fit_trimmed(self) -> TrimmedFit:
        """Policies fitted to the share of the demonstrations that is explained best, by concentration steps from all;
        what explains a demonstration counts less its monotony."""
        every, settings = np.arange(self.data.n_demonstrations), self.settings.trimming
        count, less = max(2, round(settings.share * len(every))), monotony(self.own, self.typical_own, self.settings)
        fit = self.fit(every >= 0)
        for _ in range(settings.max_iter):
            explained = self.data.mean_steps(fit.log_prob) - less
            best = np.isin(every, np.argsort(-explained, kind="stable")[:count])
            if (best == fit.group).all():
                break
            fit = self.fit(best, fit.history.tolist())
        return fit

    def score(self, fit: TrimmedFit) -> Scores:
        """Scores of all demonstrations under policies of a training group.

        The reference of a density is uniform over the box of the actions: a constant, which is left out.
        """
        data, settings = self.data, self.settings
        log_ratio = fit.log_prob if data.space.has_density else fit.log_prob - self.log_q
        mean, squares, by_neighbours = means(data, log_ratio)
        score = mean - monotony(self.own, self.typical_own, settings)
        step_variance = float(squares.sum()) / max(len(log_ratio) - data.n_demonstrations, 1)
        variance = mean_variance(squares, data.lengths, step_variance, settings.variance_steps)
        groups = fit_groups(score, variance, data.lengths, settings.groups)
        gain = float(np.median(data.mean_steps(fit.log_prob - self.log_q_best)[fit.group]))
        entropy = 1.0 if data.space.has_density else -float(self.log_q.mean())  # the most that can be gained
        predicts = gain > settings.min_gain * min(entropy, 1.0)
        excess = by_neighbours + fewer_steps(data.lengths, step_variance)
        return Scores(score, variance, excess, groups, step_variance, predicts, fit, self.typical_own)


def choose_ridge(data: FitData, model: HeldOutModel, group: Bool[Array, " M"]) -> float:
    """The ridge, a step, with the largest median over the demonstrations of `group` of the mean held-out
    log-likelihood, under policies fitted to that group; 0 where `model` has no ridges.

    The median, because the demonstration that is explained worst would decide a mean. The search ends at the first
    ridge, from the strongest on, that explains no more.
    """
    weight = data.per_step(group.astype(float))
    best, largest = 0.0, -np.inf
    for ridge in model.ridges:
        value = float(np.median(data.mean_steps(model.evaluate(weight, ridge))[group]))
        if value <= largest:
            break
        best, largest = ridge, value
    return best


def monotony(own: Float[Array, " M"], typical_own: float, settings: JudgeSettings) -> Float[Array, " M"]:
    """The share `JudgeSettings.monotony` of how far `own` lies above the typical one."""
    return settings.monotony * np.maximum(own - typical_own, 0.0)


def means(data: FitData, log_ratio: Float[Array, " N"]) -> tuple[Array, Array, Array]:
    """The mean log-ratio of each demonstration, the sum of squares of its steps around it, and its `dependence`."""
    mean = data.mean_steps(log_ratio)
    squares = data.sum_steps((log_ratio - data.per_step(mean)) ** 2)
    return mean, squares, dependence(data, log_ratio, squares)


def dependence(data: FitData, log_ratio: Float[Array, " N"], squares: Float[Array, " M"]) -> Float[Array, " M"]:
    """Variance of the mean over the steps of each demonstration because steps depend on their neighbours: that by the
    means of `N_BATCHES` stretches (batch means; Law and Carson 1979), less that of independent steps with this sum of
    `squares` around their mean. 0 with fewer than two steps a stretch."""
    offsets, lengths = data.offsets, data.lengths
    starts = offsets[:-1, None] + lengths[:, None] * np.arange(N_BATCHES) // N_BATCHES
    sizes = np.diff(starts, append=offsets[1:, None], axis=1)
    means = np.add.reduceat(log_ratio, starts.ravel()).reshape(starts.shape) / np.maximum(sizes, 1)
    excess = means.var(axis=1, ddof=1) / N_BATCHES - squares / np.maximum(lengths * (lengths - 1), 1)
    return np.where(lengths < 2 * N_BATCHES, 0.0, np.maximum(excess, 0.0))


def fewer_steps(lengths: Int[Array, " M"], step_variance: float) -> Float[Array, " M"]:
    """Variance of the mean over the steps of each demonstration above that of one of the median length."""
    return np.asarray(step_variance * np.maximum(1 / lengths - 1 / np.median(lengths), 0.0))


def mean_variance(
    squares: Float[Array, " M"], lengths: Int[Array, " M"], step_variance: float, variance_steps: float
) -> Float[Array, " M"]:
    """Variance v_m of the mean over the steps of each demonstration,

        v_m = s_m^2 / N_m,     s_m^2 = (S_m + k s^2) / (N_m + k)

    with its sum of `squares` S_m around that mean, its N_m steps, taken as independent, and the `step_variance` s^2 of
    all demonstrations, which counts like k = `variance_steps` steps.
    """
    own: Array = (squares + variance_steps * step_variance) / (lengths + variance_steps)
    return own / lengths
