"""Conversion of columns of any type to the array types that the library computes with, or one `DataError`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from rpil.data.errors import DataError
from rpil.numerics.types import Array, Bool

Id = int | str
"""Ids of demonstrations: whole numbers for all of them, or text for all of them."""

Indices = slice | int | Sequence[int] | Array
"""Numbers of demonstrations, or a mask over them."""

ActionKind = Literal["auto", "discrete", "continuous"]
"""Kinds of actions; "auto" decides by `action_kind`."""

FEW_CLASSES, MAX_CLASSES, STEPS_PER_CLASS = 10, 100, 10
"""Whole numbers are classes where at most `FEW_CLASSES` differ, or at most `MAX_CLASSES` with this many steps each."""

SMALLEST, LARGEST = 1e-150, 1e150
"""Largest number that may be squared in double precision."""

LONGEST_TEXT = 1_000
"""Characters that an id, or an action that is text, may have: an array of text takes as much for each of its rows."""

_EXACT = np.float64(2**53)
"""Smaller floats hold integers exactly; its type makes numpy compare half precision, which lacks it, in double."""


def as_array(values: object, what: str, where: str) -> Array:
    """`values` as a plain array of bool, integer, real or text kind ("b", "i", "u", "f", "U"), not copied if it is one.

    A `DataError` on ragged nesting, on text mixed with numbers, and on any other type.
    """
    try:
        array = np.asarray(values)
        if array.dtype.kind == "T" or (array.dtype.kind == "O" and array.size):
            items = array.ravel().tolist()
            if 0 < sum(isinstance(item, str) for item in items) < len(items):
                raise DataError(f"{where}: {what} mix text with numbers or missing values; use one kind throughout.")
            _check_items(items, what, where)
            flat = np.array(items)
            # None is the one object a column of numbers may hold; as NaN it meets the check for missing values.
            array = (flat.astype(np.float64) if flat.dtype.kind == "O" else flat).reshape(array.shape)
    except DataError:
        raise
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        remedy = "give every row as many values, or, of an episode, a dict of arrays"
        raise DataError(f"{where}: {what} must be a rectangular array of numbers or text; {remedy}.") from error
    if array.dtype.kind not in "biufU" and array.size:
        raise DataError(f"{where}: {what} must be numbers or text, not {array.dtype}; convert them.")
    is_list = not isinstance(values, np.ndarray)
    if is_list and (array.dtype.kind == "U" or (array.dtype == np.float64 and (np.abs(array) >= 2.0**63).any())):
        _check_items(np.asarray(values, object).ravel().tolist(), what, where)
    if array.dtype.kind == "U" and array.dtype.itemsize:
        codes = np.ascontiguousarray(array, array.dtype.newbyteorder("=")).view(np.uint32)
        if np.any((codes >= 0xD800) & ((codes < 0xE000) | (codes > 0x10FFFF))):
            raise DataError(f"{where}: {what} hold a character that is not Unicode; replace it.")
    return array


def _check_items(items: Sequence[object], what: str, where: str) -> None:
    """Raise a `DataError` on items that NumPy would change, so that several become the same one."""
    if any(isinstance(item, str) and "\0" in item for item in items):
        raise DataError(f"{where}: {what} hold the character NUL; replace it.")
    if any(isinstance(item, int) and not -(1 << 63) <= item < 1 << 63 for item in items):
        raise DataError(f"{where}: {what} hold whole numbers of over 64 bits; use smaller ones, or text.")


def as_names(values: Iterable[object], where: str) -> tuple[str, ...]:
    """Names of observations, as text; a `DataError` where they are no list."""
    array = as_array(values, "observation names", where)
    if array.ndim != 1:
        raise DataError(f"{where}: observation names must be a list, not of shape {array.shape}; name each number.")
    return tuple(str(name) for name in array.tolist())


def as_observations(values: object, where: str) -> Array:
    """Observations as a C-contiguous (N, D) array, float32 kept and all else float64."""
    array = as_array(values, "observations", where)
    if array.dtype.kind == "U":
        raise DataError(f"{where}: observations hold text, not numbers; encode it as numbers first.")
    if array.ndim != 2 or array.shape[1] == 0:
        remedy = "use reshape(-1, 1)" if array.ndim == 1 else "flatten each one to a row"
        raise DataError(f"{where}: observations must be (N, D), not {array.shape}; {remedy}.")
    return np.ascontiguousarray(array, dtype=np.float32 if array.dtype == np.float32 else np.float64)


def as_actions(values: object, where: str, wanted: ActionKind = "auto") -> Array:
    """Actions as (N,) int64 or text if discrete, C-contiguous (N, A) float32 or float64 if continuous.

    One number a step is discrete or continuous by `action_kind`.
    """
    array = as_array(values, "actions", where)
    kind = array.dtype.kind
    if array.ndim == 2 and array.shape[1] == 1 and (kind != "f" or wanted == "discrete"):
        array = array[:, 0]
    if array.ndim not in (1, 2) or (array.ndim == 2 and (kind != "f" or array.shape[1] == 0 or wanted == "discrete")):
        raise DataError(
            f"{where}: actions of shape {array.shape} and type {array.dtype} are neither (N,) discrete nor (N, A) "
            "floats; number the combinations, as numpy.unique(actions, axis=0, return_inverse=True)[1] does, name one "
            "part, or convert to float if they are continuous."
        )
    if array.ndim == 1:
        whole = kind != "f" or are_whole(array)
        n_classes = len(np.unique(array)) if wanted == "auto" and whole else 0
        if action_kind(n_classes, len(array), kind == "U", whole, wanted, where)[0] == "discrete":
            if kind == "u" and array.size and array.max() > np.iinfo(np.int64).max:
                raise DataError(f"{where}: actions do not fit into 64-bit integers; renumber them.")
            return np.ascontiguousarray(array, dtype=None if kind == "U" else np.int64)
    array = array.reshape(len(array), -1)
    return np.ascontiguousarray(array, dtype=np.float32 if array.dtype == np.float32 else np.float64)


def action_kind(
    n_classes: int, n_steps: int, is_text: bool, whole: bool, wanted: ActionKind, where: str
) -> tuple[ActionKind, str]:
    """Whether actions of one number or text each are "discrete" or "continuous", and why in words.

    That is by how many of them differ, and by whether they are text or `whole` numbers. A `DataError` where they cannot
    be what is `wanted`, or where there are too many texts.
    """
    if wanted != "auto":
        if not {"discrete": whole, "continuous": not is_text}.get(wanted):
            found = "text" if is_text else "whole numbers" if whole else "numbers that are not whole"
            raise DataError(f"{where}: the actions are {found}, which cannot be {wanted}; leave out the action kind.")
        return wanted, "as asked"
    if not whole:
        return "continuous", "not all of its numbers are whole"
    if is_text:
        if n_classes > (MAX_CLASSES if n_steps >= 2 * n_classes else FEW_CLASSES):
            raise DataError(
                f"{where}: the action takes {n_classes:,} different texts in {n_steps:,} steps, too many to compare; "
                "name a column of classes, or, if they are classes, give --action-kind discrete."
            )
        return "discrete", f"{n_classes:,} different texts"
    if n_classes > MAX_CLASSES:
        return "continuous", f"more than {MAX_CLASSES} different whole numbers"
    differ = f"{n_classes:,} different whole numbers in {n_steps:,} steps"
    if n_classes > FEW_CLASSES and n_steps < STEPS_PER_CLASS * n_classes:
        return "continuous", f"{differ}, fewer than {STEPS_PER_CLASS} steps for each"
    return "discrete", differ


def are_whole(array: Array) -> bool:
    """Whether all floats in `array` are whole numbers that an int64 holds exactly; NaN is not."""
    return bool(np.all((np.trunc(array) == array) & (np.abs(array) < _EXACT)))


def check_any(n_demonstrations: int, where: str) -> None:
    """Raise a `DataError` where there is nothing to learn from."""
    if n_demonstrations < 1:
        raise DataError(f"{where}: there are no demonstrations; give at least one with at least one step.")


def as_ids(values: Iterable[object], where: str) -> tuple[Id, ...]:
    """Demonstration ids as a tuple of distinct ints, or of distinct strings."""
    if isinstance(values, np.ndarray):
        values = as_array(values, "demonstration ids", where).tolist()
    given = tuple(value.item() if isinstance(value, np.generic) else value for value in values)
    if not (all(isinstance(i, int) for i in given) or all(isinstance(i, str) for i in given)):
        raise DataError(f"{where}: demonstration ids must be all whole numbers or all text; convert them.")
    ids = cast(tuple[Id, ...], given)
    for m, name in enumerate(ids):
        check_name(name, f"the id of demonstration number {m}", where)
    repeated = next((i for i, count in Counter(ids).items() if count > 1), None)
    if repeated is not None:
        raise DataError(f"{where}: demonstration {repeated!r} appears twice; give each demonstration its own id.")
    return ids


def check_name(name: Id, what: str, where: str) -> None:
    """Raise a `DataError` on a name that files and reports could not hold, or would not give back."""
    if isinstance(name, int):
        is_sound = -(1 << 63) <= name < 1 << 63
    else:
        is_sound = 0 < len(name) <= LONGEST_TEXT and "\0" not in name and name.encode(errors="replace").decode() == name
    if not is_sound:
        form = f"a whole number of 64 bits or 1 to {LONGEST_TEXT:,} characters of Unicode without NUL"
        raise DataError(f"{where}: {what} must be {form}; change it.")


def as_offsets(values: object, ids: tuple[Id, ...], n_steps: int, where: str) -> NDArray[np.int64]:
    """Offsets as (M + 1,) int64 rising from 0 to `n_steps`, M being the number of `ids`."""
    offsets = as_array(values, "offsets", where)
    if offsets.ndim != 1 or (offsets.size and offsets.dtype.kind not in "iu"):
        said = "offsets must be a list of whole numbers; give the first step of each demonstration, and N"
        raise DataError(f"{where}: {said}.")
    offsets = np.ascontiguousarray(offsets, dtype=np.int64)
    if len(ids) != len(offsets) - 1:
        raise DataError(f"{where}: {len(ids)} ids for {len(offsets) - 1} demonstrations; give one id for each.")
    lengths = np.diff(offsets)
    if offsets[0] != 0 or offsets[-1] != n_steps or np.any(lengths < 0):
        raise DataError(f"{where}: offsets must increase from 0 to the number of steps, {n_steps}.")
    if np.any(lengths == 0):
        empty = ids[int(np.argmin(lengths))]
        raise DataError(f"{where}, demonstration {empty!r}: it has no steps; leave it out.")
    return offsets


def group_rows(group: Array, order: Array | None = None) -> tuple[Array, NDArray[np.int64], Array | None]:
    """The demonstrations among the group numbers of the rows (N,): numbers by first appearance, and offsets.

    Also the rows, (N,), so that those of a demonstration lie together, by `order` (N,) or else as they come; None where
    they do already, because to gather rows copies all the data.
    """
    # Of runs of rows, which are fewer than rows.
    heads = np.append(0, np.flatnonzero(group[1:] != group[:-1]) + 1)[: len(group)]
    lengths = np.diff(np.append(heads, len(group)))
    values, first, inverse = np.unique(group[heads], return_index=True, return_inverse=True)
    appearance = np.argsort(first, kind="stable")
    place = np.argsort(appearance)[inverse]
    offsets = np.append(0, np.cumsum(np.bincount(place, lengths))).astype(np.int64)
    in_place = len(heads) == len(values)
    if order is not None:
        in_order = order[1:] >= order[:-1]
        in_order[heads[1:] - 1] = True
        in_place &= bool(in_order.all())
    if in_place:
        return values[appearance], offsets, None
    place = np.repeat(place, lengths)
    rows = np.argsort(place, kind="stable") if order is None else np.lexsort([order, place])
    return values[appearance], offsets, rows


def check_squares(ends: Array | Sequence[Array], what: str, names: Sequence[str] = ()) -> None:
    """A `DataError` where columns that reach from ``ends[0]`` to ``ends[1]``, (K,) each, are too large, or vary by too
    little, to be squared; `what` and its name, or else its number, name the column."""
    low, high = np.asarray(ends, dtype=float)
    spread, shown = high / 2 - low / 2, list(map(repr, names)) or range(len(low))
    beyond, alike = f"is beyond {LARGEST:g}", f"varies by less than {SMALLEST:g}"
    large, tiny = np.maximum(-low, high) > LARGEST, (spread > 0) & (spread < SMALLEST)
    for wrong, how, other in ((large, beyond, "larger"), (tiny, alike, "smaller")):
        if wrong.any():
            raise DataError(f"{what} {shown[np.argmax(wrong)]} {how}, where a square is no number; use {other} units.")


def check_finite(
    values: Array, columns: tuple[str, ...], offsets: NDArray[np.int64], ids: tuple[Id, ...], where: str
) -> None:
    """Raise a `DataError` naming the first value of `values` (N, K) that is not finite, if there is one."""
    finite = np.isfinite(values)
    if finite.all():
        return
    row, column = (int(k) for k in np.argwhere(~finite)[0])
    m = int(np.searchsorted(offsets, row, side="right")) - 1
    raise DataError(
        f"{where}, demonstration {ids[m]!r}, step {row - offsets[m]}: {columns[column]} is {values[row, column]}; "
        "repair the value, leave the demonstration out, or read with --skip-bad."
    )


def spans(rows: Bool[Array, " n"]) -> list[tuple[int, int]]:
    """The first row of each run of True, and the one after its last."""
    edges = np.flatnonzero(np.diff(rows, prepend=False, append=False)).tolist()
    return [*zip(edges[::2], edges[1::2], strict=True)]
