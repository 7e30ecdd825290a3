"""Log-probabilities of all steps by policies that were fitted without the demonstration of the step (held out).

    discrete      log pi(a|s) = log[(1 - eps) softmax(x W)_a + eps q_a],   q the frequencies of the actions
    continuous    a_j | s ~ Student's t with 4 degrees of freedom around x w_j, independent over the parts j
    any           a policy that cross-fits itself (`rpil.policies.cross_fitted`), with the same lapses eps

Actions of continuous spaces are in robust spreads (`rpil.inference.parts`). The judge evaluates a held-out model again
and again, each time with other weights of the steps.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from hashlib import sha256
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.inference.parts import ActionScale
from rpil.inference.settings import HeldOutSettings
from rpil.numerics import regression
from rpil.numerics.blocks import at_actions, log_softmax, one_hot
from rpil.numerics.regression import MIN_WEIGHT, error_scale, normal_equations, solve_ridge, student_log_densities
from rpil.numerics.types import Array, Float, Int
from rpil.policies.folds import deal, out_of_fold

if TYPE_CHECKING:
    from rpil.numerics.newton import Preconditioner, SoftmaxFit
    from rpil.policies.cross_fitted import CrossFittedPolicy


@runtime_checkable
class HeldOutModel(Protocol):
    """A kind of policy that is fitted to weighted steps and evaluated on held-out demonstrations."""

    @property
    def ridges(self) -> tuple[float, ...]:
        """Ridges a step to choose from, the strongest first; empty where there is nothing to choose."""
        return ()

    def evaluate(self, weight: Float[Array, " N"], ridge: float) -> Float[Array, " N"]:
        """Held-out log-probabilities of all steps, by policies fitted to the steps with such weights."""


@dataclass(eq=False)
class _Linear(HeldOutModel):
    """Common part of both kinds of linear policies; `fold` (M,) is the fold of each demonstration."""

    data: FitData
    fold: Int[Array, " M"]
    settings: HeldOutSettings
    _known: dict[tuple[bytes, float], Float[Array, " N"]] = field(default_factory=dict, init=False)
    """Results of before: stages ask for the same group again."""

    @property
    def ridges(self) -> tuple[float, ...]:
        return self.settings.ridges

    def evaluate(self, weight: Float[Array, " N"], ridge: float) -> Float[Array, " N"]:
        key = sha256(weight.tobytes()).digest(), ridge
        if key not in self._known:
            self._known[key] = self._evaluate(weight, ridge)
        return self._known[key]

    def _evaluate(self, weight: Float[Array, " N"], ridge: float) -> Float[Array, " N"]:
        raise NotImplementedError


@dataclass(eq=False)
class HeldOutSoftmax(_Linear):
    """Softmax policies with lapses, for discrete actions. The fit to all folds begins at the last one, and each fit
    without a fold at that one, with its Hessian (approximate cross-validation, Rad and Maleki 2020). Each goes on until
    it has converged: after one step alone the ranks of a set correlated by .92 with those of refits."""

    _weights: Float[Array, "D K"] | None = field(default=None, init=False)

    def _evaluate(self, weight: Float[Array, " N"], ridge: float) -> Float[Array, " N"]:
        features, tol = self.data.features, self.settings.tol
        whole = fit_weighted(self.data, weight, ridge, tol, self._weights)
        self._weights = whole.weights

        def predict(_: int, test: Array) -> Array:
            fit, others = whole, np.where(test, 0.0, weight)
            if weight[test].any():
                fit = fit_weighted(self.data, others, ridge, tol, whole.weights, whole.preconditioner)
            return log_softmax(features[test] @ fit.weights)

        log_proba = out_of_fold(self.data.per_step(self.fold), predict, features)
        return with_lapses(log_proba, frequencies(self.data), self.data.actions, self.settings.lapse)


def fit_weighted(
    data: FitData,
    weight: Float[Array, " N"],
    ridge: float,
    tol: float,
    start: Float[Array, "D K"] | None = None,
    hessian: Preconditioner | None = None,
) -> SoftmaxFit:
    """A softmax policy fitted to weighted steps, with a `ridge` a step and none on the constant, from `start`."""
    from rpil.numerics.newton import NewtonSettings, fit_softmax  # which ridge regression does without

    rows = np.flatnonzero(weight > 0)
    features, weight = data.features[rows], weight[rows]
    assert isinstance(data.space, Discrete)
    targets = one_hot(data.actions[rows], weight, data.space.n)
    penalty = np.append(np.full(features.shape[1] - 1, ridge * max(float(weight.sum()), MIN_WEIGHT)), 0.0)
    return fit_softmax(features, targets, penalty, NewtonSettings(tol), start=start, preconditioner=hessian)


def frequencies(data: FitData, weight: Float[Array, " N"] | None = None) -> Float[Array, " K"]:
    """How often each discrete action is taken, with one step of each added."""
    assert isinstance(data.space, Discrete)
    counts = np.bincount(data.actions, weight, data.space.n) + 1.0
    return np.asarray(counts / counts.sum())


def with_lapses(
    log_proba: Float[Array, "N K"], frequency: Float[Array, " K"], actions: Int[Array, " N"], lapse: float
) -> Float[Array, " N"]:
    """Log-probabilities of the actions taken under (1 - lapse) pi + lapse q, with q = `frequency`."""
    taken = np.log1p(-lapse) + at_actions(log_proba, actions)
    return np.asarray(np.logaddexp(taken, np.log(lapse * frequency)[actions]))


@dataclass(eq=False)
class HeldOutRidge(_Linear):
    """Ridge regression with Student's errors, for continuous actions."""

    def __post_init__(self) -> None:
        self.actions, fold = ActionScale.of(self.data)(self.data.actions), self.data.per_step(self.fold)
        rows = (np.flatnonzero(fold == k) for k in range(int(fold.max()) + 1))
        self._folds = [(each, self.data.features[each], self.actions[each]) for each in rows]
        self._whole: dict[int, tuple[Array, Array, float]] = {}  # sums of folds all of whose steps have the weight 1

    def _evaluate(self, weight: Float[Array, " N"], ridge: float) -> Float[Array, " N"]:
        return np.asarray(log_densities(self.errors(weight, ridge), weight, self.settings).sum(axis=1))

    def errors(self, weight: Float[Array, " N"], ridge: float) -> Float[Array, "N A"]:
        """Held-out errors of the actions, scaled."""
        sums = [self._sums(k, weight[rows]) for k, (rows, _, _) in enumerate(self._folds)]
        of_all, out = [sum(terms) for terms in zip(*sums, strict=True)], np.empty(self.actions.shape)
        for (rows, features, actions), own in zip(self._folds, sums, strict=True):
            gram, product, total = (every - part for every, part in zip(of_all, own, strict=True))
            out[rows] = actions - features @ solve_ridge(gram, product, total, ridge)
        return out

    def _sums(self, k: int, weight: Float[Array, " n"]) -> tuple[Array, Array, float]:
        """The normal equations of a fold, computed once for the weight 1, which every choice begins with."""
        if not (weight == 1.0).all():
            return normal_equations(*self._folds[k][1:], weight)
        if k not in self._whole:
            self._whole[k] = normal_equations(*self._folds[k][1:], weight)
        return self._whole[k]


@dataclass(eq=False)
class HeldOutPolicy(HeldOutModel):
    """A policy that cross-fits itself over demonstrations, such as a scikit-learn estimator."""

    data: FitData
    policy: CrossFittedPolicy
    settings: HeldOutSettings

    def evaluate(self, weight: Float[Array, " N"], ridge: float) -> Float[Array, " N"]:
        self.policy, outputs = self.policy.fit(self.data, np.maximum(weight, MIN_WEIGHT))
        if isinstance(self.data.space, Discrete):
            return with_lapses(outputs, frequencies(self.data), self.data.actions, self.settings.lapse)
        log_density = self.policy.log_prob(outputs, self.data.actions)
        return np.asarray(log_density + np.log(ActionScale.of(self.data).spread).sum())


def held_out_model(data: FitData, settings: HeldOutSettings) -> HeldOutSoftmax | HeldOutRidge:
    """The linear policies for the actions of the data; the folds follow from the demonstrations, and from no seed, so
    that no word of the judge is a matter of chance."""
    n = data.n_demonstrations
    fold = deal(data, n if n <= settings.max_left_out else min(settings.max_folds, n), seed=0)
    return (HeldOutSoftmax if isinstance(data.space, Discrete) else HeldOutRidge)(data, fold, settings)


def indicators(data: FitData, scaling: ActionScale | None = None) -> Float[Array, "N J"]:
    """The actions as the policy sees them: numbers by a `scaling`, that of the data by default, or an indicator of each
    class."""
    space, actions = data.space, data.actions
    return np.eye(space.n)[actions] if isinstance(space, Discrete) else (scaling or ActionScale.of(data))(actions)


def log_densities(errors: Float[Array, "N A"], weight: Float[Array, " N"], settings: HeldOutSettings) -> Array:
    """Student's log-density of the errors of each part, with the scale of those with `weight`."""
    return student_log_densities(errors, error_scale(errors, weight, settings.errors), settings.errors)


def log_reference(data: FitData, group: Array, settings: HeldOutSettings, best: bool = False) -> Float[Array, " N"]:
    """log q(a) of each step: the distribution of the actions of a `group` (M,) bool of demonstrations, whatever the
    state. It is the frequencies of discrete actions, or one Student distribution. The `best` one has the mean and
    deviation of a part, where these explain it better than its middle: that of two values is one."""
    weight = data.per_step(group.astype(float))
    if isinstance(data.space, Discrete):
        return np.asarray(np.log(frequencies(data, weight))[data.actions])
    actions, own, errors = ActionScale.of(data)(data.actions), weight > 0, settings.errors
    each = log_densities(actions - regression.medians(actions[own].T), weight, settings)
    if best:
        mean, scale = actions[own].mean(axis=0), actions[own].std(axis=0) + errors.min_scale
        by_mean = student_log_densities(actions - mean, scale, errors)
        each = np.where(by_mean[own].mean(axis=0) > each[own].mean(axis=0), by_mean, each)
    return np.asarray(each.sum(axis=1))
