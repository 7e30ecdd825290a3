"""The table of array layouts: which names arrays have, and which of their steps are a demonstration, in any container.

Arrays lie end to end, (N, ...), where ids, lengths, starts or ends tell demonstrations apart; or they are stacked,
(M, T, ...) or (T, M, ...), where an index is one demonstration; or each demonstration has a group or a file of its own.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import PurePath

import numpy as np

from rpil.data.arrays import are_whole, as_names
from rpil.data.errors import DataError
from rpil.data.memory import BYTES_PER_NUMBER, check_memory
from rpil.data.text import ACTION_COLUMNS, EPISODE, plain_name
from rpil.formats.columns import ColumnOptions, as_list
from rpil.formats.format import Metadata, StepTables
from rpil.formats.scan import commas
from rpil.formats.step_arrays import NO_STEPS, Closed, Part, StoredArray, Tree, from_parts, read_once
from rpil.numerics.types import Array

ROLES = {
    "actions": ("actions", "action", "acts", "expert_actions"),
    "observations": ("observations", "observation", "obs", "expert_observations", "states", "state"),
    "ids": EPISODE,
    "lengths": ("episode_lengths", "lengths", "path_lengths", "traj_lengths"),
    "offsets": ("meta/episode_ends",),  # of diffusion policy
    "masks": ("mask", "valid_mask", "valid", "is_valid"),
    "starts": ("episode_starts",),  # of stable-baselines
    "terminals": ("terminals", "terminations", "terminated"),
    "cuts": ("timeouts", "truncations", "truncated", "dones", "done"),  # also of demonstrations that were cut short
    "next": ("next_observations", "next_obs"),
    "names": ("observation_names",),
}
"""The names of the arrays of each role; the first one that is there counts."""

_NUMBERED = "episode"  # the column of the id where demonstrations have no names but their numbers
_ASIDE = (*ROLES["offsets"], *ROLES["names"])  # which are no columns of steps


@dataclass(frozen=True)
class Cut:
    """Which steps are which demonstration, and how that was told."""

    column: str  # the name of the ids
    ids: Array  # of each of N steps, or of each of M first indices where arrays are stacked
    note: str = ""
    is_step: Array | None = None  # (M, T): which rows are steps, where arrays are stacked


@dataclass(frozen=True, eq=False)
class Arrays:
    """The arrays of a container by name, with the roles that they play; it is called `source` in messages."""

    arrays: Tree
    source: str
    kind: str = ""  # the name of the format
    options: ColumnOptions = ColumnOptions()
    attributes: Callable[[str], Tree] = lambda _: {}  # of the group at a path
    notes: tuple[str, ...] = ()  # what of the container is not read
    unread: Mapping[str, str] = field(default_factory=dict)  # arrays that are not here, and why

    @cached_property
    def names(self) -> dict[str, list[str]]:
        """The names of the arrays with rows that have each role, or that the user names for it."""
        named = {**ROLES, "ids": (self.options.id,) if self.options.id else ROLES["ids"]}
        named["actions"] = (*_actions(self.arrays, self.options),)
        named["observations"] = (*ROLES["observations"], *as_list(self.options.observations))
        there = {name for name in {*sum(named.values(), ())} & self.arrays.keys() if self.arrays[name].shape}
        return {role: [name for name in names if name in there] for role, names in named.items()}

    def shape(self, role: str) -> tuple[int, ...]:
        """The shape of the first array of a role; empty where there is none."""
        return self.arrays[self.names[role][0]].shape if self.names[role] else ()

    def shaped(self, shapes: Sequence[tuple[int, ...]], *roles: str) -> list[str]:
        """The names of the arrays of these roles that have one of these shapes."""
        return [name for role in roles for name in self.names[role] if self.arrays[name].shape in shapes]

    def values(self, name: str) -> Array:
        """All values of an array; text as text."""
        values = np.asarray(self.arrays[name][:])
        return np.char.decode(values.astype("S")) if values.dtype.kind in "SO" else values

    def flags(self, names: Sequence[str], shape: tuple[int, ...]) -> Array:
        """Where any of the arrays is true."""
        found = np.zeros(shape, bool)
        for name in names:
            array = self.arrays[name]
            if array.shape not in (shape, (*shape, 1)) or array.dtype.kind not in "biuf":
                fault = f"{name} has the shape {array.shape} and the type {array.dtype} for {shape[0]:,} actions"
                raise DataError(f"{self.source}: {fault}; write one 0 or 1 for each.")
            found |= self.values(name).reshape(shape) != 0
        return found

    @cached_property
    def n_steps(self) -> int:
        """The rows of the actions; or of ids, or the first array, where it is to be said that there are no actions."""
        shapes = (one.shape for one in self.arrays.values() if one.shape)
        return (self.shape("actions") or self.shape("ids") or next(shapes, (0,)))[0]

    @cached_property
    def is_stacked(self) -> bool:
        """Whether actions and observations have an index for demonstrations, and no array marks single rows."""
        acted, seen = self.shape("actions"), self.shape("observations")
        if not acted or not seen or self.names["offsets"]:
            return False
        longer = seen[0] - acted[0], seen[1] - acted[1] if len(acted) > 1 and len(seen) == 3 else -1
        if longer not in ((0, 0), (0, 1), (1, 0)) or self.shaped((acted[:1],), "starts", "terminals", "cuts"):
            return False
        ids = [name for name in self.shaped((acted[:1],), "ids") if name in EPISODE]
        return not any(len({*self.values(name).tolist()}) < acted[0] for name in ids)

    def groups(self) -> tuple[str, dict[str, Part]]:
        """The first place where groups hold actions, and the arrays in each of these groups, by its name."""
        places: dict[str, dict[str, dict[str, StoredArray]]] = {"data/": {}, "episodes/": {}, "": {}}
        for path, array in self.arrays.items():
            within = next(m for m in places if path.startswith(m))
            name, slash, rest = path.removeprefix(within).partition("/")
            if slash:
                places[within].setdefault(name, {})[rest] = array
        most = None if self.options.action else 1  # of those that the user names, some may hold no steps
        for within, own in places.items():
            acted = {m: [t[a].shape[0] for a in _actions(t, self.options) if t[a].shape][:most] for m, t in own.items()}
            if parts := {m: Part(min(n for n in of if n >= max(of) - 1), own[m]) for m, of in acted.items() if of}:
                return within, parts
        return "", {}

    def cut(self) -> Cut:
        """The demonstrations by ids, or the first row of `_ROWS` that fits; a `DataError` where none does."""
        n = self.n_steps
        if (named := self.shaped(((n,),), "ids")) or self.is_stacked:
            column, ids = (named[0], self.values(named[0])) if named else (_NUMBERED, np.arange(n))
            ids = ids.astype(np.int64) if ids.dtype.kind == "f" and are_whole(ids) else ids
            return Cut(column, ids, *(self._stacked_steps() if self.is_stacked else ()))
        for roles, find, note in _ROWS:
            if self.names[roles[-1]] and (found := find(self)) is not None:
                told = " and ".join(name for role in roles for name in self.names[role])
                return Cut(_NUMBERED, found, note.format(told))
        if self.names["ids"]:
            fault = f"{self.names['ids'][0]} has the shape {self.shape('ids')} for {n:,} actions"
            raise DataError(f"{self.source}: {fault}; give one id for each.")
        there = commas([f"{name} {array.shape}" for name, array in self.arrays.items()]) or "no arrays"
        remedy = "add terminals and timeouts, or one called episode_index, or write a group with actions and obs each"
        remedy += ", or name the array of actions in each group with --action"
        if self.names["actions"] and not self.names["observations"]:
            remedy = "name the array of observations with --observations"
        raise DataError(f"{self.source}: nothing says where demonstrations begin (it holds {there}); {remedy}.")

    def _stacked_steps(self) -> tuple[str, Array]:
        """How it was told which of the rows of stacked arrays are steps, in words, and which they are (M, T)."""
        shape, words = self.shape("actions")[:2], "Each first index of the arrays is one demonstration"
        if self.names["lengths"]:
            lengths = self.values(name := self.names["lengths"][0])
            whole = lengths.shape == shape[:1] and lengths.dtype.kind in "iu"
            if not whole or np.any((lengths < 1) | (lengths > shape[1])):
                fault = f"{name} must be 1 to {shape[1]:,} for each of {shape[0]:,} demonstrations"
                raise DataError(f"{self.source}: {fault}; repair it.")
            return f"{words}, as long as {name} says.", np.arange(shape[1]) < lengths[:, None]
        if masks := self.shaped((shape, (*shape, 1)), "masks"):
            return f"{words}, as long as {masks[0]} is true.", self.flags(masks[:1], shape)
        for name in (one for one in self.names["masks"] if len(self.arrays[one].shape) == 2):  # else those of images
            fault = f"{name} has the shape {self.arrays[name].shape} for actions of {shape}"
            raise DataError(f"{self.source}: {fault}; give one true or false for each step.")
        is_end = self.flags(ends := self.shaped((shape, (*shape, 1)), "terminals", "cuts"), shape)
        again = np.flatnonzero((np.diff(is_end.astype(int), axis=1, prepend=0) > 0).sum(axis=1) > 1)
        if len(again):
            fault = f"{' or '.join(ends)} end more than one demonstration in the first index {again[0]}"
            raise DataError(f"{self.source}: {fault}; write each one as a first index, or all steps end to end.")
        words += f", which ends at {' or '.join(ends)}." if ends else f" of {shape[1]:,} steps."
        return words, np.cumsum(is_end, axis=1) - is_end == 0  # up to the first end

    def turned(self) -> Arrays:
        """The same with the demonstration first, where arrays are (T, M, ...).

        A mask, or what marks ends, has one run of true a demonstration, or there are M lengths or ids, or T + 1 states.
        """
        if not self.is_stacked:
            return self
        shape = self.shape("actions")[:2]
        told = [{self.arrays[name].shape for name in (*self.names["lengths"], *self.names["ids"])}]
        if flags := self.shaped((shape, (*shape, 1)), "masks", "terminals", "cuts"):
            flag = self.flags(flags[:1], shape).astype(int)
            runs = [(np.diff(flag, axis=k, prepend=0) > 0).sum(axis=k) for k in (0, 1)]
            told += [{shape[1 - k :][:1] for k in (0, 1) if np.all(runs[k] == 1)}]
        says = [shape[1:] in one for one in told if (shape[:1] in one) != (shape[1:] in one)]
        says = [True] if self.shape("observations")[0] > shape[0] else says
        if says[:1] != [True]:
            return self

        def swapped(array: StoredArray) -> Closed:
            size = (array.shape[1], array.shape[0], *array.shape[2:])
            return read_once(size, array.dtype, lambda: np.swapaxes(np.asarray(array[:]), 0, 1))

        shapes = shape, (shape[0] + 1, shape[1])
        own = {name: swapped(one) for name, one in self.arrays.items() if one.shape[:2] in shapes}
        return replace(self, arrays={**self.arrays, **own})

    def read(self) -> StepTables:
        """The recording in arrays of several demonstrations."""
        if not self.options.on_disk:
            check_memory(BYTES_PER_NUMBER * self.n_steps, self.source, self.options.memory)
        for name in (*self.names["actions"], *self.names["observations"]):
            if self.arrays[name].dtype.hasobject:  # an error that says what to do where these are Python objects
                self.arrays[name][:]
        these, asked = self.turned(), as_list(self.options.observations)
        seen = next((name for name in (*asked, *self.names["observations"]) if name in self.arrays), "")
        cut = these.cut()
        ids, steps = these.steps(cut)
        ignored = {**dict.fromkeys(self.arrays.keys() - steps.keys() - {*_ASIDE}, NO_STEPS), **self.unread}
        names = as_names(self.values(self.names["names"][0]), self.source) if self.names["names"] else ()
        if len(names) == 1 and seen:
            steps[f"{seen}.{names[0]}"] = steps.pop(seen)
        parts, notes = [Part(len(ids), {**steps, cut.column: ids})], (*self.notes, *filter(None, [cut.note]))
        about = Metadata(names={seen: names})
        found = from_parts(parts, cut.column, self.source, self.kind, self.options, about, notes)
        return replace(found, ignored=ignored, sizes={self.source: len(ids)} if cut.is_step is None else {})

    def steps(self, cut: Cut) -> tuple[Array, dict[str, StoredArray]]:
        """The id of each step, and the arrays of all steps end to end.

        Of the arrays with one value for each demonstration (M,), those that the user names have this value at each
        step; where arrays are stacked, all of them.
        """
        options, is_step = self.options, cut.is_step
        found = {m: one for m, one in self.arrays.items() if m not in _ASIDE}

        def taken(name: str, rows: Callable[[Array], Array], n_left: int) -> Closed:
            shape = (len(ids), *self.arrays[name].shape[n_left:])
            return read_once(shape, self.arrays[name].dtype, lambda: np.asarray(rows(self.values(name))))

        outcomes = (name.removeprefix("-") for name in options.outcomes)
        named = {options.operator, options.session, options.task, *outcomes}
        each = [m for m, one in self.arrays.items() if len(one.shape) == 1 and m not in _ASIDE]
        if is_step is None:
            ids = cut.ids
            each = [m for m in each if self.arrays[m].shape != ids.shape and m in named]
            _, first, inverse = np.unique(ids if each else ids[:0], return_index=True, return_inverse=True)
            n, owners = len(first), np.argsort(np.argsort(first))[inverse]
        else:
            n, longest = is_step.shape
            owners = np.repeat(np.arange(n), is_step.sum(axis=1))
            ids, shapes = cut.ids[owners], ((n, longest), (n, longest + 1))
            own = [m for m, one in found.items() if one.shape[:2] in shapes]
            found = {m: taken(m, lambda values: values[:, :longest][is_step], 2) for m in own}
        whole = {m: taken(m, lambda values: values[owners], 1) for m in each if self.arrays[m].shape == (n,)}
        return ids, {**found, **whole} if is_step is None else {**whole, **found}


def _actions(arrays: Tree, options: ColumnOptions) -> list[str]:
    """The names of the arrays of actions: those that the user names, or else those that may be one, likeliest first."""
    named = [m for one in as_list(options.action) for m in (one, *fnmatch.filter(arrays, one))]
    for names in (named, ROLES["actions"]):
        if there := [name for name in names if name in arrays]:
            return there
    return [name for one, _ in ACTION_COLUMNS[:2] for name in arrays if one.fullmatch(plain_name(name))]


def _by_lengths(these: Arrays) -> Array | None:
    lengths = these.values(these.names["lengths"][0])
    fits = lengths.ndim == 1 and lengths.dtype.kind in "iu" and lengths.sum() == these.n_steps and lengths.min() > 0
    return np.repeat(np.arange(len(lengths)), lengths) if fits else None


def _by_offsets(these: Arrays) -> Array | None:
    ends, n = these.values(name := these.names["offsets"][0]), these.n_steps
    lengths: Array = np.diff(ends.ravel().astype(np.int64), prepend=0)
    if ends.ndim != 1 or ends.dtype.kind not in "iu" or lengths.min(initial=0) < 0 or lengths.sum() != n:
        said = f"must hold rising numbers of steps, one a demonstration, up to the {n:,} of the actions"
        raise DataError(f"{these.source}: {name} {said}; write it again.")
    return np.repeat(np.arange(len(lengths)), lengths)


def _by_starts(these: Arrays) -> Array | None:
    starts = these.flags(these.names["starts"], (these.n_steps,))
    return np.asarray(np.cumsum(starts) - starts[0])


def _by_ends(these: Arrays) -> Array | None:
    ends = these.flags([*these.names["terminals"], *these.names["cuts"]], (these.n_steps,))
    return np.cumsum(ends) - ends if these.names["cuts"] or ends[:-1].any() else None


def _by_leaps(these: Arrays) -> Array | None:
    """By where the next observation is not the following one; a `DataError` where it is so nearly everywhere."""
    if not these.names["observations"]:
        return None
    following, seen, n = these.names["next"][0], these.names["observations"][0], these.n_steps
    if these.shape("next") != these.shape("observations") or these.shape("next")[0] != n:
        shapes = f"{following} has the shape {these.shape('next')} and {seen} {these.shape('observations')}"
        raise DataError(f"{these.source}: {shapes} for {n:,} actions; write both for every step.")
    then, now = these.values(following)[:-1], these.values(seen)[1:]
    differs = (then != now) & ((then == then) | (now == now))  # a value that is missing in both is the same
    leaps = np.append(differs.any(axis=tuple(range(1, differs.ndim))), False)
    if 2 * leaps.sum() > n:
        fault = f"after {leaps.sum():,} of {n:,} steps, {following} is not the following observation"
        remedy = "use the file before it was shuffled, or add timeouts"
        raise DataError(f"{these.source}: {fault}, so that the order of the steps was lost; {remedy}.")
    ends = leaps | these.flags(these.names["terminals"], (n,))
    return np.cumsum(ends) - ends


def _by_group(these: Arrays) -> Array | None:
    is_one = any(name.startswith("observations/") for name in these.arrays)
    return np.full(these.n_steps, PurePath(these.source).stem) if is_one else None


_LEAPS = "There are no timeouts: demonstrations end at terminals, and where {} is not the following observation."
_TERMINALS = "Demonstrations end at terminals alone: without timeouts, one that was cut short is joined to the next."
_ROWS: tuple[tuple[tuple[str, ...], Callable[[Arrays], Array | None], str], ...] = (
    (("lengths",), _by_lengths, "Demonstrations are as long as {} says."),
    (("offsets",), _by_offsets, ""),
    (("starts",), _by_starts, "Demonstrations begin at {}."),
    (("terminals", "cuts"), _by_ends, "Demonstrations end at {}."),
    (("next",), _by_leaps, _LEAPS),
    (("terminals",), _by_ends, _TERMINALS),
    (("actions",), _by_group, "All steps of the file are one demonstration."),  # as ALOHA writes it
)
"""Roles that tell demonstrations apart where arrays lie end to end and no array of ids does: the arrays, of which
the last one must be there, the number of the demonstration of each step, and how it was told."""
