"""What is missing in data, values that are NaN or infinite and chunks of arrays: refused unless a block allows it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_ALLOWED: ContextVar[bool] = ContextVar("missing values are allowed", default=False)
_FILLED: ContextVar[bool] = ContextVar("missing chunks are filled", default=False)


@contextmanager
def allow_missing(wanted: bool = True) -> Iterator[None]:
    """Within the block, and if `wanted`, data may hold NaN and infinite values. They must not reach a fit."""
    token = _ALLOWED.set(wanted or are_allowed())
    try:
        yield
    finally:
        _ALLOWED.reset(token)


def are_allowed() -> bool:
    """Whether data may hold NaN and infinite values here."""
    return _ALLOWED.get()


@contextmanager
def fill_chunks(wanted: bool = True) -> Iterator[None]:
    """Within the block, and only if `wanted`, chunks of Zarr and HDF5 that are not there are read as the fill value."""
    token = _FILLED.set(wanted)
    try:
        yield
    finally:
        _FILLED.reset(token)


def are_chunks_filled() -> bool:
    """Whether chunks that are not there are read as the fill value here."""
    return _FILLED.get()
