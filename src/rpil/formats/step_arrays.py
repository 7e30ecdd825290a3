"""Named arrays of a container, and the recording that they make: a `Part` for each demonstration or container."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any

import numpy as np
import pyarrow as pa

from rpil.data.arrays import LONGEST_TEXT, Id, check_any
from rpil.data.errors import DamagedError
from rpil.data.memory import BYTES_PER_NUMBER, check_memory
from rpil.formats import table as flat
from rpil.formats.column_search import find_columns
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Metadata, StepTables
from rpil.formats.scan import commas, without_damaged
from rpil.formats.table import BATCH_ROWS, Kind
from rpil.numerics.types import Array

NO_STEPS, NOT_IN_ALL = "not one value for each step", "not in every demonstration"
OF_WHOLE = "one value for each demonstration, which --outcome, --operator, --session and --task can name"

MAX_MATRIX = 1024
"""Numbers of a matrix that is no image, at most; it is read as a list."""

StoredArray = Any
"""An array with a shape and a type that need not be in memory, and of which slices of rows are read."""

Tree = Mapping[str, StoredArray]
"""A container of named arrays, whatever its format; names are paths where it has groups."""


@dataclass(frozen=True, eq=False)
class Closed:
    """An array whose container is closed when it is read, because not all files may be open."""

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
    """Consecutive steps of a container: of one demonstration, or of several that a column tells apart."""

    n_steps: int  # T, the number of actions
    arrays: Tree  # of T rows, or T + 1, the last of which is left out; others are ignored
    about: Mapping[str, Id | float] = field(default_factory=dict)  # of one demonstration, as its id and its task

    def has_steps(self, name: str) -> bool:
        """Whether an array of this name has one value, or row of values, for each step."""
        shape = self.arrays[name].shape
        return bool(shape) and shape[0] - self.n_steps in (0, 1) and math.prod(shape[1:]) > 0

    def fact(self, name: str) -> Id | float | None:
        """The number or short text of a whole demonstration, in an array or else in `about`; None where neither is."""
        one, value = self.arrays.get(name), None
        if self.about and one is not None and one.shape in ((), (1,)) and is_value(one.dtype):
            stored = np.asarray(one[...]).item()
            with suppress(ValueError, OverflowError, pa.ArrowException):  # no column holds such a value
                value = pa.scalar(stored.decode() if isinstance(stored, bytes) else stored).as_py()
        return self.about.get(name) if value is None or len(str(value)) > LONGEST_TEXT else value

    def kind(self, name: str) -> Kind:
        """The kind of an array by its shape and type; nested where it has no value for each step, or holds images."""
        if name in self.about:
            return "text" if isinstance(self.about[name], str) else "number"
        array = self.arrays[name]
        shape, is_flat = array.shape, len(array.shape) == 1
        most = MAX_MATRIX if len(shape) > 2 else flat.WIDEST
        is_image = not is_flat and (array.dtype == np.uint8 or math.prod(shape[1:]) > most)
        if not self.has_steps(name) or is_image:
            return "nested"
        if is_text(array.dtype):
            return "text" if is_flat else "nested"
        return "nested" if not is_value(array.dtype) else "number" if is_flat else "list"


def from_parts(
    parts: Sequence[Part],
    id_column: str,
    source: str,
    format_name: str,
    options: ColumnOptions = ColumnOptions(),
    metadata: Metadata = Metadata(),
    notes: tuple[str, ...] = (),
) -> StepTables:
    """The recording in all parts, whose columns are those of most; `id_column` is the id unless `options` say so.

    A `DataError` where a column is not found or missing in a part, differs in shape, or takes too much memory.
    """
    if empty := [str(part.about.get(id_column, k)) for k, part in enumerate(parts) if not part.n_steps]:
        notes = (*notes, f"Left out, because they have no steps: {commas(empty)}.")
    parts = [part for part in parts if part.n_steps]
    check_any(len(parts), source)
    layouts = [frozenset((m, one.shape[1:]) for m, one in part.arrays.items() if part.has_steps(m)) for part in parts]
    first = parts[layouts.index(Counter(layouts).most_common(1)[0][0])]
    kinds = {name: first.kind(name) for name in (*first.arrays, *first.about)}
    widths = {name: math.prod(first.arrays[name].shape[1:]) for name, kind in kinds.items() if kind == "list"}
    lists = {name: flat.part_names(name, width, metadata.names.get(name, ())) for name, width in widths.items()}
    columns = find_columns(kinds, source, replace(options, id=options.id or id_column), lists=lists)
    without = [m for m in {*columns.ignored} - {*columns.all} if m in first.arrays and not first.has_steps(m)]
    more = (name for part in parts for name in (*part.arrays, *part.about) if name not in kinds)
    told = {m: NO_STEPS if first.fact(m) is None else OF_WHOLE for m in without}
    columns = replace(columns, ignored={**columns.ignored, **told, **dict.fromkeys(more, NOT_IN_ALL)})
    others = {*columns.all} - {*columns.actions, *columns.observations}
    facts = [m for m in others if first.fact(m) is not None]
    steps = [name for name in columns.stored if name not in facts]
    named = {str(part.about.get(id_column, k)): part for k, part in enumerate(parts)}
    places = {m: f"{source}, demonstration {m!r}" if id_column in part.about else source for m, part in named.items()}
    check = partial(_check, first, steps, facts, "read with --skip-bad" if len(parts) > 1 else "write it again")
    sound, skipped = without_damaged(named, lambda m: check(named[m], places[m]), options.skip_bad)
    metadata = replace(metadata, lengths={m: n for m, n in metadata.lengths.items() if str(m) not in skipped})
    whole = {name: np.array([part.fact(name) for part in sound.values()]).tolist() for name in facts}
    parts = [replace(part, about={m: own[k] for m, own in whole.items()}) for k, part in enumerate(sound.values())]
    if not options.on_disk:
        arrays = [part.arrays[name] for part in parts for name in columns.stored if name in part.arrays]
        n_bytes = sum(max(BYTES_PER_NUMBER, one.dtype.itemsize) * math.prod(one.shape) for one in arrays)
        n_bytes += sum(part.n_steps * len(str(value)) for part in parts for value in part.about.values())
        check_memory(n_bytes, source, options.memory)
    dtypes = {name: [part.arrays[name].dtype for part in parts] for name in steps}
    types = {m: None if is_text(own[0]) else np.result_type(*map(_native_type, own)) for m, own in dtypes.items()}

    def table_of(pieces: Sequence[tuple[Part, slice]]) -> pa.Table:
        values = {m: _column([part.arrays[m][rows] for part, rows in pieces], types[m]) for m in steps}
        owners = np.repeat(np.arange(len(pieces)), [rows.stop - rows.start for _, rows in pieces])
        about = {m: pa.array([part.about[m] for part, _ in pieces]).take(owners) for m in whole}
        return flat.flattened(pa.table(values | about), columns.lists, columns.all)

    if longer := [name for name in steps if any(part.arrays[name].shape[0] > part.n_steps for part in parts)]:
        notes = (*notes, f"The last value of {commas(longer)}, which comes after the last action, is left out.")
    tables = map(table_of, _batches(parts))
    return StepTables(tables, columns, source, format_name, {}, metadata, notes, skipped=(*skipped,))


def _check(first: Part, steps: Sequence[str], facts: Sequence[str], remedy: str, part: Part, place: str) -> Part:
    """The part; a `DamagedError` with a `remedy` where it lacks a column of the `first`, or has another shape there."""
    for name in (*steps, *facts):
        array: Any = part.arrays.get(name)
        if (part.fact(name) if name in facts else array) is None:
            raise DamagedError(f"{place}: it has no {name!r}, as others have; {remedy}, or leave {name!r} out.")
        is_other = name in steps and name in first.arrays and array.shape[1:] != first.arrays[name].shape[1:]
        if is_other or (name in steps and part.kind(name) == "nested"):
            has = f"{name!r} has the shape {array.shape} and the type {array.dtype} for {part.n_steps:,} actions"
            raise DamagedError(f"{place}: {has}, not one row of as many numbers for each; {remedy}, or leave it out.")
    return part


def is_value(dtype: np.dtype[Any]) -> bool:
    """Whether values are numbers or texts."""
    return dtype.kind in "biuf" or is_text(dtype)


def is_text(dtype: np.dtype[Any]) -> bool:
    """Whether values are texts: of one length, or of any, as Zarr and h5py have them."""
    return dtype.kind in "SUT" or (dtype.metadata is not None and dtype.metadata.get("vlen") in (str, bytes))


def _batches(parts: Sequence[Part]) -> Iterator[list[tuple[Part, slice]]]:
    """All steps, of which about as many go together as a table has rows: parts, and the rows of each."""
    pieces, n_rows = list[tuple[Part, slice]](), 0
    for part in parts:
        for first in range(0, part.n_steps, BATCH_ROWS):
            rows = slice(first, min(first + BATCH_ROWS, part.n_steps))
            pieces.append((part, rows))
            n_rows += rows.stop - first
            if n_rows >= BATCH_ROWS:
                yield pieces
                pieces, n_rows = [], 0
    if pieces:
        yield pieces


def _column(pieces: Sequence[object], dtype: np.dtype[np.generic] | None) -> pa.Array:
    """One column of some steps: texts where there is no type, and lists of numbers where it has several a step."""
    values = np.concatenate([np.asarray(one) for one in pieces])
    if dtype is None:
        texts = (value.decode() if isinstance(value, bytes) else str(value) for value in values.tolist())
        return pa.array(texts, pa.string())
    column = pa.array(np.ascontiguousarray(values, dtype).reshape(-1))
    return column if values.ndim == 1 else pa.FixedSizeListArray.from_arrays(column, math.prod(values.shape[1:]))


def _native_type(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """The type in the byte order of the machine; pyarrow computes with no half precision, and with no wider floats."""
    if dtype.kind == "f" and dtype.itemsize not in (4, 8):
        return np.dtype(np.float32 if dtype.itemsize < 4 else np.float64)
    return dtype.newbyteorder("=")
