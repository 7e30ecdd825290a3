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
from rpil.data.demonstrations import Demonstrations, DemonstrationSet
from rpil.data.errors import DataError
from rpil.formats import read
from rpil.formats.format import Frame
from rpil.numerics.types import Array

ROWS = "rows"
"""The constructor parameter `groups` of an estimator for which each row is a demonstration."""

Given = Demonstrations | Frame | list[object] | Iterator[object]
"""Demonstrations, or what they are read from: a data frame, or trajectories."""


def see(estimator: BaseEstimator, X: DemonstrationSet) -> None:
    """Keep the names of the observations."""
    estimator.n_features_in_, estimator.observation_names_ = X.n_observations, X.observation_names


def checked_rows(estimator: BaseEstimator, X: ArrayLike) -> Array:
    """X checked by scikit-learn, (N, D).

    In a rollout a policy predicts a few rows thousands of times, and the check takes longer than the prediction. So an
    array that plainly passes is returned unchecked; the check returns it unchanged as well.
    """
    passes = (
        type(X) is np.ndarray
        and X.dtype in (np.float32, np.float64)
        and X.shape[1:] == (estimator.n_features_in_,)
        and len(X) > 0
        and not hasattr(estimator, "feature_names_in_")  # the check warns if it is missing from X
        and np.isfinite(X).all()
    )
    return X if passes else validate_data(estimator, X, reset=False)  # type: ignore[return-value]


def as_demonstrations(
    estimator: BaseEstimator,
    X: ArrayLike | Given,
    y: ArrayLike | None,
    groups: ArrayLike | None = None,
) -> Demonstrations:
    """`Demonstrations` from observations (N, D), actions and groups (N,), a data frame or a list of trajectories.

    Every row is one only where the estimator has the parameter ``groups="rows"``; else a `DataError` without groups.
    """
    if y is None and isinstance(X, Frame | list | Iterator):
        X = read(X)
    if isinstance(X, Demonstrations):
        see(estimator, X)
        return X
    estimator.observation_names_, given = (), np.asarray(y)
    are_numbers = given.ndim == 2 and given.dtype.kind == "f"
    observations, actions = cast(tuple[Array, Array], validate_data(estimator, X, y, multi_output=are_numbers))
    if actions.ndim == 1 and actions.dtype.kind == "f" and not are_whole(actions):
        raise DataError("Unknown label type: continuous; give continuous actions as columns, (N, 1) where it is one.")
    if actions.dtype.kind not in "fc":
        check_classification_targets(actions)
    if groups is None:
        groups = _a_group_for_each_row(estimator, len(observations))
    # Targets (N,) are classes to scikit-learn, however many they are; (N, A) are not.
    kind: ActionKind = "discrete" if actions.ndim == 1 else "continuous"
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
