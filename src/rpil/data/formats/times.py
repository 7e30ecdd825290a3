"""What a recording says about its own times: timestamps, the frame rate, and how many frames there should be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.formats import robomimic
from rpil.data.formats.dialect import TEXT_SUFFIXES, find_dialect
from rpil.data.formats.names import EPISODE
from rpil.data.formats.parquet_pages import check_table
from rpil.data.guard import guard
from rpil.data.json_files import LARGEST_TABLE, parse_lines, read_json, read_text
from rpil.numerics.types import Array, Float

TIMESTAMP = ("timestamp", "timestamps")


@dataclass(frozen=True, eq=False)
class Times:
    """What a recording says about its times and lengths.

    Attributes
    ----------
    timestamps : (N,) array, optional
        Time of each step in seconds, in the order of the demonstrations.
    fps : float, optional
        Frames a second.
    frames : mapping of id to int
        Frames that each demonstration should have.
    """

    timestamps: Float[Array, " N"] | None = None
    fps: float | None = None
    frames: Mapping[Id, int] = field(default_factory=dict)


@guard
def read_times(path: StrPath, ids: Sequence[Id], id_column: str | None = None) -> Times:
    """The times of a Parquet file, a folder of such files (LeRobot's with what ``meta`` says), or a text table.

    Arrays of an NPZ file are read as well; robomimic's HDF5 says only how many steps there should be.

    `ids` are those of the demonstrations, in order, and `id_column` is the column that holds them, by default
    "episode_index". A column ``timestamp`` or an array ``timestamps`` holds seconds; where there is none, times are not
    known.
    """
    place, id_column = Path(str(path)), id_column or EPISODE[0]
    if "://" in str(path) or not place.exists():
        return Times()
    if place.suffix.lower() == ".npz":
        return Times(_npz_timestamps(place, ids))
    if robomimic.is_mine(place):
        return Times(frames=robomimic.stated_lengths(place))
    timestamps = _table_timestamps(place, id_column, ids)
    meta = place / "meta"
    if not (meta / "info.json").is_file():
        return Times(timestamps)
    try:
        fps = read_json(meta / "info.json").get("fps")
    except (ValueError, AttributeError) as error:
        raise DataError(f"{meta / 'info.json'}: it is not the description of a data set; write it again.") from error
    known = isinstance(fps, int | float) and not isinstance(fps, bool) and 0 < fps < np.inf
    return Times(timestamps, float(fps) if known else None, _frames(meta))


def _npz_timestamps(path: Path, ids: Sequence[Id]) -> Array | None:
    with np.load(path, allow_pickle=False) as stored:
        name = next((name for name in TIMESTAMP if name in stored.files), None)
        episode = next((name for name in ("episode_ids", *EPISODE) if name in stored.files), None)
        return None if name is None or episode is None else _in_order(stored[name], stored[episode], ids)


def _table_timestamps(path: Path, id_column: str, ids: Sequence[Id]) -> Array | None:
    """From Parquet, or from one table of text; None from other files."""
    import pyarrow as pa
    from pyarrow import csv, dataset

    from rpil.data.formats.store import find_files

    try:
        if path.is_file() and path.name.lower().endswith(TEXT_SUFFIXES):
            dialect = find_dialect(path)
            options = csv.ConvertOptions(column_types={id_column: pa.string()}, decimal_point=dialect.decimal)
            rows = csv.ReadOptions(
                skip_rows=dialect.skip_rows, column_names=dialect.names, encoding=dialect.encoding, use_threads=False
            )
            table = csv.read_csv(path, rows, csv.ParseOptions(delimiter=dialect.separator), options)
        else:
            filesystem, files, _ = find_files(path)
            opened = dataset.dataset(files, filesystem=filesystem)
            table = opened.to_table([name for name in (id_column, *TIMESTAMP) if name in opened.schema.names])
    except (pa.ArrowException, OSError, DataError):
        return None  # the demonstrations were read, so that there is no error to report
    name = next((name for name in TIMESTAMP if name in table.column_names), None)
    if name is None or id_column not in table.column_names:
        return None
    return _in_order(table[name].to_numpy(), table[id_column].to_numpy(), ids)


def _in_order(times: Array, episodes: Array, ids: Sequence[Id]) -> Array | None:
    """Times in the order of the demonstrations; None where they are no numbers, or the rows are not those of `ids`."""
    if times.dtype.kind not in "iuf" or times.ndim != 1 or len(times) != len(episodes):
        return None
    values, inverse = np.unique(episodes.astype(str), return_inverse=True)
    number = {str(name): m for m, name in enumerate(ids)}
    if any(value not in number for value in values.tolist()):
        return None
    owner = np.array([number[value] for value in values.tolist()])[inverse]
    return np.asarray(times[np.argsort(owner, kind="stable")], dtype=np.float64)


def _frames(meta: Path) -> dict[Id, int]:
    """LeRobot's lengths by episode: of version 3 in ``episodes/``, before in ``episodes.jsonl``."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        if (meta / "episodes.jsonl").is_file():
            path = meta / "episodes.jsonl"
            rows = parse_lines(read_text(path, LARGEST_TABLE), str(path), LARGEST_TABLE)
        else:
            files = sorted((meta / "episodes").rglob("*.parquet"))
            for file in files:
                check_table(file)
            rows = [row for f in files for row in pq.read_table(f, columns=["episode_index", "length"]).to_pylist()]
        return {int(row["episode_index"]): int(row["length"]) for row in rows}
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"{meta}: it does not say how long each episode is, or is damaged; write it again.") from error
