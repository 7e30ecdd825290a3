"""Fitted estimators to a file and back, without pickle.

The file is an archive of `rpil.data.archive`.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
from sklearn.utils.validation import check_is_fitted

from rpil.data.archive import Decoder, encode, read_archive, write_archive
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rment import RMEnt
from rpil.estimators.rpil import RPIL
from rpil.mixture.adversaries import named  # noqa: F401  a file may hold each of them
from rpil.numerics.types import Array

SavedEstimator = RPIL | RMEnt | BehavioralCloning
ESTIMATORS: dict[str, type[SavedEstimator]] = {"RPIL": RPIL, "RMEnt": RMEnt, "BehavioralCloning": BehavioralCloning}
_POLICY = ("space_", "features_", "policy_")
_FIT = ("n_iter_", "converged_")
FITTED = {
    "BehavioralCloning": _POLICY,
    "RMEnt": (*_POLICY, "ids_", "weights_", "log_likelihood_", "objective_", *_FIT),
    "RPIL": ("space_", "state_", "features_", "policy_", "lower_bound_", *_FIT),
}
"""The attributes of each estimator that a file holds, in the order in which their sizes are compared: the state of the
mixture has other features than the policy. An audit is none, because `rpil.audit` makes it again."""

FITTED_ARRAYS = dict.fromkeys(("weights_", "log_likelihood_"), "M")


def save(estimator: SavedEstimator, path: StrPath) -> None:
    """Write a fitted estimator to a file of any name.

    `load` returns the same estimator, bit for bit, without `progress`, `engine` and ``audit_``.

    Parameters
    ----------
    estimator : RPIL, RMEnt or BehavioralCloning
    path : path

    Raises
    ------
    DataError
        If the estimator is of another class, its policy or adversary is of the user's own class, or the path cannot
        be written; an existing file then stays as it was.
    """
    kind = type(estimator).__name__
    if ESTIMATORS.get(kind) is not type(estimator):
        raise DataError(f"{path}: a {kind} cannot be saved; save one of {', '.join(ESTIMATORS)}.")
    check_is_fitted(estimator)
    arrays: dict[str, Array] = {}
    try:  # the policy first, which the message names
        fitted = {name: encode(getattr(estimator, name), name.strip("_"), arrays) for name in reversed(FITTED[kind])}
    except TypeError as error:
        remedy = "leave it out, or keep the weights of the steps (rpil audit --weights, or audit_.step_weight)"
        raise DataError(f"{path}: a {error} cannot be saved without pickle; {remedy} and fit to them again.") from None
    given, params = estimator.get_params(deep=False), dict[str, Any]()
    for name in [name for name in given if name not in ("progress", "engine")]:
        with suppress(TypeError):  # those that cannot be encoded are dropped
            params[name] = encode(given[name], f"params/{name}", arrays)
    header = {
        "class": kind,
        "names": [*getattr(estimator, "feature_names_in_", ())],
        "params": params,
        "classes": encode(estimator.classes_, "classes", arrays),
        "fitted": fitted,
    }
    write_archive(path, header, arrays)


def load(path: StrPath) -> SavedEstimator:
    """Read what `save` wrote; nothing is ever unpickled.

    Raises
    ------
    DataError
        One sentence: no such file, no saved estimator, another version of the format, or a damaged file.
    """
    header, arrays = read_archive(path)
    try:
        estimator = _restore(header, Decoder(arrays))
        with np.errstate(all="ignore"):  # used on one step, so that parts of different shapes fail here and not later
            observation, classes = np.zeros((1, estimator.n_features_in_)), estimator.classes_
            outputs = estimator.policy_.outputs(estimator.features_.design(observation))
            action = estimator.space_.act(outputs)
            sound = np.isfinite(outputs).all() and np.isfinite(action).all() and (classes[:-1] < classes[1:]).all()
            sound &= len(classes) == getattr(estimator.space_, "n", 0)
            sound &= np.isfinite(getattr(estimator.space_, "log_volume", 0.0))  # of a box: each low < high, and finite
            sound &= len(getattr(estimator, "ids_", ())) == len(getattr(estimator, "weights_", ()))
            if isinstance(estimator, RPIL):
                sound &= estimator.state_ is None or np.isfinite(estimator.state_.prior.log).all()
        if not sound:
            raise ValueError("values out of range")
    except Exception as error:  # edited values make NumPy and Python raise errors of many types
        raise DataError(f"{path}: its parts do not belong together; fit and save it again.") from error
    return estimator


def _restore(header: dict[str, Any], decoder: Decoder) -> SavedEstimator:
    kind = header["class"]
    classes = decoder.arrays.pop(header["classes"]["array"])  # of any type
    (decoder.sizes["K"],) = classes.shape
    params = {name: decoder.value(node) for name, node in header["params"].items()}
    estimator: SavedEstimator = ESTIMATORS[kind](**params)
    estimator.classes_ = classes
    if header["fitted"].keys() != set(FITTED[kind]):
        raise KeyError("fitted")
    for name in FITTED[kind]:
        node, array = header["fitted"][name], FITTED_ARRAYS.get(name)
        setattr(estimator, name, decoder.array(node, array) if array else decoder.value(node))
    estimator.n_features_in_ = decoder.sizes["D"]
    if names := header["names"]:
        if np.shape(names) != (estimator.n_features_in_,):
            raise ValueError(names)
        estimator.feature_names_in_ = np.array(names, dtype=object)
    if decoder.arrays:
        raise KeyError(f"unknown arrays {sorted(decoder.arrays)}")
    return estimator
