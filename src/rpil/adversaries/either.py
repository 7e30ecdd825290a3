"""An adversary that does now this, now that."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpil.adversaries.protocol import Adversary
from rpil.passes import Array, Sums
from rpil.policies import Policy
from rpil.problem import Problem

_PSEUDO_COUNT = 1.0


@dataclass(frozen=True, eq=False)
class Either:
    """psi = share psi_1 + (1 - share) psi_2, step by step.

    One policy of its own seldom explains all adversaries: what it does not explain should not fall to the expert.

    Attributes
    ----------
    first, second : Adversary
        Of these only the first may have something to teach, or be symmetric.
    share : float
        Has the prior Beta(2, 2).
    """

    first: Any
    second: Adversary
    share: float = 0.5

    @property
    def name(self) -> str:
        return f"{self.first.name} or {self.second.name}"

    @property
    def symmetric(self) -> bool:
        return bool(self.first.symmetric)

    def with_policy(self, policy: Policy) -> Either:
        """The same, its own policy being another one."""
        return replace(self, first=self.first.with_policy(policy))

    def log_prob(self, features: Array, outputs: Array, actions: Array) -> Array:
        return np.logaddexp(*self._parts(features, outputs, actions))

    def intended(self, outputs: Array, actions: Array) -> None:
        return None

    def fit(self, problem: Problem, outputs: Array, weight: Array) -> Either:
        first = self._first(problem, outputs, weight)
        one, other = self.first.fit(problem, outputs, first), self.second.fit(problem, outputs, weight - first)
        return Either(one, other, _share(first.sum(), weight.sum()))

    def primed(self, problem: Problem, weight: Array, ridge: Array, factor: float) -> Either:
        return replace(self, first=self.first.primed(problem, self.share * weight, ridge, factor))

    def like(self, primed: Either) -> Either:
        return replace(self, first=self.first.like(primed.first))

    def statistics(self, problem: Problem, outputs: Array, weight: Array) -> Sums:
        first = self._first(problem, outputs, weight)
        one = self.first.statistics(problem, outputs, first)
        return one, self.second.statistics(problem, outputs, weight - first), first.sum(), weight.sum()

    def improved(self, statistics: Sums, radius: float = np.inf) -> Either:
        one, other, first, total = statistics
        return Either(self.first.improved(one, radius), self.second.improved(other, radius), _share(first, total))

    def log_prior(self) -> float:
        own = _PSEUDO_COUNT * (np.log(self.share) + np.log1p(-self.share))
        return float(own + self.first.log_prior() + self.second.log_prior())

    def _first(self, problem: Problem, outputs: Array, weight: Array) -> Array:
        """The part of `weight` (N,) that falls to the first."""
        one, other = self._parts(problem.features, outputs, problem.actions)
        part: Array = weight * np.exp(one - np.logaddexp(one, other))
        return part

    def _parts(self, features: Array, outputs: Array, actions: Array) -> tuple[Array, Array]:
        one, other = (part.log_prob(features, outputs, actions) for part in (self.first, self.second))
        return np.log(self.share) + one, np.log1p(-self.share) + other


def _share(first: float, total: float) -> float:
    """The mode of the posterior."""
    return float((first + _PSEUDO_COUNT) / (total + 2 * _PSEUDO_COUNT))
