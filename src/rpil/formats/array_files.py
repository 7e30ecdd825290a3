"""NPZ, HDF5 and Zarr: named arrays by the table of layouts; also a folder with a file for each demonstration."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import replace
from functools import partial
from pathlib import Path
from zipfile import ZipFile

import numpy as np

from rpil.data.archive import MEMBER, array_head, read_arrays, write_npz
from rpil.data.arrays import Id
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError, guarded
from rpil.data.files import replacing
from rpil.data.memory import object_in, read_json
from rpil.data.text import STEP, TASK, TIMESTAMP, is_observation, may_be_outcome, natural_key, plain_name
from rpil.formats.array_layout import ROLES, Arrays
from rpil.formats.columns import ColumnOptions
from rpil.formats.containers import ZIP, is_zarr, keep_groups, open_hdf5, open_zarr
from rpil.formats.format import Format, Metadata, StepTables, called
from rpil.formats.parquet import frame_rate
from rpil.formats.scan import commas, without_damaged
from rpil.formats.step_arrays import Closed, Part, StoredArray, Tree, from_parts, read_once
from rpil.formats.table import step_columns
from rpil.formats.table_folder import has_tables
from rpil.numerics.types import Array

_NPZ, _HDF5 = (".npz",), (".hdf5", ".h5")
_FILE_NAME, _GROUP_NAME = "name of the file", "name of the group"
_STATES = "There are no observations: the simulator's states are used; dataset_states_to_obs.py writes some."

_OBJECTS = "ep_meta", "env_args", "env_info"
_ATTRIBUTES = {
    "task": ("ep_meta/lang", "env_args/env_name", "env_info/env_name", "env_args/env_kwargs/env_name", "env"),
    "rate": tuple(f"{m}/control_freq" for m in ("env_args", "env_info", "env_args/env_kwargs", "env_info/env_kwargs")),
}
"""The attributes of a group that say its task and its steps a second, with the keys in an object of JSON there."""


def claims(path: Path) -> bool:
    """Whether `path` is such a file, by its name, or a folder of such files and of no tables."""
    is_file = is_zarr(path) or called(*_NPZ, *_HDF5)(path)
    return is_file or (path.is_dir() and not has_tables(path) and bool(_files(path)))


def _open(path: Path, options: ColumnOptions = ColumnOptions(), where: str = "") -> Arrays:
    """The arrays in a file, which is called `where` in messages; those of NPZ are read as a whole."""
    if is_zarr(path):
        return open_zarr(path, options)
    if path.suffix.lower() in _HDF5:
        return open_hdf5(path, options)[1]
    archive, members = _open_npz(path, where := where or path.name)

    def stored(member: str) -> StoredArray:
        try:
            return read_once(*array_head(archive, member)[:2], lambda: read_arrays(archive, [member], where)[0])
        except ValueError:  # it is of another version, or no array: it has no rows
            return Closed((), np.dtype(object), lambda _: read_arrays(archive, [member], where)[0])

    return Arrays({member.removesuffix(MEMBER): stored(member) for member in members}, where, "NPZ", options)


def _open_npz(path: Path, where: str) -> tuple[ZipFile, list[str]]:
    """The open NPZ file, and its members that are arrays; a `DataError` where it is damaged, or two have one name."""
    with guarded(where, "not an NPZ file, or a damaged or truncated one", "write it again"):
        archive = ZipFile(path)
    members = [name for name in archive.namelist() if name.endswith(MEMBER)]
    if len({*members}) < len(members):
        raise DataError(f"{where}: it holds two arrays of one name; write it again.")
    return archive, members


def read(path: Path, options: ColumnOptions) -> StepTables:
    """Read the arrays of a file, or the demonstration in each file of a folder, opened again for its values."""
    if path.is_file() or is_zarr(path):
        arrays = _open(path, options)
        within, groups = arrays.groups()
        return _read_groups(arrays, within, groups) if groups else arrays.read()
    files = _files(path)
    found, damaged = without_damaged(files, lambda name: _part(name, files[name], path), options.skip_bad)
    notes = tuple(dict.fromkeys(note for _, of_file in found.values() for note in of_file))
    parts = [part for part, _ in found.values()]
    kind = "HDF5" if next(iter(files.values())).suffix.lower() in _HDF5 else "NPZ"
    tables = from_parts(parts, _FILE_NAME, path.name, f"{kind}, a file for each demonstration", options, notes=notes)
    return replace(tables, skipped=(*(files[name].name for name in damaged), *tables.skipped))


def _files(path: Path) -> dict[str, Path]:
    """The files in a folder by their names without the extension, with the numbers in names in order.

    HDF5 files come first. NPZ files may lie in a folder each, by whose name they are called.
    """
    for pattern, suffixes in (("*", _HDF5), ("*", _NPZ), ("*/*", _NPZ)):
        files = [file for file in path.glob(pattern) if file.suffix.lower() in suffixes and file.is_file()]
        files = [file for file in files if not any(part[0] == "." for part in file.relative_to(path).parts)]
        found = {file.stem if pattern == "*" else file.parent.name: file for file in files}
        for again in {*files} - {*found.values()}:
            raise DataError(f"{again}: another file here is of the same demonstration by its name; move one of them.")
        if found:
            return {name: found[name] for name in sorted(found, key=natural_key)}
    return {}


def _part(name: str, file: Path, top: Path) -> tuple[Part, tuple[str, ...]]:
    """The demonstration in one file, with what a text beside it says of its task and outcome, and notes.

    A `DataError` where there are no actions, or several demonstrations.
    """
    found, beside = {}, file.parent / "meta.json"
    if file.parent != top and beside.is_file():
        with guarded(beside, "no JSON, or damaged", "write it again"):
            found = read_json(beside)
    said = found.items() if isinstance(found, dict) else ()
    tasks = {m: value for m, value in said if TASK.fullmatch(plain_name(m)) and isinstance(value, str)}
    ends = {m: float(value) for m, value in said if may_be_outcome(m) and isinstance(value, int | float)}
    these = _open(file, where=f"{file.parent.name}/{file.name}")
    arrays, n, fault = these.arrays, these.n_steps, "in a folder each file is one demonstration, and here"
    if not these.names["actions"]:
        remedy = f"give the path of the file itself, call the array {ROLES['actions'][0]!r}, or take the file out"
        raise DataError(f"{these.source}: {fault} no array holds its actions; {remedy} of the folder.")
    several = [m for m in ("terminals", "timeouts") if m in arrays and these.flags([m], (n,))[:-1].any()]
    several += [m for m in these.shaped(((n,),), "ids") if len(np.unique(these.values(m))) > 1]
    if several:
        raise DataError(f"{these.source}: {fault} {several[0]} names several; give the path of the file itself.")

    def rows_of(name: str, rows: slice) -> object:
        return _open(file).arrays[name][rows]

    closed = {m: Closed(one.shape, one.dtype, partial(rows_of, m)) for m, one in arrays.items()}
    return Part(n, closed, {_FILE_NAME: name, **tasks, **ends}), these.notes


def _read_groups(these: Arrays, within: str, groups: Mapping[str, Part]) -> StepTables:
    """The recording in groups of arrays, as robomimic and Isaac Lab write it: the arrays that the first one has."""
    first, notes, options = next(iter(groups.values())).arrays, these.notes, these.options
    if "states" in first and not options.observations and not any(map(is_observation, first)):
        notes = (*notes, _STATES)
    names = dict.fromkeys(path.split("/")[1] for path in these.arrays if within and path.startswith(within))
    if without := commas([name for name in names if name not in groups]):
        notes = (*notes, f"Left out, because they are links, or hold no actions: {without}.")
    parts, lengths, of_all = list[Part](), dict[Id, int](), these.attributes(within or "/")
    rate, task = (_said(of_all, what) for what in ("rate", "task"))
    own = {name: these.attributes(within + name) for name in groups}
    groups_of = {**own, "all": of_all}.items()
    texts = {f"{m} of {name}": str(of[m][...]) for m in _OBJECTS for name, of in groups_of if m in of}
    if broken := [m for m, text in texts.items() if text[:1] == "{" and text.strip("{ }") and not object_in(text)]:
        notes = (*notes, f"Not read, because they hold no JSON: {commas(broken)}; write them again.")
    # An attribute `task` counts before what is said of all, where each group has one, and none says its own task.
    counts = all(_said(m, "task") is None and Part(1, m, {"": ""}).fact("task") is not None for m in own.values())
    for name, one in groups.items():
        about = {_GROUP_NAME: name, **({"task": m} if isinstance(m := _said(own[name], "task") or task, str) else {})}
        attributes = {m: value for m, value in own[name].items() if counts or m != "task" or m not in about}
        parts.append(replace(one, arrays={**attributes, **one.arrays}, about=about))
        lengths |= {name: stated} if type(stated := parts[-1].fact("num_samples")) is int else {}
    metadata = Metadata(fps=frame_rate(rate), lengths=lengths)
    name = f"{these.kind} of robomimic's layout" if within else f"{these.kind}, a group for each demonstration"
    return from_parts(parts, _GROUP_NAME, these.source, name, options, metadata, notes)


def _said(attributes: Tree, what: str) -> object:
    """Value of a group's attribute on the task or the rate, by `_ATTRIBUTES`; None where they say nothing."""
    for place in _ATTRIBUTES[what]:
        name, *keys = place.split("/")
        value = attributes[name][...] if name in attributes else None
        for key in keys:
            value = (value if isinstance(value, dict) else object_in(value)).get(key)
        if isinstance(value, str | int | float) and value:
            return value
    return None


def write(path: Path, demonstrations: Demonstrations, truth: Mapping[str, Array]) -> None:
    """Write the arrays that `read` reads, and each `truth`, (M,) or (N,), under its own name."""
    ids, numbers = step_columns(demonstrations.ids, demonstrations.offsets).values()
    arrays = {
        "observations": demonstrations.observations,
        "actions": demonstrations.actions,
        "episode_ids": ids,
        "observation_names": np.array(demonstrations.observation_names),
        **({STEP: numbers} if TIMESTAMP[0] in truth else {}),  # by which rows are sorted, and which may go back
    }
    with replacing(path) as temporary:
        write_npz(temporary, {**truth, **arrays})


def keep(path: Path, output: Path, ids: Set[str], options: ColumnOptions) -> None:
    """Write the demonstrations called `ids`, with all that the file says of them.

    In NPZ an array with one value for each step or demonstration is cut, any other is written whole.
    """
    if path.suffix.lower() in _HDF5:
        keep_groups(path, output, ids, options)
        return
    archive, members = _open_npz(path, path.name)
    names = (member.removesuffix(MEMBER) for member in members)
    arrays = dict(zip(names, read_arrays(archive, members, path.name), strict=True))
    owners = Arrays(arrays, path.name, options=options).cut().ids
    there = list(dict.fromkeys(owners.tolist()))
    kept = [m for m in there if str(m) in ids]
    rows = np.isin(owners, kept)
    # One value more comes after the last action.
    masks = {len(there): np.isin(there, kept), len(rows): rows, len(rows) + 1: np.append(rows, rows[-1])}
    own = {name: array for name, array in arrays.items() if array.shape and name not in ROLES["names"]}
    write_npz(output, arrays | {name: one[masks[len(one)]] for name, one in own.items() if len(one) in masks})


def unkept(path: Path, options: ColumnOptions) -> str:
    """Name of the data that `keep` writes no new file of, in words; empty where it writes one."""
    if path.is_dir() or is_zarr(path):
        return "Zarr" if is_zarr(path) else "file of arrays for each demonstration"
    arrays = _open(path, options)
    has_groups, is_hdf5 = bool(arrays.groups()[1]), path.suffix.lower() in _HDF5
    if is_hdf5 and has_groups and options.id:
        return "groups by other ids than their names"
    is_told = bool(arrays.names["ids"] or arrays.names["lengths"]) and not (has_groups or arrays.is_stacked)
    return "" if (has_groups if is_hdf5 else is_told) else "arrays of this layout"


FORMAT = Format("arrays", claims, read, keep, unkept, suffixes=(*_NPZ, *_HDF5, ZIP), write=write)
