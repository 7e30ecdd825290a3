"""The one guard around all that reads files of others: whatever a library raises there becomes one sentence."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager

from rpil.data.errors import DamagedError, DataError, MissingExtraError
from rpil.data.files import StrPath

_OF_WRITING = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
_OF_SYSTEM = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EAGAIN, errno.EINTR, errno.ECHILD)
_LONGEST = 100  # characters of a foreign error


@contextmanager
def guarded(
    where: StrPath, fault: str = "it cannot be read", remedy: str = "it is damaged or of another form, write it again"
) -> Iterator[None]:
    """Let nothing but a `DataError` of one sentence leave the block, which reads `where`.

    A `MissingExtraError`, a warning and an interruption pass, and so does an error of writing, such as a full disk: it
    is no fault of what is read, and `rpil.data.files.replacing` names the output. Where the system lacks something,
    such as memory or file handles, the sentence says so, and not the `fault`.
    """
    try:
        yield
    except (DataError, MissingExtraError, Warning):
        raise
    except MemoryError as error:
        raise DataError(f"{where}: reading it needs more memory than is free; read less of it.") from error
    except Exception as error:  # damaged files make libraries raise errors of very many types
        if isinstance(error, OSError) and error.errno in _OF_WRITING:
            raise
        is_own = type(error).__module__ == OSError.__module__  # FFmpeg has errors of these names for damaged videos
        if is_own and isinstance(error, OSError) and error.errno in _OF_SYSTEM:
            raise DataError(f"{where}: the system could not read it ({in_words(error)}); try again.") from error
        if is_own and isinstance(error, PermissionError):
            raise DataError(f"{error.filename or where}: it may not be read; change its permissions.") from error
        raise DamagedError(f"{where}: {fault} ({in_words(error)}); {remedy}.") from error


def in_words(error: BaseException) -> str:
    """The type of an error and the beginning of its message, printable and without a full stop."""
    text = "".join(sign if sign.isprintable() else " " for sign in str(error))
    text = " ".join(text.split()).replace(". ", ", ")[:_LONGEST].rstrip(" .")
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
