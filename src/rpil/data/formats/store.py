"""Where the rows of Parquet files are, and what they hold: read row group by row group, on any file system."""

from __future__ import annotations

import glob
import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.formats import table as flat

Where = Callable[[int], str]
"""Names a row of a table in messages."""

_BATCH = 65_536
"""Rows that are decoded at a time."""

_BUFFER = 1 << 18
"""Bytes of a column that are read at a time: a row group need not fit in memory."""


@dataclass(frozen=True)
class RowGroup:
    """Rows of a file that lie together: number `number` of `path`, rows ``first:last`` of the data set, the first of
    which is row `row` of the file."""

    path: str
    number: int
    first: int
    last: int
    row: int


@dataclass(frozen=True, eq=False)
class Store:
    """Where the rows of a data set are, and what they hold: the same in all files.

    Attributes
    ----------
    filesystem : pyarrow.fs.FileSystem
    groups : tuple of RowGroup
        In order.
    columns : Columns
    names : tuple of str
        Of the observations, D.
    widths : tuple of int
        How many of them each column holds.
    observation, action : dtype
    n_parts : int
        Numbers of a continuous action, 0 where actions are discrete.
    """

    filesystem: Any
    groups: tuple[RowGroup, ...]
    columns: flat.Columns
    names: tuple[str, ...] = ()
    widths: tuple[int, ...] = ()
    observation: Any = np.float64
    action: Any = np.int64
    n_parts: int = 0

    def between(self, first: int, last: int) -> Store:
        """The part of it that holds the rows ``first:last``."""
        return replace(self, groups=tuple(g for g in self.groups if g.first < last and first < g.last))

    @property
    def data_columns(self) -> list[str]:
        """The columns that a block holds."""
        return [*self.columns.actions, *self.columns.observations]

    def file_of(self, row: int) -> str:
        """Name of the file that holds a row."""
        return next(PurePosixPath(g.path).name for g in self.groups if row < g.last)

    def tables(
        self, first: int, last: int, columns: list[str], whose: Where = lambda _: ""
    ) -> Iterator[tuple[int, Any, Where]]:
        """Rows ``first:last``: tables, which row each begins with, and how messages name a row of it, for which `whose`
        tells the demonstration."""
        import pyarrow as pa

        for path, groups in itertools.groupby(self.between(first, last).groups, key=lambda group: group.path):
            with opened(self.filesystem, path) as file:
                for group in groups:
                    name = PurePosixPath(path).name
                    try:
                        n_rows = file.metadata.row_group(group.number).num_rows
                    except IndexError:
                        n_rows = -1
                    if n_rows != group.last - group.first:
                        raise DataError(f"{name}: it has changed since the data set was opened; open it again.")
                    row, shift = group.first, group.row - group.first
                    batches = file.iter_batches(_BATCH, row_groups=[group.number], columns=columns, use_threads=False)
                    for batch in batches:
                        a, b = max(first - row, 0), min(last - row, len(batch))
                        if a < b:
                            table = pa.Table.from_batches([batch.slice(a, b - a)])
                            yield row + a, table, _where(path, row + a, shift, whose)
                        row += len(batch)

    def empty(self, n_steps: int) -> tuple[NDArray[Any], NDArray[Any]]:
        """Room for the observations and actions of `n_steps`."""
        order: Any = "F" if max(self.widths) == 1 else "C"  # as the files have it: no transposing
        shape = (n_steps, self.n_parts) if self.n_parts else (n_steps,)
        return np.empty((n_steps, len(self.names)), self.observation, order), np.empty(shape, self.action)

    def fill(self, observations: NDArray[Any], actions: NDArray[Any], table: Any, where: Where) -> None:
        """The rows of `table`, written to where they belong."""
        _fill(observations, table, self.columns.observations, self.widths, where)
        self.fill_actions(actions, table, where)

    def fill_actions(self, actions: NDArray[Any], table: Any, where: Where) -> None:
        """The actions in `table`, which need have no other columns."""
        n_columns = len(self.columns.actions)
        per_column = self.n_parts // n_columns if self.n_parts else 1
        _fill(actions.reshape(len(actions), -1), table, self.columns.actions, (per_column,) * n_columns, where)


def _fill(out: NDArray[Any], table: Any, names: Sequence[str], widths: Sequence[int], where: Where) -> None:
    start = 0
    for name, width in zip(names, widths, strict=True):
        block = flat.values(table, name, where)
        block = block.reshape(len(block), -1)
        if block.shape[1] != width:
            raise DataError(f"{where(0)}: column {name!r} holds {block.shape[1]} numbers, not {width} as elsewhere.")
        out[:, start : start + width] = block
        start += width


def shifted(where: Where, rows: int) -> Where:
    """`where` for a table without its first `rows`."""
    return lambda row: where(rows + row)


@contextmanager
def opened(filesystem: Any, path: str) -> Iterator[Any]:
    """A ``pyarrow.parquet.ParquetFile`` whose pages are checked as they are read; a `DataError` where it is none."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    name = PurePosixPath(path).name
    try:
        # Neither mapped into memory, where what is mapped stays and counts, nor fetched by whole row groups.
        options = {"buffer_size": _BUFFER, "pre_buffer": False, "page_checksum_verification": True}
        with filesystem.open_input_file(path) as stream, pq.ParquetFile(stream, **options) as file:
            yield file
    except FileNotFoundError as error:
        raise DataError(f"{path}: there is no such file here; check the path.") from error
    except PermissionError as error:
        raise DataError(f"{path}: it may not be read; change its permissions.") from error
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise DataError(f"{name}: not a Parquet file, or a damaged or truncated one; write it again.") from error


def is_many(path: StrPath) -> bool:
    """Whether `path` is something that only a data set can read: a folder, a pattern, an address."""
    return "://" in str(path) or os.path.isdir(path) or (not os.path.exists(path) and glob.has_magic(str(path)))


def find_files(path: StrPath) -> tuple[Any, list[str]]:
    """The file system, and the Parquet files of a data set in the order of their names; a `DataError` if none."""
    import pyarrow as pa
    from pyarrow import fs

    where = str(path)
    try:
        if "://" in where:
            filesystem, place = fs.FileSystem.from_uri(where)
        else:
            filesystem, place = fs.LocalFileSystem(), os.path.abspath(where)
            if not os.path.exists(place) and glob.has_magic(place):
                return filesystem, _some(sorted(glob.glob(place, recursive=True)), where)
        kind = filesystem.get_file_info(place).type
        if kind == fs.FileType.NotFound:
            raise DataError(f"{where}: there is no such file or folder; check the path.")
        if kind == fs.FileType.File:
            return filesystem, _some([place], where)
        # LeRobot keeps the steps in data/, and tables of other things in meta/.
        data = f"{place}/data"
        place = data if filesystem.get_file_info(data).type == fs.FileType.Directory else place
        listed = filesystem.get_file_info(fs.FileSelector(place, recursive=True))
    except (pa.ArrowException, OSError) as error:
        raise DataError(f"{where}: it cannot be listed ({' '.join(str(error).split())[:100]}).") from error
    return filesystem, _some(sorted(info.path for info in listed if info.type == fs.FileType.File), where)


def _some(paths: list[str], where: str) -> list[str]:
    found = [p for p in paths if p.lower().endswith(".parquet") and not Path(p).name.startswith((".", "_"))]
    if not found:
        raise DataError(f"{where}: no .parquet file is there; only Parquet files make a data set on disk.")
    return found


def describe(filesystem: Any, paths: list[str]) -> Store:
    """The row groups of `paths`, and what all of them hold; a `DataError` where they differ."""
    groups: list[RowGroup] = []
    first, store, begins = "", None, 0
    for path in paths:
        name = PurePosixPath(path).name
        with opened(filesystem, path) as file:
            row = 0
            for number in range(file.num_row_groups):
                n_rows = file.metadata.row_group(number).num_rows
                groups.append(RowGroup(path, number, begins + row, begins + row + n_rows, row))
                row += n_rows
            begins += row
            columns = flat.find_columns(file.schema_arrow.names, name)
            head = next(file.iter_batches(1, columns=columns.all), None)
        if head is not None:
            this = _contents(filesystem, columns, head, name)
            if store is None:
                first, store = name, this
            elif _same(this) != _same(store):
                raise DataError(f"{name}: its columns are not those of {first}; give all files the same ones.")
            else:
                store = replace(store, observation=np.result_type(store.observation, this.observation))
    if store is None:
        raise DataError(f"{paths[0]}: there are no demonstrations; give at least one with at least one step.")
    return replace(store, groups=tuple(groups))


def _contents(filesystem: Any, columns: flat.Columns, head: Any, name: str) -> Store:
    """What a file holds, from its first row; whether one number is a discrete action is to be seen."""
    import pyarrow as pa

    table = pa.Table.from_batches([head])
    observations, names = flat.stack(table, columns.observations, lambda _: name)
    widths = [flat.values(table, column, lambda _: name).size for column in columns.observations]
    one = flat.values(table, columns.actions[0], lambda _: name)
    kept = Store(filesystem, (), columns, names, tuple(widths), observations.dtype)
    if columns.one_action and (one.dtype.kind != "f" or one.ndim == 1) and one.size == 1:
        return replace(kept, action=one.dtype if one.dtype.kind in "fU" else np.dtype(np.int64))
    actions, _ = flat.stack(table, columns.actions, lambda _: name)
    single = actions.dtype == np.float32
    return replace(kept, action=np.dtype(np.float32 if single else np.float64), n_parts=actions.shape[1])


def _same(store: Store) -> tuple[Any, ...]:
    return store.columns, store.names, store.widths, np.dtype(store.action).kind, store.n_parts


def _where(path: str, first: int, shift: int, whose: Where) -> Where:
    return lambda row: f"{PurePosixPath(path).name}{whose(first + row)}, row {first + row + shift + 1}"
