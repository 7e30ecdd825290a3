"""Episodes as other libraries give them in Python: the observations and actions of each, as arrays.

Gymnasium, Minari and imitation keep the observation after the last action, which is dropped here. Observations in dicts
become columns, each with a name.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from rpil.data.arrays import Id, as_array, as_ids, as_observations, check_any
from rpil.data.errors import DataError
from rpil.numerics.types import Array

NAMES = ("observations", "obs", "observation"), ("actions", "acts", "action")
"""Names that an episode gives its observations and its actions: Minari, imitation, Gymnasium."""


def lay_end_to_end(
    episodes: Iterable[object], ids: Iterable[object] | None, source: str
) -> tuple[Array, Array, Array, tuple[Id, ...], tuple[str, ...]]:
    """Observations (N, D), actions, offsets (M + 1,), ids and the names of the observations of M `episodes`.

    A `DataError` where an episode cannot be read, or has other columns than the first.
    """
    given = list(episodes)
    check_any(len(given), source)
    names = as_ids(range(len(given)) if ids is None else ids, source)
    if len(names) != len(given):
        raise DataError(f"{source}: give each demonstration one id, not {len(names)} ids for {len(given)}.")
    places = [f"{source}, demonstration {name!r}" for name in names]
    read = [as_episode(*one) for one in zip(given, places, strict=True)]
    for where, episode in zip(places, read, strict=True):
        for what, one, first in zip(("observations", "actions", "names"), episode, read[0], strict=True):
            # All episodes have the same names, and arrays of the same width, of text or not.
            forms = ((x.shape[1:], x.dtype.kind == "U") if isinstance(x, np.ndarray) else x for x in (one, first))
            if len({*forms}) > 1:
                raise DataError(
                    f"{where}: its {what} differ in width or kind from those of demonstration {names[0]!r}; "
                    "give every demonstration the same columns."
                )
    offsets = np.cumsum([0, *(len(observations) for observations, _, _ in read)])
    return np.concatenate([e[0] for e in read]), np.concatenate([e[1] for e in read]), offsets, names, read[0][2]


def as_episode(given: object, where: str) -> tuple[Array, Array, tuple[str, ...]]:
    """Observations (T, D), actions (T,) or (T, A), and names of the observations where they came with names.

    `given` is a pair (observations, actions), or a dict or an object that holds both. A `DataError` where it is none of
    these, where the parts differ in length, or where an observation is no number.
    """
    both = _parts(given)
    if both is None:
        raise DataError(f"{where}: give one pair (observations, actions), or a dict or an object that holds both.")
    observations, names = _as_table(both[0], "observation", where)
    actions, _ = _as_table(both[1], "action", where)
    lengths = [len(array) if array.ndim else 0 for array in (observations, actions)]
    if lengths[0] - lengths[1] not in (0, 1):
        raise DataError(
            f"{where}: {lengths[0]} observations but {lengths[1]} actions; give one action per observation, where at "
            "most the observation after the last action has none."
        )
    if not lengths[1]:
        raise DataError(f"{where}: it has no steps; give arrays with a row for each, or leave it out.")
    return as_observations(observations[: lengths[1]], where), actions, names


def _parts(given: object) -> tuple[object, object] | None:
    """The observations and the actions in one of the forms of an episode; None where it has none of them."""
    get = given.get if isinstance(given, Mapping) else lambda name: getattr(given, name, None)
    found = [next((part for part in map(get, names) if part is not None), None) for names in NAMES]
    if all(part is not None for part in found):
        return found[0], found[1]
    if isinstance(given, Sequence | np.ndarray) and not isinstance(given, str) and len(given) == 2:
        are_steps = all(isinstance(one, Mapping) and _parts(one) for one in given)
        return None if are_steps else (given[0], given[1])
    return None


def _as_table(part: object, what: str, where: str) -> tuple[Array, tuple[str, ...]]:
    """Values as they are; those in dicts side by side, (T, K), and a name for each of the K."""
    columns = _columns(part, "", what, where)
    if "" in columns:
        return columns[""], ()
    blocks: list[Array] = []
    names: list[str] = []
    for name, column in columns.items():
        block = np.reshape(column, (len(column), -1)) if column.ndim else column.reshape(1, 1)
        if column.dtype.kind == "U" or (blocks and len(block) != len(blocks[0])):
            fault = "is text" if column.dtype.kind == "U" else f"has {len(block)} steps, not {len(blocks[0])}"
            raise DataError(
                f"{where}: {what} {name!r} {fault}; leave it out, or give one number or array for each step."
            )
        blocks.append(block)
        names += [name] if block.shape[1] == 1 else [f"{name}.{k}" for k in range(block.shape[1])]
    if not blocks:
        raise DataError(f"{where}: there are no {what}s; give at least one number for each step.")
    return np.concatenate(blocks, axis=1), tuple(names)


def _columns(part: object, name: str, what: str, where: str) -> dict[str, Array]:
    """The arrays in nested dicts, by their names joined with dots; an array by itself is called ""."""
    # A dict, or imitation's DictObs, has entries by name; a table of pandas is an array.
    if not hasattr(part, "items") or hasattr(part, "__array__"):
        return {name: as_array(part, f"{what} {name!r}" if name else f"{what}s", where)}
    found: dict[str, Array] = {}
    for key, value in part.items():
        found |= _columns(value, f"{name}.{key}" if name else str(key), what, where)
    return found
