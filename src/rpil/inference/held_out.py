"""Log-probabilities of every step under policies that did not see its demonstration.

Each scorer deals the demonstrations into folds, fits a policy to the weighted steps of the other folds, and is called
again and again with other weights: it starts each fit where the last one ended.

    softmax    log pi(a|s) = log[(1 - eps) softmax(x W)_a + eps q_a],   q the frequencies of the actions
    ridge      a_j | s ~ Student's t with 4 degrees of freedom around x w_j, independent over the parts j
    cross-fit  what a policy that cross-fits itself says (`rpil.policies.cross_fitted`)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from rpil.data.fit_data import FitData
from rpil.numerics.blocks import log_softmax
from rpil.numerics.newton import NewtonSettings, Preconditioner, fit_softmax
from rpil.numerics.parallel import in_parallel
from rpil.numerics.regression import (
    MIN_WEIGHT,
    column_scales,
    error_scale,
    normal_equations,
    solve_ridge,
    standardise,
    student_log_density,
)
from rpil.numerics.types import Array
from rpil.policies.protocol import Policy
from rpil.policies.softmax import one_hot

N_FOLDS = {"discrete": 5, "continuous": 50}
"""At most: least squares leave out one demonstration of fifty as cheaply as ten, softmax policies do not."""

LAPSE = 0.01
"""Share of its steps in which an expert may do anything, after the frequencies of the actions: bounds what one step
can cost, as Student's tails do for continuous actions."""

_LIMITS = NewtonSettings(tol=1e-3, max_iter=15, max_cg=30)
"""Of a fit that decides about trust; the policy that is returned is fitted further."""


@dataclass(frozen=True, eq=False)
class Scored:
    """What held-out policies say of N steps.

    Attributes
    ----------
    log_prob : (N,) array
        log pi(a_n|s_n), nats.
    residual : (N,) array
        log pi(a_n|s_n) - E_pi log pi(.|s_n): expectation zero where the policy is right.
    """

    log_prob: Array
    residual: Array


@runtime_checkable
class Scorer(Protocol):
    """Held-out log-probabilities for any weights of the steps."""

    @property
    def ridges(self) -> tuple[float, ...]:
        """Ridges a step to choose from, the strongest first; empty where there is nothing to choose."""

    def held_out(self, weight: Array, ridge: float) -> Scored:
        """Of every step, where the steps teach by `weight` (N,)."""

    def anew(self) -> Scorer:
        """The same scorer for other weights: its fits do not start where those of this one ended."""


RIDGES = (1e-1, 1e-2, 1e-3, 1e-4)


def deal(data: FitData, n_folds: int, seed: int) -> Array:
    """The fold of each demonstration, (M,): drawn, but the same for a demonstration wherever it stands in the data."""
    keys = data.sum_steps(np.asarray(data.features[:, :-1], dtype=float)).sum(axis=1)
    columns = standardise(np.asarray(data.actions, dtype=float).reshape(len(data.actions), -1))
    actions = data.sum_steps(columns).sum(axis=1)
    # Rounded, because sums over the same values in another order differ in their last digits.
    order = np.lexsort((np.round(keys, 6), np.round(actions, 6), data.lengths))
    fold = np.empty(len(order), dtype=int)
    fold[order] = np.random.default_rng(seed).permutation(len(order)) % n_folds
    return fold


@dataclass(eq=False)
class SoftmaxScorer:
    """Softmax policies on the design matrix of a problem with discrete actions."""

    data: FitData
    fold: Array
    ridges: tuple[float, ...] = RIDGES
    _starts: dict[int, tuple[Array, Preconditioner | None]] = field(default_factory=dict)

    def anew(self) -> SoftmaxScorer:
        return SoftmaxScorer(self.data, self.fold, self.ridges)

    def held_out(self, weight: Array, ridge: float) -> Scored:
        n_actions = self.data.space.n  # type: ignore[union-attr]
        log_proba = np.empty((len(weight), n_actions))
        of_step = self.data.per_step(self.fold)

        def one(k: int) -> None:
            start, preconditioner = self._starts.get(k, (None, None))
            teach = (of_step != k) & (weight > 0)
            fit = fit_weighted(self.data, np.flatnonzero(teach), weight[teach], ridge, start, preconditioner)
            self._starts[k] = fit
            test = of_step == k
            log_proba[test] = log_softmax(self.data.features[test] @ fit[0])

        in_parallel(one, range(int(self.fold.max()) + 1), self.data.features)
        return scored(log_proba, frequencies(self.data), self.data.actions)


def fit_weighted(
    data: FitData,
    rows: Array,
    weight: Array,
    ridge: float,
    start: Array | None = None,
    preconditioner: Preconditioner | None = None,
) -> tuple[Array, Preconditioner | None]:
    """Weights (D, K) of a softmax policy fitted to the `rows` of a problem, and its preconditioner."""
    n_actions = data.space.n  # type: ignore[union-attr]
    features = data.features[rows]
    targets = one_hot(data.actions[rows], weight, n_actions)
    penalty = np.append(np.full(features.shape[1] - 1, ridge * max(float(weight.sum()), MIN_WEIGHT)), 0.0)
    fit = fit_softmax(features, targets, penalty, _LIMITS, start=start, preconditioner=preconditioner)
    return fit.weights, fit.preconditioner


def frequencies(data: FitData) -> Array:
    """How often each action is taken, (K,), with one step of each added."""
    counts = np.bincount(data.actions, minlength=data.space.n) + 1.0  # type: ignore[union-attr]
    found: Array = counts / counts.sum()
    return found


def scored(log_proba: Array, frequency: Array, actions: Array) -> Scored:
    """`Scored` of the actions taken, where policies say `log_proba` (N, K) but lapse now and then."""
    mixed = np.logaddexp(np.log1p(-LAPSE) + log_proba, np.log(LAPSE * frequency))
    taken = np.take_along_axis(mixed, actions[:, None], axis=1)[:, 0]
    return Scored(taken, taken - np.einsum("nk,nk->n", np.exp(mixed), mixed))


@dataclass(eq=False)
class RidgeScorer:
    """Ridge regression with Student's errors, for continuous actions; actions are measured in standard deviations."""

    data: FitData
    fold: Array
    ridges: tuple[float, ...] = RIDGES

    def __post_init__(self) -> None:
        self.actions = standardise(self.data.actions)

    def anew(self) -> RidgeScorer:
        return self

    def held_out(self, weight: Array, ridge: float) -> Scored:
        errors = np.empty_like(self.actions)
        of_step = self.data.per_step(self.fold)
        tests = [of_step == k for k in range(int(self.fold.max()) + 1)]
        parts = [normal_equations(self.data.features[test], self.actions[test], weight[test]) for test in tests]
        gram, product, total = (sum(part) for part in zip(*parts, strict=True))
        for test, (own_gram, own_product, own_total) in zip(tests, parts, strict=True):
            mean = solve_ridge(gram - own_gram, product - own_product, total - own_total, ridge)
            errors[test] = self.actions[test] - self.data.features[test] @ mean
        log_prob = student_log_density(errors, error_scale(errors, weight))
        return Scored(log_prob, log_prob - np.average(log_prob, weights=np.maximum(weight, MIN_WEIGHT)))


@dataclass(eq=False)
class PolicyScorer:
    """A policy that cross-fits itself over demonstrations, such as a scikit-learn estimator."""

    data: FitData
    policy: Policy
    ridges: tuple[float, ...] = ()

    def anew(self) -> PolicyScorer:
        return self

    def held_out(self, weight: Array, ridge: float) -> Scored:
        self.policy, outputs = self.policy.fit(self.data, np.maximum(weight, MIN_WEIGHT))
        if self.data.space.kind == "discrete":
            return scored(outputs, frequencies(self.data), self.data.actions)
        log_prob = self.policy.log_prob(outputs, self.data.actions)
        log_prob = log_prob + np.log(column_scales(self.data.actions)).sum()  # in standard deviations, as all else
        return Scored(log_prob, log_prob - np.average(log_prob, weights=np.maximum(weight, MIN_WEIGHT)))


_SCORERS: dict[str, Any] = {"discrete": SoftmaxScorer, "continuous": RidgeScorer}


def scorer(data: FitData, seed: int) -> Scorer:
    """The scorer for the actions of a problem."""
    kind = data.space.kind
    found: Scorer = _SCORERS[kind](data, deal(data, min(N_FOLDS[kind], data.n_demonstrations), seed))
    return found


def reference(data: FitData, group: Array) -> Array:
    """Log-probability of every step under what the demonstrations `group` (M,) bool do whatever the state, (N,):
    frequencies of the actions, or one Student distribution."""
    weight = data.per_step(group.astype(float))
    if data.space.kind == "discrete":
        counts = np.bincount(data.actions, weight, data.space.n) + 1.0
        return np.asarray(np.log(counts / counts.sum())[data.actions])
    actions = standardise(data.actions)
    errors = actions - np.median(actions[weight > 0], axis=0)
    return student_log_density(errors, error_scale(errors, weight))
