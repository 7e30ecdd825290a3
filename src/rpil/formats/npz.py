"""NPZ: NumPy arrays by name, one row per step, read without ever unpickling anything."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from rpil.data.arrays import group_rows
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import replacing
from rpil.data.names import EPISODE, TIMESTAMP, may_be_outcome, quoted
from rpil.data.npy import Npz, opened_npz, write_npz
from rpil.formats import array_layout
from rpil.formats.array_layout import ACTIONS, OBSERVATIONS, ArrayLayout
from rpil.formats.columns import ColumnOptions, Columns, as_list
from rpil.formats.format import Format, keep_one_file
from rpil.formats.places import Cuts
from rpil.formats.recording import from_demonstrations
from rpil.formats.step_arrays import Closed, read_once
from rpil.formats.step_tables import StepTables
from rpil.numerics.types import Array

SPELLINGS = OBSERVATIONS, ACTIONS, ("episode_ids", *EPISODE)
_OPTIONAL = "observation_names"


def claims(path: Path) -> bool:
    """Whether `path` is a file that ends in .npz."""
    return path.is_file() and path.suffix.lower() == ".npz"


def read(path: Path, options: ColumnOptions) -> StepTables:
    """Read ``observations``, ``actions``, ``episode_ids`` and, where there, ``observation_names``, ``timestamps``.

    Arrays of another layout are read as those of HDF5.
    """
    source = path.name
    with opened_npz(path) as stored:
        found = stored.names
        if laid_out := _laid_out(stored, options):
            return array_layout.read_arrays(laid_out, source, "NPZ", options)
        wanted = _find_arrays(found, options, source)
        columns = _fact_columns(found, wanted, options, source)
        clock = _timestamps(stored, wanted[-1])
        optional = dict.fromkeys([_OPTIONAL, options.operator, clock, *columns.facts])
        arrays = stored.read([name for name in (*wanted, *optional) if name in found])
    observations, actions, steps = (arrays[name] for name in wanted)
    demonstrations = Demonstrations.from_groups(
        *(observations, actions, steps),
        observation_names=arrays.get(_OPTIONAL, ()),
        source=source,
        action_kind=options.action_kind,
        allows_missing=True,  # values are checked when they are asked for
    )
    if options.operator and options.operator not in arrays:
        raise DataError(f"{source}: it holds no {options.operator!r}; name one of {quoted(found)}.")
    ignored = dict.fromkeys((name for name in found if name not in arrays), "no array of demonstrations")
    ignored |= dict.fromkeys(columns.facts, "session or outcome")
    columns = replace(columns, ignored=ignored, operator=options.operator, times=(clock,) if clock else ())
    others = dict.fromkeys([*columns.times, *columns.facts, *([options.operator] if options.operator else [])])
    per_step = {name: _per_step(arrays[name], name, steps, demonstrations) for name in others}
    return from_demonstrations(demonstrations, "NPZ", columns, per_step)


def _laid_out(stored: Npz, options: ColumnOptions) -> dict[str, Closed]:
    """The arrays, where no ids of steps are among them but other arrays say which are a demonstration; else nothing."""
    names = [name for name in as_list(options.observations) or OBSERVATIONS if name in stored.names]
    has_ids = any(name in stored.names for name in SPELLINGS[-1])
    if options.id or (has_ids and not (names and len(stored.declared(names[0])[0]) == 3)):
        return {}
    arrays = arrays_of(stored)
    return arrays if array_layout.tells(arrays) else {}


def arrays_of(stored: Npz) -> dict[str, Closed]:
    """All arrays, each of which is read as a whole when some of it is first asked for."""
    return {name: read_once(*stored.declared(name), partial(stored.read_one, name)) for name in stored.names}


def _find_arrays(found: Iterable[str], options: ColumnOptions, source: str) -> list[str]:
    """Names of the arrays of observations, actions and ids among those `found`."""
    unused = [name for name in ("exclude", "order", "task") if getattr(options, name)]
    if unused:
        raise DataError(f"{source}: an NPZ file holds arrays and no columns; leave out {unused[0]}=.")
    wanted = []
    for given, usual in zip((options.observations, options.action, options.id or ()), SPELLINGS, strict=True):
        names = as_list(given) or usual
        name = next((name for name in names if name in found), None)
        if name is None:
            raise DataError(
                f"{source}: no array is called {names[0]!r}; save it under that name (found {quoted(found) or 'none'})."
            )
        wanted.append(name)
    return wanted


def _fact_columns(found: Iterable[str], wanted: Sequence[str], options: ColumnOptions, source: str) -> Columns:
    """The arrays of session and outcome; a `DataError` where there are none of these names, or they are `wanted`."""
    others = [name for name in found if name not in (*wanted, _OPTIONAL)]
    outcomes = tuple(filter(may_be_outcome, others))
    columns = Columns(wanted[-1], (), (), True, session=options.session, outcome=options.outcome, outcomes=outcomes)
    columns = replace(columns, action_kind=options.action_kind)
    unknown = [name for name in columns.facts if name not in others]
    if unknown:
        remedy = f"name one of {quoted(others)}" if others else "leave it out"
        raise DataError(f"{source}: it holds no array {unknown[0]!r} beside the demonstrations; {remedy}.")
    return columns


def _per_step(values: Array, name: str, steps: Array, demonstrations: Demonstrations) -> Array:
    """Values of steps, or of demonstrations, as one for each step, in the order of the demonstrations."""
    d = demonstrations
    if values.ndim != 1 or len(values) not in (d.n_steps, len(d)):
        raise DataError(
            f"{d.source}: {name!r} has the shape {values.shape}; give one value for each step or demonstration."
        )
    if len(values) != d.n_steps:
        return np.repeat(values, d.lengths)
    rows = group_rows(np.unique(steps, return_inverse=True)[1])[2]
    return values if rows is None else values[rows]


def _timestamps(stored: Npz, steps: str) -> str | None:
    """The array of times, if it says that it has a number for each of the `steps`: others are not read."""
    name = next((name for name in TIMESTAMP if name in stored.names), None)
    with suppress(ValueError):  # of another version, or no array
        if name is not None and stored.declared(name)[1].kind in "iuf":
            return name if stored.declared(name)[0] == stored.declared(steps)[0] else None
    return None


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


def _keep_arrays(path: Path, output: Path, ids: Set[str], options: ColumnOptions, cuts: Cuts) -> set[str]:
    """Write the arrays of an NPZ file with the rows, or the values, of the demonstrations `ids`; return the ids found.

    An array with one value for each step or demonstration is cut, any other is written whole; what is no array is not.
    """
    with opened_npz(path) as stored:
        arrays = stored.read(stored.names)
        laid_out = _laid_out(stored, options)
    if laid_out:
        layout = array_layout.layout_of(arrays, path.name)
    else:
        column = next(name for name in as_list(options.id or ()) or SPELLINGS[-1] if name in arrays)
        owners = arrays[column]
        owners = owners.astype(np.int64) if owners.dtype.kind == "f" else owners
        layout = ArrayLayout(column, owners, "", by_demonstration=True)
    kept = [name for name in layout.names if str(name) in ids]
    added = layout.new_arrays(arrays, kept, cuts, path.name)
    rows = {name: layout.kept_rows(name, array, kept, cuts) for name, array in arrays.items() if name != _OPTIONAL}
    arrays |= {name: arrays[name][kept_rows] for name, kept_rows in rows.items() if kept_rows is not None}
    for name, array in arrays.items():
        layout.cut_stacked(name, array, kept, cuts)
    write_npz(output, {**arrays, **added})
    return {*map(str, kept)}


FORMAT = Format(name="NPZ", claims=claims, read=read, keep=keep_one_file(_keep_arrays), suffixes=(".npz",), write=write)
