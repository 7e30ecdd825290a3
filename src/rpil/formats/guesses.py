"""Guesses at the columns of demonstration, action and time, by values and words, where no name says them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import are_whole
from rpil.data.names import is_observation, is_order, plain_name

if TYPE_CHECKING:
    import pyarrow as pa

GUESSED_ROWS = 20_000
"""The first rows, by which the column of the demonstration is guessed."""

_SHORTEST = 3
"""Steps of a demonstration, on average and at least."""

_CONTROL = re.compile(
    r"(?:.*_)?(?:steer(?:ing)?|throttle|gas|brak(?:e|ing)|accel(?:eration)?|pedal|torque|thrust|force|rudder|aileron|motor"
    r"|gripper|joystick|command|cmd|control|ctrl|button|key)s?(?:_.*|\d+)?|user_angle"
)

_OF_MANY = re.compile(r"(?:operator|demonstrator|teleoperator|annotator|worker)s?(?:_.*)?")
"""Names of people who give many demonstrations each, as a participant or a driver need not."""

OF_PART = re.compile(r"(?:lap|round|attempt|take|rep|repetition|leg|heat|stint)s?(?:_(?:index|ids?|no|num|number|nr))?")
"""Names of the parts of what a driver did, each of which may be a demonstration."""

TIME_OF_DAY = (
    r"(?P<date>\d{4}[-_]\d\d[-_]\d\d)[-_T ](?P<hour>\d\d)[-_:](?P<minute>\d\d)[-_:](?P<second>\d\d)"
    r"(?:[-_.](?P<millisecond>\d{3}))?"
)
"""A time of day in a text, as in ``center_2021_10_25_16_31_20_658.jpg``."""


def guess_id(head: pa.Table | None, names: Iterable[str]) -> str | None:
    """The column of the demonstration by the first rows, if any: its values come in runs, and none of them comes again.

    Of several such columns it is the one with most values. A time is none, whatever its values, nor is an operator.
    """
    found, most = None, 1
    for name in names if head is not None else ():
        other = is_order(name) or _OF_MANY.fullmatch(plain_name(name))
        if head is not None and name in head.column_names and not other:
            n_values, n_runs = _values_and_runs(head[name].slice(0, GUESSED_ROWS))
            if most < n_values == n_runs <= min(len(head), GUESSED_ROWS) / _SHORTEST:
                found, most = name, n_values
    return found


def guess_actions(names: Iterable[str]) -> list[str]:
    """The columns that are called as what people steer with, such as a wheel, pedals, or a gripper."""
    own = [name for name in names if "," not in name and not is_observation(name)]
    return [name for name in own if _CONTROL.fullmatch(plain_name(name))]


def text_with_time(head: pa.Table | None, names: Iterable[str]) -> list[str]:
    """The first of the columns in whose first row there is a text with a time of day."""
    for name in names if head is not None and head.num_rows else ():
        value = head[name][0].as_py() if head is not None and name in head.column_names else None
        if isinstance(value, str) and re.search(TIME_OF_DAY, value):
            return [name]
    return []


def _values_and_runs(column: pa.ChunkedArray) -> tuple[int, int]:
    """How many different values a column has, and how many runs of equal ones; none where they cannot be ids."""
    import pyarrow as pa

    if column.null_count or pa.types.is_boolean(column.type):
        return 0, 0
    if pa.types.is_floating(column.type) and not are_whole(column.to_numpy()):
        return 0, 0
    codes = column.dictionary_encode().unify_dictionaries().combine_chunks().indices.to_numpy()
    return len(np.unique(codes)), 1 + int(np.count_nonzero(np.diff(codes)))
