"""Guesses at the columns of demonstration and action, by values and words, where no name says them."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np
import pyarrow as pa

from rpil.data.arrays import are_whole
from rpil.data.names import OPERATOR, is_observation, is_order, plain_name
from rpil.formats.table import encoded

GUESSED_ROWS = 20_000
"""The first rows, by which the column of the demonstration is guessed."""

_SHORTEST = 3
"""Steps of a demonstration, on average and at least."""

_CONTROL = re.compile(
    r"(?:.*_)?(?:(?P<pedal>gas|brak(?:e|ing)|accel(?:eration)?|pedal)|steer(?:ing)?|throttle|torque|thrust|force|rudder"
    r"|aileron|motor|gripper|joystick|command|cmd|control|ctrl|button|key|bolus)s?(?:_.*|\d+)?"
    r"|(?:.*_)?stick(?:_.*|[a-z]?\d*)|user_angle"
)

_OF_MANY = re.compile(r"(?:operator|demonstrator|teleoperator|annotator|worker)s?(?:_.*)?")
"""Names of people who give many demonstrations each, as a participant or a driver need not."""

OF_PART = re.compile(r"(?:lap|round|attempt|take|rep|repetition|leg|heat|stint)s?(?:_(?:index|ids?|no|num|number|nr))?")
"""Names of the parts of what a driver did, each of which may be a demonstration."""


def guess_id(head: pa.Table | None, names: Iterable[str]) -> str | None:
    """The column of the demonstration by the first rows, if any: its values come in runs, and none of them comes again.

    Of several such columns it is the one with most values. A time is none, whatever its values, nor is an operator.
    """
    found, most = None, 1
    for name, column in _there(head, names).items():
        if not (is_order(name) or _OF_MANY.fullmatch(plain_name(name))):
            n_values, n_runs = _values_and_runs(column.slice(0, GUESSED_ROWS))
            if most < n_values == n_runs <= min(len(column), GUESSED_ROWS) / _SHORTEST:
                found, most = name, n_values
    return found


def guess_actions(numbers: Iterable[str], texts: Iterable[str] = (), head: pa.Table | None = None) -> list[str]:
    """The columns of numbers that are called as what people steer with, such as a wheel or a gripper, but for pedals
    alone; else a choice or order, of numbers or `texts`, which does not count the rows of the `head`."""
    own = [name for name in numbers if "," not in name and not is_observation(name)]
    if controls := {name: found for name in own if (found := _CONTROL.fullmatch(plain_name(name)))}:
        return [] if all(found["pedal"] for found in controls.values()) else [*controls]  # a wheel of another name
    decisions = [name for name in (*own, *texts) if plain_name(name).rstrip("s") in ("choice", "order")]
    return [name for name, column in _there(head, decisions).items() if not _counts(column)][:1]


def one_id(head: pa.Table | None, names: Iterable[str]) -> str:
    """The first column that may be an id and has one value in all the first rows, in words; else nothing."""
    for name, column in _there(head, names).items():
        is_id = re.fullmatch(rf"(?:.*_)?(?:id|name|no|number)|{OPERATOR.pattern}", plain_name(name))
        if is_id and len(values := column.unique().to_pylist()) == 1:
            return f" ({name!r} is {values[0]!r:.40} in every row: one demonstration)"
    return ""


def _counts(column: pa.ChunkedArray) -> bool:
    """Whether most numbers of a column are one more than the one before."""
    values = column.to_numpy()
    return values.dtype.kind in "iuf" and bool(np.sum(np.diff(values) == 1) > len(values) / 2)


def _there(head: pa.Table | None, names: Iterable[str]) -> dict[str, pa.ChunkedArray]:
    """Those of the columns that are in the first rows."""
    return {name: head[name] for name in names if head is not None and name in head.column_names}


def _values_and_runs(column: pa.ChunkedArray) -> tuple[int, int]:
    """How many different values a column has, and how many runs of equal ones; none where they cannot be ids."""
    has_parts = pa.types.is_floating(column.type) and not are_whole(column.to_numpy())
    if column.null_count or pa.types.is_boolean(column.type) or has_parts:
        return 0, 0
    codes = encoded(column)[1]
    return len(np.unique(codes)), 1 + int(np.count_nonzero(np.diff(codes)))
