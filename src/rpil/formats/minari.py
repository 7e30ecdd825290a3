"""Minari data sets: ``data/metadata.json``, and the episodes in one HDF5 file, or in a folder each (Arrow, Parquet)."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpil.data.arrays import Id
from rpil.data.files import new_folder
from rpil.data.folders import check_inside, copy_folder
from rpil.data.guard import guarded
from rpil.data.json_files import object_in, read_json
from rpil.formats import hdf5
from rpil.formats import table as flat
from rpil.formats.arrow import from_arrow
from rpil.formats.columns import ColumnOptions
from rpil.formats.description import commas
from rpil.formats.format import Format, StepTables, kept_of
from rpil.formats.places import Cut, Cuts
from rpil.formats.step_arrays import MAX_MATRIX, NUMBERED, Part, from_parts, without_steps

if TYPE_CHECKING:
    import h5py
    import pyarrow as pa
    from pyarrow import dataset

_HDF5 = "main_data.hdf5"
_METADATA = "metadata.json"
_INFOS = "infos"
_IMAGES = "images"
_LAST = "The last observation of a demonstration, which comes after its last action, is left out."
_FOLDERS = ("arrow", "parquet")


def claims(path: Path) -> bool:
    """Whether this is the folder of a data set, its ``data``, or the HDF5 file in it."""
    return _find(path) is not None


def read(path: Path, options: ColumnOptions) -> StepTables:
    """The recording in all episodes; parts of Dict and Tuple spaces are columns such as ``observations/goal/0``.

    A `DataError` where a file is damaged.
    """
    data, about = _open(path)
    if object_in(about.get("action_space")).get("type") == "Discrete" and options.action_kind == "auto":
        options = replace(options, action_kind="discrete")
    environment = object_in(about.get("env_spec")).get("id")
    notes = (f"Environment: {commas([str(environment)])}.",) if environment else ()
    if not (data / _HDF5).exists():
        return _read_tables(data, about["data_format"], path.name, options, notes)
    with hdf5.opened(data / _HDF5) as file:
        parts = [_part(episode, number, options.fill_missing) for number, episode in _groups(file).items()]
        return from_parts(parts, NUMBERED, path.name, "Minari, HDF5", options, notes=notes)


def keep(path: Path, output: Path, ids: Sequence[Id], options: ColumnOptions, cuts: Cuts) -> None:
    """Write some episodes, numbered from 0, to the folder of a new data set, which Minari loads."""
    data, about = _open(path)
    with new_folder(output) as folder:
        new = folder / "data"
        new.mkdir()
        if (data / _HDF5).exists():
            lengths = _copy_groups(path, data, new, ids, cuts, output)
        else:
            lengths = _copy_folders(path, data, new, ids, cuts)
        n_bytes = sum(file.stat().st_size for file in new.rglob("*") if file.is_file())
        totals = {"total_episodes": len(lengths), "total_steps": sum(lengths), "dataset_size": round(n_bytes / 1e6, 1)}
        (new / _METADATA).write_text(json.dumps({**about, **totals}))


def _find(path: Path) -> Path | None:
    """The folder that holds the episodes."""
    folder = path.parent if path.name == _HDF5 else path / "data" if (path / "data").is_dir() else path
    if not folder.is_dir():
        return None
    if path.name == _HDF5:
        check_inside(folder / _METADATA, folder)  # which the path does not name
    if (folder / _HDF5).exists():
        return folder
    about = _json(folder / _METADATA)
    damaged = not about and (folder / _METADATA).exists() and _folders(folder)  # which `_open` refuses
    return folder if damaged or about.get("data_format") in _FOLDERS else None


def _open(path: Path) -> tuple[Path, dict[str, Any]]:
    """The folder that holds the episodes, and what the data set says of itself; tables need it, and HDF5 does not."""
    data = _find(path)
    assert data is not None
    with guarded(data / _METADATA):
        return data, (_json if (data / _HDF5).exists() else read_json)(data / _METADATA)


def _json(path: Path) -> dict[str, Any]:
    """The entries of a JSON file; none where it cannot be read."""
    with suppress(OSError, ValueError, RecursionError):
        if isinstance(found := read_json(path), dict):
            return found
    return {}


def _groups(file: h5py.File) -> dict[int, h5py.Group]:
    """The groups ``episode_7`` by their number."""
    found = {re.fullmatch(r"episode_(\d{1,18})", name): group for name, group in hdf5.groups(file).items()}
    return {int(match[1]): group for match, group in found.items() if match}


def _part(episode: h5py.Group, number: int, fills: bool = False) -> Part:
    arrays = {
        name.replace("/_index_", "/"): array
        for name, array in hdf5.Arrays(episode, fills).items()
        if not name.startswith(f"{_INFOS}/")
    }
    actions = (array for name, array in arrays.items() if name.partition("/")[0] == "actions" and array.shape)
    return Part(next((array.shape[0] for array in actions), 0), arrays, {NUMBERED: number})


def _copy_groups(path: Path, data: Path, new: Path, ids: Sequence[Id], cuts: Cuts, output: Path) -> list[int]:
    """Copy episodes to a new HDF5 file; the number of steps of each."""
    lengths = []
    with hdf5.opened(data / _HDF5) as old_file, hdf5.writing(new / _HDF5, output) as new_file:
        hdf5.copy_attributes(old_file, new_file)
        groups = _groups(old_file)
        for k, i in enumerate(kept_of(groups, ids, path)):
            if str(i) in cuts:
                hdf5.copy_cut(groups[i], new_file.create_group(f"episode_{k}"), cuts[str(i)], fills=True)
            else:
                old_file.copy(groups[i], new_file, f"episode_{k}")
            new_file[f"episode_{k}"].attrs["id"] = k
            lengths.append(_part(new_file[f"episode_{k}"], i).n_steps)
    return lengths


def _folders(data: Path) -> dict[int, Path]:
    """The folders of episodes by their number."""
    found = (folder for folder in data.iterdir() if folder.is_dir() and re.fullmatch(r"\d{1,18}", folder.name))
    return {int(folder.name): folder for folder in sorted(found, key=lambda folder: int(folder.name))}


def _read_tables(data: Path, kind: str, source: str, options: ColumnOptions, notes: tuple[str, ...]) -> StepTables:
    """The steps in folders that hold a table each; images are not read."""
    import pyarrow as pa
    from pyarrow import dataset

    tables, images, empty, n_left_out = [], {}, [], 0
    for number, folder in _folders(data).items():
        with guarded(f"{source}, demonstration {folder.name}", "it is damaged or truncated", "write it again"):
            stored = _stored(folder, kind)
            leaves = dict(_leaves(stored[0].physical_schema))
            images = {name: _IMAGES for name, (_, leaf) in leaves.items() if _is_image(leaf)}
            columns = {name: dataset.field(*path) for name, (path, _) in leaves.items() if name not in images}
            table = pa.concat_tables(one.to_table(columns=columns, use_threads=False) for one in stored)
            table.validate(full=True)  # or texts could be read from memory that is not theirs
        n_steps = _n_steps(folder, len(table))
        n_left_out += len(table) > n_steps
        empty += [] if n_steps else [number]
        tables.append(table.slice(0, n_steps).append_column(NUMBERED, pa.repeat(number, n_steps)))
    notes = (*notes, *([_LAST] if n_left_out else []), *without_steps(empty))
    table = flat.end_to_end(tables, source)
    return from_arrow(table, options, source, f"Minari, {kind}", notes).with_ignored(images)


def _stored(folder: Path, kind: str) -> list[dataset.Fragment]:
    """The tables of an episode, one below the other, which are not read yet."""
    import pyarrow as pa
    from pyarrow import dataset

    form = dataset.IpcFileFormat() if kind == "arrow" else dataset.ParquetFileFormat()
    return [form.make_fragment(pa.memory_map(str(file))) for file in sorted(folder.glob(f"*.{kind}"))]


def _n_steps(folder: Path, n_rows: int) -> int:
    """T of an episode in a folder, whose rows are T or T + 1."""
    given = _json(folder / _METADATA).get("total_steps")
    return given if given in (n_rows - 1, n_rows) else max(n_rows - 1, 0)


def _leaves(
    fields: Iterable[pa.Field], above: tuple[str, ...] = ()
) -> Iterator[tuple[str, tuple[tuple[str, ...], Any]]]:
    """The columns and the parts of structures but infos: name, path and type."""
    import pyarrow as pa

    for field in fields:
        path = (*above, field.name)
        if pa.types.is_struct(field.type) and field.name != _INFOS:
            yield from _leaves(field.type, path)
        elif field.name != _INFOS:
            yield "/".join(path), (path, field.type)


def _is_image(kind: pa.DataType) -> bool:
    import pyarrow as pa

    is_bytes = pa.types.is_fixed_size_list(kind) and pa.types.is_uint8(kind.value_type)
    return bool(pa.types.is_binary(kind) or (is_bytes and kind.list_size > MAX_MATRIX))


def _copy_folders(path: Path, data: Path, new: Path, ids: Sequence[Id], cuts: Cuts) -> list[int]:
    """Copy folders of episodes; the number of steps of each."""
    lengths = []
    folders, kind = _folders(data), _json(data / _METADATA)["data_format"]
    for k, i in enumerate(kept_of(folders, ids, path)):
        copy_folder(folders[i], new / str(k), without=(_METADATA,))
        about = {**_json(folders[i] / _METADATA), "id": k}
        if str(i) in cuts:
            _cut_tables(new / str(k), kind, cuts[str(i)])
            about["total_steps"] = cuts[str(i)].n_steps
        (new / str(k) / _METADATA).write_text(json.dumps(about))
        n_rows = sum(one.count_rows() for one in _stored(new / str(k), kind))
        lengths.append(_n_steps(new / str(k), n_rows))
    return lengths


def _cut_tables(folder: Path, kind: str, cut: Cut) -> None:
    """Write the tables of an episode as one, without the steps that are cut."""
    import pyarrow as pa
    from pyarrow import dataset

    table = pa.concat_tables(one.to_table(use_threads=False) for one in _stored(folder, kind))
    rows = [pa.array(cut.rows(name, len(table) - len(cut.places))) for name in table.column_names]
    columns = [column.take(one).combine_chunks() for column, one in zip(table.columns, rows, strict=True)]
    for file in folder.glob(f"*.{kind}"):
        file.unlink()
    there = {"basename_template": f"part-{{i}}.{kind}", "existing_data_behavior": "overwrite_or_ignore"}
    dataset.write_dataset(pa.table(columns, schema=table.schema), folder, format=kind, use_threads=False, **there)


FORMAT = Format(name="Minari", claims=claims, read=read, keep=keep, has_own_ids=True)
