"""Guesses at the roles of columns whose names say nothing, for messages: nothing is read by a guess."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING

from rpil.data.errors import DataError
from rpil.data.names import OPERATOR, plain_name
from rpil.formats.columns import ColumnOptions, as_list

if TYPE_CHECKING:
    import pyarrow as pa

_CONTROL = re.compile(
    r"(?:.*_)?(?:steer(?:ing)?|throttle|gas|brak(?:e|ing)|accel(?:eration)?|pedal|torque|thrust|force|rudder|aileron|motor"
    r"|gripper|joystick|command|cmd|control|ctrl|button|key)s?(?:_.*|\d+)?"
)
_QUANTITY = re.compile(r"[+-]?\d[\d.,]*\s*[^\d\s.,:/-][^\d]*")
_MOST_OPERATORS, _SHORTEST = 20, 3


class RoleError(DataError):
    """A column of some role was not found; `guess` are the options that may say which, by their names."""

    def __init__(self, sentence: str, guess: Mapping[str, str]) -> None:
        said = ", ".join(f"{name}={value!r}" for name, value in guess.items())
        super().__init__(f"{sentence}; perhaps {said}." if guess else f"{sentence}.")
        self.sentence, self.guess = sentence, guess


def guess_options(head: pa.Table | None, options: ColumnOptions) -> dict[str, str]:
    """Options that may name id, action and operator, by the first rows, and those given; none without id and action.

    An id comes in runs of equal values, none of which comes again, and of such columns it has most values. An operator
    is of few values, and the same within each demonstration.
    """
    if head is None or not head.num_rows:
        return {}
    columns = {name: head[name].to_pylist() for name in head.column_names}
    runs = {name: sum(a != b for a, b in pairwise(values)) + 1 for name, values in columns.items()}
    n_values = {name: len({*map(str, values)}) for name, values in columns.items()}
    ids = [name for name in columns if 1 < n_values[name] == runs[name] <= head.num_rows / _SHORTEST]
    own = options.id or max(ids, key=n_values.__getitem__, default=None)
    actions = as_list(options.action) if options.action else [n for n in columns if _CONTROL.fullmatch(plain_name(n))]
    if own is None or own not in columns or not actions:
        return {}
    pairs = {name: len({*zip(map(str, columns[own]), map(str, columns[name]), strict=True)}) for name in columns}
    few = [name for name in columns if 1 < n_values[name] <= min(_MOST_OPERATORS, n_values[own] / 2)]
    who = [name for name in few if pairs[name] == n_values[own] and isinstance(columns[name][0], str)]
    named = [name for name in columns if OPERATOR.fullmatch(plain_name(name)) and name not in (own, *actions)]
    operator = options.operator or next(iter(named or who), None)
    found = {"id": own, "action": ",".join(actions)} | ({"operator": operator} if operator else {})
    names = ("id", "action", "observations", "exclude", "order", "operator", "task", "session", "outcome")
    given = {name: ",".join(as_list(getattr(options, name) or ())) for name in names} | found
    return {name: value for name, value in given.items() if value}


def quantity(head: pa.Table | None, name: str) -> str:
    """The first value of a column of text, where it is a number with a unit; else nothing."""
    first = head[name][0].as_py() if head is not None and head.num_rows and name in head.column_names else None
    return first if isinstance(first, str) and _QUANTITY.fullmatch(first.strip()) else ""
