"""The fitted judge: policies of the training group and the groups of scores, which judge further demonstrations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference.channels import StateScale
from rpil.inference.groups import Groups
from rpil.inference.held_out import fit_weighted, frequencies, with_lapses
from rpil.inference.parts import ActionScale
from rpil.inference.settings import HeldOutSettings, JudgeSettings
from rpil.inference.trust import Judgement
from rpil.numerics.blocks import linear, log_softmax
from rpil.numerics.regression import error_scale, medians, normal_equations, solve_ridge, student_log_densities
from rpil.numerics.types import Array, Float, Int

StepRatios = tuple[Float[Array, " N"], Float[Array, " N"], Float[Array, " N"]]
"""Terms of each step, nats: log pi, log pi - log q, and what scores are means of."""


@dataclass(frozen=True, eq=False)
class SoftmaxRatio:
    """log pi(a|s) - log q(a) of a softmax policy with lapses, q the frequencies of the actions."""

    weights: Float[Array, "D K"]
    frequency: Float[Array, " K"]
    """q."""

    @classmethod
    def fit(cls, data: FitData, weight: Float[Array, " N"], ridge: float, settings: HeldOutSettings) -> SoftmaxRatio:
        """Fit the policy to weighted steps, with a `ridge` a step."""
        return cls(fit_weighted(data, weight, ridge, settings.tol).weights, frequencies(data))

    def step_ratios(
        self, features: Float[Array, "N D"], actions: Int[Array, " N"], settings: HeldOutSettings
    ) -> StepRatios:
        """Log-ratios of the actions taken."""
        log_proba = log_softmax(linear(features, self.weights))
        log_prob = with_lapses(log_proba, self.frequency, actions, settings.lapse)
        log_ratio = log_prob - np.log(self.frequency)[actions]
        return log_prob, log_ratio, log_ratio

    def indicators(self, actions: Int[Array, " N"]) -> Float[Array, "N K"]:
        """Indicators of the actions."""
        return np.eye(len(self.frequency))[actions]


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

    @classmethod
    def fit(cls, data: FitData, weight: Float[Array, " N"], ridge: float, settings: HeldOutSettings) -> StudentRatio:
        """Fit the policy to weighted steps, with a `ridge` a step."""
        scaling, rows = ActionScale.of(data), weight > 0
        actions = scaling(data.actions)
        weights = solve_ridge(*normal_equations(data.features[rows], actions[rows], weight[rows]), ridge)
        errors = actions - linear(data.features, weights)
        center = medians(actions.T)
        width = error_scale(actions - center, np.ones(len(actions)), settings.errors)
        scale = error_scale(errors, weight, settings.errors)
        return cls(weights, scaling, scale, center, width)

    def step_ratios(
        self, features: Float[Array, "N D"], actions: Float[Array, "N A"], settings: HeldOutSettings
    ) -> StepRatios:
        """Log-ratios of the actions taken."""
        scaled = self.scaling(actions)
        errors = scaled - linear(features, self.weights)
        log_prob = student_log_densities(errors, self.scale, settings.errors).sum(axis=1)
        log_q = student_log_densities(scaled - self.center, self.width, settings.errors).sum(axis=1)
        return log_prob, log_prob - log_q, log_prob

    def indicators(self, actions: Float[Array, "N A"]) -> Float[Array, "N J"]:
        """The actions, scaled."""
        return self.scaling(actions)


Ratio = SoftmaxRatio | StudentRatio


def fit_ratio(data: FitData, weight: Float[Array, " N"], ridge: float, settings: HeldOutSettings) -> Ratio:
    """The ratio for the actions of the data, whose policy is fitted to weighted steps, with a `ridge` a step."""
    return (SoftmaxRatio if isinstance(data.space, Discrete) else StudentRatio).fit(data, weight, ridge, settings)


@dataclass(frozen=True, eq=False)
class FittedJudge:
    """Fitted values that judge demonstrations that were not fitted."""

    ratio: Ratio
    """Gives the log-ratios of steps."""
    groups: Groups
    step_variance: float
    """Variance of the log-ratio of a step within a demonstration."""
    states: StateScale
    typical_own: float | None = None
    """See `rpil.inference.scores.Scoring`; None where actions are discrete."""

    @classmethod
    def of(cls, judgement: Judgement, data: FitData, settings: JudgeSettings) -> FittedJudge:
        """From a judgement of `data`."""
        scores, weight = judgement.scores, data.per_step(judgement.scores.fit.group.astype(float))
        ratio = fit_ratio(data, weight, scores.fit.ridge, settings.held_out)
        return cls(ratio, scores.groups, scores.step_variance, judgement.states, scores.typical_own)

    def score(
        self, data: FitData, log_ratio: Float[Array, " N"], own: Float[Array, " M"], settings: JudgeSettings
    ) -> tuple[Float[Array, " M"], Float[Array, " M"]]:
        """Scores of the demonstrations of `data`, whose steps have these log-ratios, and whose actions have the mean
        log-density `own` by their own distribution, and the sums of squares around their means."""
        mean = data.mean_steps(log_ratio)
        squares = data.sum_steps((log_ratio - data.per_step(mean)) ** 2)
        if self.typical_own is None:
            return mean, squares
        return mean - settings.monotony * np.maximum(own - self.typical_own, 0.0), squares
