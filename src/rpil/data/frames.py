"""Columns as a data frame of the library that the user has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any, Literal, get_args

from rpil.data.errors import DataError

Backend = Literal["pandas", "polars", "pyarrow"]

DataFrame = Any
"""A frame of one of these libraries; none of them need be installed for type checkers."""


def data_frame(columns: Mapping[str, Sequence[object]], backend: Backend | None) -> DataFrame:
    """The columns as a data frame of the `backend`, or of the first of `Backend` that is installed.

    A `DataError` where the backend is unknown or not installed.
    """
    names = get_args(Backend)
    for name in (name for name in names if backend in (None, name)):
        with suppress(ImportError):
            module = import_module(name)
            make = module.table if name == "pyarrow" else module.DataFrame
            return make({name: list(values) for name, values in columns.items()})
    raise DataError(f"backend={backend!r} is unknown or not installed; choose one of {', '.join(map(repr, names))}.")
