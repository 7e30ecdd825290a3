"""The arguments of `fit` and `predict`: scikit-learn's X, y and groups, or `Demonstrations`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import validate_data

from rpil.data.arrays import ActionKind, are_whole
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.formats import read
from rpil.formats.arrow import Frame
from rpil.numerics.types import Array

ROWS = "rows"
"""The constructor parameter `groups` of an estimator for which each row is a demonstration."""

Given = Demonstrations | Frame | list[object] | Iterator[object]
"""Demonstrations, or what they are read from: a data frame, or trajectories."""


def as_given(X: ArrayLike | Given, y: ArrayLike | None) -> ArrayLike | Demonstrations:
    """`X`; read as `Demonstrations` where it comes without actions and is a data frame, or a list of trajectories."""
    if y is None and isinstance(X, Frame | list | Iterator):
        return read(X)
    return cast("ArrayLike | Demonstrations", X)


def observations_and_actions(
    estimator: BaseEstimator, X: ArrayLike | Given, y: ArrayLike | None, reset: bool = True
) -> tuple[Array, Array]:
    """Observations and actions: X and y checked by scikit-learn, or those of demonstrations."""
    X = as_given(X, y)
    if isinstance(X, Demonstrations):
        if reset:
            estimator.n_features_in_ = X.n_observations
            estimator.observation_names_ = X.observation_names
        elif estimator.n_features_in_ != X.n_observations:
            raise DataError(f"{X.source}: {X.n_observations} observations, but {estimator.n_features_in_} were fitted.")
        return X.observations, X.actions
    if reset:
        estimator.observation_names_ = ()
    given = np.asarray(y)
    checked: tuple[Array, Array] = validate_data(
        estimator, X, y, reset=reset, multi_output=given.ndim == 2 and given.dtype.kind == "f"
    )
    if checked[1].ndim == 1 and checked[1].dtype.kind == "f" and not are_whole(checked[1]):
        raise DataError("Unknown label type: continuous; give continuous actions as columns, (N, 1) where it is one.")
    return checked


def checked_rows(estimator: BaseEstimator, X: ArrayLike) -> Array:
    """X checked by scikit-learn, (N, D).

    In a rollout a policy predicts a few rows thousands of times, and the check takes longer than the prediction. So an
    array that plainly passes is returned unchecked; the check returns it unchanged as well.
    """
    passes = (
        type(X) is np.ndarray
        and X.dtype in (np.float32, np.float64)
        and X.ndim == 2
        and X.shape[1] == estimator.n_features_in_
        and len(X) > 0
        and not hasattr(estimator, "feature_names_in_")  # the check warns if it is missing from X
        and np.isfinite(X).all()
    )
    return X if passes else validate_data(estimator, X, reset=False)  # type: ignore[return-value]


def as_demonstrations(
    estimator: BaseEstimator,
    X: ArrayLike | Given,
    y: ArrayLike | None,
    groups: ArrayLike | None,
    reset: bool = True,
) -> Demonstrations:
    """`Demonstrations` from observations (N, D), actions and groups (N,).

    Every row is one only where the estimator has the parameter ``groups="rows"``; else a `DataError` without groups.
    """
    X = as_given(X, y)
    observations, actions = observations_and_actions(estimator, X, y, reset)
    if isinstance(X, Demonstrations):
        return X
    if np.asarray(actions).dtype.kind not in "fc":
        check_classification_targets(actions)
    if groups is None:
        groups = _a_group_for_each_row(estimator, len(observations))
    kind = _kind_of_targets(actions)
    return Demonstrations.from_groups(observations, actions, groups, action_kind=kind)


def _a_group_for_each_row(estimator: BaseEstimator, n_rows: int) -> Array:
    """The number of each row, where the estimator was told that every row is a demonstration; else a `DataError`."""
    given, name = estimator.groups, type(estimator).__name__
    if given not in (None, ROWS):
        raise DataError(f"groups={given!r} in {name}() is unknown; leave it out, or give {ROWS!r}.")
    if given is None:
        raise DataError(
            "No groups were given, so it is not known which rows are one demonstration; pass groups=, the "
            "demonstration of each row (in cross-validation by metadata routing, "
            f"{name}().set_fit_request(groups=True)), or "
            f"{name}(groups={ROWS!r}) where each row is one."
        )
    return np.arange(n_rows)


def one_step_each(observations: Array, actions: Array) -> Demonstrations:
    """Every row (N, D) a demonstration of its own, the actions as scikit-learn takes them."""
    offsets = np.arange(len(observations) + 1)
    return Demonstrations(observations, actions, offsets, action_kind=_kind_of_targets(actions))


def _kind_of_targets(y: Array) -> ActionKind:
    """Targets (N,) are classes to scikit-learn, however many they are; (N, A) are not."""
    return "discrete" if y.ndim == 1 else "continuous"
