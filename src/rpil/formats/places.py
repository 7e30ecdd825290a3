"""Where the demonstrations of a recording are, and the order of their steps, by columns of the file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import repeat

import numpy as np

from rpil.data.arrays import Id, as_ids, check_any, group_rows
from rpil.data.errors import DataError
from rpil.data.text import ORDER_COLUMNS, OUTCOME, plain_name
from rpil.formats import table as flat
from rpil.formats.columns import FILE, STRETCH, Columns
from rpil.formats.metadata import find_clock
from rpil.formats.steps import Steps
from rpil.formats.table import Place
from rpil.numerics.types import Array, Int

_WHOLE_NUMBER = re.compile(r"0|-?[1-9]\d{0,18}")
_FILE_ORDER = "steps in the order of the file"


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
    if columns.episode == FILE and not columns.options.id:
        starts = np.cumsum([0, *rows.sizes.values()])
        heads = np.union1d(heads, starts[starts < len(rows)])
    files: dict[Id, str] = {}
    for row, file in zip(heads, rows.files(heads) or repeat(rows.source), strict=False):
        if files.setdefault(m := names_of[group[row]], file) != file:
            remedy = "give each demonstration its own id, in one file"
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
            raise DataError(f"{at(0)}: order column {name!r} needs a number or time in every row; name another.")
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
    """The ids of the shorter demonstrations that the options make of those with these `names`, and the number of that
    of each row, as `group` is.

    A demonstration ends where the next row is more than `split_gap` seconds later, or earlier: "P01" is split into
    "P01-0" and "P01-1"; and after each `segment` seconds from its first row on: into "P01 [0, 10) s" and
    "P01 [10, 20) s".
    """
    clock, is_new = find_clock(replace(rows, offsets=np.arange(2)), columns), columns.episode == STRETCH
    if clock is None or clock.unit is None:
        said = (
            "no column is a time in seconds, which ends demonstrations: name one timestamp, or time_ms, or name it with"
        )
        raise DataError(f"{rows.source}: {said} --order; make one of times in texts.")
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
