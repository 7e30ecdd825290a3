"""Trajectories of the library imitation: a folder of Hugging Face's datasets, or an older NPZ file.

Their ``infos`` may hold Python objects that run code when they are decoded, so that they never are.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.files import check_extension, new_folder, replacing
from rpil.data.guard import guarded
from rpil.data.json_files import read_json
from rpil.data.npy import opened_npz, write_npz
from rpil.formats import table as flat
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Format, StepTables, kept_of
from rpil.formats.places import Cuts
from rpil.formats.step_arrays import NO_STEPS, NUMBERED, Part, from_parts
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

_STEPS = ("obs", "acts", "rews")
_NPZ = ("obs", "acts", "indices", "terminal")
_STATE, _INFO, _STREAM = "state.json", "dataset_info.json", "data-00000-of-00001.arrow"


def claims(path: Path) -> bool:
    """Whether `path` is such a folder or NPZ file."""
    if path.is_dir():
        there = all((path / name).is_file() for name in (_STATE, _INFO))
        return there and {"obs", "acts"} <= {*read_json(path / _INFO)["features"]}
    if path.suffix.lower() == ".npz":
        with suppress(DataError), opened_npz(path) as stored:  # which the format NPZ names
            return {*_NPZ} <= {*stored.names}
    return False


def read(path: Path, options: ColumnOptions) -> StepTables:
    """The steps of all trajectories, which are numbered from 0; a `DataError` where they are damaged."""
    others: dict[str, str] = {}
    if path.is_dir():
        table, names = _table(path, _STEPS)
        others = {name: NO_STEPS for name in names if name not in _STEPS}
        arrays = {name: _lists(table, name, path.name) for name in _STEPS if name in table.column_names}
    else:
        arrays = _arrays(path)
    parts = [
        Part(len(acts), {name: parts[m] for name, parts in arrays.items()}, {NUMBERED: m})
        for m, acts in enumerate(arrays["acts"])
    ]
    found = from_parts(parts, NUMBERED, path.name, "imitation" if path.is_dir() else "imitation, NPZ", options)
    return found.with_ignored(others | {"infos": "never decoded, because that can run any code"})


def keep(path: Path, output: Path, ids: Sequence[Id], options: ColumnOptions, cuts: Cuts) -> None:
    """Write some trajectories to a new folder, with their infos as they are; or to an NPZ file, without infos."""
    if not path.is_dir():
        _keep_npz(path, check_extension(output, [".npz"]), ids, cuts)
        return
    table, _ = _table(path)
    rows = kept_of(range(len(table)), ids, path)
    with new_folder(output) as folder:
        import pyarrow as pa

        with pa.ipc.new_stream(folder / _STREAM, table.schema) as stream:
            stream.write_table(_cut_table(table.take(rows), rows, cuts))
        state = read_json(path / _STATE)
        said = "".join(
            [f"{state.get('_fingerprint')}{rows}", *(f"{m}:{cut.first}:{cut.end}" for m, cut in cuts.items())]
        )
        mark = hashlib.sha256(said.encode()).hexdigest()[:16]  # of the datasets' cache
        state |= {"_data_files": [{"filename": _STREAM}], "_fingerprint": mark}
        (folder / _STATE).write_text(json.dumps(state))
        info = read_json(path / _INFO)
        (folder / _INFO).write_text(json.dumps({name: info[name] for name in info.keys() - {"splits"}}))


def _table(path: Path, chosen: Sequence[str] | None = None) -> tuple[pa.Table, list[str]]:
    """The table of the folder, a row for each trajectory, mapped into memory, and the names of all columns.

    Of the columns those `chosen` are read, by default all.
    """
    import pyarrow as pa

    with guarded(path.name, "it is damaged or truncated", "save it again"):
        files = [path / Path(file["filename"]).name for file in read_json(path / _STATE)["_data_files"]]
        streams = [pa.memory_map(str(file)) for file in files]
        names = pa.ipc.read_schema(streams[0]).names
        streams[0].seek(0)
        fields = None if chosen is None else [k for k, name in enumerate(names) if name in chosen]
        how = pa.ipc.IpcReadOptions(included_fields=fields)
        table = pa.concat_tables(pa.ipc.open_stream(stream, options=how).read_all() for stream in streams)
        table.validate(full=True)  # or values could be read from memory that is not theirs
        return table, names


def _lists(table: pa.Table, name: str, source: str) -> list[Array]:
    """The numbers of each trajectory in a column that holds a list of steps."""
    import pyarrow as pa

    if not pa.types.is_list(table[name].type):
        raise DataError(f"{source}: {name!r} holds {table[name].type}, not a list of steps; leave parts out.")
    column = table[name].combine_chunks()
    if column.null_count:
        m = column.is_null().index(True).as_py()
        raise DataError(f"{source}, demonstration {m}: it has no {name!r}; leave it out.")
    ends = np.cumsum(column.value_lengths().to_numpy())

    def place(row: int) -> str:
        return f"{source}, demonstration {np.searchsorted(ends, row, side='right')}"

    return np.split(flat.column_values(pa.table({name: column.flatten()}), name, place, allows_missing=True), ends[:-1])


def _arrays(path: Path) -> dict[str, list[Array]]:
    """The arrays of each trajectory in an NPZ file; ``indices`` are where all but the first begin."""
    source = path.name
    with opened_npz(path, remedy="save it again") as stored:
        arrays = stored.read([name for name in (*_NPZ, "rews") if name in stored.names])
    starts = arrays.pop("indices")
    if starts.ndim != 1 or (starts.size and starts.dtype.kind not in "iu") or not arrays["acts"].ndim:
        raise DataError(f"{source}: indices must be whole numbers, one for each trajectory but the first; repair them.")
    n_steps, n = len(arrays["acts"]), len(starts) + 1
    rising = np.diff([0, *starts.tolist(), n_steps])
    if np.any(rising < 0) or arrays["terminal"].shape != (n,) or np.shape(arrays["obs"])[:1] != (n_steps + n,):
        shapes = f"{arrays['obs'].shape} observations, {arrays['acts'].shape} actions, {n:,} trajectories"
        raise DataError(f"{source}: its arrays do not fit together ({shapes}); save it again.")
    of_observations = starts + np.arange(1, n)  # which each trajectory has one more of
    cuts = {name: of_observations if name == "obs" else starts for name in arrays} | {"terminal": np.arange(1, n)}
    return {name: np.split(array, cuts[name]) for name, array in arrays.items()}


def _cut_table(table: pa.Table, numbers: Sequence[int], cuts: Cuts) -> pa.Table:
    """The table of the trajectories of these numbers, whose lists hold the steps that are kept."""
    import pyarrow as pa

    for place, field in enumerate(table.schema):
        if cuts and pa.types.is_list(field.type) and not table[field.name].null_count:
            lists = [row.values for row in table[field.name]]
            for k, cut in ((k, cuts[str(m)]) for k, m in enumerate(numbers) if str(m) in cuts):
                rows = cut.rows_of(field.name, (len(lists[k]),))
                lists[k] = lists[k] if rows is None else lists[k].take(pa.array(rows))
            offsets = pa.array(np.cumsum([0, *map(len, lists)]), pa.int32())
            column = pa.ListArray.from_arrays(offsets, pa.concat_arrays(lists)).cast(field.type)
            table = table.set_column(place, field, column)
    return table


def _keep_npz(path: Path, output: Path, ids: Sequence[Id], cuts: Cuts) -> None:
    arrays = _arrays(path)
    numbers = kept_of(range(len(arrays["acts"])), ids, path)
    for name, parts in arrays.items():
        for m in (m for m in numbers if str(m) in cuts):
            rows = cuts[str(m)].rows_of(name, parts[m].shape)
            parts[m] = parts[m] if rows is None else parts[m][rows]
    kept = {name: np.concatenate([parts[m] for m in numbers]) for name, parts in arrays.items()}
    starts = np.cumsum([len(arrays["acts"][m]) for m in numbers])[:-1]
    infos = np.full(len(kept["acts"]), "{}")  # the library wants one for each step
    with replacing(output) as temporary:
        write_npz(temporary, {**kept, "indices": starts, "infos": infos})


FORMAT = Format(name="imitation", claims=claims, read=read, keep=keep, has_own_ids=True)
