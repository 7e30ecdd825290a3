"""JSON and other text beside data: no more of a file is read than metadata need."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rpil.data.errors import DataError

Parsed = Any
"""A value of JSON."""

LARGEST_METADATA = 16 * 2**20
"""Bytes of a file of metadata, at most; parsed, JSON takes up to 24 times its size."""


def read_text(path: Path, limit: int = LARGEST_METADATA, encoding: str = "utf-8") -> str:
    """The text of a file; a `DataError` where it has more bytes than `limit`."""
    with path.open("rb") as file:
        content = file.read(limit + 1)
    check_size(len(content), str(path), limit)
    return content.decode(encoding)


def read_json(path: Path, limit: int = LARGEST_METADATA) -> Parsed:
    """What a file of JSON holds; a `DataError` where it has more bytes than `limit`.

    A `ValueError` or `RecursionError` where it is no JSON.
    """
    return json.loads(read_text(path, limit))


def check_size(n_bytes: int, where: str, limit: int = LARGEST_METADATA) -> None:
    """A `DataError` where a text has more bytes than `limit`."""
    if n_bytes > limit:
        raise DataError(
            f"{where}: it is longer than {limit / 2**20:,.0f} MiB, which no such file needs; write it again."
        )
