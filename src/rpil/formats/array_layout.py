"""Which steps of a file of arrays are a demonstration, in HDF5 and NPZ alike.

Arrays lie end to end, (N, ...), where ids, starts, ends or lengths tell demonstrations apart; or they are stacked,
(M, T, ...), where each first index is one demonstration.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.names import EPISODE
from rpil.formats.columns import ColumnOptions
from rpil.formats.step_arrays import NO_STEPS, NUMBERED, Part, StoredArray, from_parts
from rpil.formats.step_tables import StepTables
from rpil.numerics.types import Array

ACTIONS = ("actions", "action", "acts", "expert_actions")
OBSERVATIONS = ("observations", "observation", "obs", "expert_observations")
TIMEOUTS = "timeouts"

_NEXT = ("next_observations", "next_obs")
_STARTS = "episode_starts"  # of stable-baselines
_LENGTHS = ("episode_lengths", "lengths", "path_lengths", "traj_lengths")
_MASKS = ("mask", "valid_mask")
_TERMINALS = ("terminals", "terminations", "terminated")
_CUTS = (TIMEOUTS, "truncations", "truncated", "dones", "done")  # which also mark demonstrations that were cut short
_MARKS = (_STARTS, *_TERMINALS, *_CUTS)

Tree = Mapping[str, StoredArray]


@dataclass(frozen=True)
class ArrayLayout:
    """Which rows of the arrays are which demonstration.

    Attributes
    ----------
    n_steps : int
        N, or T where arrays are stacked.
    column : str
        Name of the ids.
    ids : array
        The id of each of N steps, or of each of M first indices where arrays are stacked.
    note : str
        How it was told.
    lengths : array (M,), optional
        The steps of each first index where arrays are stacked.
    by_demonstration : set of str
        Arrays with one value for each demonstration, where arrays lie end to end.
    """

    n_steps: int
    column: str
    ids: Array
    note: str
    lengths: Array | None = None
    by_demonstration: Set[str] = frozenset()

    def kept_rows(self, name: str, array: StoredArray, ids: Sequence[Id]) -> Array | None:
        """The rows of an array of the demonstrations `ids`; None where it has none for steps or demonstrations."""
        if array.shape[:1] == self.ids.shape:
            return np.flatnonzero(np.isin(self.ids, ids))
        return np.flatnonzero(np.isin(self.names, ids)) if name in self.by_demonstration else None

    def kept(self, name: str, array: Array, ids: Sequence[Id]) -> Array:
        """An array in memory with the rows of `kept_rows`, or as it is."""
        rows = self.kept_rows(name, array, ids)
        return array if rows is None else array[rows]

    @property
    def names(self) -> list[Any]:
        """The ids of the M demonstrations in the order of the file."""
        return list(dict.fromkeys(self.ids.tolist()))

    def added_ends(self, arrays: Tree, ids: Sequence[Id]) -> dict[str, Array]:
        """Timeouts for the steps of the demonstrations `ids`, where no array marks those that were cut short."""
        if self.lengths is not None or self.by_demonstration or first(arrays, (_STARTS, *_CUTS)):
            return {}
        is_last = np.append(self.ids[1:] != self.ids[:-1], True)
        is_terminal = _flags(arrays, _TERMINALS[0], self.n_steps, "terminals")
        return {TIMEOUTS: (is_last & ~is_terminal)[np.isin(self.ids, ids)]}


def first(arrays: Tree, names: Sequence[str]) -> str | None:
    """The first of the names that an array with rows has."""
    return next((name for name in names if name in arrays and arrays[name].shape), None)


def tells(arrays: Tree) -> bool:
    """Whether there are actions, and anything but ids says which steps are a demonstration."""
    n_steps = _n_steps(arrays)
    return n_steps is not None and (
        is_stacked(arrays) or first(arrays, (*_MARKS, *_NEXT)) is not None or _lengths(arrays, n_steps) is not None
    )


def read_arrays(
    arrays: Tree, source: str, format_name: str, options: ColumnOptions, notes: tuple[str, ...] = ()
) -> StepTables:
    """The recording in arrays that `tells` knows, or that have ids, which `options` may name."""
    if options.id and not is_stacked(arrays):
        return from_parts([Part(_n_steps(arrays) or 0, arrays)], options.id, source, format_name, options, notes=notes)
    layout = layout_of(arrays, source)
    notes = (*notes, layout.note)
    if layout.lengths is None:
        parts = [Part(layout.n_steps, {layout.column: layout.ids, **arrays})]
        return from_parts(parts, layout.column, source, format_name, options, notes=notes)
    n = len(layout.ids)
    steps = {name: array for name, array in arrays.items() if array.shape[:1] == (n,) and len(array.shape) > 1}
    whole = {name: array for name, array in arrays.items() if array.shape == (n,) and array.dtype.kind in "biufSU"}
    about = {name: _values(array).tolist() for name, array in whole.items()}
    about[layout.column] = layout.ids.tolist()
    parts = [
        Part(
            int(length),
            {name: _Stacked(array, m, int(length) - layout.n_steps) for name, array in steps.items()},
            {name: values[m] for name, values in about.items()},
        )
        for m, length in enumerate(layout.lengths)
    ]
    recording = from_parts(parts, layout.column, source, format_name, options, notes=notes)
    return recording.with_ignored(dict.fromkeys(arrays.keys() - steps.keys() - whole.keys(), NO_STEPS))


def layout_of(arrays: Tree, source: str) -> ArrayLayout:
    """The layout of arrays that `tells` knows, or that have ids; a `DataError` where they do not fit together."""
    n_steps, named = _n_steps(arrays) or 0, first(arrays, EPISODE)
    own_ids = None if named is None else arrays[named]
    if is_stacked(arrays):
        n, longest = arrays[str(first(arrays, ACTIONS))].shape[:2]
        lengths, note = _stacked_lengths(arrays, n, longest, source)
        if named is not None and own_ids is not None and own_ids.shape == (n,) and own_ids.dtype.kind in "iuSU":
            return ArrayLayout(longest, named, _values(own_ids), note, lengths)
        return ArrayLayout(longest, NUMBERED, np.arange(n), note, lengths)
    if named is not None and own_ids is not None and own_ids.shape == (n_steps,) and own_ids.dtype.kind in "iu":
        return ArrayLayout(n_steps, named, _values(own_ids), f"Demonstrations by the array {named}.")
    if (name := _lengths(arrays, n_steps)) is not None:
        lengths, note = _values(arrays[name]), f"Demonstrations are as long as {name} says."
        ids = np.repeat(np.arange(len(lengths)), lengths)
        return ArrayLayout(n_steps, NUMBERED, ids, note, by_demonstration={name})
    ends, note = _ends(arrays, n_steps, source)
    return ArrayLayout(n_steps, NUMBERED, np.concatenate([[0], np.cumsum(ends[:-1])]), note)


@dataclass(frozen=True, eq=False)
class _Stacked:
    """The steps of one demonstration in a stacked array, without the last `-shift`, which only fill it up."""

    stacked: StoredArray
    index: int
    shift: int

    @property
    def shape(self) -> tuple[int, ...]:
        n_rows, *more = self.stacked.shape[1:]
        return (max(n_rows + self.shift, 0), *more)

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.stacked.dtype

    def __getitem__(self, rows: slice) -> object:
        return np.asarray(self.stacked[self.index : self.index + 1])[0][: self.shape[0]][rows]


def _n_steps(arrays: Tree) -> int | None:
    actions = first(arrays, ACTIONS)
    return None if actions is None else int(arrays[actions].shape[0])


def is_stacked(arrays: Tree) -> bool:
    """Whether actions and observations have a first index for demonstrations, and no array marks single rows."""
    actions, observations = first(arrays, ACTIONS), first(arrays, OBSERVATIONS)
    if actions is None or observations is None:
        return False
    acted, seen = arrays[actions].shape, arrays[observations].shape
    flat = any(name in arrays and arrays[name].shape == acted[:1] for name in _MARKS)
    return not flat and len(acted) > 1 and len(seen) == 3 and seen[0] == acted[0] and seen[1] - acted[1] in (0, 1)


def _lengths(arrays: Tree, n_steps: int) -> str | None:
    """The array of the steps of each demonstration, where they are all `n_steps` together."""
    name = first(arrays, _LENGTHS)
    if name is None or len(arrays[name].shape) != 1 or arrays[name].dtype.kind not in "iu":
        return None
    lengths = _values(arrays[name])
    return name if lengths.sum() == n_steps and (lengths > 0).all() else None


def _stacked_lengths(arrays: Tree, n: int, longest: int, source: str) -> tuple[Array, str]:
    """The steps of each of `n` demonstrations (M,), and how they were told, in words."""
    name = first(arrays, _LENGTHS)
    ends = [name for name in (*_TERMINALS, *_CUTS) if name in arrays and arrays[name].shape[:2] == (n, longest)]
    words = "Each first index of the arrays is one demonstration"
    if name is not None:
        lengths, told = _values(arrays[name]), f"as long as {name} says"
    elif (name := first(arrays, _MASKS)) is not None:
        is_step = _values(arrays[name]).reshape(n, -1) != 0
        lengths, told = is_step.sum(axis=1), f"as long as {name} is true"
        if is_step.shape != (n, longest) or (np.diff(is_step.astype(int), axis=1) > 0).any():
            raise DataError(f"{source}: {name} must be true for the first steps of each demonstration; write it again.")
    elif ends:
        is_end = np.any([_values(arrays[name]).reshape(n, longest) != 0 for name in ends], axis=0)
        lengths = np.where(is_end.any(axis=1), is_end.argmax(axis=1) + 1, longest)
        told = f"which ends at {' or '.join(ends)}"
    else:
        return np.full(n, longest), f"{words} of {longest:,} steps."
    if lengths.shape != (n,) or lengths.dtype.kind not in "iu" or (lengths < 0).any() or (lengths > longest).any():
        raise DataError(f"{source}: {name} must be up to {longest:,} for each of {n:,} demonstrations; repair it.")
    return lengths, f"{words}, {told}."


def _ends(arrays: Tree, n_steps: int, source: str) -> tuple[Array, str]:
    """Whether a demonstration ends at each step (N,), and how that was told, in words."""
    if _STARTS in arrays:
        starts = _flags(arrays, _STARTS, n_steps, source)
        return np.append(starts[1:], True), f"Demonstrations begin at {_STARTS}."
    marks = [name for name in (*_TERMINALS, *_CUTS) if name in arrays]
    ends = np.any([np.zeros(n_steps, bool), *(_flags(arrays, name, n_steps, source) for name in marks)], axis=0)
    if {*marks} & {*_CUTS}:
        return ends, f"Demonstrations end at {' and '.join(marks)}."
    following = first(arrays, _NEXT)
    jumps = None if following is None else _jumps(arrays, following, n_steps, source)
    if jumps is not None:
        return ends | jumps, (
            f"There are no timeouts: demonstrations end at terminals, and where {following} is not the following "
            "observation."
        )
    if not ends[:-1].any():
        raise DataError(
            f"{source}: nothing says where demonstrations begin (there are no timeouts, no next_observations, and no "
            "terminals before the last step); add an array timeouts, or one called episode_index."
        )
    return ends, (
        "There are no timeouts and no next_observations: demonstrations end at terminals alone, and one that was cut "
        "short is joined to the next."
    )


def holds_several(arrays: Tree, n_steps: int, source: str) -> str:
    """The array by which arrays that should be of one demonstration are of several; no text where none says so."""
    for name in (_TERMINALS[0], TIMEOUTS):
        if _flags(arrays, name, n_steps, source)[:-1].any():
            return name
    named = first(arrays, EPISODE)
    is_of_imitation = {"acts", "indices", "terminal"} <= arrays.keys()
    if named is None or arrays[named].shape[:1] != (n_steps,):
        return "indices" if is_of_imitation else ""
    return named


def _flags(arrays: Tree, name: str, n_steps: int, source: str) -> Array:
    """An array of true and false (N,); all false where there is none."""
    if name not in arrays:
        return np.zeros(n_steps, bool)
    array = arrays[name]
    if array.shape not in ((n_steps,), (n_steps, 1)) or array.dtype.kind not in "biuf":
        raise DataError(
            f"{source}: {name} has the shape {array.shape} and the type {array.dtype} for {n_steps:,} actions; write "
            "one 0 or 1 for each."
        )
    return np.asarray(_values(array).reshape(-1) != 0)


def _jumps(arrays: Tree, following: str, n_steps: int, source: str) -> Array | None:
    """Whether the step after each of the N begins anew; None where no array tells.

    Steps whose order was shuffled begin anew nearly everywhere: a `DataError`.
    """
    seen = first(arrays, OBSERVATIONS)
    if seen is None:
        return None
    if arrays[following].shape != arrays[seen].shape or arrays[seen].shape[:1] != (n_steps,):
        raise DataError(
            f"{source}: {following} has the shape {arrays[following].shape} and {seen} {arrays[seen].shape} for "
            f"{n_steps:,} actions; write both for every step."
        )
    differs = _values(arrays[following])[:-1] != _values(arrays[seen])[1:]
    jumps = np.append(differs.reshape(n_steps - 1, -1).any(axis=1), False)
    if 2 * jumps.sum() > n_steps:
        raise DataError(
            f"{source}: after {jumps.sum():,} of {n_steps:,} steps, {following} is not the following observation, so "
            "that the order of the steps was lost; use the file before it was shuffled, or add timeouts."
        )
    return jumps


def _values(array: StoredArray) -> Array:
    """All values of an array; text as text."""
    values = np.asarray(array[:])
    return np.char.decode(values) if values.dtype.kind == "S" else values
