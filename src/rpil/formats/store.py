"""The rows of Parquet files: where they are and which columns they have; read in batches, on any file system."""

from __future__ import annotations

import glob
import itertools
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import PurePath, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_exists, refuse_pointer
from rpil.data.folders import check_folder, check_inside, is_hidden
from rpil.data.guard import guarded, in_words
from rpil.data.names import OWN_TABLES, is_data, quoted
from rpil.formats import table as flat
from rpil.formats.column_search import find_columns
from rpil.formats.columns import ColumnOptions, Columns, Kind, check_names
from rpil.formats.dialect import TEXT_SUFFIXES
from rpil.formats.guesses import GUESSED_ROWS
from rpil.formats.layout import Layout
from rpil.formats.parquet_file import bytes_of_groups, check_sizes, check_table, input_file
from rpil.formats.rows import BATCH_ROWS, ChosenRows, names_at
from rpil.formats.spool import Copy
from rpil.formats.table import Place
from rpil.formats.table_facts import Metadata, file_names
from rpil.numerics.types import Array, Int

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq
    from pyarrow import fs

_HEAD_COLUMNS = 2000  # whose first values are looked at
_BUFFER_BYTES = 262_144  # of a column, read at a time: a row group need not fit in memory


@dataclass(frozen=True)
class RowGroup:
    """Row group `number` of the file `path`: the rows ``first:last`` of the data set, from `row` on in the file."""

    path: str
    number: int
    first: int
    last: int
    row: int


@dataclass(frozen=True, eq=False)
class ParquetRows:
    """The rows of Parquet files, which stay on disk: their row groups in order."""

    filesystem: fs.FileSystem
    groups: tuple[RowGroup, ...]
    n_bytes: int
    """Of all columns that are read, decoded, at most."""
    keeper: object = None
    """What keeps a copy for as long as its rows are needed."""
    sizes: Mapping[str, int] = field(default_factory=dict)
    """The numbers of rows from each file."""

    def __len__(self) -> int:
        return self.groups[-1].last

    def chosen(self, runs: Int[Array, "K 2"]) -> ChosenRows:
        begins, ends = runs.T  # row groups of which none is chosen are not read
        there = [np.searchsorted(ends, g.first, "right") < np.searchsorted(begins, g.last) for g in self.groups]
        return ChosenRows(replace(self, groups=tuple(itertools.compress(self.groups, there))), runs)

    def numbers(self, steps: slice) -> None:
        return None

    def files(self, rows: Array) -> list[str]:
        return names_at(self.sizes, rows)

    def tables(
        self, first: int, last: int, columns: list[str], demonstration: Place = lambda _: ""
    ) -> Iterator[tuple[int, pa.Table, Place]]:
        import pyarrow as pa

        there = (g for g in self.groups if g.first < last and first < g.last)
        for path, groups in itertools.groupby(there, key=lambda group: group.path):
            changed = f"{PurePosixPath(path).name}: it has changed since the data set was opened; open it again."
            with opened(self.filesystem, path) as file:
                for group in groups:
                    n_rows = group.last - group.first
                    if group.number >= file.num_row_groups or file.metadata.row_group(group.number).num_rows != n_rows:
                        raise DataError(changed)
                    row, shift = group.first, group.row - group.first
                    for batch in file.iter_batches(BATCH_ROWS, [group.number], columns, use_threads=False):
                        a, b = max(first - row, 0), min(last - row, len(batch))
                        if a < b:
                            table = pa.Table.from_batches([batch.slice(a, b - a)])
                            check_table(table, PurePosixPath(path).name)
                            yield row + a, table, _place(path, row + a, shift, demonstration)
                        row += len(batch)
                    if row != group.last:
                        raise ValueError(f"{row - group.first} of {n_rows} rows are there")


@contextmanager
def opened(filesystem: fs.FileSystem, path: str) -> Iterator[pq.ParquetFile]:
    """The open file, whose checksums are compared as it is read; a `DataError` where it is no Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        # Neither mapped into memory, where mapped pages stay and count, nor fetched by whole row groups.
        options = {"buffer_size": _BUFFER_BYTES, "pre_buffer": False, "page_checksum_verification": True}
        with input_file(filesystem, path) as stream, pq.ParquetFile(stream, **options) as file:
            # A text that repeats stays in memory once.
            texts = [field.name for field in file.schema_arrow if pa.types.is_string(field.type)]
            if texts:
                file = pq.ParquetFile(stream, metadata=file.metadata, read_dictionary=texts, **options)
            yield file
    except FileNotFoundError as error:
        raise DataError(f"{path}: there is no such file here; check the path.") from error
    except DataError:
        raise
    except Exception:
        with guarded(PurePosixPath(path).name, "not a Parquet file, or a damaged or truncated one", "write it again"):
            with input_file(filesystem, path) as stream:
                refuse_pointer(stream.read_at(100, 0), PurePosixPath(path).name)
            raise


def may_be_many_files(path: StrPath) -> bool:
    """Whether `path` may name several files: a folder, a pattern, an address."""
    return "://" in str(path) or os.path.isdir(path) or (not os.path.exists(path) and glob.has_magic(str(path)))


def has_tables(path: StrPath) -> bool:
    """Whether a folder has Parquet files, or text tables but those of rpil: a .txt file may be any text."""
    _, _, files, texts = _listed(path)
    tables = (text for text in texts if PurePath(text).name not in OWN_TABLES)
    return bool(files) or not all(text.lower().endswith((".txt", ".txt.gz")) for text in tables)


def find_files(path: StrPath) -> tuple[fs.FileSystem, list[str], list[str]]:
    """The file system, and the Parquet files and the text tables of a data set in the order of their names.

    Of LeRobot's files those that ``meta`` lists. A `DataError` where `path` does not exist or cannot be listed.
    """
    from rpil.formats.meta_folder import choose_files

    filesystem, folder, files, texts = _listed(path)
    return filesystem, choose_files(filesystem, str(path), folder, files) if folder else files, texts


def _listed(path: StrPath) -> tuple[fs.FileSystem, str, list[str], list[str]]:
    """The file system, the folder if it is one, and all Parquet files and text tables; none of them is opened."""
    from pyarrow import fs

    where = str(path)
    if where.startswith(("http://", "https://")):
        raise DataError(f"{where}: addresses of the web are not read; download the file, and give its path.")
    with guarded(where, "it cannot be listed", "check the path"):
        try:
            if "://" in where:
                filesystem, place = fs.FileSystem.from_uri(where)
            else:
                filesystem, place = fs.LocalFileSystem(), os.path.abspath(where)
                if not os.path.exists(place) and glob.has_magic(place):
                    return filesystem, "", *_matches(place)
                check_exists(where)
            if isinstance(filesystem, fs.LocalFileSystem):
                check_folder(place)
            kind = filesystem.get_file_info(place).type
            if kind == fs.FileType.NotFound:
                raise DataError(f"{where}: there is no such file or folder; check the path.")
            if kind == fs.FileType.File:
                return filesystem, "", *_tables([place], place)
            data = f"{place}/data"  # of LeRobot, which has tables of other things in meta
            place = data if filesystem.get_file_info(data).type == fs.FileType.Directory else place
            entries = filesystem.get_file_info(fs.FileSelector(place, recursive=True))
        except ImportError as error:
            reason = in_words(error)
            raise DataError(f"{where}: addresses of this kind need a package of their own ({reason}).") from error
        return filesystem, place, *_tables(sorted(i.path for i in entries if i.type == fs.FileType.File), place)


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


def columns_of_file(file: pq.ParquetFile, name: str, options: ColumnOptions, facts: Collection[str] = ()) -> Columns:
    """The columns of an open file, by their names, types and first values; a `DataError` where these are too large.

    Those of the `facts` that the user names are among them.
    """
    import pyarrow as pa

    schema = file.schema_arrow
    check_names(schema.names, name)
    kinds = {field.name: flat.kind_of_type(field.type) for field in schema} if file.metadata.num_rows else {}
    # Of images no value is read, and of very many columns the types are enough.
    plain = [column for column, kind in kinds.items() if kind in ("number", "text")][:_HEAD_COLUMNS]
    bytes_of_groups(file, plain, name)
    n_rows = GUESSED_ROWS if options.guess else flat.HEAD_ROWS
    batch = next(file.iter_batches(n_rows, columns=plain, use_threads=False), None)
    head = None if batch is None else pa.Table.from_batches([batch])
    if head is not None:
        check_table(head, name)
        kinds |= flat.kinds_of(head.slice(0, flat.HEAD_ROWS))
    named = {options.operator, options.session, (options.outcome or "").removeprefix("-")} - {*schema.names}
    made: dict[str, Kind] = {fact: "text" for fact in facts if fact in named}
    return find_columns(schema.names, kinds, name, options, head=head, made=made)


def check_columns(file: pq.ParquetFile, columns: Columns, name: str, first: str) -> None:
    """A `DataError` where the file `name` lacks columns that are read, or has more that hold data, than `first`."""
    names, known = set(file.schema_arrow.names), {*columns.all, *columns.ignored}
    if not names.issuperset(columns.all) or any(is_data(other) for other in names - known):
        raise other_columns(name, first, names, known)


def other_columns(name: str, first: str, names: Collection[str] = (), known: Collection[str] = ()) -> DataError:
    """The error that the file `name` has other columns, these `names`, than the file `first`."""
    differ = (quoted(sorted({*some} - {*others}), 5) for some, others in ((known, names), (names, known)))
    which = " and ".join(f"{what} {some}" for what, some in zip(("without", "with"), differ, strict=True) if some)
    said = f"its columns are not those of {first}{which and f' ({which})'}"
    return DataError(f"{name}: {said}; give all files the same ones, or take it out.")


def copied_rows(copy: Copy, sizes: Mapping[str, int]) -> ParquetRows:
    """The rows of a Parquet file of our own, which is a copy of files with so many rows."""
    from pyarrow import fs

    path = str(copy.path)
    with opened(fs.LocalFileSystem(), path) as file:
        counts = [file.metadata.row_group(number).num_rows for number in range(file.num_row_groups)]
    ends = np.cumsum(counts).tolist()
    groups = (RowGroup(path, k, end - n, end, end - n) for k, (n, end) in enumerate(zip(counts, ends, strict=True)))
    return ParquetRows(fs.LocalFileSystem(), tuple(groups), 0, keeper=copy, sizes=sizes)


def open_rows(
    filesystem: fs.FileSystem, paths: Sequence[str], options: ColumnOptions
) -> tuple[ParquetRows, Columns, Layout, Metadata]:
    """The rows of the files `paths`, their columns, and what they say of themselves.

    A `DataError` where the columns of the files differ.
    """
    import pyarrow as pa

    from rpil.formats.meta_folder import read_metadata

    groups: list[RowGroup] = []
    sizes: list[int] = []
    columns, layout, metadata, first, begins, n_bytes = None, None, Metadata(), PurePosixPath(paths[0]).name, 0, 0
    for path in paths:
        name = PurePosixPath(path).name
        with opened(filesystem, path) as file:
            if path == paths[0]:  # so that damaged data are named before damaged metadata
                metadata = read_metadata(filesystem, paths)
            row = 0
            for number in range(file.num_row_groups):
                n_rows = file.metadata.row_group(number).num_rows
                groups.append(RowGroup(path, number, begins + row, begins + row + n_rows, row))
                row += n_rows
            begins += row
            sizes.append(row)
            columns = columns or columns_of_file(file, name, options, metadata.facts)
            check_columns(file, columns, name, first)
            own = check_sizes(file, {*columns.all, *columns.outcomes}, filesystem, path)
            n_bytes += 0 if options.on_disk else sum(own)
            head = next(file.iter_batches(1, columns=columns.data, use_threads=False), None)
        if head is not None:
            this = Layout.of(pa.Table.from_batches([head]), columns, metadata.names)
            if layout is not None and this.shape != layout.shape:
                raise other_columns(name, first)
            other = layout or this
            action = np.result_type(this.action, other.action) if this.action.kind == "f" else this.action
            layout = replace(this, observation=np.result_type(this.observation, other.observation), action=action)
    if columns is None or layout is None:
        raise DataError(f"{paths[0]}: there are no demonstrations; give at least one with at least one step.")
    named = dict(zip(file_names(paths), sizes, strict=True))
    return ParquetRows(filesystem, tuple(groups), n_bytes, sizes=named), columns, layout, metadata


def _place(path: str, first: int, shift: int, demonstration: Place) -> Place:
    return lambda row: f"{PurePosixPath(path).name}{demonstration(first + row)}, row {first + row + shift + 1}"
