"""Policies of the groups of a sample, which judge demonstrations that were not fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference.held_out import fit_weighted, frequencies, with_lapses
from rpil.inference.parts import ActionScale
from rpil.inference.settings import HeldOutSettings
from rpil.numerics.blocks import linear, log_softmax
from rpil.numerics.regression import error_scale, medians, normal_equations, solve_ridge, student_log_densities
from rpil.numerics.types import Array, Bool, Float, Int

StepRatios = tuple[Float[Array, " N"], Float[Array, " N"]]
"""log pi and log pi - log q of each step, nats."""


@dataclass(frozen=True, eq=False)
class SoftmaxRatio:
    """log pi(a|s) - log q(a) of a softmax policy with lapses, q the frequencies of the actions."""

    weights: Float[Array, "D K"]
    frequency: Float[Array, " K"]
    """q."""
    scaling: None = None

    def step_ratios(
        self, features: Float[Array, "N D"], actions: Int[Array, " N"], settings: HeldOutSettings
    ) -> StepRatios:
        """Log-ratios of the actions taken."""
        log_proba = log_softmax(linear(features, self.weights))
        log_prob = with_lapses(log_proba, self.frequency, actions, settings.lapse)
        return log_prob, log_prob - np.log(self.frequency)[actions]


@dataclass(frozen=True, eq=False)
class StudentRatio:
    """log pi(a|s) of ridge regression with Student's errors, and log q(a) of one Student distribution for all states,
    of actions as `scaling` scales them.
    """

    weights: Float[Array, "D A"]
    scaling: ActionScale
    scale: Float[Array, " A"]
    """Scale of the errors."""
    center: Float[Array, " A"]
    width: Float[Array, " A"]
    """Location and scale of q."""

    def step_ratios(
        self, features: Float[Array, "N D"], actions: Float[Array, "N A"], settings: HeldOutSettings
    ) -> StepRatios:
        """Log-ratios of the actions taken."""
        scaled = self.scaling(actions)
        errors = scaled - linear(features, self.weights)
        log_prob = student_log_densities(errors, self.scale, settings.errors).sum(axis=1)
        log_q = student_log_densities(scaled - self.center, self.width, settings.errors).sum(axis=1)
        return log_prob, log_prob - log_q


Ratio = SoftmaxRatio | StudentRatio


def fit_ratio(data: FitData, group: Bool[Array, " M"], ridge: float, settings: HeldOutSettings) -> Ratio:
    """The ratio for the actions of the data, whose policy is fitted to a `group`, with a `ridge` a step."""
    weight = data.per_step(group.astype(float))
    if isinstance(data.space, Discrete):
        return SoftmaxRatio(fit_weighted(data, weight, ridge, settings.tol).weights, frequencies(data))
    scaling, rows = ActionScale.of(data), weight > 0
    actions = scaling(data.actions)
    weights = solve_ridge(*normal_equations(data.features[rows], actions[rows], weight[rows]), ridge)
    scale = error_scale(actions - linear(data.features, weights), weight, settings.errors)
    center = medians(actions.T)
    width = error_scale(actions - center, np.ones(len(actions)), settings.errors)
    return StudentRatio(weights, scaling, scale, center, width)
