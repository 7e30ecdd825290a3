"""NPZ: NumPy arrays by name, one row per step, read without ever unpickling anything."""

from __future__ import annotations

from collections.abc import Mapping, Set
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rpil.data.arrays import as_names
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import replacing
from rpil.data.names import quoted
from rpil.data.npy import Npz, opened_npz, write_npz
from rpil.formats import array_layout as layouts
from rpil.formats.columns import ColumnOptions, as_list
from rpil.formats.format import Format, StepTables, called, keep_one_file
from rpil.formats.step_arrays import Closed, read_once
from rpil.formats.table_facts import Metadata
from rpil.numerics.types import Array

_OPTIONAL = "observation_names"


def read(path: Path, options: ColumnOptions) -> StepTables:
    """Read the arrays as those of HDF5 are, and ``observation_names`` where they are there."""
    source = path.name
    with opened_npz(path) as stored:
        arrays, options = _by_role(arrays_of(stored), options, source)
        arrays |= _turned(arrays, layouts.time_first(arrays, source))
        named = arrays.pop(_OPTIONAL, None)
        names = () if named is None else as_names(np.asarray(named[:]), source)
        if len(names) == 1 and "observation" in arrays:
            arrays[f"observation.{names[0]}"] = arrays.pop("observation")
        found = layouts.read_arrays(arrays, source, "NPZ", options, metadata=Metadata(names={"observation": names}))
        damaged = dict.fromkeys({*stored.names} - {*arrays_of(stored)}, "no array that is known")
    sizes = {} if layouts.is_stacked(arrays) else {source: layouts.n_actions(arrays)}
    return replace(found.with_ignored(damaged), sizes=sizes)


def arrays_of(stored: Npz) -> dict[str, Closed]:
    """All arrays, each of which is read as a whole when some of it is first asked for."""
    found = {}
    for name in stored.names:
        with suppress(ValueError):  # of another version, or no array
            found[name] = read_once(*stored.declared(name), partial(stored.read_one, name))
    return found


def _by_role(arrays: layouts.Tree, options: ColumnOptions, source: str) -> tuple[dict[str, Any], ColumnOptions]:
    """The arrays, with the names "observation" and "action" for those that the user names, or that are called so; and
    the options but for these."""
    found = dict(arrays)
    for role, names, usual in (
        ("observation", options.observations, layouts.OBSERVATIONS),
        ("action", options.action, layouts.ACTIONS),
    ):
        given = as_list(names)
        name = layouts.first(arrays, given or usual)
        if name is None and not given:
            there = quoted(arrays) or "none"
            raise DataError(f"{source}: no array is called {usual[0]!r}; save it under that name (found {there}).")
        if name is not None and len(given) < 2:
            arrays[name][:]  # an error where it is damaged, or too large, or holds Python objects
            found = {role: arrays[name], **{other: one for other, one in found.items() if other not in (name, role)}}
            options = replace(options, action=()) if role == "action" else replace(options, observations=())
    return found, options


def _turned(arrays: layouts.Tree, shape: tuple[int, ...] | None) -> dict[str, Any]:
    """The arrays that are (T, M, ...) or (T + 1, M, ...) by the `shape` T and M, as (M, T, ...) or (M, T + 1, ...)."""
    own = [name for name in arrays if shape and arrays[name].shape[:2] in (shape, (shape[0] + 1, shape[1]))]
    return {name: np.swapaxes(np.asarray(arrays[name][:]), 0, 1) for name in own}


def write(path: Path, demonstrations: Demonstrations, truth: Mapping[str, Array]) -> None:
    """Write the arrays that `read` reads, and each `truth` (M,) under its own name."""
    arrays = {
        "observations": demonstrations.observations,
        "actions": demonstrations.actions,
        "episode_ids": np.repeat(np.array(demonstrations.ids), demonstrations.lengths),
        _OPTIONAL: np.array(demonstrations.observation_names),
    }
    with replacing(path) as temporary:
        write_npz(temporary, {**truth, **arrays})


def _keep_arrays(path: Path, output: Path, ids: Set[str], options: ColumnOptions) -> set[str]:
    """Write the arrays of an NPZ file with the rows, or the values, of the demonstrations `ids`; return the ids found.

    An array with one value for each step or demonstration is cut, any other is written whole; what is no array is not.
    """
    with opened_npz(path) as stored:
        arrays = stored.read(stored.names)
    layout = layouts.layout_of(_by_role(arrays, options, path.name)[0], path.name, options.id)
    layout = replace(layout, by_demonstration=layout.by_demonstration or layout.column in arrays)
    kept = [name for name in layout.names if str(name) in ids]
    added = layout.new_arrays(arrays, kept, path.name)
    rows = {name: layout.kept_rows(array, kept) for name, array in arrays.items() if name != _OPTIONAL}
    arrays |= {name: arrays[name][kept_rows] for name, kept_rows in rows.items() if kept_rows is not None}
    write_npz(output, {**arrays, **added})
    return {*map(str, kept)}


def _unkept(path: Path, options: ColumnOptions) -> str:
    """What `keep` writes no new file of, in words: stacked arrays."""
    with opened_npz(path) as stored:
        return "stacked arrays" if layouts.is_stacked(_by_role(arrays_of(stored), options, path.name)[0]) else ""


FORMAT = Format(
    name="NPZ",
    claims=called(".npz"),
    read=read,
    keep=keep_one_file(_keep_arrays),
    unkept=_unkept,
    suffixes=(".npz",),
    write=write,
)
