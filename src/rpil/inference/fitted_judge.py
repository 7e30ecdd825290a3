"""The judge as it is kept: a policy of the teachers, and the groups of scores, for demonstrations yet to come."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rpil.data.archive import stored
from rpil.data.fit_data import FitData
from rpil.inference.groups import Groups
from rpil.inference.held_out import fit_weighted, frequencies, scored
from rpil.numerics.blocks import linear, log_softmax
from rpil.numerics.regression import error_scale, normal_equations, solve_ridge, student_log_density
from rpil.numerics.types import Array

SHRINKAGE = 20.0
"""Steps' worth of the variance of all steps that each demonstration's own is averaged with."""


@stored(weights="F+1 K", frequency="K")
@dataclass(frozen=True, eq=False)
class SoftmaxScale:
    """log pi(a|s) of a softmax policy with lapses, and log q(a), the frequency of the action.

    Attributes
    ----------
    weights : (D, K) array
    frequency : (K,) array
    """

    weights: Array
    frequency: Array

    @classmethod
    def fit(cls, data: FitData, weight: Array, ridge: float) -> SoftmaxScale:
        """Taught by steps of `weight` (N,)."""
        rows = np.flatnonzero(weight > 0)
        return cls(fit_weighted(data, rows, weight[rows], ridge)[0], frequencies(data))

    def measure(self, features: Array, actions: Array) -> tuple[Array, Array]:
        """What each step counts for the score of its demonstration, and log pi - log q, (N,) each, nats."""
        log_prob = scored(log_softmax(linear(features, self.weights)), self.frequency, actions).log_prob
        log_ratio = log_prob - np.log(self.frequency)[actions]
        return log_ratio, log_ratio


@stored(weights="F+1 A", location="A", spread="A", scale="A", center="A", width="A")
@dataclass(frozen=True, eq=False)
class StudentScale:
    """Log-densities of ridge regression with Student's errors, and of one Student distribution for all states.

    Attributes
    ----------
    weights : (D, A) array
        For actions in standard deviations.
    location, spread : (A,) arrays
        What actions subtract and are divided by.
    scale : (A,) array
        Of the errors.
    center, width : (A,) arrays
        Of the distribution that does not look at the state.
    """

    weights: Array
    location: Array
    spread: Array
    scale: Array
    center: Array
    width: Array

    @classmethod
    def fit(cls, data: FitData, weight: Array, ridge: float) -> StudentScale:
        """Taught by steps of `weight` (N,)."""
        raw = np.asarray(data.actions, dtype=float)
        location, spread = raw.mean(axis=0), raw.std(axis=0)
        spread = np.where(spread > 0, spread, 1.0)
        actions, rows = (raw - location) / spread, weight > 0
        weights = solve_ridge(*normal_equations(data.features[rows], actions[rows], weight[rows]), ridge)
        errors = actions - linear(data.features, weights)
        center = np.median(actions, axis=0)
        width = error_scale(actions - center, np.ones(len(actions)))
        return cls(weights, location, spread, error_scale(errors, weight), center, width)

    def measure(self, features: Array, actions: Array) -> tuple[Array, Array]:
        """What each step counts for the score of its demonstration, and log pi - log q, (N,) each, nats."""
        units = (actions - self.location) / self.spread
        log_prob = student_log_density(units - linear(features, self.weights), self.scale)
        return log_prob, log_prob - student_log_density(units - self.center, self.width)


SCALES: dict[str, Any] = {"discrete": SoftmaxScale, "continuous": StudentScale}


@stored()
@dataclass(frozen=True, eq=False)
class FittedJudge:
    """What is needed to judge demonstrations that were not fitted.

    Attributes
    ----------
    scale : SoftmaxScale, StudentScale or None
        None where a policy of the user's took its place: then that policy measures.
    groups : Groups
    pooled : float
        Variance of a step's measure within a demonstration.
    independent : float
        Independent steps that one step is worth, on average.
    reference : array or None
        Without a `scale`: the frequencies of the actions, (K,), or the units of the parts of an action, (A,).
    """

    scale: Any
    groups: Groups
    pooled: float
    independent: float
    reference: Any = None

    def log_odds(self, measure: Array, offsets: Array) -> Array:
        """Log-odds of expert against adversary, (M,), of demonstrations whose steps have this `measure` (N,)."""
        lengths = np.diff(offsets)
        score = np.add.reduceat(measure, offsets[:-1]) / lengths
        squares = np.add.reduceat((measure - np.repeat(score, lengths)) ** 2, offsets[:-1])
        variance = mean_variance(squares, lengths, self.pooled, self.independent * lengths)
        return self.groups.bounded(self.groups.log_odds(score, variance))


def mean_variance(squares: Array, lengths: Array, pooled: float, effective: Array) -> Array:
    """Variance of the mean over a demonstration's steps, (M,), from its sum of `squares` (M,) around that mean."""
    own: Array = (squares + SHRINKAGE * pooled) / (lengths + SHRINKAGE)
    return own / effective
