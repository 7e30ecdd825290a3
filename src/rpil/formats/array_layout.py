"""Which steps of a file of arrays are a demonstration, in HDF5 and NPZ alike.

Arrays lie end to end, (N, ...), where ids, starts, ends or lengths tell demonstrations apart; or they are stacked,
(M, T, ...), where each first index is one demonstration.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpil.data.arrays import Id, are_whole
from rpil.data.errors import DataError
from rpil.data.names import EPISODE, may_be_outcome
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import StepTables
from rpil.formats.step_arrays import NO_STEPS, NUMBERED, Closed, Part, StoredArray, from_parts, is_text, read_once
from rpil.formats.table_facts import Metadata
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
    column : str
        Name of the ids.
    ids : array
        The id of each of N steps, or of each of M first indices where arrays are stacked.
    note : str
        How it was told.
    is_step : array (M, T), optional
        Which rows are steps, where arrays are stacked.
    by_demonstration : bool
        Whether arrays of M rows have one for each demonstration, where those of the steps lie end to end.
    """

    column: str
    ids: Array
    note: str
    is_step: Array | None = None
    by_demonstration: bool = False

    @property
    def names(self) -> list[Any]:
        """The ids of the M demonstrations in the order of the file."""
        return list(dict.fromkeys(self.ids.tolist()))

    def facts(self, arrays: Tree, options: ColumnOptions) -> dict[str, StoredArray]:
        """Arrays (M,) that the user names, or that may be an outcome, with a value for each of the N steps."""
        named = {options.operator, options.session, options.task, (options.outcome or "").removeprefix("-")}
        place = {m: k for k, m in enumerate(self.names)}
        rows = np.array([place[m] for m in self.ids.tolist()], dtype=int)
        whole = {name: one for name, one in arrays.items() if one.shape == (len(place),) != rows.shape}

        def steps(array: StoredArray) -> Closed:
            return read_once(rows.shape, array.dtype, lambda: np.asarray(_values(array)[rows]))

        return {name: steps(one) for name, one in whole.items() if name in named or may_be_outcome(name)}

    def kept_rows(self, array: StoredArray, ids: Sequence[Id]) -> Array | None:
        """The rows of an array that the demonstrations `ids` have; None where it has none for either."""
        n, n_rows = len(self.ids), array.shape[0] if array.shape else 0
        if n_rows in (n, n + 1):  # one more comes after the last action
            owners = self.ids[np.minimum(np.arange(n_rows), n - 1)]
            return np.flatnonzero(np.isin(owners, ids))
        each = self.by_demonstration and array.shape[:1] == (len(self.names),)
        return np.flatnonzero(np.isin(self.names, ids)) if each else None

    def new_arrays(self, arrays: Tree, ids: Sequence[Id], source: str) -> dict[str, Array]:
        """Timeouts that tell the demonstrations `ids` apart, where no array marks those that were cut short."""
        if self.by_demonstration or first(arrays, (_STARTS, *_CUTS)):
            return {}
        is_last = np.append(self.ids[1:] != self.ids[:-1], True)
        is_terminal = np.any([_flags(arrays, name, len(self.ids), source) for name in _TERMINALS], axis=0)
        timeouts = is_last & ~is_terminal
        return {TIMEOUTS: timeouts[np.isin(self.ids, ids)]}


def first(arrays: Tree, names: Sequence[str]) -> str | None:
    """The first of the names that an array with rows has."""
    return next((name for name in names if name in arrays and arrays[name].shape), None)


def n_actions(arrays: Tree) -> int:
    """The rows of the array of actions; 0 where there is none."""
    actions = first(arrays, ACTIONS)
    return 0 if actions is None else int(arrays[actions].shape[0])


def tells(arrays: Tree) -> bool:
    """Whether there are actions, and anything says which steps are a demonstration, as in a file of D4RL."""
    marked = first(arrays, ACTIONS) and first(arrays, (*EPISODE, *_MARKS, *_NEXT))
    return bool(marked or is_stacked(arrays) or (n_actions(arrays) and _lengths(arrays, n_actions(arrays))))


def read_arrays(
    arrays: Tree,
    source: str,
    format_name: str,
    options: ColumnOptions,
    notes: tuple[str, ...] = (),
    metadata: Metadata = Metadata(),
) -> StepTables:
    """The recording in arrays that `tells` knows; `options` may name the ids."""
    layout = layout_of(arrays, source, options.id)
    steps, ids = arrays, layout.ids
    if layout.is_step is not None:
        steps, ids = _end_to_end(arrays, layout.is_step), np.repeat(ids, layout.is_step.sum(axis=1))
    else:
        steps = {**arrays, **layout.facts(arrays, options)}
    parts, notes = [Part(len(ids), {**steps, layout.column: ids})], (*notes, *filter(None, [layout.note]))
    found = from_parts(parts, layout.column, source, format_name, options, metadata, notes)
    return found.with_ignored(dict.fromkeys(arrays.keys() - steps.keys(), NO_STEPS))


def layout_of(arrays: Tree, source: str, wanted: str | None = None) -> ArrayLayout:
    """The layout of arrays that `tells` knows; ids may be `wanted` by their name.

    A `DataError` where the arrays do not fit together.
    """
    n_steps = n_actions(arrays)
    names = [name for name in ([wanted] if wanted else EPISODE) if name in arrays]
    own = {name: arrays[name] for name in names if arrays[name].shape == (n_steps,)}
    named = next((name for name, ids in own.items() if wanted or ids.dtype.kind in "iuf" or is_text(ids.dtype)), None)
    column, ids = (named, _values(own[named])) if named else (NUMBERED, np.arange(n_steps))
    if ids.dtype.kind == "f" and np.isnan(ids).any():
        fault = f"row {np.argmax(np.isnan(ids)) + 1}: {column} has no value"
        raise DataError(f"{source}, {fault}; fill it in or leave the demonstration out.")
    if ids.dtype.kind == "f" and are_whole(ids):
        ids = ids.astype(np.int64)
    if is_stacked(arrays):
        if time_first(arrays, source):
            raise DataError(f"{source}: the first index of its arrays is the time; swap the first two axes of each.")
        is_step, note = _is_step(arrays, arrays[str(first(arrays, ACTIONS))].shape[:2], source)
        return ArrayLayout(column, ids, note, is_step)
    if named:
        return ArrayLayout(column, ids, "")
    if (name := _lengths(arrays, n_steps)) is not None:
        lengths = _values(arrays[name])
        ids, note = np.repeat(np.arange(len(lengths)), lengths), f"Demonstrations are as long as {name} says."
        return ArrayLayout(NUMBERED, ids, note, by_demonstration=True)
    if names and not first(arrays, (*_MARKS, *_NEXT)):
        said = f"{names[0]} has the shape {arrays[names[0]].shape} for {n_steps:,} actions"
        said = f"{names[0]} holds true and false, which are no ids" if names[0] in own else said
        raise DataError(f"{source}: {said}; give one id for each.")
    ends, note = _ends(arrays, n_steps, source)
    return ArrayLayout(NUMBERED, np.concatenate([[0], np.cumsum(ends[:-1])]), note)


def _end_to_end(arrays: Tree, is_step: Array) -> dict[str, StoredArray]:
    """Stacked arrays (M, T, ...) or (M, T + 1, ...) as arrays of their steps, and values (M,) as one for each step."""
    (n, longest), lengths = is_step.shape, is_step.sum(axis=1)

    def steps(array: StoredArray) -> Closed:
        return read_once((lengths.sum(), *array.shape[2:]), array.dtype, lambda: _values(array)[:, :longest][is_step])

    stacked = {name: one for name, one in arrays.items() if one.shape[:2] in ((n, longest), (n, longest + 1))}
    whole = {name: one for name, one in arrays.items() if one.shape == (n,)}
    repeated = {name: np.repeat(_values(one), lengths) for name, one in whole.items()}
    return {**repeated, **{name: steps(one) for name, one in stacked.items()}}


def is_stacked(arrays: Tree) -> bool:
    """Whether actions and observations have a first index for demonstrations, and no array marks single rows."""
    actions, observations = first(arrays, ACTIONS), first(arrays, OBSERVATIONS)
    if actions is None or observations is None:
        return False
    acted, seen = arrays[actions].shape, arrays[observations].shape
    of_rows = [name for name in (*_MARKS, *EPISODE) if name in arrays and arrays[name].shape == acted[:1]]
    flat = any(name in _MARKS or len({*_values(arrays[name]).tolist()}) < acted[0] for name in of_rows)
    longer = seen[0] - acted[0], seen[1] - acted[1] if len(acted) > 1 and len(seen) == 3 else -1
    return not flat and longer in ((0, 0), (0, 1), (1, 0))


def time_first(arrays: Tree, source: str) -> tuple[int, ...] | None:
    """T and M, where arrays are (T, M, ...): each demonstration has one run of true in a mask, or in what marks ends,
    or there are M lengths or ids, or T + 1 observations; else None. A `DataError` where only the values look so."""
    if not is_stacked(arrays):
        return None
    shape, seen = arrays[str(first(arrays, ACTIONS))].shape[:2], arrays[str(first(arrays, OBSERVATIONS))]
    if seen.shape[0] > shape[0]:
        return shape
    told = [{arrays[name].shape for name in (*_LENGTHS, *EPISODE) if name in arrays}]
    flags = {name: one for name, one in arrays.items() if one.shape in (shape, (*shape, 1))}
    if name := first(flags, (*_MASKS, *_TERMINALS, *_CUTS)):
        flag = np.asarray(_values(flags[name]).reshape(shape) != 0, dtype=int)
        runs = [(np.diff(flag, axis=k, prepend=0) > 0).sum(axis=k) for k in (0, 1)]
        told += [{shape[1 - k :][:1] for k in (0, 1) if np.all(runs[k] == 1)}]
    for one in told:
        if (shape[:1] in one) != (shape[1:] in one):
            return shape if shape[1:] in one else None
    values = np.asarray(seen[:99], dtype=float)[:, :99]
    with np.errstate(invalid="ignore"):
        pairs = ((values - np.roll(values, n, axis=k) for n in (1, values.shape[k] // 2)) for k in (0, 1))
        (near, far), (beside, apart) = ([np.abs(one).mean() for one in pair] for pair in pairs)
    if min(values.shape[:2]) > 7 and 2 * near < far and 4 * beside > 3 * apart:
        fault = f"the first index of its arrays seems to be the time, and the second one of {shape[1]:,} demonstrations"
        raise DataError(f"{source}: {fault}; add an array lengths, with the steps of each, or swap the two axes.")
    return None


def _lengths(arrays: Tree, n_steps: int) -> str | None:
    """The array of the steps of each demonstration, where they are all `n_steps` together."""
    name = first(arrays, _LENGTHS)
    if name is None or len(arrays[name].shape) != 1 or arrays[name].dtype.kind not in "iu":
        return None
    lengths = _values(arrays[name])
    return name if lengths.sum() == n_steps and (lengths > 0).all() else None


def _is_step(arrays: Tree, shape: tuple[int, ...], source: str) -> tuple[Array, str]:
    """Which of the rows of stacked arrays are steps (M, T), and how that was told, in words."""
    longest, words = shape[1], "Each first index of the arrays is one demonstration"
    if name := first(arrays, _LENGTHS):
        lengths = _values(arrays[name])
        if lengths.shape != shape[:1] or lengths.dtype.kind not in "iu" or np.any((lengths < 1) | (lengths > longest)):
            fault = f"{name} must be 1 to {longest:,} for each of {shape[0]:,} demonstrations"
            raise DataError(f"{source}: {fault}; repair it.")
        return np.arange(longest) < lengths[:, None], f"{words}, as long as {name} says."
    stacked = {name: array for name, array in arrays.items() if array.shape in (shape, (*shape, 1))}
    if name := first(stacked, _MASKS):
        return _values(stacked[name]).reshape(shape) != 0, f"{words}, as long as {name} is true."
    if ends := [name for name in (*_TERMINALS, *_CUTS) if name in stacked]:
        is_end = np.any([_values(stacked[name]).reshape(shape) != 0 for name in ends], axis=0)
        again = np.flatnonzero((np.diff(is_end.astype(int), axis=1, prepend=0) > 0).sum(axis=1) > 1)
        if len(again):
            fault = f"{' or '.join(ends)} end more than one demonstration in the first index {again[0]}"
            raise DataError(f"{source}: {fault}; write each one as a first index, or all steps end to end.")
        is_step = np.cumsum(is_end, axis=1) - is_end == 0  # up to the first end
        return is_step, f"{words}, which ends at {' or '.join(ends)}."
    return np.ones(shape, bool), f"{words} of {longest:,} steps."


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
    varies = named is not None and arrays[named].shape == (n_steps,) and len(np.unique(_values(arrays[named]))) > 1
    return named if named is not None and varies else ""


def _flags(arrays: Tree, name: str, n_steps: int, source: str) -> Array:
    """An array of true and false (N,); all false where there is none."""
    if name not in arrays:
        return np.zeros(n_steps, bool)
    array = arrays[name]
    if array.shape not in ((n_steps,), (n_steps, 1)) or array.dtype.kind not in "biuf":
        fault = f"{name} has the shape {array.shape} and the type {array.dtype} for {n_steps:,} actions"
        raise DataError(f"{source}: {fault}; write one 0 or 1 for each.")
    return np.asarray(_values(array).reshape(-1) != 0)


def _jumps(arrays: Tree, following: str, n_steps: int, source: str) -> Array | None:
    """Whether the step after each of the N begins anew; None where no array tells.

    Steps whose order was shuffled begin anew nearly everywhere: a `DataError`.
    """
    seen = first(arrays, OBSERVATIONS)
    if seen is None:
        return None
    if arrays[following].shape != arrays[seen].shape or arrays[seen].shape[:1] != (n_steps,):
        shapes = f"{following} has the shape {arrays[following].shape} and {seen} {arrays[seen].shape}"
        raise DataError(f"{source}: {shapes} for {n_steps:,} actions; write both for every step.")
    then, now = _values(arrays[following])[:-1], _values(arrays[seen])[1:]
    differs = (then != now) & ((then == then) | (now == now))  # a value that is missing in both is the same
    jumps = np.append(differs.any(axis=tuple(range(1, differs.ndim))), False)
    if 2 * jumps.sum() > n_steps:
        raise DataError(
            f"{source}: after {jumps.sum():,} of {n_steps:,} steps, {following} is not the following observation, so "
            "that the order of the steps was lost; use the file before it was shuffled, or add timeouts."
        )
    return jumps


def _values(array: StoredArray) -> Array:
    """All values of an array; text as text."""
    values = np.asarray(array[:])
    return np.char.decode(values.astype("S")) if values.dtype.kind in "SO" else values
