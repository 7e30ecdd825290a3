"""Columns as a data frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

DataFrame = Any
"""A frame of pandas, which need not be installed, or a table of pyarrow."""


def data_frame(columns: Mapping[str, Sequence[object]]) -> DataFrame:
    """The columns as a data frame of pandas, or where that is not installed as a table of pyarrow."""
    lists = {name: list(values) for name, values in columns.items()}
    try:
        return import_module("pandas").DataFrame(lists)
    except ImportError:
        return import_module("pyarrow").table(lists)
