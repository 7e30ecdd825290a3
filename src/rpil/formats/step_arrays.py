"""Makes a recording of arrays of steps, one `Part` for each demonstration or file that holds them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from rpil.data.arrays import Id, check_any
from rpil.data.errors import DataError
from rpil.data.memory import BYTES_PER_NUMBER, check_memory
from rpil.formats import table as flat
from rpil.formats.column_search import find_columns
from rpil.formats.columns import ColumnOptions, Kind
from rpil.formats.description import commas
from rpil.formats.format import StepTables
from rpil.formats.table import BATCH_ROWS
from rpil.formats.table_facts import Metadata, Origin
from rpil.numerics.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

NO_STEPS, NOT_IN_FIRST = "not one value for each step", "not in the first demonstration"

NUMBERED = "episode"
"""The column of the id where demonstrations have no names but their numbers."""

MAX_MATRIX = 1024
"""Numbers of a matrix that is no image, at most; it is read as a list."""


class StoredArray(Protocol):
    """An array that need not be in memory, such as a data set of HDF5."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Its declared shape."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Its declared type."""

    def __getitem__(self, rows: slice, /) -> object:
        """Some of its rows."""


@dataclass(frozen=True, eq=False)
class Closed:
    """An array in a file that is closed, because there may be more files than a process may have open."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    read: Callable[[slice], object]

    def __getitem__(self, rows: slice, /) -> object:
        return self.read(rows)


def read_once(shape: tuple[int, ...], dtype: np.dtype[Any], read: Callable[[], Array]) -> Closed:
    """An array that `read` gives as a whole when some of it is first asked for."""
    whole = cache(read)
    return Closed(shape, dtype, lambda rows: whole()[rows])


@dataclass(frozen=True)
class Part:
    """Consecutive steps of a file: of one demonstration, or of several that a column tells apart.

    Attributes
    ----------
    n_steps : int
        T, the number of actions.
    arrays : mapping of str to array
        Of T rows, or T + 1, the last of which is left out; others are ignored.
    about : mapping of str to int or str
        What holds for all steps, as the id of the demonstration and its task.
    """

    n_steps: int
    arrays: Mapping[str, StoredArray]
    about: Mapping[str, Id | float] = field(default_factory=dict)

    def has_steps(self, name: str) -> bool:
        """Whether an array of this name has one value, or row of values, for each step."""
        shape = self.arrays[name].shape
        return bool(shape) and shape[0] - self.n_steps in (0, 1) and math.prod(shape[1:]) > 0


def from_parts(
    parts: Sequence[Part],
    id_column: str,
    source: str,
    format_name: str,
    options: ColumnOptions = ColumnOptions(),
    metadata: Metadata = Metadata(),
    notes: tuple[str, ...] = (),
) -> StepTables:
    """The recording in all parts, whose columns are those of the first; `id_column` is the id unless `options` say so.

    A `DataError` where a column is not found or missing in a part, differs in shape, or takes too much memory.
    """
    import pyarrow as pa

    empty = [str(part.about.get(id_column, k)) for k, part in enumerate(parts) if not part.n_steps]
    parts = [part for part in parts if part.n_steps]
    check_any(len(parts), source)
    kinds = _kinds(parts[0])
    columns = find_columns(list(kinds), kinds, source, replace(options, id=options.id or id_column))
    without = {name: NO_STEPS for name in columns.ignored if name in parts[0].arrays and not parts[0].has_steps(name)}
    named = (names for part in parts[1:] for names in (part.arrays, part.about) if isinstance(names, dict))
    more = dict.fromkeys((name for names in named for name in names if name not in kinds), NOT_IN_FIRST)
    ignored, is_chosen = {**columns.ignored, **without, **more}, options.id is not None
    columns = replace(columns, ignored=ignored, id_chosen=is_chosen)
    whole = [name for name in columns.all if all(name in part.about for part in parts)]
    steps = [name for name in columns.all if name not in whole]
    for part in sorted(parts, key=lambda part: all(name in part.arrays or name in part.about for name in steps)):
        place = f"{source}, demonstration {part.about[id_column]!r}" if id_column in part.about else source
        _check(part, parts[0], steps, place)  # those that lack a column first
    if not options.on_disk:
        arrays = [part.arrays[name] for part in parts for name in columns.all if name in part.arrays]
        n_bytes = sum(max(BYTES_PER_NUMBER, one.dtype.itemsize) * math.prod(one.shape) for one in arrays)
        check_memory(n_bytes, source, options.memory)
    dtypes = {name: [part.arrays[name].dtype for part in parts] for name in steps}
    types = {m: None if is_text(own[0]) else np.result_type(*map(_native_type, own)) for m, own in dtypes.items()}
    tables = (
        pa.table(
            {m: _column(part, rows, m, source, types[m]) for m in steps}
            | {m: pa.repeat(part.about[m], rows.stop - rows.start) for m in whole}
        )
        for part in parts
        for rows in (slice(k, min(k + BATCH_ROWS, part.n_steps)) for k in range(0, part.n_steps, BATCH_ROWS))
    )
    shapes = [(name, part.arrays[name].shape, part) for name in steps for part in parts]
    longer = list(dict.fromkeys(name for name, shape, part in shapes if shape[0] > part.n_steps))
    if longer:
        notes = (*notes, f"The last value of {commas(longer)}, which comes after the last action, is left out.")
    notes = (*notes, *without_steps(empty))
    return StepTables(tables, columns, Origin(source, format_name, metadata, notes))


def without_steps(ids: Sequence[object]) -> tuple[str, ...]:
    """The note that the demonstrations called `ids` are left out; none where there are none."""
    return (f"Left out, because they have no steps: {commas(map(str, ids))}.",) if ids else ()


def _kinds(part: Part) -> dict[str, Kind]:
    """The kind of every column by its type, and by its first values where it has one number a step."""
    import pyarrow as pa

    kinds: dict[str, Kind] = {name: _kind(array) for name, array in part.arrays.items()}
    kinds |= dict.fromkeys((name for name in part.arrays if not part.has_steps(name)), "nested")
    numbers = [name for name, kind in kinds.items() if kind == "number"]
    head = {}
    for name in numbers:  # of columns that are not read, chunks may be missing or damaged; of others it is said later
        with suppress(DataError, OSError):
            values = np.asarray(part.arrays[name][: flat.HEAD_ROWS])[: part.n_steps]
            head[name] = values.astype(_native_type(values.dtype), copy=False)
    kinds |= flat.kinds_of(pa.table(head)) if head else {}
    return kinds | {name: "text" if isinstance(value, str) else "number" for name, value in part.about.items()}


def is_text(dtype: np.dtype[Any]) -> bool:
    """Whether values are texts: of one length, or of any, as Zarr and h5py have them."""
    return dtype.kind in "SUT" or (dtype.metadata is not None and dtype.metadata.get("vlen") in (str, bytes))


def _kind(array: StoredArray) -> Kind:
    kind, shape = array.dtype.kind, array.shape
    if is_text(array.dtype):
        return "text" if len(shape) == 1 else "nested"
    is_image = (len(shape) > 1 and array.dtype == np.uint8) or (len(shape) > 2 and math.prod(shape[1:]) > MAX_MATRIX)
    if kind not in "biuf" or is_image:
        return "nested"
    return "number" if len(shape) == 1 else "list"


def _check(part: Part, first: Part, columns: Sequence[str], place: str) -> None:
    """A `DataError` where a column is missing, is not of one value for each step, or differs from the first part's."""
    for name in columns:
        array = part.arrays.get(name)
        if array is None:
            fault = f"one {name!r}, and not every other has" if name in part.about else f"no {name!r}, as others have"
            raise DataError(f"{place}: it has {fault}; leave it out, or leave {name!r} out.")
        shape = array.shape
        if not part.has_steps(name):
            raise DataError(f"{place}: {name!r} has the shape {shape} for {part.n_steps:,} actions; leave it out.")
        if _kind(array) == "nested" or (name in first.arrays and shape[1:] != first.arrays[name].shape[1:]):
            fault = f"the shape {shape} and the type {array.dtype}"
            raise DataError(f"{place}: {name!r} has {fault}, not one row of as many numbers for each step; exclude it.")


def _column(part: Part, rows: slice, name: str, source: str, dtype: np.dtype[np.generic] | None) -> pa.Array:
    """One column of some steps: texts where there is no type, and lists of numbers where it has several a step."""
    import pyarrow as pa

    values = np.asarray(part.arrays[name][rows])
    if dtype is None:
        return pa.array([_text(value, name, source) for value in values.tolist()], pa.string())
    column = pa.array(np.ascontiguousarray(values, dtype).reshape(-1))
    return column if values.ndim == 1 else pa.FixedSizeListArray.from_arrays(column, math.prod(values.shape[1:]))


def _text(value: object, name: str, source: str) -> str:
    try:
        return value.decode() if isinstance(value, bytes) else str(value)
    except UnicodeDecodeError as error:
        raise DataError(f"{source}: {name!r} holds text that is not Unicode; write it again.") from error


def _native_type(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """The type in the byte order of the machine; pyarrow computes with no half precision, and with no wider floats."""
    if dtype.kind == "f" and dtype.itemsize not in (4, 8):
        return np.dtype(np.float32 if dtype.itemsize < 4 else np.float64)
    return dtype.newbyteorder("=")
