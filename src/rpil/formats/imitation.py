"""Trajectories of the library imitation: a folder of Hugging Face's datasets, or an older NPZ file.

Their ``infos`` may hold Python objects that run code when they are decoded, so that they never are.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.files import check_extension, new_folder, replacing
from rpil.data.guard import guarded
from rpil.data.json_files import read_json
from rpil.data.memory import check_memory
from rpil.data.npy import opened_npz, write_npz
from rpil.formats import table as flat
from rpil.formats.arrow import read_ipc
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Format, keep_by_own_ids, kept_of
from rpil.formats.step_arrays import NO_STEPS, NUMBERED, Part, from_parts
from rpil.formats.step_tables import StepTables
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

_NOT_READ = {"infos": "never decoded, because that can run any code"}
_PICKLES = (".pkl", ".pickle")
_STEPS = ("obs", "acts", "rews")
_NPZ = ("obs", "acts", "indices", "terminal")
_STATE, _INFO, _STREAM = "state.json", "dataset_info.json", "data-00000-of-00001.arrow"


def claims(path: Path) -> bool:
    """Whether `path` is such a folder or NPZ file; or a pickle, which is refused."""
    if path.is_dir():
        return all((path / name).is_file() for name in (_STATE, _INFO)) and {"obs", "acts"} <= _features(path)
    return path.suffix.lower() in _PICKLES or _is_npz(path)


def read(path: Path, options: ColumnOptions) -> StepTables:
    """The recording in all trajectories, which are numbered from 0; a `DataError` where they are damaged."""
    if path.is_dir():
        table = _table(path)
        others = dict.fromkeys({*table.column_names} - {*_STEPS}, NO_STEPS)
        recording = _recording(_columns(table, path.name), path.name, "imitation", options)
        return recording.with_ignored(others | _NOT_READ)
    return _recording(_arrays(path), path.name, "imitation, NPZ", options).with_ignored(_NOT_READ)


def keep(path: Path, output: Path, ids: Sequence[Id]) -> None:
    """Write some trajectories to a new folder, with their infos as they are; or to an NPZ file, without infos."""
    if not path.is_dir():
        _keep_npz(path, check_extension(output, [".npz"]), ids)
        return
    table = _table(path)
    rows = kept_of(range(len(table)), ids, path)
    with new_folder(output) as folder:
        import pyarrow as pa

        with pa.ipc.new_stream(folder / _STREAM, table.schema) as stream:
            stream.write_table(table.take(rows))
        state = read_json(path / _STATE)
        mark = hashlib.sha256(f"{state.get('_fingerprint')}{rows}".encode()).hexdigest()[:16]  # of the datasets' cache
        state |= {"_data_files": [{"filename": _STREAM}], "_fingerprint": mark}
        (folder / _STATE).write_text(json.dumps(state))
        info = read_json(path / _INFO)
        (folder / _INFO).write_text(json.dumps({name: info[name] for name in info.keys() - {"splits"}}))


def _features(path: Path) -> set[str]:
    return {*read_json(path / _INFO)["features"]}


def _is_npz(path: Path) -> bool:
    with suppress(DataError):  # which the format NPZ names
        if path.suffix.lower() == ".npz":
            with opened_npz(path) as stored:
                return {*_NPZ} <= {*stored.names}
    return False


def _recording(
    columns: Mapping[str, Sequence[Array]], source: str, format_name: str, options: ColumnOptions
) -> StepTables:
    """The recording in arrays of each trajectory, which `columns` have one below the other."""
    names = list(columns)
    parts = [
        Part(len(arrays[names.index("acts")]), dict(zip(names, arrays, strict=True)), {NUMBERED: m})
        for m, arrays in enumerate(zip(*columns.values(), strict=True))
    ]
    return from_parts(parts, NUMBERED, source, format_name, options)


def _table(path: Path) -> pa.Table:
    """The table of the folder, a row for each trajectory, mapped into memory."""
    import pyarrow as pa

    with guarded(path.name, "it is damaged or truncated", "save it again"):
        files = [Path(file["filename"]).name for file in read_json(path / _STATE)["_data_files"]]
        tables = [read_ipc(path / name) for name in files]
        for table in tables:
            table.validate(full=True)
        return pa.concat_tables(tables)


def _columns(table: pa.Table, source: str) -> dict[str, list[Array]]:
    """The numbers of each trajectory in the columns that hold a list of steps."""
    import pyarrow as pa
    import pyarrow.compute as pc

    names = [name for name in _STEPS if name in table.column_names]
    check_memory(2 * table.select(names).nbytes, source)
    found = {}
    for name in names:
        if not pa.types.is_list(table[name].type):
            raise DataError(f"{source}: {name!r} holds {table[name].type}, not a list of steps; leave parts out.")
        if table[name].null_count:
            m = pc.index(pc.is_null(table[name]), True).as_py()
            raise DataError(f"{source}, demonstration {m}: it has no {name!r}; leave it out.")
        ends = np.cumsum(pc.list_value_length(table[name]).to_numpy())
        steps = pa.table({name: table[name].combine_chunks().flatten()})
        found[name] = np.split(flat.column_values(steps, name, _place_of_step(ends, source)), ends[:-1])
    return found


def _place_of_step(ends: Array, source: str) -> flat.Place:
    return lambda row: f"{source}, demonstration {np.searchsorted(ends, row, side='right')}"


def _arrays(path: Path) -> dict[str, list[Array]]:
    """The arrays of each trajectory in an NPZ file; ``indices`` are where all but the first begin."""
    source = path.name
    if path.suffix.lower() in _PICKLES:
        raise DataError(f"{source}: it is a pickle, which can run any code; load it with imitation and save a folder.")
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


def _keep_npz(path: Path, output: Path, ids: Sequence[Id]) -> None:
    arrays = _arrays(path)
    rows = kept_of(range(len(arrays["acts"])), ids, path)
    kept = {name: np.concatenate([parts[m] for m in rows]) for name, parts in arrays.items()}
    starts = np.cumsum([len(arrays["acts"][m]) for m in rows])[:-1]
    infos = np.full(len(kept["acts"]), "{}")  # the library wants one for each step
    with replacing(output) as temporary:
        write_npz(temporary, {**kept, "indices": starts, "infos": infos})


FORMAT = Format(name="imitation", claims=claims, read=read, keep=keep_by_own_ids(keep))
