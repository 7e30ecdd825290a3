"""Parquet: the flat table with its types kept, and LeRobot's folder ``meta`` beside it."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rpil.data.arrays import Id
from rpil.data.errors import DamagedError, DataError, guarded
from rpil.data.files import StrPath, check_inside, replacing
from rpil.data.memory import LARGEST_TABLE, Parsed, check_memory, read_json, read_text
from rpil.data.text import EPISODE, is_data
from rpil.formats import table as flat
from rpil.formats.column_search import find_columns
from rpil.formats.columns import FILE, ColumnOptions, Columns, check_names
from rpil.formats.format import Format, Metadata, StepTables, called
from rpil.formats.parquet_file import check_sizes, check_table, opened, read_table
from rpil.formats.scan import parts_in_words, without_damaged
from rpil.formats.table import BATCH_ROWS, other_columns

_HEAD_COLUMNS = 2000  # whose first values are looked at
_ROWS_OF_LISTS = 16  # by which their widths are told
_NESTED_ROWS = 1000  # read at a time where there are images, whose bytes no footer says


def read_files(paths: Sequence[str], options: ColumnOptions, source: str) -> StepTables:
    """Read files with the same columns; each of several is a demonstration where no column is its id."""
    paths, skipped = readable(paths, source) if options.skip_bad else (paths, ())
    try:
        found, n_bytes = _opened_files(paths, options, source)
    except DamagedError:
        readable(paths, source, skips=False)
        raise
    if not options.on_disk:
        check_memory(n_bytes, source, options.memory)
    return replace(found, skipped=skipped)


def _opened_files(paths: Sequence[str], options: ColumnOptions, source: str) -> tuple[StepTables, int]:
    """The recording in the files, and the bytes that it takes in memory; a `DataError` where their columns differ."""
    schema, sizes, n_bytes, columns, metadata = pa.schema([]), dict[str, int](), 0, None, Metadata()
    short = [Path(path).name for path in paths]  # but where two are called alike
    for path, name in zip(paths, short if len({*short}) == len({*paths}) else paths, strict=True):
        with opened(path) as file:
            if columns is None:  # so that damaged data are named before damaged metadata
                metadata = read_metadata(paths)
                # LeRobot has ids, and the files of a folder such as episode=1 are parts of one.
                default = None if len(paths) == 1 or metadata.version or "=" in Path(path).parent.name else FILE
                columns = columns_of_file(file, path, options, metadata, default)
                stored = {one: None for one in columns.stored if one != FILE}
            names, known = set(file.schema_arrow.names), {*stored, *columns.ignored, *columns.lists}
            if not names.issuperset(stored) or any(is_data(other) for other in names - known):
                raise other_columns(name, next(iter(sizes)), names, known)
            n_bytes += sum(check_sizes(file, stored, path))
            own = pa.schema([one for one in file.schema_arrow if one.name in stored])
            try:
                schema = pa.unify_schemas([schema, own], promote_options="permissive")
            except pa.ArrowException as error:
                raise other_columns(name, next(iter(sizes))) from error
            sizes[name] = file.metadata.num_rows
    assert columns is not None, "there is a file"
    kind = f"LeRobot {metadata.version}" if metadata.version else "Parquet"
    kind = kind if len(paths) == 1 else f"{kind}, {len(paths):,} files"
    tables = _tables(paths, pa.schema([schema.field(one) for one in stored]), columns)
    return StepTables(tables, columns, source, kind, sizes, metadata), n_bytes


def _tables(paths: Sequence[str], schema: pa.Schema, columns: Columns) -> Iterator[pa.Table]:
    """The rows of files, with the types of a schema of what is stored, in the columns that are read."""
    folder = os.path.commonpath([Path(path).parent for path in paths])
    for path in paths:
        n_rows, name, of_file = 0, Path(path).name, Path(path).relative_to(folder).with_suffix("").as_posix()
        with opened(path) as file:
            for batch in file.iter_batches(BATCH_ROWS, columns=schema.names, use_threads=False):
                n_rows += len(batch)
                table = pa.Table.from_batches([batch]).select(schema.names)
                check_table(table, name)
                table = table.cast(schema).append_column(FILE, pa.repeat(of_file, len(table)))
                yield flat.flattened(table, columns.lists, columns.all)
            if n_rows != file.metadata.num_rows:
                raise ValueError(f"{n_rows} of {file.metadata.num_rows} rows are there")


def columns_of_file(
    file: pq.ParquetFile, path: StrPath, options: ColumnOptions, meta: Metadata = Metadata(), default: str | None = None
) -> Columns:
    """The columns of an open file, by their names, types and first values; a `DataError` where these are too large."""
    schema, n_rows, parts_of_path = file.schema_arrow, file.metadata.num_rows, Path(path).parts
    name = "/".join(parts_of_path[-4:] if meta.version else parts_of_path[-1:])  # of a folder of LeRobot
    check_names(schema.names, name)
    kinds = {field.name: flat.kind_of_type(field.type) if n_rows else "number" for field in schema}
    # Of images no value is read, and of very many columns the types are enough.
    plain = [column for column, kind in kinds.items() if kind in ("number", "text")][:_HEAD_COLUMNS]
    lists = [column for column, kind in kinds.items() if kind == "list"]
    check_sizes(file, [*plain, *lists], path)
    parts: Mapping[str, Sequence[str]] = {}
    for own, n in ((plain, flat.HEAD_ROWS), (lists, _ROWS_OF_LISTS)):
        batch = next(file.iter_batches(n, columns=own, use_threads=False), None) if own else None
        head = pa.table({}) if batch is None else pa.Table.from_batches([batch])
        head.validate(full=True)
        if own is plain:
            check_table(head, name)
        kinds |= flat.kinds_of(head)
        parts = flat.parts_of_lists(head, meta.names)
    return find_columns(kinds, name, options, default, parts)


def readable(paths: Sequence[str], source: str, skips: object = True) -> tuple[list[str], tuple[str, ...]]:
    """The Parquet files that are not damaged, by all of their rows, and words for the others, with the episodes that
    ``meta`` lists and no other file has; unless these are skipped, a `DataError` on them, by footers alone."""

    def read(path: str) -> None:
        with opened(path) as file:
            for batch in file.iter_batches(flat.HEAD_ROWS, use_threads=False) if skips else ():
                batch.validate(full=True)

    found, damaged = without_damaged(paths, read)
    data = next((folder for path in damaged for folder in Path(path).parents if folder.name == "data"), None)
    names, there, listed = [Path(path).name for path in damaged], set[int](), set[int]()
    if data is not None:
        with suppress(DataError):  # of damaged metadata, which their reader names
            listed |= {int(m) for m in MetaFolder(data.parent).lengths}
        for path in found if listed else ():
            there |= {*read_table(path, [EPISODE[0]])[EPISODE[0]].to_pylist()}
        names = [str(Path(path).relative_to(data.parent)) for path in damaged]
    words = parts_in_words(listed - there, "episode", names)
    if damaged and not skips:
        said = f"damaged, as where a recording is cut off: {words}; copy again, or read and keep"
        others = parts_in_words(there, "episode", []) or "the others"
        raise DataError(f"{source}: {said} {others} with --skip-bad.")
    return [*found], (words,) if words else ()


def write_tables(path: Path, tables: Iterator[pa.Table]) -> None:
    """Write tables of one schema one below the other; one of them is in memory at a time."""
    first = next(tables)
    # Floating-point values rarely repeat: a dictionary of them only costs time and space.
    dictionary = [field.name for field in first.schema if not pa.types.is_floating(field.type)]
    with (
        replacing(path) as temporary,
        pq.ParquetWriter(temporary, first.schema, use_dictionary=dictionary, write_page_checksum=True) as writer,
    ):
        for table in chain([first], tables):
            writer.write_table(table)


def keep_rows(path: Path, output: Path, ids: Set[str], options: ColumnOptions) -> None:
    """Write the rows of the demonstrations `ids` of a Parquet file, a batch at a time."""
    with opened(path) as file:
        schema, column = file.schema.to_arrow_schema(), columns_of_file(file, path, options).episode
        check_memory(max(check_sizes(file, schema.names, path), default=0), path.name, options.memory)
        nested = any(flat.kind_of_type(field.type) == "nested" for field in schema)
        with pq.ParquetWriter(output, schema) as writer:
            for batch in file.iter_batches(_NESTED_ROWS if nested else BATCH_ROWS, use_threads=False):
                table = pa.Table.from_batches([batch])
                names, owners = flat.id_codes(table, column, lambda _: path.name)
                rows = np.flatnonzero(np.isin(owners, [k for k, name in enumerate(names) if str(name) in ids]))
                if len(rows):
                    writer.write_table(table.take(rows).cast(schema))


_PLACE = re.compile(r"\{(\w+)(?::(0\dd))?\}")


@dataclass(frozen=True, eq=False)
class MetaFolder:
    """The folder ``meta`` in the folder at `path`, which no link may leave."""

    path: Path

    @cached_property
    def files(self) -> list[Path]:
        """Files in it; a `DataError` where a link leads out of the folder, or to nothing."""
        inside = ((Path(folder), [*folders, *files]) for folder, folders, files in os.walk(self.path / "meta"))
        found = sorted(folder / name for folder, names in inside for name in names)
        for place in found:
            if not place.name.startswith("."):
                check_inside(place, self.path)
        return found

    @cached_property
    def info(self) -> dict[str, Parsed]:
        """The content of ``info.json``; empty where it is not there, and a `DataError` where it is damaged."""
        place, name = self.path / "meta" / "info.json", f"{self.path.name}/meta/info.json"
        if place not in self.files:
            return {}
        with guarded(name, "it does not describe a data set", "write it again, or move it away"):
            if isinstance(info := read_json(place), dict):
                return info
            raise TypeError("no object")

    @property
    def features(self) -> dict[str, dict[str, Parsed]]:
        """Facts in ``info.json`` about each feature."""
        features = self.info.get("features")
        return {m: of for m, of in features.items() if isinstance(of, dict)} if isinstance(features, dict) else {}

    def cameras(self, *kinds: str) -> tuple[str, ...]:
        """The features of these kinds, "video" or "image"."""
        return tuple(name for name, of in self.features.items() if of.get("dtype") in kinds)

    def tables(self, name: str) -> list[Path]:
        """The Parquet files of a table, in order."""
        tables, meta = (one for one in self.files if one.suffix == ".parquet"), self.path / "meta"
        return [one for one in tables if one.relative_to(meta).parts[0] in (name, f"{name}.parquet")]

    def rows(self, name: str, wanted: Callable[[str], bool] = lambda _: True) -> list[dict[str, Parsed]]:
        """The rows of a table: of lines of JSON before version 3.0, of Parquet files since; none where it is not there.

        Of Parquet files the columns that are `wanted` are given. Errors of reading are left as they are.
        """
        lines = self.path / "meta" / f"{name}.jsonl"
        if lines in self.files:
            text = read_text(lines, LARGEST_TABLE).replace("\r", "\n")  # the ends of lines that JSON knows
            return [json.loads(line) for line in text.split("\n") if line.strip()]
        tables = [read_table(place) for place in self.tables(name)]
        return [row for one in tables for row in one.select([*filter(wanted, one.column_names)]).to_pylist()]

    @cached_property
    def lengths(self) -> dict[Id, int]:
        """Steps by episode; empty where it does not say, and a `DataError` where it is damaged."""
        with guarded(self.path / "meta", "it does not say how long each episode is", "write it again"):
            rows = self.rows("episodes", lambda name: name in ("episode_index", "length"))
            return {int(row["episode_index"]): int(row["length"]) for row in rows}

    def tasks(self) -> dict[str, str]:
        """Task by its number; since version 3.0 its text is the index of pandas. Empty where they are damaged,
        and a `DataError` where they are not in UTF-8."""
        found, damages = {}, (pa.ArrowException, OSError, DataError, json.JSONDecodeError, KeyError, TypeError)
        place, *words = self.path / "meta", "its tasks cannot be read", "write them again in UTF-8"
        with guarded(place, *words), suppress(*damages, RecursionError):
            for row in self.rows("tasks"):
                texts = [text for name, text in row.items() if name != "task_index"]
                found[str(row["task_index"])] = str(row.get("task", *texts[:1]))
        return found


def read_metadata(paths: Sequence[str]) -> Metadata:
    """The metadata of the data set that holds the data files `paths`; empty where there are none.

    Lengths are those of all demonstrations, and empty where `paths` are some of the files only. A `DataError` where
    ``info.json`` or the table of lengths is damaged; a value of ``info.json`` that cannot be used is left out.
    """
    data = next((folder for folder in Path(paths[0]).parents if folder.name == "data"), None)
    meta = None if data is None else MetaFolder(data.parent)
    if data is None or meta is None or not meta.info:
        return Metadata()
    info = meta.info
    shown = {str(file) for file in data.rglob("*.parquet") if not file.name.startswith((".", "_"))}
    return Metadata(
        version=str(info.get("codebase_version", ""))[:40],
        fps=frame_rate(info.get("fps")),
        names={m: parts for m, one in meta.features.items() if (parts := _part_names(one))},
        tasks=meta.tasks(),
        videos=meta.cameras("video"),
        n_cameras=len(meta.cameras("video", "image")),
        lengths=meta.lengths if shown <= {*paths} else {},
    )


def frame_rate(value: Parsed) -> float | None:
    """The number that a value or a text says, as frames a second; None where it is none above 0."""
    with suppress(ValueError, TypeError, OverflowError):
        return float(value) if not isinstance(value, bool) and 0 < float(value) < 1e9 else None
    return None


def fill(template: str, chunk: int, file: int, camera: str = "") -> str:
    """A path of ``info.json``, as data/chunk-{chunk_index:03d}, with the numbers of a chunk and of a file in it."""
    values: dict[str, object] = {"chunk_index": chunk, "file_index": file, "video_key": camera}
    values |= {"episode_chunk": chunk, "episode_index": file}
    return _PLACE.sub(lambda match: format(values[match[1]], match[2] or ""), template)


def _part_names(feature: Mapping[str, object]) -> tuple[str, ...]:
    names = feature.get("names")
    if isinstance(names, dict):  # version 2 has {"motors": [...]}
        names = next(iter(names.values()), None)
    if isinstance(names, list) and len(names) == 1 and isinstance(names[0], list):  # of Unitree's converter
        names = names[0]
    return tuple(map(str, names)) if isinstance(names, list) and feature.get("shape") == [len(names)] else ()


FORMAT = Format(
    name="Parquet",
    claims=called(".parquet"),
    read=lambda path, options: read_files([str(path.absolute())], options, path.name),
    keep=keep_rows,
    suffixes=(".parquet",),
    write=lambda path, *data: write_tables(path, iter([flat.from_demonstrations(*data)])),
)
