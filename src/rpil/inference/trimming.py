"""The training group: the demonstrations that are explained best, to which the judge fits its policy.

A policy of all demonstrations follows the majority. So the demonstrations are ranked by their mean held-out
log-likelihood of a step, the best share h of them is the next training group T, and so on:

    T <- the share h of the demonstrations with the largest  (1 / N_m) sum_n log pi_T(a_n | s_n) - monotony

This is trimmed likelihood with concentration steps (Rousseeuw and Van Driessen 1999), and the paper's robust maximum
entropy (eq. 2) with held-out likelihoods. h is `TrimmingSettings.share`. Labels are not read: they are evidence about
demonstrations (`rpil.inference.answers`), and not about what most of them do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rpil.data.fit_data import FitData
from rpil.inference.held_out import HeldOutModel
from rpil.inference.settings import TrimmingSettings
from rpil.numerics.types import Array, Bool, Float


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


def fit_group(
    data: FitData, model: HeldOutModel, group: Bool[Array, " M"], ridge: float, history: Sequence[float] = ()
) -> TrimmedFit:
    """Policies fitted to `group`, after concentration steps with this `history`."""
    log_prob = model.evaluate(data.per_step(group.astype(float)), ridge)
    return TrimmedFit(log_prob, group, ridge, np.array([*history, data.mean_steps(log_prob)[group].mean()]))


def fit_trimmed(
    data: FitData,
    model: HeldOutModel,
    ridge: float,
    settings: TrimmingSettings,
    monotony: Float[Array, " M"] | float = 0.0,
) -> TrimmedFit:
    """Policies fitted to the share of the demonstrations that is explained best, by concentration steps from all; what
    explains a demonstration counts less its `monotony` (`rpil.inference.scores`)."""
    count, every = max(2, round(settings.share * data.n_demonstrations)), np.arange(data.n_demonstrations)
    fit = fit_group(data, model, every >= 0, ridge)
    for _ in range(settings.max_iter):
        explained = data.mean_steps(fit.log_prob) - monotony
        best = np.isin(every, np.argsort(-explained, kind="stable")[:count])
        if (best == fit.group).all():
            break
        fit = fit_group(data, model, best, ridge, fit.history.tolist())
    return fit
