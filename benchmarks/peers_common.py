"""What the peers share: their task and answer, and the policy that all of them learn."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from rpil.data.coding import class_codes
from rpil.data.demonstrations import Demonstrations
from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.estimators.cloning import BehavioralCloning
from rpil.policies.features import FeatureMap, FeatureSettings
from rpil.policies.softmax import SoftmaxPolicy

Array = NDArray[Any]
N_FOLDS = 5


@dataclass(frozen=True, eq=False)
class Task:
    """The input of a method beside the demonstrations.

    Attributes
    ----------
    features : str
        Kind of features, the same for all methods of a run.
    seed : int
    prior : float
        P(expert), for the paper's recipe alone: it gives .2 for Mountain Car, .5 for Lunar Lander, .75 for Acrobot.
    n_trusted : int, optional
        How many demonstrations are good: for RM-ENT alone, which takes half of them where it is None.
    good : (M,) bool array, optional
        Which demonstrations are good: for the oracle alone.
    """

    features: str = "raw"
    seed: int = 0
    prior: float = 0.5
    n_trusted: int | None = None
    good: Array | None = None


@dataclass(frozen=True, eq=False)
class Answer:
    """The output of a method.

    Attributes
    ----------
    scores : (M,) array or None
        Higher is more trusted; None where the method does not rank.
    policy : Any or None
        Has `predict`, `predict_log_proba` and `classes_`; None where the method only ranks.
    """

    scores: Array | None
    policy: Any | None


Method = Callable[[Demonstrations, Task], Answer]


@dataclass(frozen=True, eq=False)
class Ensemble:
    """The mean of softmax policies, pi(k|s) = 1/E sum_e pi_e(k|s); often E = 1."""

    members: tuple[tuple[FeatureMap, SoftmaxPolicy], ...]
    classes_: Array

    def predict_log_proba(self, X: Array) -> Array:
        """log pi(k|s), (N, K)."""
        each = np.stack([policy.log_proba(features.design(X)) for features, policy in self.members])
        return logsumexp(each, 0) - np.log(len(each))

    def predict(self, X: Array) -> Array:
        """The most likely action, (N,)."""
        return self.classes_[self.predict_log_proba(X).argmax(axis=1)]

    def log_prob(self, X: Array, y: Array) -> Array:
        """log pi(a|s) of the actions y taken in X, (N,)."""
        return self.predict_log_proba(X)[np.arange(len(X)), np.searchsorted(self.classes_, y)]


def kind_of(data: Demonstrations, task: Task) -> str:
    """The kind of features, the same for every method; "auto" is what cloning chooses on all demonstrations."""
    return chosen_kind(data) if task.features == "auto" else task.features


@lru_cache(maxsize=1)
def chosen_kind(data: Demonstrations) -> str:
    return BehavioralCloning(features="auto").fit(data).features_.kind


def cloned(data: Demonstrations, kind: str, weight: Array | None = None) -> BehavioralCloning:
    """Our policy; `weight` (N,) may leave steps out, and their actions are still known."""
    return BehavioralCloning(features=kind).fit(data, sample_weight=weight)


def fit_data(data: Demonstrations, kind: str) -> tuple[FitData, FeatureMap, Array]:
    """The demonstrations behind a feature map, for methods with an optimiser of their own; the map; the actions."""
    classes, codes = class_codes(data.actions, data.source)
    features = FeatureMap.fit(kind, data.observations, settings=FeatureSettings())
    no_labels = np.zeros(len(data), dtype=int)
    return (
        FitData(features.design(data.observations), codes, data.offsets, Discrete(len(classes)), no_labels),
        features,
        classes,
    )


def pooled_policy(problem: FitData, ridge: Array) -> SoftmaxPolicy:
    """The policy that trusts every step."""
    return SoftmaxPolicy.zero(problem.space.n, ridge).fit(problem, np.ones(len(problem.actions)))[0]


def taken(problem: FitData, log_proba: Array) -> Array:
    """Log-probability of the action taken, (N, K) -> (N,)."""
    return np.take_along_axis(log_proba, problem.actions[:, None], axis=1)[:, 0]


def step_mean(data: Demonstrations, values: Array) -> Array:
    """Means over the steps of each demonstration, (N,) -> (M,)."""
    return np.add.reduceat(values, data.offsets[:-1]) / data.lengths


def cross_fitted(data: Demonstrations, task: Task) -> Iterator[tuple[Array, BehavioralCloning]]:
    """Folds of whole demonstrations, as steps (N,) bool, and policies cloned from the others."""
    kind = kind_of(data, task)
    folds = np.random.default_rng(task.seed).permutation(len(data)) % N_FOLDS
    for fold in range(min(N_FOLDS, len(data))):
        held_out = (folds == fold)[data.groups]
        yield held_out, cloned(data, kind, (~held_out).astype(float))
