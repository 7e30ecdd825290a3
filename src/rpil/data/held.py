"""Files that stay open for a while, so that all that reads a file of others opens it once."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import BinaryIO, TypeVar

T = TypeVar("T")

MOST_OPEN = 64
"""Files that stay open, at most: a process may have a few hundred."""

_open = threading.local()  # two threads that read one open file would move each other's place


@contextmanager
def holding() -> Iterator[None]:
    """Within the block, what `held` opens stays open until the end of the outermost such block."""
    if hasattr(_open, "files"):
        yield
        return
    with ExitStack() as _open.stack:
        _open.files = {}
        try:
            yield
        finally:
            del _open.files


@contextmanager
def held(path: str | os.PathLike[str], open_it: Callable[[], AbstractContextManager[T]], kind: str = "") -> Iterator[T]:
    """The file at `path` as `open_it` opens it, or as it was opened before within `holding`; closed after the block.

    `kind` tells apart what several libraries open.
    """
    key, files = (str(path), kind), getattr(_open, "files", None)
    if files is None or (key not in files and len(files) >= MOST_OPEN):
        with open_it() as one:
            yield one
        return
    if key not in files:
        files[key] = _open.stack.enter_context(open_it())
    yield files[key]


@contextmanager
def held_bytes(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """The bytes of a file from the first one on; to close this stream leaves the file that is held open."""
    with held(path, lambda: open(path, "rb"), "bytes") as file:
        file.seek(0)
        with os.fdopen(os.dup(file.fileno()), "rb") as stream:
            yield stream
