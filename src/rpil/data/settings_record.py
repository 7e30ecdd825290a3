"""Records of settings, whose values are checked where a record is made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, TypeVar, dataclass_transform

import numpy as np

from rpil.data.archive import stored
from rpil.data.errors import DataError
from rpil.numerics.regression import ErrorSettings

stored()(ErrorSettings)  # here, because numerics knows nothing of archives

Record = TypeVar("Record")


@dataclass_transform(frozen_default=True)
def settings_record(**intervals: str) -> Callable[[type[Record]], type[Record]]:
    """Make a class a frozen dataclass that an archive may hold, whose numbers lie in these intervals.

    See `check_settings`; a ``__post_init__`` of the class may check more.
    """

    def decorate(kind: type[Record]) -> type[Record]:
        check_more = getattr(kind, "__post_init__", None)

        def check(settings: Any) -> None:
            check_settings(settings, **intervals)
            if check_more:
                check_more(settings)

        kind.__post_init__ = check  # type: ignore[attr-defined]
        return stored()(dataclass(frozen=True)(kind))

    return decorate


def check_settings(settings: Any, **intervals: str) -> None:
    """Raise a `DataError` that names the first field of a dataclass with a number outside its interval.

    An interval is written as in mathematics, such as "[0, 1)"; by default it is "[1, inf)" for fields whose default is
    a whole number, and "(0, inf)" for others. Fields that default to something else than numbers are not checked, nor
    is a None that the type of the field allows.
    """
    for field in fields(settings):
        value, default = getattr(settings, field.name), field.default
        several = isinstance(default, tuple)
        kind, numbers = (type(default[0]), value) if isinstance(default, tuple) else (type(default), (value,))
        if kind not in (int, float) or (value is None and "None" in str(field.type)):
            continue
        interval = intervals.get(field.name, "[1, inf)" if kind is int else "(0, inf)")
        if not isinstance(numbers, tuple) or not numbers or not all(_is_in(x, interval, kind) for x in numbers):
            noun = "whole number" if kind is int else "number"
            must = f"a tuple of {noun}s, each" if several else f"a {noun}"
            raise DataError(f"{type(settings).__name__}: {field.name}={value!r} must be {must} in {interval}.")


def _is_in(value: object, interval: str, kind: type) -> bool:
    low, high = map(float, interval[1:-1].split(","))
    if not isinstance(value, int | float | np.integer | np.floating) or (kind is int and not float(value).is_integer()):
        return False
    above = low <= value if interval[0] == "[" else low < value
    return bool(above and (value <= high if interval[-1] == "]" else value < high))
