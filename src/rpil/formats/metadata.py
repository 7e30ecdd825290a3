"""Statements of a recording beside its steps: metadata, times, operators and tasks, and facts for who asks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from rpil.data.arrays import Id, are_whole
from rpil.data.errors import DataError
from rpil.data.names import EPISODE, TIMESTAMP, plain_name
from rpil.data.recorded_facts import FILE_SESSION, Facts, outcome_of_steps
from rpil.data.text import counted
from rpil.formats.columns import LENGTH, Columns
from rpil.formats.steps import Steps
from rpil.formats.table import encoded, numbers_or_missing, order_values
from rpil.numerics.types import Array, Float

MAX_NAMES = 20
"""Tasks and operators of a description, at most."""


@dataclass(frozen=True)
class Metadata:
    """Statements of a recording on itself: attributes of a file, or LeRobot's ``meta``; empty where it says nothing."""

    version: str = ""
    fps: float | None = None
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # of the numbers in a column of lists
    tasks: Mapping[str, str] = field(default_factory=dict)  # by task_index, as text
    videos: tuple[str, ...] = ()  # observations that lie beside the table
    n_cameras: int = 0  # of videos and of images
    lengths: Mapping[Id, int] = field(default_factory=dict)  # declared steps of each demonstration

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on it for the user."""
        unseen = f"{counted(self.n_cameras, 'camera')} {'are' if self.n_cameras > 1 else 'is'} not used"
        return (f"{unseen}: what only pictures show is not known here.",) if self.n_cameras else ()


def find_facts(steps: Steps, columns: Columns, metadata: Metadata) -> Facts:
    """The facts about the M demonstrations.

    A `DataError` where the column of the session or of the outcome, which the user names, cannot be one.
    """
    table = steps.read(columns.facts)
    files, order = steps.files(steps.offsets[:-1]), None
    are_numbers = plain_name(columns.episode) == EPISODE[0] and isinstance(steps.ids[0], int)
    if files and metadata.version and are_numbers:  # LeRobot numbers them in their order
        order = np.array(steps.ids, dtype=float)
    sessions = () if columns.session is None else _sessions(columns.session, steps, files)
    outcomes = tuple(_outcome(table, name, columns, steps.offsets, steps.source) for name in columns.outcomes)
    return Facts(order, sessions, outcomes, columns.outcomes)


def _sessions(name: str, steps: Steps, files: Sequence[str]) -> tuple[str, ...]:
    """The session of each demonstration."""
    if name == FILE_SESSION and name not in steps.table.schema.names:
        if not files:
            raise DataError(f"{steps.source}: its files make no sessions; name a column with <option>.", "session")
        return tuple(files)
    pairs, ids = pairs_of(steps, name), {str(m): m for m in steps.ids}
    counts = Counter(m for m, _ in pairs)
    for m, value in pairs:
        if value is None or counts[m] > 1:
            fault = "has no value" if value is None else "changes"
            place = f"{steps.source}, demonstration {ids[m]!r}"
            raise DataError(f"{place}: column {name!r} {fault} within it; give it one session.")
    return tuple(str(value) for _, value in pairs)


def _outcome(table: pa.Table, wanted: str, columns: Columns, offsets: Array, source: str) -> Float[Array, " M"]:
    """The outcome of each demonstration in the `wanted` column, with NaN where it is not known."""
    name = wanted.removeprefix("-")
    ways = f"name another column with <option>, or {LENGTH!r}"
    found: Array | None = np.diff(offsets).astype(float)
    if name != LENGTH:
        values = numbers_or_missing(table[name])
        if values is None or values.shape[1] != 1:
            raise DataError(f"{source}: column {name!r} is not of one number for each step; {ways}.", "outcome")
        found = outcome_of_steps(values[:, 0].astype(float), offsets, name)
    if found is None:
        raise DataError(
            f"{source}: column {name!r} changes within demonstrations and is neither a reward nor a flag of 0 and 1, "
            f"so that nothing says which value is the outcome; {ways}.",
            "outcome",
        )
    return (
        found if wanted == name else float(np.isin(found[~np.isnan(found)], (0, 1)).all()) - found
    )  # a flag stays one


def pairs_of(steps: Steps, name: str | None) -> list[tuple[str, object]]:
    """The different pairs of id, as text, and value of a column, if there is one, in the order of the file."""
    if name is None:
        return []
    values, codes = encoded(steps.read([name])[name])
    each = np.repeat(np.arange(len(steps.ids)), np.diff(steps.offsets))
    _, first = np.unique(each * (len(values) + 1) + codes, return_index=True)
    values = [int(v) if isinstance(v, float) and are_whole(np.array([v])) else v for v in values] + [None]
    owners = each[np.sort(first)]
    return [(str(steps.ids[m]), values[codes[row]]) for m, row in zip(owners.tolist(), np.sort(first), strict=True)]


def different(pairs: Iterable[tuple[str, object]], names: Mapping[str, str] | None = None) -> tuple[str, ...]:
    """The different values of pairs of id and value, the first ones, by their `names` if they have any."""
    values = dict.fromkeys(str(value) for _, value in pairs if value is not None)
    return tuple((names or {}).get(value, value) for value in list(values)[:MAX_NAMES])


_UNITS = {"s sec secs seconds": 1.0, "ms msec msecs": 1e-3, "us": 1e-6, "ns nsec nsecs nanosec": 1e-9}
_SECONDS = {unit: seconds for units, seconds in _UNITS.items() for unit in units.split()}
_WORDS_OF_TIME = {"t", "ts", "time", "timestamp", "timestamps", "stamp", "elapsed", "clock"}


@dataclass(frozen=True, eq=False)
class Times:
    """Statements of a recording on its times and lengths."""

    timestamps: Float[Array, " N"] | None = None  # of each step in seconds; NaN where it is missing
    fps: float | None = None  # frames a second
    frames: Mapping[Id, int] = field(default_factory=dict)  # that each demonstration should have


@dataclass(frozen=True, eq=False)
class Clock:
    """A column of time."""

    ticks: Float[Array, " N"]
    """Times of the steps, in the order of the demonstrations, from the smallest on; NaN where it is missing."""
    unit: float | None
    """Seconds in a tick, None where neither type, name nor size says it: then it is taken to be a second."""

    def seconds(self, offsets: Array) -> tuple[float | None, float | None]:
        """Duration of all demonstrations in seconds, and steps a second; None where they are not known."""
        lengths, step = self.lengths(offsets), usual_step(np.diff(self.ticks))
        if self.unit is None or step is None or not np.all(lengths >= 0):
            return None, None
        return float(lengths.sum() * self.unit), 1 / (step * self.unit)

    def lengths(self, offsets: Array) -> Float[Array, " M"]:
        """Lengths of the demonstrations, in ticks."""
        return np.asarray(self.ticks[offsets[1:] - 1] - self.ticks[offsets[:-1]])


def usual_step(steps: Array) -> float | None:
    """The mean of the usual ones among the times between two rows, to which pauses do not belong; None without any."""
    steps = steps[steps > 0]
    return float(steps[steps <= 1.5 * np.median(steps)].mean()) if len(steps) else None


def find_clock(steps: Steps, columns: Columns) -> Clock | None:
    """The first column of time whose unit is known, or else one that is called so; None where there is none."""
    named, found = [name for name in columns.all if plain_name(name) in TIMESTAMP], list[Clock]()
    table = steps.read([*columns.orders, *named, *columns.times])  # the likeliest first
    for name in table.column_names:
        missing = np.asarray(table[name].is_null(nan_is_null=True).to_numpy(), dtype=bool)
        values = order_values(table[name].filter(~missing))
        if values is None or not len(values):
            continue
        ticks = np.full(len(missing), np.nan)
        ticks[~missing] = values - values.min()
        clock = Clock(ticks, unit_of(name, table[name].type, values))
        is_named = plain_name(name) in TIMESTAMP
        passes = (np.diff(ticks) > 0).any() and not (clock.lengths(steps.offsets) < 0).any()
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
