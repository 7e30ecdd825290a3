"""Some demonstrations of tables and of NumPy's arrays, in the format in which they came: all columns, as they were."""

from __future__ import annotations

import csv
import gzip
import itertools
import os
import shutil
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from pathlib import Path
from typing import IO, TYPE_CHECKING, cast

import numpy as np

from rpil.data.cells import from_cell
from rpil.data.errors import DataError
from rpil.data.files import new_folder, replacing
from rpil.data.id_values import check_ids
from rpil.data.npy import ARRAY, read_arrays, write_npz
from rpil.formats import npz
from rpil.formats import table as flat
from rpil.formats.columns import ColumnOptions, as_list
from rpil.formats.csv import FILE, find_text_columns, names_in_folder
from rpil.formats.dialect import TEXT_SUFFIXES, find_dialect, without_suffix
from rpil.formats.rows import BATCH_ROWS
from rpil.formats.store import columns_of_file, find_files, opened

if TYPE_CHECKING:
    import pyarrow as pa

_NESTED_ROWS = 1000  # read at a time where there are images

Change = Callable[["pa.Table"], "pa.Table"]


def keep_file(path: Path, output: Path, ids: Sequence[object], options: ColumnOptions) -> None:
    """Write the demonstrations `ids` of one file to `output`."""
    name, wanted = path.name.lower(), set(map(str, ids))
    with replacing(output) as temporary:
        keep = keep_text if name.endswith(TEXT_SUFFIXES) else _keep_arrays if name.endswith(".npz") else keep_rows
        found = keep(path, temporary, wanted, options)
        check_ids(wanted, found, str(path), "them")


def keep_folder(path: Path, output: Path, ids: Sequence[object], options: ColumnOptions) -> None:
    """Write the demonstrations `ids` of a folder to the new folder `output`, in files of the same names.

    Files of other demonstrations are left out, and so is all that is not read.
    """
    parquet_files, text_files = find_files(path)[1:]
    files = [Path(file) for file in parquet_files or text_files]
    if not files:
        raise DataError(f"{path}: no .parquet or .csv file is there; check the path.")
    wanted, found = set(map(str, ids)), set()
    with new_folder(output) as folder:
        for file, name in zip(files, names_in_folder(files), strict=True):
            target = folder / file.relative_to(os.path.abspath(path))
            target.parent.mkdir(parents=True, exist_ok=True)
            if parquet_files:
                in_file = keep_rows(file, target, wanted, options)
            else:
                in_file = _keep_text_or_file(file, target, wanted, options, without_suffix(name))
            if not in_file:
                target.unlink(missing_ok=True)
            found |= in_file
        check_ids(wanted, found, str(path), "them")


def keep_rows(
    path: Path, output: Path, ids: Set[str], options: ColumnOptions, change: Change = lambda table: table
) -> set[str]:
    """Write the rows of the demonstrations `ids` of a Parquet file, after a `change`; return the ids found."""
    import pyarrow.parquet as pq

    found: set[str] = set()
    tables = _kept_tables(path, ids, options, found)
    schema = next(tables).schema
    with pq.ParquetWriter(output, schema) as writer:  # whose errors must not be taken for those of the file
        for table in tables:
            writer.write_table(change(table).cast(schema))
    return found


def _kept_tables(path: Path, ids: Set[str], options: ColumnOptions, found: set[str]) -> Iterator[pa.Table]:
    """An empty table of a Parquet file's columns, and then its rows of the demonstrations `ids`, which `found` gets."""
    import pyarrow as pa
    from pyarrow import fs

    filesystem = fs.LocalFileSystem()
    with opened(filesystem, str(path)) as file:
        schema = file.schema.to_arrow_schema()
        nested = any(flat.kind_of_type(field.type) == "nested" for field in schema)
        column = columns_of_file(filesystem, str(path), file, options).episode
        yield schema.empty_table()
        for batch in file.iter_batches(_NESTED_ROWS if nested else BATCH_ROWS):
            rows = pa.Table.from_batches([batch])
            names, codes = flat.id_codes(rows, column, lambda _: path.name)
            kept = np.array([str(name) in ids for name in names])
            found |= {str(name) for name in names} & ids
            if kept.any():
                yield rows.filter(pa.array(kept[codes]))


def keep_text(path: Path, output: Path, ids: Set[str], options: ColumnOptions) -> set[str]:
    """Write the lines of the demonstrations `ids` of a text table, and its comments; return the ids found."""
    dialect = find_dialect(path)
    column = dialect.names.index(find_text_columns(path, dialect, options).episode)
    encoding, found = dialect.encoding, set()
    with _open(path, "rt", encoding) as source, _open(output, "wt", encoding) as target:
        target.writelines(itertools.islice(source, dialect.skip_rows))
        for lines, values in _rows(source, dialect.separator):
            is_row = bool(values) and not lines.lstrip().startswith("#")
            name = from_cell(values[column].strip()) if is_row else ""
            if not is_row or name in ids:
                target.write(lines)
                found.add(name)
    return found & ids


def _keep_text_or_file(path: Path, output: Path, ids: Set[str], options: ColumnOptions, name: str) -> set[str]:
    """The same for a file of a folder: it is the demonstration `name` where no column names the demonstration."""
    if find_text_columns(path, find_dialect(path), options, FILE).episode != FILE:
        return keep_text(path, output, ids, options)
    if name in ids:
        shutil.copyfile(path, output)
    return {name} & ids


def _open(path: Path, mode: str, encoding: str) -> IO[str]:
    opener = gzip.open if path.suffix.lower() == ".gz" else open
    return cast(IO[str], opener(path, mode, encoding=encoding, newline=""))


def _rows(lines: Iterable[str], separator: str) -> Iterator[tuple[str, list[str]]]:
    """The text of each row, which may have several lines, and its values."""
    taken: list[str] = []
    for values in csv.reader(_tee(lines, taken), delimiter=separator):
        yield "".join(taken), values
        taken.clear()


def _tee(lines: Iterable[str], taken: list[str]) -> Iterator[str]:
    for line in lines:
        taken.append(line)
        yield line


def _keep_arrays(path: Path, output: Path, ids: Set[str], options: ColumnOptions) -> set[str]:
    """Write the arrays of an NPZ file with the rows, or the values, of the demonstrations `ids`; return the ids found.

    An array with one value for each step or demonstration is cut, any other is written whole; what is no array is not.
    """
    order = [str(name) for name in npz.read(path, options).demonstrations.ids]
    with zipfile.ZipFile(path) as stored:
        members = [name for name in stored.namelist() if name.endswith(ARRAY)]
        values = read_arrays(stored, members, path.name)
    arrays = dict(zip((name.removesuffix(ARRAY) for name in members), values, strict=True))
    column = next(name for name in as_list(options.id or ()) or npz.SPELLINGS[-1] if name in arrays)
    owners = arrays[column]
    owners = owners.astype(np.int64) if owners.dtype.kind == "f" else owners
    steps = np.array([str(name) in ids for name in owners.tolist()])
    demonstrations = np.array([name in ids for name in order])
    for name, array in arrays.items():
        mask = next((m for m in (steps, demonstrations) if array.ndim and len(array) == len(m)), None)
        arrays[name] = array if mask is None or name == "observation_names" else array[mask]
    write_npz(output, arrays)
    return {*order} & ids
