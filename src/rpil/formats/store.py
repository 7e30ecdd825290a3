"""The rows of Parquet files: where they are and which columns they have; read in batches, on any file system."""

from __future__ import annotations

import glob
import itertools
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import PurePath, PurePosixPath
from typing import TYPE_CHECKING, Literal

import numpy as np

from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_exists
from rpil.data.folders import check_folder, check_inside, is_hidden
from rpil.data.guard import guard, guarded, one_line
from rpil.data.names import is_data
from rpil.formats import table as flat
from rpil.formats.column_search import find_columns
from rpil.formats.columns import ColumnOptions, Columns, check_unique
from rpil.formats.dialect import TEXT_SUFFIXES
from rpil.formats.lerobot import Metadata, read_metadata
from rpil.formats.parquet_pages import check_pages
from rpil.formats.table import Place
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq
    from pyarrow import fs

BATCH_ROWS = 65_536  # decoded at a time
_HEAD_COLUMNS = 2000  # whose first values are looked at
_BUFFER_BYTES = 1 << 18  # of a column, read at a time: a row group need not fit in memory


@dataclass(frozen=True)
class RowGroup:
    """Row group `number` of the file `path`: the rows ``first:last`` of the data set, from `row` on in the file."""

    path: str
    number: int
    first: int
    last: int
    row: int


@dataclass(frozen=True, eq=False)
class Store:
    """The row groups of a data set, in order, and the columns to read, which are the same in all files."""

    filesystem: fs.FileSystem
    groups: tuple[RowGroup, ...]
    columns: Columns
    names: tuple[str, ...]  # of the D observations
    widths: tuple[int, ...]  # number of observations that each column holds
    observation: np.dtype[np.generic]
    action: np.dtype[np.generic]
    n_parts: int = 0  # numbers of a continuous action, 0 where actions are discrete
    batch_rows: int = BATCH_ROWS

    def between(self, first: int, last: int) -> Store:
        """The store of the row groups that hold the rows ``first:last``."""
        return replace(self, groups=tuple(g for g in self.groups if g.first < last and first < g.last))

    @property
    def layout(self) -> tuple[object, ...]:
        """What must be the same in all files."""
        return self.columns, self.names, self.widths, np.dtype(self.action).kind, self.n_parts

    @property
    def data_columns(self) -> list[str]:
        """The columns that a block holds."""
        return [*self.columns.actions, *self.columns.observations]

    def file_of(self, row: int) -> str:
        """Name of the file that holds a row."""
        return next(PurePosixPath(g.path).name for g in self.groups if row < g.last)

    def tables(
        self, first: int, last: int, columns: list[str], demonstration: Place = lambda _: ""
    ) -> Iterator[tuple[int, pa.Table, Place]]:
        """Rows ``first:last`` in tables: the first row of each, the table, and the place of a row of it for messages.

        `demonstration` names the demonstration of a row of the data set.
        """
        import pyarrow as pa

        for path, groups in itertools.groupby(self.between(first, last).groups, key=lambda group: group.path):
            with opened(self.filesystem, path) as file:
                for group in groups:
                    name = PurePosixPath(path).name
                    n_rows = group.last - group.first
                    if group.number >= file.num_row_groups or file.metadata.row_group(group.number).num_rows != n_rows:
                        raise DataError(f"{name}: it has changed since the data set was opened; open it again.")
                    row, shift = group.first, group.row - group.first
                    for batch in file.iter_batches(self.batch_rows, [group.number], columns, use_threads=False):
                        a, b = max(first - row, 0), min(last - row, len(batch))
                        if a < b:
                            table = pa.Table.from_batches([batch.slice(a, b - a)])
                            if any(pa.types.is_dictionary(field.type) for field in table.schema):
                                table.validate(full=True)  # text from a damaged file need not be Unicode
                            yield row + a, table, _place(path, row + a, shift, demonstration)
                        row += len(batch)
                    if row != group.last:
                        raise ValueError(f"{row - group.first} of {n_rows} rows are there")

    def statistics(self) -> Statistics:
        """The ranges of the columns that hold data, and their missing values, from one reading of all rows."""
        found = Statistics()
        for _, table, _ in self.tables(0, self.groups[-1].last, self.columns.data):
            found.add(table)
        return found

    def empty(self, n_steps: int) -> tuple[Array, Array]:
        """Uninitialised observations (n_steps, D) and actions, (n_steps,) or (n_steps, A)."""
        # As in the files, so that nothing is transposed.
        order: Literal["F", "C"] = "F" if max(self.widths) == 1 else "C"
        shape = (n_steps, self.n_parts) if self.n_parts else (n_steps,)
        return np.empty((n_steps, len(self.names)), self.observation, order), np.empty(shape, self.action)

    def fill(self, observations: Array, actions: Array, table: pa.Table, at: Place) -> None:
        """Write the rows of `table` to the two arrays."""
        with guarded(at(0)):
            _fill(observations, table, self.columns.observations, self.widths, at)
            self.fill_actions(actions, table, at)

    def fill_actions(self, actions: Array, table: pa.Table, at: Place) -> None:
        """Write the actions of `table`, which needs no other columns, to the array."""
        n_columns = len(self.columns.actions)
        per_column = self.n_parts // n_columns if self.n_parts else 1
        _fill(actions.reshape(len(actions), -1), table, self.columns.actions, (per_column,) * n_columns, at)


def _fill(out: Array, table: pa.Table, names: Sequence[str], widths: Sequence[int], at: Place) -> None:
    start = 0
    for name, width in zip(names, widths, strict=True):
        block = flat.column_values(table, name, at)
        block = block.reshape(len(block), -1)
        if block.shape[1] != width:
            raise DataError(f"{at(0)}: column {name!r} holds {block.shape[1]} numbers, not {width} as elsewhere.")
        out[:, start : start + width] = block
        start += width


def shifted(at: Place, rows: int) -> Place:
    """`at` for a table without its first `rows`."""
    return lambda row: at(rows + row)


@contextmanager
def opened(filesystem: fs.FileSystem, path: str) -> Iterator[pq.ParquetFile]:
    """The open file, whose pages are checked as they are read; a `DataError` where it is no Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    name = PurePosixPath(path).name
    try:
        # Neither mapped into memory, where mapped pages stay and count, nor fetched by whole row groups.
        options = {"buffer_size": _BUFFER_BYTES, "pre_buffer": False, "page_checksum_verification": True}
        with filesystem.open_input_file(path) as stream, pq.ParquetFile(stream, **options) as file:
            # A text that repeats stays in memory once.
            texts = [field.name for field in file.schema_arrow if pa.types.is_string(field.type)]
            yield pq.ParquetFile(stream, metadata=file.metadata, read_dictionary=texts, **options) if texts else file
    except FileNotFoundError as error:
        raise DataError(f"{path}: there is no such file here; check the path.") from error
    except PermissionError as error:
        raise DataError(f"{path}: it may not be read; change its permissions.") from error
    except DataError:
        raise
    except Exception:
        fault = "not a Parquet file, or a damaged or truncated one"
        if _is_unfinished(filesystem, path):
            fault = "a damaged or truncated Parquet file, which was never finished, as when a recording is cut off"
        with guarded(name, fault, "write it again"):
            raise


def _is_unfinished(filesystem: fs.FileSystem, path: str) -> bool:
    """Whether a file begins as Parquet does, and lacks the end."""
    with filesystem.open_input_file(path) as stream:
        size = stream.size()
        return bool(size > 8 and stream.read_at(4, 0) == b"PAR1" != stream.read_at(4, size - 4))


def may_be_many_files(path: StrPath) -> bool:
    """Whether `path` may name several files: a folder, a pattern, an address."""
    return "://" in str(path) or os.path.isdir(path) or (not os.path.exists(path) and glob.has_magic(str(path)))


@guard
def find_files(path: StrPath) -> tuple[fs.FileSystem, list[str], list[str]]:
    """The file system, and the Parquet files and the text tables of a data set in the order of their names.

    A `DataError` where `path` does not exist or cannot be listed.
    """
    import pyarrow as pa
    from pyarrow import fs

    where = str(path)
    try:
        if "://" in where:
            filesystem, place = fs.FileSystem.from_uri(where)
        else:
            filesystem, place = fs.LocalFileSystem(), os.path.abspath(where)
            if not os.path.exists(place) and glob.has_magic(place):
                return filesystem, *_matches(place)
            check_exists(where)
        if isinstance(filesystem, fs.LocalFileSystem):
            check_folder(place)
        kind = filesystem.get_file_info(place).type
        if kind == fs.FileType.NotFound:
            raise DataError(f"{where}: there is no such file or folder; check the path.")
        if kind == fs.FileType.File:
            return filesystem, *_tables([place], place)
        # LeRobot keeps the steps in data/, and tables of other things in meta/.
        data = f"{place}/data"
        place = data if filesystem.get_file_info(data).type == fs.FileType.Directory else place
        entries = filesystem.get_file_info(fs.FileSelector(place, recursive=True))
    except ImportError as error:
        reason = one_line(error)
        raise DataError(f"{where}: addresses of this kind need a package of their own ({reason}).") from error
    except PermissionError:  # which the guard names
        raise
    except (pa.ArrowException, OSError) as error:
        raise DataError(f"{where}: it cannot be listed ({one_line(error)}); check the path.") from error
    return filesystem, *_tables(sorted(info.path for info in entries if info.type == fs.FileType.File), place)


def _matches(pattern: str) -> tuple[list[str], list[str]]:
    """The tables that a pattern matches; no link may lead out of the folder in which it begins."""
    found = _tables(sorted(glob.glob(pattern, recursive=True)), pattern)
    top = next(folder for folder in PurePath(pattern).parents if not glob.has_magic(str(folder)))
    for path in itertools.chain(*found):
        check_inside(path, top)
    return found


def _tables(paths: list[str], top: str) -> tuple[list[str], list[str]]:
    """The Parquet files and the text tables among files, but for those in hidden folders of `top`."""
    shown = [p for p in paths if not PurePosixPath(p).name.startswith((".", "_"))]
    shown = [p for p in shown if not is_hidden(p.removeprefix(top).lstrip("/"))]
    return [p for p in shown if p.lower().endswith(".parquet")], [p for p in shown if p.lower().endswith(TEXT_SUFFIXES)]


@dataclass(eq=False)
class Statistics:
    """Smallest and largest values and numbers of missing ones by column.

    They are those of the values: to read what the footer of a damaged file says of them would end the process.
    """

    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    missing: dict[str, int] = field(default_factory=dict)

    def add(self, table: pa.Table) -> None:
        """Add the values of a table."""
        for name in table.column_names:
            values = flat.numbers_or_missing(table[name])
            if values is None or not values.size:
                continue
            n_missing = int(np.isnan(values).sum())
            if n_missing:
                self.missing[name] = self.missing.get(name, 0) + n_missing
            if n_missing < values.size:
                low, high = self.ranges.get(name, (np.inf, -np.inf))
                self.ranges[name] = float(min(low, np.nanmin(values))), float(max(high, np.nanmax(values)))


def columns_of_file(filesystem: fs.FileSystem, path: str, file: pq.ParquetFile, options: ColumnOptions) -> Columns:
    """The columns of an open file, by their names, types and first values; a `DataError` where these are too large."""
    import pyarrow as pa

    schema, name = file.schema_arrow, PurePosixPath(path).name
    check_unique(schema.names, name)
    kinds = {field.name: flat.kind_of_type(field.type) for field in schema} if file.metadata.num_rows else {}
    # Of images no value is read, and of very many columns the types are enough.
    plain = [name for name, kind in kinds.items() if kind in ("number", "text")][:_HEAD_COLUMNS]
    check_pages(filesystem, path, file, plain)
    head = next(file.iter_batches(flat.HEAD_ROWS, columns=plain), None)
    if head is not None:
        kinds |= flat.kinds_of(pa.Table.from_batches([head]))
    return find_columns(schema.names, kinds, name, options)


def check_columns(file: pq.ParquetFile, columns: Columns, name: str, first: str) -> None:
    """A `DataError` where the file `name` lacks columns that are read, or has more that hold data, than `first`."""
    names, known = set(file.schema_arrow.names), {*columns.all, *columns.ignored}
    if not names.issuperset(columns.all) or any(is_data(other) for other in names - known):
        raise DataError(f"{name}: its columns are not those of {first}; give all files the same ones.")


def describe(
    filesystem: fs.FileSystem, paths: list[str], options: ColumnOptions = ColumnOptions()
) -> tuple[Store, Metadata]:
    """The store of the files `paths`, and what they say of themselves; a `DataError` where their columns differ."""
    with opened(filesystem, paths[0]):  # damaged data are named before damaged metadata
        metadata = read_metadata(filesystem, paths)
    groups: list[RowGroup] = []
    columns, first, store, begins = None, "", None, 0
    for path in paths:
        name = PurePosixPath(path).name
        with opened(filesystem, path) as file:
            row = 0
            for number in range(file.num_row_groups):
                n_rows = file.metadata.row_group(number).num_rows
                groups.append(RowGroup(path, number, begins + row, begins + row + n_rows, row))
                row += n_rows
            begins += row
            columns, first = columns or columns_of_file(filesystem, path, file, options), first or name
            check_columns(file, columns, name, first)
            check_pages(filesystem, path, file, columns.all)
            head = next(file.iter_batches(1, columns=columns.data), None)
        if head is not None:
            this = _store_of_row(filesystem, columns, head, name, metadata)
            if store is None:
                store = this
            elif this.layout != store.layout:
                raise DataError(f"{name}: its columns are not those of {first}; give all files the same ones.")
            else:
                store = replace(store, observation=np.result_type(store.observation, this.observation))
    if store is None:
        raise DataError(f"{paths[0]}: there are no demonstrations; give at least one with at least one step.")
    return replace(store, groups=tuple(groups)), metadata


def _store_of_row(
    filesystem: fs.FileSystem, columns: Columns, head: pa.RecordBatch, name: str, metadata: Metadata
) -> Store:
    """The store of a file by its first row; later, all rows decide whether single floats are discrete actions."""
    import pyarrow as pa

    table = pa.Table.from_batches([head])
    observations, names = flat.stack_columns(table, columns.observations, lambda _: name, metadata.names)
    widths = tuple(flat.column_values(table, column, lambda _: name).size for column in columns.observations)
    first = flat.column_values(table, columns.actions[0], lambda _: name)
    n_parts = 0
    if columns.one_action and (first.dtype.kind != "f" or first.ndim == 1) and first.size == 1:
        action = first.dtype if first.dtype.kind in "fU" else np.dtype(np.int64)
    else:
        actions = flat.stack_columns(table, columns.actions, lambda _: name)[0]
        action, n_parts = actions.dtype, actions.shape[1]
    return Store(filesystem, (), columns, names, widths, observations.dtype, action, n_parts)


def _place(path: str, first: int, shift: int, demonstration: Place) -> Place:
    return lambda row: f"{PurePosixPath(path).name}{demonstration(first + row)}, row {first + row + shift + 1}"
