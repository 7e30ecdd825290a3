"""Whether chunks of arrays that are missing are filled: else they are refused."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_FILLED: ContextVar[bool] = ContextVar("missing chunks are filled", default=False)


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
