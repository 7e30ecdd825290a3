"""Files that stay open for a while, so that all that reads a file of others opens it once."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import BinaryIO, TypeVar, cast

T = TypeVar("T")

MOST_OPEN = 64
"""Files that stay open, at most: a process may have a few hundred."""

Held = tuple[ExitStack | None, dict[tuple[str, object], object]]
"""What closes the files, and the files by path and kind."""

_open = threading.local()  # two threads that read one open file would move each other's place


@contextmanager
def holding() -> Iterator[None]:
    """Within the block, what `held` opens stays open until the end of the outermost such block."""
    if hasattr(_open, "files"):
        yield
        return
    with ExitStack() as stack:
        _open.files = stack, {}
        try:
            yield
        finally:
            del _open.files


@contextmanager
def held(path: str | os.PathLike[str], open_it: Callable[[], AbstractContextManager[T]], kind: str = "") -> Iterator[T]:
    """The file at `path` as `open_it` opens it, or as it was opened before within `holding`; closed after the block.

    `kind` tells apart what several libraries open.
    """
    stack, found = cast(Held, getattr(_open, "files", (None, {})))
    key = str(path), kind
    if stack is None or (key not in found and len(found) >= MOST_OPEN):
        with open_it() as one:
            yield one
        return
    if key not in found:
        found[key] = stack.enter_context(open_it())
    yield cast(T, found[key])


@contextmanager
def held_bytes(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """The bytes of a file from the first one on; to close this stream leaves the file that is held open."""
    with held(path, lambda: open(path, "rb"), "bytes") as file:
        file.seek(0)
        with os.fdopen(os.dup(file.fileno()), "rb") as stream:
            yield stream
