"""Action codes, and the space of the actions, of demonstrations in memory or on disk."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.utils.multiclass import check_classification_targets

from rpil.data.arrays import LARGEST
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.formats.dataset import Dataset
from rpil.data.formats.id_values import match_labels
from rpil.data.spaces import Box, Discrete, Space
from rpil.numerics.types import Array


def code_actions(
    demonstrations: Demonstrations, box: tuple[ArrayLike, ArrayLike] | None = None
) -> tuple[Space, Array, Array]:
    """The space of the actions, the K classes where they are discrete (else none), and codes or numbers, (N, ...)."""
    actions, source = demonstrations.actions, demonstrations.source
    if demonstrations.is_discrete:
        _no_box(box, source)
        classes, codes = class_codes(actions, source)
        return Discrete(len(classes)), classes, codes
    actions = np.asarray(actions, dtype=float)
    space = _box(np.stack([actions.min(axis=0), actions.max(axis=0)]), box, source)
    outside = (actions < space.low) | (actions > space.high)
    if outside.any():
        step, part = np.argwhere(outside)[0]
        m = demonstrations.ids[demonstrations.groups[step]]
        raise _outside(f"{source}, demonstration {m!r}: action {part} is {actions[step, part]:g}", space, part)
    return space, np.empty(0), actions


def action_space(data: Dataset, box: tuple[ArrayLike, ArrayLike] | None = None) -> tuple[Space, Array]:
    """The space of the actions on disk, and the K classes where they are discrete, else none."""
    source = data.source
    if data.is_discrete:
        _no_box(box, source)
        return Discrete(len(data.classes)), class_codes(data.classes, source)[0]
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


def class_codes(actions: Array, source: str) -> tuple[Array, Array]:
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


def encode_actions(classes: Array, actions: Array, where: str) -> Array:
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


def encode_demonstrations(classes: Array, n_parts: int, demonstrations: Demonstrations) -> Array:
    """`encode_actions` of demonstrations that were not fitted."""
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
        [encode_actions(classes, actions, f"{demonstrations.source}, demonstration {m!r}") for m, (_, actions) in parts]
    )


def label_codes(labels: Mapping[Any, str] | None, demonstrations: Demonstrations | Dataset) -> Array:
    """1 for known experts, -1 for known adversaries, 0 for the rest, (M,)."""
    known = np.zeros(len(demonstrations), dtype=int)
    for m, expert in match_labels(labels or {}, demonstrations.ids).items():
        known[m] = 1 if expert else -1
    if (known < 0).all():
        raise DataError(
            f"{demonstrations.source}: all demonstrations are labelled adversary; leave one that may be an expert's."
        )
    return known
