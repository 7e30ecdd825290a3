"""Values that are NaN or infinite: refused where data are read, except for a check that reports all of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_ALLOWED: ContextVar[bool] = ContextVar("missing values are allowed", default=False)


@contextmanager
def allow_missing() -> Iterator[None]:
    """Within the block, data may hold NaN and infinite values. They must not reach a fit."""
    token = _ALLOWED.set(True)
    try:
        yield
    finally:
        _ALLOWED.reset(token)


def are_allowed() -> bool:
    """Whether data may hold NaN and infinite values here."""
    return _ALLOWED.get()
