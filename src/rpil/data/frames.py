"""Columns as a data frame of the library that the user has."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Literal, get_args

from rpil.data.errors import DataError

Backend = Literal["pandas", "polars", "pyarrow"]

DataFrame = Any
"""A frame of one of these libraries; none of them need be installed for type checkers."""

_MAKERS = {"pandas": "DataFrame", "polars": "DataFrame", "pyarrow": "table"}


def data_frame(columns: Mapping[str, Sequence[object]], backend: Backend | None) -> DataFrame:
    """The columns as a data frame of the `backend`, or of the first of `Backend` that is installed.

    A `DataError` where the backend is unknown or not installed.
    """
    names = get_args(Backend)
    if backend is not None and backend not in names:
        raise DataError(f"backend={backend!r} is unknown; choose one of {', '.join(map(repr, names))}.")
    chosen: str = backend or next(name for name in names if find_spec(name) is not None)
    try:
        make: Callable[[dict[str, list[object]]], DataFrame] = getattr(import_module(chosen), _MAKERS[chosen])
    except ImportError as error:
        raise DataError(f"backend={chosen!r} is not installed; install it, or leave backend out.") from error
    return make({name: list(values) for name, values in columns.items()})
