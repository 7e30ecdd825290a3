"""Times of a recording: its timestamps, frame rate and numbers of frames, and demonstrations that end at pauses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.json_files import Parsed
from rpil.data.names import TIMESTAMP, plain_name
from rpil.formats import table as flat
from rpil.formats.columns import ColumnOptions, Columns
from rpil.formats.steps import Steps
from rpil.numerics.types import Array, Float, Int

_UNITS = {"s sec secs seconds": 1.0, "ms msec msecs": 1e-3, "us": 1e-6, "ns nsec nsecs nanosec": 1e-9}
_SECONDS = {unit: seconds for units, seconds in _UNITS.items() for unit in units.split()}
_WORDS_OF_TIME = {"t", "ts", "time", "timestamp", "timestamps", "stamp", "elapsed", "clock"}
_WALL_CLOCK = 5e8, 1e10
"""Seconds since 1970 from 1985 to 2286: times of day, and times since a recorder was started, are far from these."""


@dataclass(frozen=True, eq=False)
class Times:
    """What a recording says about its times and lengths.

    Attributes
    ----------
    timestamps : (N,) array, optional
        Time of each step in seconds, in the order of the demonstrations; NaN where it is missing.
    fps : float, optional
        Frames a second.
    frames : mapping of id to int
        Frames that each demonstration should have.
    """

    timestamps: Float[Array, " N"] | None = None
    fps: float | None = None
    frames: Mapping[Id, int] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Clock:
    """A column of time."""

    ticks: Float[Array, " N"]
    """Of each step, in the order of the demonstrations, from the smallest on; NaN where it is missing."""
    unit: float | None
    """Seconds in a tick, None where neither type, name nor size says it: then it is taken to be a second."""

    def seconds(self, offsets: Array) -> tuple[float | None, float | None]:
        """Duration of all demonstrations in seconds, and steps a second; None where they are not known."""
        lengths, step = self.lengths(offsets), usual_step(np.diff(self.ticks))
        if self.unit is None or step is None or not np.all(lengths >= 0):
            return None, None
        return float(lengths.sum() * self.unit), 1 / (step * self.unit)

    def lengths(self, offsets: Array) -> Float[Array, " M"]:
        """Of the demonstrations, in ticks."""
        return np.asarray(self.ticks[offsets[1:] - 1] - self.ticks[offsets[:-1]])


def usual_step(steps: Array) -> float | None:
    """The mean of the usual ones among the times between two rows, to which pauses do not belong; None without any."""
    steps = steps[steps > 0]
    return float(steps[steps <= 1.5 * np.median(steps)].mean()) if len(steps) else None


def clock_columns(columns: Columns) -> list[str]:
    """The columns that may hold the time of each step, the likeliest first."""
    named = [name for name in columns.all if plain_name(name) in TIMESTAMP]
    return list(dict.fromkeys([*columns.orders, *named, *columns.times]))


def find_clock(table: pa.Table, columns: Columns, offsets: Array) -> Clock | None:
    """The first column of time whose unit is known, or else one that is called so; None where there is none.

    The rows of the table are in the order of the demonstrations.
    """
    found: list[Clock] = []
    for name in clock_columns(columns):
        missing = np.asarray(table[name].is_null(nan_is_null=True).to_numpy(), dtype=bool)
        values = flat.order_values(table[name].filter(~missing))
        if values is None or not len(values):
            continue
        ticks = np.full(len(missing), np.nan)
        ticks[~missing] = values - values.min()
        clock = Clock(ticks, unit_of(name, table[name].type, values))
        is_named = plain_name(name) in TIMESTAMP
        passes = (np.diff(ticks) > 0).any() and not (clock.lengths(offsets) < 0).any()
        if is_named or (clock.unit is not None and passes):
            found.append(clock)
    return next((clock for clock in found if clock.unit is not None), found[0] if found else None)


def unit_of(name: str, kind: pa.DataType, values: Array) -> float | None:
    """Seconds in one unit of a column of time; by its type, its name, or the size of a time since 1970."""
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind) or pa.types.is_time(kind):
        return _SECONDS[kind.unit]
    words = plain_name(name).split("_")
    if words[-1] in _SECONDS and len(words) > 1:
        return _SECONDS[words[-1]]
    largest = float(np.abs(values).max())
    for limit, unit in ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3)):
        if largest > limit:
            return unit
    if not _WORDS_OF_TIME & set(words):
        return None
    return 1.0 if values.dtype.kind == "f" and not np.array_equal(values, np.round(values)) else None


def start_times(columns: Mapping[str, pa.ChunkedArray], offsets: Array) -> tuple[Array | None, str]:
    """When each demonstration starts, and the first of the `columns` in which each has a wall-clock time of its own.

    The columns are in the order of the demonstrations. None, and no name, where none has: clocks that begin anew with
    each demonstration, or with the recorder, do not tell which demonstration came first.
    """
    for name, column in columns.items():
        seconds = _since_1970(name, column)
        if seconds is not None and len(np.unique(starts := seconds[offsets[:-1]])) == len(starts):
            return starts.astype(float), name
    return None, ""


def _since_1970(name: str, column: pa.ChunkedArray) -> Array | None:
    """Seconds since 1970; None where a value is missing or is no wall-clock time."""
    if pa.types.is_date(column.type):
        column = column.cast(pa.timestamp("s"))
    values = flat.order_values(column)
    if values is None or not len(values) or pa.types.is_duration(column.type) or pa.types.is_time(column.type):
        return None
    seconds = values * (unit_of(name, column.type, values) or 1.0)
    low, high = _WALL_CLOCK
    return seconds if low < seconds.min() and seconds.max() < high else None


def with_facts(
    tables: Iterable[pa.Table], episode: str, facts: Mapping[str, Mapping[str, Parsed]]
) -> Iterator[pa.Table]:
    """The tables with a column for each of the `facts`, which have a value for each id."""
    for table in tables:
        ids, rows = flat.encoded(table[episode])
        for name, by_id in facts.items():
            table = table.append_column(name, pa.array([by_id.get(str(m)) for m in ids]).take(pa.array(rows)))
        yield table


def shorter(
    names: Sequence[Id], group: Int[Array, " N"], rows: Steps, columns: Columns, options: ColumnOptions
) -> tuple[list[Id], Int[Array, " N"]]:
    """The ids of the shorter demonstrations that the options make of those with these `names`, and the number of that
    of each row, as `group` is.

    A demonstration ends where the next row is more than `split_gap` seconds later, or earlier: "P01" is split into
    "P01-0" and "P01-1"; and after each `segment` seconds from its first row on: into "P01 [0, 10) s" and
    "P01 [10, 20) s".
    """
    seconds, is_new = _seconds(rows, columns), columns.episode in columns.made
    if gap := options.split_gap:
        steps, counts, labels = np.diff(seconds, prepend=np.nan), Counter[int](), list[Id]()
        starts = (steps > gap) | (steps < 0) | (np.diff(group, prepend=-1) != 0)
        for k in group[starts].tolist():
            labels.append(counts[k] if is_new else f"{names[k]}-{counts[k]}")
            counts[k] += 1
        names, group = _numbered(labels, np.cumsum(starts) - 1)
    if length := options.segment:
        if np.isnan(seconds).any():
            raise DataError(f"{columns.source}: the column of time lacks values; fill it in.")
        first = seconds[np.unique(group, return_index=True)[1]]
        parts = np.stack([group, np.floor((seconds - first[group]) / length)])
        pairs, places = np.unique(parts, axis=1, return_inverse=True)
        ends = ((names[int(k)], part * length, (part + 1) * length) for k, part in pairs.T.tolist())
        names, group = _numbered([f"{m} [{a:.10g}, {b:.10g}) s" for m, a, b in ends], places.reshape(-1))
    return [*names], group


def _numbered(labels: Sequence[Id], rows: Array) -> tuple[list[Id], Int[Array, " N"]]:
    """The different labels, and the number of that of each row, where `rows` has the place of its label."""
    numbers: dict[Id, int] = {}
    codes = [numbers.setdefault(label, len(numbers)) for label in labels]
    return [*numbers], np.array(codes, np.int32)[rows]


def _seconds(rows: Steps, columns: Columns) -> Float[Array, " N"]:
    """The first column of time whose unit is known in seconds; NaN where it has no value."""
    table = rows.read([*columns.orders, *columns.times])
    for name, column in zip(table.column_names, table.columns, strict=True):
        values = flat.order_values(column.drop_null())
        if values is not None and len(values) and (unit := unit_of(name, column.type, values)) is not None:
            if flat.kind_of_type(column.type) == "time":
                column = column.cast(pa.int32() if column.type.bit_width == 32 else pa.int64())
            return np.asarray(column.cast(pa.float64(), safe=False).to_numpy()) * unit
    said = "no column is a time in seconds, which ends demonstrations: name one timestamp, or time_ms, or name it with"
    raise DataError(f"{columns.source}: {said} <option>; make one of times in texts.", "order")
