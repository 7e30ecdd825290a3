"""JSON and other text beside data: no more of a file is read than such files need."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from rpil.data.errors import DataError
from rpil.data.memory import MIB

Parsed = Any
"""A value of JSON."""

LARGEST_METADATA, LARGEST_TABLE = 16 * MIB, 64 * MIB
"""Bytes of a text that describes data, and of one with a line for each demonstration, at most."""

MOST_LISTS = 2_000_000
"""Lists and objects in JSON, at most: an empty one takes 20 times its text when it is parsed."""


def read_text(path: Path, limit: int = LARGEST_METADATA) -> str:
    """The text of a file in UTF-8, without the mark before it; errors are those of `check_text`."""
    with path.open("rb") as file:
        content = file.read(limit + 1)
    check_text(content, str(path), limit)
    return content.decode("utf-8-sig")


def read_json(path: Path, limit: int = LARGEST_METADATA) -> Parsed:
    """Read a file of JSON; errors are those of `parse`."""
    return parse(read_text(path, limit), str(path), limit)


def object_in(text: object) -> dict[str, Parsed]:
    """The object that a text of JSON holds; empty where it holds none."""
    try:
        found = json.loads(text)  # type: ignore[arg-type]
    except (ValueError, TypeError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def parse(text: str | bytes, where: str, limit: int = LARGEST_METADATA) -> Parsed:
    """Parse a text of JSON.

    A `DataError` where it is longer than `limit`, or holds more lists than `MOST_LISTS`; another `ValueError`, or a
    `RecursionError`, where it is no JSON.
    """
    check_text(text, where, limit)
    return json.loads(text)


def check_text(text: str | bytes, where: str, limit: int) -> None:
    """A `DataError` where a text is longer than `limit`, or holds more lists than `MOST_LISTS`."""
    if len(text) > limit:
        raise DataError(f"{where}: it is longer than {limit // MIB} MiB, which no such file needs; write it again.")
    n_lists = text.count("[") + text.count("{") if isinstance(text, str) else text.count(b"[") + text.count(b"{")
    if n_lists > MOST_LISTS:
        raise DataError(f"{where}: it holds more than {MOST_LISTS:,} lists and objects; write it again.")


def parse_lines(text: str, where: str, limit: int = LARGEST_METADATA) -> list[Parsed]:
    """The values of a text with one value of JSON on each line; errors are those of `parse`."""
    check_text(text, where, limit)
    lines = text.replace("\r", "\n").split("\n")  # as JSON knows them
    return [json.loads(line) for line in lines if line.strip()]


def finite(value: object) -> object:
    """A value for JSON, with None for NaN and infinity, which JSON has not."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
