"""What a recording says about its own times: timestamps, the frame rate, and how many frames there should be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from rpil.data.arrays import Id
from rpil.data.names import TIMESTAMP, plain_name
from rpil.formats.columns import Columns
from rpil.formats.places import order_values
from rpil.numerics.types import Array, Float

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
    """Seconds in a tick, None where neither type, name nor size says it."""

    @property
    def timestamps(self) -> Float[Array, " N"]:
        """In seconds; a column of which only the name says that it is time is taken to hold them."""
        return self.ticks * (self.unit or 1.0)

    def seconds(self, offsets: Array) -> tuple[float | None, float | None]:
        """Duration of all demonstrations in seconds, and steps a second; None where they are not known."""
        lengths, step = self._lengths(offsets), usual_step(np.diff(self.ticks))
        if self.unit is None or step is None or not np.all(lengths >= 0):
            return None, None
        return float(lengths.sum() * self.unit), 1 / (step * self.unit)

    def is_plausible(self, offsets: Array) -> bool:
        """Whether time passes, and no demonstration ends before it begins."""
        return bool((np.diff(self.ticks) > 0).any()) and not (self._lengths(offsets) < 0).any()

    def _lengths(self, offsets: Array) -> Array:
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
        values = order_values(table[name].filter(~missing))
        if values is None or not len(values):
            continue
        ticks = np.full(len(missing), np.nan)
        ticks[~missing] = values - values.min()
        clock = Clock(ticks, unit_of(name, table[name].type, values))
        is_named = plain_name(name) in TIMESTAMP
        if is_named or (clock.unit is not None and clock.is_plausible(offsets)):
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
    values = order_values(column)
    if values is None or not len(values) or pa.types.is_duration(column.type) or pa.types.is_time(column.type):
        return None
    seconds = values * (unit_of(name, column.type, values) or 1.0)
    low, high = _WALL_CLOCK
    return seconds if low < seconds.min() and seconds.max() < high else None
