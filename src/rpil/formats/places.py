"""Where the demonstrations of a recording are, and their order, times and facts, by columns of the file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import repeat

import numpy as np
import pyarrow as pa

from rpil.data.arrays import Id, are_whole, as_ids, check_any, group_rows
from rpil.data.errors import DataError
from rpil.data.fit_data import FILE_SESSION, Facts, outcome_of_steps
from rpil.data.text import EPISODE, ORDER_COLUMNS, OUTCOME, TIMESTAMP, plain_name
from rpil.formats import table as flat
from rpil.formats.columns import FILE, LENGTH, STRETCH, Columns
from rpil.formats.format import Metadata
from rpil.formats.steps import Steps
from rpil.formats.table import BATCH_ROWS, Place
from rpil.numerics.types import Array, Float, Int

_WHOLE_NUMBER = re.compile(r"0|-?[1-9]\d{0,18}")
_FILE_ORDER, _NEEDED = "steps in the order of the file", "needs a number or time in every row, as 2026-11-30 14:00:05"

MAX_NAMES = 20
"""Tasks and operators of a description, at most."""


def find_places(rows: Steps, columns: Columns) -> tuple[Steps, Columns]:
    """The steps of each demonstration together and in order, and the columns with the one that gives the order.

    A `DataError` where ids are missing or unclear, or a demonstration is in two files.
    """
    check_any(len(rows), rows.source)
    names_of, group = _ids(rows, columns)
    if is_cut := bool(columns.options.split_gap or columns.options.segment):
        names_of, group = shorter(names_of, group, rows, columns)

    def at(row: int) -> str:
        return replace(rows, ids=(names_of[int(group[row])],), offsets=np.array([row])).place_of(row, 0)

    _check_ids(names_of, group, columns, rows.source, is_cut)
    order, words, values = _find_order(rows, columns, group, at)
    if not is_cut:
        _check_one_id(rows, columns, group, order, at)
    chosen, offsets, moved = group_rows(group, values)
    ids = as_ids([names_of[k] for k in chosen.tolist()], rows.source)
    heads = np.append(0, np.flatnonzero(group[1:] != group[:-1]) + 1)  # of runs of rows of one demonstration
    ends = np.cumsum([0, *rows.sizes.values()])
    starts = ends if rows.place is None else np.unique(np.searchsorted(rows.place, ends))
    starts = starts[starts < len(rows)]
    if columns.episode == FILE and not columns.options.id:
        heads = np.union1d(heads, starts)
    elif order is None and columns.orders:  # whose steps may count anew in a file
        steps, later = flat.order_values(rows.read([name := columns.orders[0]])[name]), starts[1:]
        heads = heads if steps is None else np.union1d(heads, later[steps[later] < steps[later - 1]])
    files: dict[Id, str] = {}
    for row, file in zip(heads, rows.files(heads) or repeat(rows.source), strict=False):
        if files.setdefault(m := names_of[group[row]], file) != file:
            remedy = "give each demonstration its own id, in one file"
            remedy += f"; where each file is one, --exclude {columns.episode}"
            remedy = "rename one of them" if columns.episode == FILE else remedy
            raise DataError(f"{rows.source}, demonstration {m!r}: it is both in {files[m]} and in {file}; {remedy}.")
    apart = "; rows of a demonstration lay apart" if len(heads) > len(chosen) else ""
    rows = replace(rows if moved is None else rows.taken(moved), ids=ids, offsets=offsets)
    return rows, replace(columns, order=order, order_words=f"{words}{apart}")


def _ids(rows: Steps, columns: Columns) -> tuple[list[Id], Int[Array, " N"]]:
    """The different ids, and the number of that of each row; one id where no column tells demonstrations apart.

    Of text tables all are numbers where all are written as whole numbers of at most 64 bits.
    """
    numbers, group = dict[Id, int](), np.zeros(len(rows), np.int32)
    if columns.episode == STRETCH:
        return [0], group
    for row, part, place in rows.tables([columns.episode]):
        ids, codes = flat.id_codes(part, columns.episode, place)
        group[row : row + len(part)] = np.array([numbers.setdefault(m, len(numbers)) for m in ids])[codes]
    texts = [str(m) for m in numbers] if columns.id_written else []
    if texts and all(_WHOLE_NUMBER.fullmatch(text) and abs(int(text)) < 1 << 63 for text in texts):
        return [int(text) for text in texts], group
    return [*texts] or [*numbers], group


def _find_order(steps: Steps, columns: Columns, group: Array, at: Place) -> tuple[str | None, str, Array | None]:
    """By the first of the likely columns that tells the steps of every demonstration apart; its values, to sort by.

    `group` (N,) numbers the demonstration of each row. A `DataError` where the user named a column that does not.
    """
    by_group = np.argsort(group, kind="stable") if np.any(group[1:] < group[:-1]) else slice(None)
    same = group[by_group][1:] == group[by_group][:-1]
    fault = ""
    for name, column in ((name, steps.read([name])[name]) for name in columns.orders):
        values, said = flat.order_values(column), "values that are missing, or neither numbers nor times"
        if values is not None:
            step, said = values[by_group], "repeated values within a demonstration"
            if np.all((step[1:] > step[:-1]) | ~same):
                return name, f"steps in the order of {name}", values
            rows = np.lexsort([values, group])
            twice = np.flatnonzero((values[rows][1:] == values[rows][:-1]) & (group[rows][1:] == group[rows][:-1]))
            if not len(twice):
                return name, f"steps sorted by {name}, because rows of the file are out of order", values
            if columns.options.order:
                row = int(rows[twice[0] + 1])
                raise DataError(f"{at(row)}: order column {name!r} repeats a value; name another, or leave it out.")
        if columns.options.order:
            raise DataError(f"{at(0)}: order column {name!r} {_NEEDED}; name another.")
        fault = fault or f"{_FILE_ORDER}, because {name} has {said}"
    return None, fault or _FILE_ORDER, None


def _check_ids(names: Sequence[Id], group: Array, columns: Columns, source: str, is_cut: bool) -> None:
    """A `DataError` where ids are yes or no; or where a user chose the time or number of a row, or too short times."""
    name, plain, flags = columns.episode, plain_name(columns.episode), {str(name).lower() for name in names[:3]}
    if flags <= {"true", "false"} or (flags <= {"0", "1"} and OUTCOME.fullmatch(plain)):
        said = f"column {name!r} is yes or no, and no id; where it marks the ends of demonstrations"
        way = f"make a column of ids from it, in Python: numpy.cumsum({name}) - {name}"
        raise DataError(f"{source}: {said}, {way}.")
    if not (is_cut or columns.options.id) or len(group) < 2:
        return
    ways = "name the column of the demonstration with --id, or, where pauses divide demonstrations, --split-gap"
    if 2 * len(names) > len(group):
        said = f"{name!r} would make {len(names):,} demonstrations of {len(group):,} steps; {ways}"
        more = "if that is meant, call it episode_index; where --split-gap or --segment is given, give more seconds"
        raise DataError(f"{source}: {said}; {more}.")
    is_order = any(pattern.fullmatch(plain) for pattern in ORDER_COLUMNS)
    if is_order and 2 * np.count_nonzero(group[1:] != group[:-1]) > len(group):
        said = "looks like a time, or the number of a step, as it changes from row to row"
        raise DataError(f"{source}: {name!r} {said}; {ways}.")


def _check_one_id(steps: Steps, columns: Columns, group: Array, order: str | None, at: Place) -> None:
    """A `DataError` where the rows of one id seem to be several demonstrations, as where each session counts its own.

    They are one where a column gives the order of its rows, unless they lie together only by a second column.
    """
    changes, ids = group[1:] != group[:-1], flat.first_rows(group, group)
    for name in columns.parts if order is None or 1 + np.count_nonzero(changes) > len(ids) else ():
        codes = flat.encoded(steps.read([name])[name])[1]
        rows, n_runs = flat.first_rows(group, codes), 1 + np.count_nonzero(changes | (codes[1:] != codes[:-1]))
        if len(ids) < len(rows) <= len(group) / 2 and (order is None or n_runs == len(rows)):
            row = int(rows[~np.isin(rows, ids)][0])
            said = f"column {name!r} changes within this demonstration"
            way = f"write a column of ids that no two demonstrations share, or, if {columns.episode!r} is one"
            raise DataError(f"{at(row)}: {said}; {way}, say so with --id.")


def shorter(
    names: Sequence[Id], group: Int[Array, " N"], rows: Steps, columns: Columns
) -> tuple[list[Id], Int[Array, " N"]]:
    """The ids of the shorter demonstrations that the options make of these `names`, and which is that of each row.

    A demonstration ends where the next row is more than `split_gap` seconds later, or earlier: "P01" becomes
    "P01-0" and "P01-1"; and after each `segment` seconds from its first row on: "P01 [0, 10) s" and "P01 [10, 20) s".
    """
    clock, is_new = find_clock(replace(rows, offsets=np.arange(2)), columns), columns.episode == STRETCH
    if clock is None or clock.unit is None:
        said = "no column is a time in seconds, which ends demonstrations: name one timestamp, or time_ms, or name it"
        raise DataError(f"{rows.source}: {said} with --order; make one of times in texts.")
    seconds = clock.ticks * clock.unit
    if gap := columns.options.split_gap:
        steps, counts, labels = np.diff(seconds, prepend=np.nan), Counter[int](), list[Id]()
        starts = (steps > gap) | (steps < 0) | (np.diff(group, prepend=-1) != 0)
        for k in group[starts].tolist():
            labels.append(counts[k] if is_new else f"{names[k]}-{counts[k]}")
            counts[k] += 1
        names, group = labels, np.cumsum(starts) - 1
    if length := columns.options.segment:
        if np.isnan(seconds).any():
            raise DataError(f"{rows.source}: the column of time lacks values; fill it in.")
        first = seconds[np.unique(group, return_index=True)[1]]
        parts = np.stack([group, np.floor((seconds - first[group]) / length)])
        pairs, places = np.unique(parts, axis=1, return_inverse=True)
        ends = ((names[int(k)], part * length, (part + 1) * length) for k, part in pairs.T.tolist())
        names, group = [f"{m} [{a:.10g}, {b:.10g}) s" for m, a, b in ends], places.reshape(-1)
    return [*names], group


def find_facts(steps: Steps, columns: Columns, metadata: Metadata) -> Facts:
    """The facts about the M demonstrations; a `DataError` where a column that the user names cannot be one."""
    files, order = steps.files(steps.offsets[:-1]), None
    are_numbers = plain_name(columns.episode) == EPISODE[0] and isinstance(steps.ids[0], int)
    if files and metadata.version and are_numbers:  # LeRobot numbers them in their order
        order = np.array(steps.ids, dtype=float)
    sessions, name = tuple[str, ...](), columns.session
    if name == FILE_SESSION and name not in steps.table.schema.names:
        if not files:
            raise DataError(f"{steps.source}: its files make no sessions; name a column with --session.")
        sessions = tuple(files)
    elif name is not None:
        pairs = pairs_of(steps, name)
        counts = Counter(m for m, _ in pairs)
        if wrong := [m for m, value in pairs if value is None or counts[m] > 1]:
            place = f"{steps.source}, demonstration {wrong[0]}"
            raise DataError(f"{place}: column {name!r} changes, or has no value, within it; give it one session.")
        sessions = tuple(str(value) for _, value in pairs)
    outcomes, lengths = list[Array](), np.diff(steps.offsets).astype(float)
    for column, less in ((one.removeprefix("-"), one.startswith("-")) for one in columns.outcomes):
        found = lengths if column == LENGTH else flat.numbers_or_missing(steps.read([column])[column])
        if found is not None and column != LENGTH:
            found = outcome_of_steps(found.astype(float), steps.offsets, column)
        if found is None:
            kinds = "neither one number for each demonstration, nor a reward, nor a flag of 0 and 1"
            said = f"column {column!r} is {kinds}; write 1 for a success and 0 for a failure"
            raise DataError(f"{steps.source}: {said}, or name another column with --outcome.")
        is_flag = bool(np.isin(found[~np.isnan(found)], (0, 1)).all())  # which stays one
        outcomes.append(float(is_flag) - found if less else found)
    return Facts(order, sessions, tuple(outcomes), columns.outcomes)


def pairs_of(steps: Steps, name: str | None) -> list[tuple[str, object]]:
    """The different pairs of id, as text, and value of a column, if there is one, in the order of the file."""
    if name is None:
        return []
    values, codes = flat.encoded(steps.read([name])[name])
    each = np.repeat(np.arange(len(steps.ids), dtype=np.int32), np.diff(steps.offsets))
    rows = flat.first_rows(each, codes)
    values = [int(v) if isinstance(v, float) and are_whole(np.array([v])) else v for v in values] + [None]
    return [(str(steps.ids[m]), values[k]) for m, k in zip(each[rows].tolist(), codes[rows].tolist(), strict=True)]


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
        some = range(0, len(self.ticks), BATCH_ROWS * -(-len(self.ticks) // (16 * BATCH_ROWS)))  # of very many
        steps = np.concatenate([np.diff(self.ticks[a : a + BATCH_ROWS + 1]) for a in some])
        lengths, step = self.lengths(offsets), usual_step(steps)
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
    named, found = [name for name in columns.all if plain_name(name) in TIMESTAMP], None
    table = steps.read([*columns.orders, *named, *columns.times])  # the likeliest first
    for name in table.column_names:
        missing = np.asarray(table[name].is_null(nan_is_null=True).to_numpy(), dtype=bool)
        values = flat.order_values(table[name].filter(~missing) if missing.any() else table[name])
        if values is None or not len(values):
            continue
        is_text, is_named = flat.kind_of_type(table[name].type) == "text", plain_name(name) in TIMESTAMP
        unit = 1e-6 if is_text else unit_of(name, table[name].type, values)
        if unit is None and (found or not is_named):
            continue
        ticks = np.full(len(missing), np.nan)
        ticks[~missing] = values - values.min()
        clock = Clock(ticks, unit)
        moved = np.diff(ticks) > 0
        moved[steps.offsets[1:-1] - 1] = False  # a date moves between demonstrations alone
        goes_on = (is_named and not is_text) or (moved.any() and not (clock.lengths(steps.offsets) < 0).any())
        if unit is not None and goes_on:
            return clock
        found = clock if unit is None else found
    return found


def unit_of(name: str, kind: pa.DataType, values: Array) -> float | None:
    """Seconds in one unit of a column of time; by its type, its name, or the size of a time since 1970."""
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind) or pa.types.is_time(kind):
        return _SECONDS[kind.unit]
    words = plain_name(name).split("_")
    if words[-1] in _SECONDS and len(words) > 1:
        return _SECONDS[words[-1]]
    largest = max(float(values.max()), -float(values.min()))
    for limit, unit in ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3)):
        if largest > limit:
            return unit
    has_parts = values.dtype.kind == "f" and not np.array_equal(values, np.round(values))
    return 1.0 if has_parts and _WORDS_OF_TIME & set(words) else None
