"""The linear policy of a space of actions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpil.data.archive import stored
from rpil.data.fit_data import FitData
from rpil.data.spaces import ActionSpace, Box, Discrete, Factor, Product
from rpil.numerics.types import Array, Float
from rpil.policies.protocol import Policy
from rpil.policies.softmax import SoftmaxPolicy
from rpil.policies.student import StudentPolicy

LinearPolicy = SoftmaxPolicy | StudentPolicy


@stored()
@dataclass(frozen=True, eq=False)
class ProductPolicy:
    """pi(a|s) = prod_j pi_j(a_j|s) of the classes, times pi(numbers|s, classes), where there are numbers.

    The means of the numbers are linear in the features of `Product.given`, which holds the classes of the action. So
    the outputs, before the action is looked at, are the features. Methods are those of `Policy`.
    """

    space: Product
    factors: tuple[Factor, ...]

    def outputs(self, features: Float[Array, "N D"]) -> Float[Array, "N D"]:
        return features

    def log_probas(self, outputs: Float[Array, "N D"]) -> list[Array]:
        """Log-probabilities of the classes of each part, (N, K_j)."""
        return [policy.outputs(outputs) for policy in factors_of(self)[: len(self.space.sizes)]]

    def act(self, outputs: Float[Array, "N D"]) -> Float[Array, "N A"]:
        """The most likely class of each part, as its number, and the mean of the numbers given these, in their box."""
        codes = np.stack([log_proba.argmax(axis=1) for log_proba in self.log_probas(outputs)], axis=1).astype(float)
        if self.space.numbers is None:
            return codes
        means = factors_of(self)[-1].outputs(self.space.given(outputs, codes))
        return np.hstack([codes, self.space.numbers.act(means)])

    def log_prob(self, outputs: Float[Array, "N D"], actions: Float[Array, "N A"]) -> Float[Array, " N"]:
        each = zip(factors_of(self), FitData.from_steps(outputs, actions, self.space).factors, strict=True)
        return np.asarray(sum(policy.log_prob(policy.outputs(own.features), own.actions) for policy, own in each))

    def fit(
        self, data: FitData, weight: Float[Array, " N"], soft_targets: Array | None = None, **limits: float
    ) -> tuple[ProductPolicy, Float[Array, "N D"]]:
        each = zip(factors_of(self), data.factors, strict=True)
        fitted = tuple(Factor(policy.fit(own, weight, **limits)[0]) for policy, own in each)
        return replace(self, factors=fitted), data.features

    def penalty(self) -> float:
        return float(sum(policy.penalty() for policy in factors_of(self)))

    def with_temperature(self, temperature: float) -> ProductPolicy:
        return replace(self, factors=tuple(Factor(p.with_temperature(temperature)) for p in factors_of(self)))


def linear_policy(space: ActionSpace, ridge: Float[Array, " D"], n_steps: float) -> Policy:
    """The policy before it is fitted; `n_steps` is the total weight of the steps that it will be fitted to."""
    if isinstance(space, Discrete):
        return SoftmaxPolicy.zero(space.n, ridge)
    if isinstance(space, Box):
        return StudentPolicy.zero(space, ridge, n_steps)
    policies: list[LinearPolicy] = [SoftmaxPolicy.zero(size, ridge) for size in space.sizes]
    if space.numbers is not None:
        # All classes share a constant, so that the one within a class is penalised like the other features there.
        within = np.append(ridge[:-1], ridge[:-1].mean())
        more = space.given(ridge[None], np.zeros((1, len(policies)))).shape[1] - len(ridge)
        given = np.append(np.resize(within[-(more // sum(space.sizes)) :], more), ridge)
        policies.append(StudentPolicy.zero(space.numbers, given, n_steps))
    return product_of(space, policies)


def product_of(space: ActionSpace, policies: Sequence[Policy]) -> Policy:
    """The policy of a space, of the `policies` of its factors."""
    return ProductPolicy(space, tuple(map(Factor, policies))) if isinstance(space, Product) else policies[0]


def factors_of(policy: Policy) -> list[Any]:
    """The policies of the factors of a product; of another space the policy itself."""
    return [factor.model for factor in policy.factors] if isinstance(policy, ProductPolicy) else [policy]
