"""Behavioural cloning, the base class of estimators with a policy, and the arguments of their `fit` and `predict`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.metrics import accuracy_score, r2_score
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data
from threadpoolctl import threadpool_limits

from rpil.data.arrays import ActionKind, are_whole
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.fit_data import FitData
from rpil.data.spaces import Space, action_space, encode_actions
from rpil.formats import read
from rpil.formats.format import Frame
from rpil.numerics.types import Array
from rpil.policies.features import FeatureMap, ridge_of
from rpil.policies.linear import LinearPolicy, linear_policy
from rpil.policies.selection import FeatureChoice, choose_features
from rpil.policies.settings import SelectionSettings

if TYPE_CHECKING:
    from rpil.estimators.task import Features, FinalPolicy


SINGLE_PRECISION_ENTRIES = 1_000_000
"""Entries of a design matrix above which it is in single precision: it no longer fits in the cache."""

_SINGLE_PRECISION_TOL = 1e-6


@dataclass(frozen=True)
class LinearPolicySpec:
    """A linear policy and how far to fit it."""

    features: str
    """A kind of features, or "auto"."""
    C: float | None
    """Inverse ridge strength, as in scikit-learn's `LogisticRegression`."""
    tol: float
    """Largest entry of the gradient, a step, at which the fit stops."""
    selection: SelectionSettings
    min_feature_weight: float = 0.0
    """See `rpil.estimators.pipeline.Settings`."""

    def choice(self, data: Demonstrations, codes: Array, weight: Array, space: Space) -> FeatureChoice:
        """The features: those asked for, or chosen by held-out steps of `weight` (N,)."""
        if self.features != "auto":
            return FeatureChoice(self.features, self.selection.maps.ridge_per_step)
        return choose_features(FitData(data.observations, codes, data.offsets, space), weight, self.C, self.selection)

    def feature_map(self, choice: FeatureChoice, observations: Array, weight: Array) -> FeatureMap:
        """The features of the `choice`, fitted to the observations of the trusted steps."""
        trusted = weight > self.min_feature_weight * min(weight.max(), 1.0)
        rows, used = observations[trusted], weight[trusted]
        return FeatureMap.fit(choice.kind, rows, used, choice.ridge, settings=self.selection.maps)

    def fit(self, data: Demonstrations, codes: Array, weight: Array, space: Space) -> tuple[FeatureMap, LinearPolicy]:
        """The feature map, and the policy fitted to all steps by their `weight` (N,)."""
        choice = self.choice(data, codes, weight, space)
        features = self.feature_map(choice, data.observations, weight)
        used = weight > 0.0
        single = bool(used.sum() * features.n_columns > SINGLE_PRECISION_ENTRIES)
        steps = FitData.from_steps(features.design(data.observations[used], single=single), codes[used], space)
        start = linear_policy(space, ridge_of(features, self.C, weight.sum(), space), weight.sum())
        policy, _ = start.fit(steps, weight[used], tol=max(self.tol, _SINGLE_PRECISION_TOL) if single else self.tol)
        return features, policy.with_temperature(choice.temperature)


ROWS = "rows"
"""The constructor parameter `groups` of an estimator for which each row is a demonstration."""

Given = Demonstrations | Frame | Sequence[object] | Iterator[object]
"""Demonstrations, or what they are read from: a data frame, or trajectories."""


def as_demonstrations(
    estimator: BaseEstimator, X: ArrayLike | Given, y: ArrayLike | None, groups: ArrayLike | None = None
) -> Demonstrations:
    """`Demonstrations` from observations (N, D), actions and groups (N,), a data frame or a list of trajectories.

    Every row is one only where the estimator has the parameter ``groups="rows"``; else a `DataError` without groups.
    """
    if isinstance(X, str | os.PathLike):
        raise DataError(f"{os.fspath(X)}: fit takes no path; give rpil.read(PATH), or RPIL rpil.open(PATH).")
    if y is None and isinstance(X, Frame | Sequence | Iterator):
        X = read(X)
    if isinstance(X, Demonstrations):
        estimator.n_features_in_ = X.n_observations
        return X
    given = np.asarray(y)
    are_numbers = given.ndim == 2 and (given.dtype.kind == "f" or given.shape[1] > 1)
    observations, actions = cast(tuple[Array, Array], validate_data(estimator, X, y, multi_output=are_numbers))
    if actions.ndim == 1 and actions.dtype.kind == "f" and not are_whole(actions):
        raise DataError("Unknown label type: continuous; give continuous actions as columns, (N, 1) where it is one.")
    if actions.dtype.kind not in "fc":
        check_classification_targets(actions)
    if groups is None:
        told, name = estimator.groups, type(estimator).__name__
        if told not in (None, ROWS):
            raise DataError(f"groups={told!r} in {name}() is unknown; leave it out, or give {ROWS!r}.")
        if told is None:
            unknown = "No groups were given, so it is not known which rows are one demonstration"
            routed = f"in cross-validation by metadata routing, {name}().set_fit_request(groups=True)"
            other = f"or {name}(groups={ROWS!r}) where each row is one"
            raise DataError(f"{unknown}; pass groups=, the demonstration of each row ({routed}), {other}.")
        groups = np.arange(len(observations))
    # Targets (N,) are classes to scikit-learn, however many they are; (N, A) are not.
    kind: ActionKind = "discrete" if actions.ndim == 1 else "continuous"
    return Demonstrations.from_groups(observations, actions, groups, action_kind=kind)


class PolicyEstimator(ClassifierMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """Predictions of an estimator with `space_`, `classes_`, `features_` and `policy_`."""

    space_: Space
    classes_: Array
    features_: Features
    policy_: FinalPolicy
    n_features_in_: int

    def predict(self, X: ArrayLike) -> Array:
        """The most likely action in each observation, (N,), or the mean action within the box, (N, A)."""
        outputs = self._outputs(X)
        action = self.space_.act(outputs)
        return self.classes_[action] if len(self.classes_) else action

    def predict_proba(self, X: ArrayLike) -> Array:
        """pi(k|s), (N, K), columns in the order of `classes_`.

        Raises
        ------
        DataError
            Where actions are continuous.
        """
        check_is_fitted(self)
        if not len(self.classes_):
            raise DataError("The actions are continuous, so that none has a probability; use log_prob or predict.")
        return np.exp(self._outputs(X))

    def score(self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None) -> float:
        """The share of actions that are the most likely one; R^2 for continuous actions."""
        predicted = self.predict(X)
        measure = accuracy_score if len(self.classes_) else r2_score
        return float(measure(y, predicted, sample_weight=sample_weight))

    def log_prob(self, X: ArrayLike, y: ArrayLike) -> Array:
        """log pi(a|s) of the actions y, (N,) or (N, A), taken in X, (N,): a density where they are continuous.

        Raises
        ------
        DataError
            If an action is not among `classes_`, or has another form than those of `predict`.
        """
        codes = encode_actions(self.classes_, np.asarray(y), "the steps")
        return self.policy_.log_prob(self._outputs(X), codes)

    def _outputs(self, X: ArrayLike) -> Array:
        check_is_fitted(self)
        return self.policy_.outputs(self.features_.design(cast(Array, validate_data(self, X, reset=False))))


class BehavioralCloning(PolicyEstimator):
    """Trust every demonstration alike: softmax regression of actions on observations.

    Parameters
    ----------
    features : {"raw", "folded", "nystroem", "auto"}
        Features of the observations, see `rpil.policies.features`. "auto" chooses, with the ridge, by the
        likelihood of demonstrations that are held out (of single steps, where X is not `Demonstrations`), see
        `rpil.policies.selection`.
    C : float, optional
        Inverse ridge strength as in scikit-learn's `LogisticRegression`: the fit then agrees with it; by default a
        ridge of 1e-5 a step on scaled columns, which depends neither on units nor on the amount of data.
    tol : float
        Largest gradient entry, a step, at which the solver stops.

    Attributes
    ----------
    classes_ : (K,) array
        The discrete actions; empty for continuous actions.
    space_ : Discrete or Box
        The set of possible actions.
    """

    groups = ROWS

    def __init__(self, features: str = "raw", C: float | None = None, tol: float = 1e-8) -> None:
        self.features = features
        self.C = C
        self.tol = tol

    def fit(
        self, X: ArrayLike | Demonstrations, y: ArrayLike | None = None, sample_weight: ArrayLike | None = None
    ) -> BehavioralCloning:
        """Learn from observations X (N, D) and actions y (N,), or from `Demonstrations`.

        Raises
        ------
        DataError
            Where the actions are all the same.
        """
        rows = as_demonstrations(self, X, y)
        weight = _check_sample_weight(sample_weight, rows.observations, dtype=float, ensure_non_negative=True)
        if not weight.any():
            raise DataError(f"{rows.source}: sample_weight is zero everywhere; give at least one step some weight.")
        self.space_, self.classes_ = action_space(rows)
        codes = encode_actions(self.classes_, rows.actions, rows.source)
        with threadpool_limits(1, "blas"):  # thin products gain nothing from threads, and can lose a lot
            spec = LinearPolicySpec(self.features, self.C, self.tol, SelectionSettings())
            self.features_, self.policy_ = spec.fit(rows, codes, weight, self.space_)
        return self
