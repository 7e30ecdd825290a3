"""Limits of what is read: the memory that data may take, and the sizes of JSON and other text beside data.

Data of a known size are refused, or left on disk, before they are read.
"""

from __future__ import annotations

import json
import math
import os
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

from rpil.data.errors import DataError

Size = str | float
"""Bytes as a number, or as text such as "4GB", "500 MB" or "2GiB"."""

FREE_SHARE = 0.5
"""Share of the free memory that data may take where no size was given."""

MOST_IN_MEMORY = 512_000_000
"""Bytes above which data stay on disk by default: an audit takes as long there, and less memory."""

BYTES_PER_NUMBER = 16
"""In tables: a number as it is read, and as it is kept."""

MIB = 1_048_576
"""Bytes of a mebibyte."""

_SIZE = re.compile(r"(\d+\.?\d*)\s*(?:([kmgt])(i?))?b?", re.IGNORECASE)


def parse_size(size: Size) -> float:
    """A size in bytes; a `DataError` where it is none."""
    match = _SIZE.fullmatch(str(size).strip())
    if match is None or not float(match[1]):
        raise DataError(f"{size!r} is no amount of memory; give one such as 4GB or 500MB.")
    power = 1 + "kmgt".index(match[2].lower()) if match[2] else 0
    return float(match[1]) * (1024.0 if match[3] else 1000.0) ** power


class TooLargeError(DataError):
    """Data that would take more memory than they may."""


def check_memory(n_bytes: float, where: str, given: Size | None = None) -> None:
    """Raise a `TooLargeError` with the figures where data of `n_bytes` would take more than is `given`, or else than a
    share of what is free."""
    most = FREE_SHARE * free_memory() if given is None else parse_size(given)
    if n_bytes > most:
        raise TooLargeError(
            f"{where}: to read it would take {_written(n_bytes)} of memory, more than the {_written(most)} that it "
            "may; allow more with --memory (rpil.open leaves larger data on disk)."
        )


def check_free(n_bytes: float) -> None:
    """Raise a `MemoryError`, which `rpil.data.errors.guarded` puts in words, where a part of a file takes more than a
    share of the free memory."""
    if n_bytes > 64 * MIB and n_bytes > FREE_SHARE * free_memory():  # which takes a moment to find
        raise MemoryError


def free_memory() -> float:
    """Free memory in bytes, at most what the container may take; infinite where the system does not say."""
    free = math.inf
    with suppress(OSError):
        available = re.search(r"MemAvailable:\s*(\d+)", Path("/proc/meminfo").read_text())
        free = 1024.0 * int(available[1]) if available else free
    for limit in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        with suppress(OSError, ValueError):  # "max" where there is none
            free = min(free, float(Path(limit).read_text()))
    if math.isinf(free):
        with suppress(OSError, ValueError, AttributeError):
            free = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    return free


def _written(n_bytes: float) -> str:
    return f"{n_bytes / 1e9:,.1f} GB" if n_bytes >= 1e8 else f"{n_bytes / 1e6:,.3g} MB"


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
    """Read a file of JSON; errors are those of `check_text`, and a `ValueError` or `RecursionError` if it is none."""
    return json.loads(read_text(path, limit))


def object_in(text: object) -> dict[str, Parsed]:
    """The object that a text of JSON holds; empty where it holds none."""
    try:
        found = json.loads(text)  # type: ignore[arg-type]
    except (ValueError, TypeError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def check_text(text: str | bytes, where: str, limit: int) -> None:
    """A `DataError` where a text is longer than `limit`, or holds more lists than `MOST_LISTS`."""
    if len(text) > limit:
        raise DataError(f"{where}: it is longer than {limit // MIB} MiB, which no such file needs; write it again.")
    n_lists = text.count("[") + text.count("{") if isinstance(text, str) else text.count(b"[") + text.count(b"{")
    if n_lists > MOST_LISTS:
        raise DataError(f"{where}: it holds more than {MOST_LISTS:,} lists and objects; write it again.")


def finite(value: object) -> object:
    """A value for JSON, with None for NaN and infinity, which JSON has not."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
