"""What the estimators accept: scikit-learn's X, y, groups or `Demonstrations`; labels, priors, ridges."""

from __future__ import annotations

import warnings
from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import validate_data

from rpil._arrays import are_whole
from rpil.demonstrations import Demonstrations
from rpil.demonstrators import Company, Strangers, company
from rpil.em import Share
from rpil.errors import DataError
from rpil.features import LARGEST, FeatureMap
from rpil.formats.dataset import Dataset
from rpil.formats.labels import match_given
from rpil.formats.table import check_ids
from rpil.passes import Array
from rpil.spaces import Box, Discrete, Space


def source_of(X: Any) -> str:
    return X.source if isinstance(X, Demonstrations) else "the demonstrations"


def observations_and_actions(
    estimator: BaseEstimator, X: ArrayLike | Demonstrations, y: ArrayLike | None, reset: bool = True
) -> tuple[Array, Array]:
    """X and y as scikit-learn wants them checked, or the columns of `Demonstrations`."""
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
    """X as scikit-learn checks it, (N, D).

    A policy at play is asked for a few rows thousands of times, and the check takes longer than the answer: an array
    that is seen at a glance to pass is handed back as it is, which the check does too.
    """
    passes = (
        type(X) is np.ndarray
        and X.dtype in (np.float32, np.float64)
        and X.ndim == 2
        and X.shape[1] == estimator.n_features_in_
        and len(X) > 0
        and not hasattr(estimator, "feature_names_in_")  # of whose absence the check warns
        and np.isfinite(X).all()
    )
    return X if passes else validate_data(estimator, X, reset=False)  # type: ignore[return-value]


def as_demonstrations(
    estimator: BaseEstimator,
    X: ArrayLike | Demonstrations,
    y: ArrayLike | None,
    groups: ArrayLike | None,
    reset: bool = True,
) -> Demonstrations:
    observations, actions = observations_and_actions(estimator, X, y, reset)
    if isinstance(X, Demonstrations):
        return X
    if np.asarray(actions).dtype.kind not in "fc":
        check_classification_targets(actions)
    if groups is None:
        warnings.warn(
            "No groups: every row is taken for a demonstration of its own; pass groups=, the demonstration of each row "
            "(in cross_validate and the like that needs metadata routing: "
            f"{type(estimator).__name__}().set_fit_request(groups=True)).",
            UserWarning,
            stacklevel=3,
        )
        groups = np.arange(len(observations))
    return Demonstrations.from_groups(observations, actions, groups)


def coded_actions(
    demonstrations: Demonstrations, box: tuple[ArrayLike, ArrayLike] | None = None
) -> tuple[Space, Array, Array]:
    """The space of the actions, the K classes where they are discrete (else none), and codes or numbers, (N, ...)."""
    actions, source = demonstrations.actions, demonstrations.source
    if demonstrations.is_discrete:
        _no_box(box, source)
        classes, codes = action_codes(actions, source)
        return Discrete(len(classes)), classes, codes
    actions = np.asarray(actions, dtype=float)
    space = _box(np.stack([actions.min(axis=0), actions.max(axis=0)]), box, source)
    outside = (actions < space.low) | (actions > space.high)
    if outside.any():
        step, part = np.argwhere(outside)[0]
        m = demonstrations.ids[demonstrations.groups[step]]
        raise _outside(f"{source}, demonstration {m!r}: action {part} is {actions[step, part]:g}", space, part)
    return space, np.empty(0), actions


def known_space(data: Dataset, box: tuple[ArrayLike, ArrayLike] | None = None) -> tuple[Space, Array]:
    """The space of the actions on disk, and the K classes where they are discrete, else none."""
    source = data.source
    if data.is_discrete:
        _no_box(box, source)
        return Discrete(len(data.classes)), action_codes(data.classes, source)[0]
    span = np.stack([data.low, data.high]).astype(float)
    space = _box(span, box, source)
    outside = (span < space.low) | (span > space.high)
    if outside.any():
        end, part = np.argwhere(outside)[0]
        raise _outside(f"{source}: action {part} reaches {span[end, part]:g}", space, part)
    return space, np.empty(0)


def _no_box(box: Any, source: str) -> None:
    if box is not None:
        raise DataError(f"{source}: the actions are discrete, which no action_box fits; leave it out.")


def _outside(said: str, space: Box, part: int) -> DataError:
    declared = f"outside the declared box from {space.low[part]:g} to {space.high[part]:g}"
    return DataError(f"{said}, {declared}; widen action_box, or clip the actions.")


def _box(span: Array, box: tuple[ArrayLike, ArrayLike] | None, source: str) -> Box:
    """The box of actions that lie within `span` (2, A): as declared, or around them."""
    if (span[0] == span[1]).all():
        raise DataError(f"{source}: every action is the same; give demonstrations with two at least.")
    if np.abs(span).max() > LARGEST:
        raise DataError(f"{source}: an action is beyond {LARGEST:g}, where its square is no number; use larger units.")
    return Box.around(span) if box is None else _declared(box, span.shape[1], source)


def _declared(box: tuple[ArrayLike, ArrayLike], n_parts: int, source: str) -> Box:
    try:
        low, high = (np.broadcast_to(np.asarray(bound, dtype=float), n_parts) for bound in box)
    except (TypeError, ValueError):
        raise DataError(f"{source}: action_box={box!r}; give (low, high), numbers or one for each part.") from None
    if not (low < high).all() or not np.isfinite([low, high]).all():
        raise DataError(f"{source}: action_box={box!r} is empty or unbounded; give finite low < high.")
    return Box(low, high)


def action_codes(actions: Array, source: str) -> tuple[Array, Array]:
    """The distinct actions (K,), and the code of each step's (N,)."""
    if np.ndim(actions) != 1:
        raise DataError(f"{source}: the actions are continuous, which it is not made for; give discrete ones.")
    if np.asarray(actions).dtype.kind == "f":
        check_classification_targets(actions)
    classes, codes = np.unique(actions, return_inverse=True)
    if len(classes) < 2:
        only = repr(classes[0].item())
        raise DataError(f"{source}: every action is {only}, one class only; give demonstrations with two at least.")
    return classes, codes


def known_actions(classes: Array, actions: Array, where: str) -> Array:
    """Codes (N,) of actions among `classes` (K,); where there are no classes, continuous actions (N, A) as they are."""
    if not len(classes):
        return np.asarray(actions, dtype=float)
    are_codes = classes.dtype.kind in "iu" and classes[0] == 0 and classes[-1] == len(classes) - 1
    if are_codes and actions.dtype.kind in "iu":
        codes = actions.clip(0, len(classes) - 1)  # they are codes as they are
    else:
        codes = np.searchsorted(classes, actions).clip(max=len(classes) - 1)
    unknown = np.flatnonzero(classes[codes] != actions)
    if len(unknown):
        action, known = actions[unknown[0]].item(), ", ".join(map(str, classes))
        raise DataError(
            f"{where}: action {action!r} is not among the known ones ({known}); fit again with it, or leave it out."
        )
    return codes


def coded_like(classes: Array, n_parts: int, demonstrations: Demonstrations) -> Array:
    """`known_actions` of demonstrations that were not fitted."""
    if demonstrations.is_discrete != bool(len(classes)):
        other = "continuous" if len(classes) else "discrete"
        raise DataError(f"{demonstrations.source}: the actions are {other}, and the fitted ones were not.")
    if np.ndim(demonstrations.actions) == 2 and demonstrations.actions.shape[1] != n_parts:
        raise DataError(
            f"{demonstrations.source}: actions with {demonstrations.actions.shape[1]} numbers each, but {n_parts} were "
            "fitted; give the same ones."
        )
    parts = zip(demonstrations.ids, demonstrations, strict=True)
    return np.concatenate(
        [known_actions(classes, actions, f"{demonstrations.source}, demonstration {m!r}") for m, (_, actions) in parts]
    )


def known_labels(labels: Mapping[Any, str] | None, demonstrations: Demonstrations | Dataset) -> Array:
    """1 for known experts, -1 for known adversaries, 0 for the rest, (M,)."""
    known = np.zeros(len(demonstrations), dtype=int)
    for m, expert in match_given(labels or {}, demonstrations.ids).items():
        known[m] = 1 if expert else -1
    if (known < 0).all():
        raise DataError(
            f"{demonstrations.source}: all demonstrations are labelled adversary; leave one that may be an expert's."
        )
    return known


def who_gave(
    demonstrators: Mapping[Any, Any] | Sequence[Any] | Array | None, demonstrations: Demonstrations | Dataset
) -> Company:
    """Who gave each demonstration; a warning where that tells nothing."""
    source, ids = demonstrations.source, demonstrations.ids
    if demonstrators is None:
        return Strangers()
    names: list[Any]
    if isinstance(demonstrators, Mapping):
        known = {str(name): who for name, who in demonstrators.items()}
        check_ids(known, ids, source, "the demonstrators")
        names = [known.get(str(m)) for m in ids]
    else:
        names = np.asarray(demonstrators).tolist() if np.ndim(demonstrators) == 1 else []
        if len(names) != len(ids):
            raise DataError(
                f"{source}: demonstrators has the shape {np.shape(demonstrators)}; give one for each of the {len(ids)} "
                "demonstrations, in their order."
            )
    for m, who in zip(ids, names, strict=True):
        if not isinstance(who, Hashable):
            raise DataError(
                f"{source}, demonstration {m!r}: the demonstrator {who!r} is no name; give text or a number."
            )
    found = company(names)
    if isinstance(found, Strangers):
        warnings.warn(f"{source}: {found.said}", UserWarning, stacklevel=3)
    return found


def as_prior(prior: float | tuple[float, float] | None) -> Share:
    """P(expert): fixed, or estimated under Beta(a, b); None is Beta(2, 2)."""
    if prior is None:
        return Share()
    if np.ndim(prior) == 0:
        if not 0 < float(prior) < 1:  # type: ignore[arg-type]
            raise DataError(f"The prior {prior!r} is no probability between 0 and 1.")
        return Share(float(prior), fixed=True)  # type: ignore[arg-type]
    a, b = (float(value) for value in prior)  # type: ignore[union-attr]
    if a < 1 or b < 1:
        raise DataError(f"The Beta prior ({a}, {b}) has no single mode; give both numbers as 1 or more.")
    return Share((a / (a + b)), a, b)


def ridge_of(features: FeatureMap, C: float | None, total_weight: float, space: Space) -> Array:
    """Penalty on each column: with two actions scikit-learn penalises the difference of the two columns once, which is
    twice the penalty on each."""
    if C is not None and not C > 0:
        raise DataError(f"C={C!r} must be a positive number.")
    ridge = features.ridge(C, total_weight)
    return 2.0 * ridge if C is not None and space == Discrete(2) else ridge
