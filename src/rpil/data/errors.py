"""The errors that users meet; each message is one sentence that names the place and the remedy.

`guarded` is the one guard around all that reads files of others: whatever a library raises there becomes one sentence.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

_QUOTE = re.compile(r"""((?:--[\w-]{1,40}|rpil \w{1,20}) )?(?<![\w=])(['"])((?:\\.|(?!\2)[^\\])*)(\2?)""", re.DOTALL)
_OPTION = re.compile(r"(?<!\S)--([a-z]+(?:-[a-z]+)?)\b")  # within a sentence


class DataError(ValueError):
    """Bad input: one sentence naming the file or array, the demonstration and the remedy; see `shortened`.

    Options in it are those of the command, as `in_shell` shows them; the message names arguments of Python.
    """

    def __init__(self, sentence: str) -> None:
        self.in_shell = sentence = shortened(sentence)
        is_command = "rpil " in sentence  # which is to be copied
        named = _OPTION.sub(lambda one: f"{one[1].replace('-', '_')}={'True' * (one[1] == 'skip-bad')}", sentence)
        super().__init__(sentence if is_command else named)


class DamagedError(DataError):
    """Bad input because of what is in a file; another file beside it may be sound."""


def shortened(sentence: str) -> str:
    """A sentence with the beginnings of the long texts that it quotes; commands and options to copy stay whole."""

    def beginning(found: re.Match[str]) -> str:
        option, quote, text, end = found.groups()
        return found[0] if option or not end or len(text) <= 100 else f"{quote}{text[:60]}...{end}"

    return _QUOTE.sub(beginning, sentence)


class MissingExtraError(ImportError):
    """A feature needs an optional dependency; its arguments are the feature and the extra to install."""

    def __str__(self) -> str:
        feature, extra = self.args
        return f"{feature} needs an optional package: install it with pip install 'rpil[{extra}]'."


def optional(module: str, feature: str, extra: str) -> Any:
    """A module of an optional dependency; a `MissingExtraError` where it is not installed."""
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(feature, extra) from error


_OF_WRITING = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
_OF_SYSTEM = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EAGAIN, errno.EINTR, errno.ECHILD)
_LONGEST = 100  # characters of a foreign error


@contextmanager
def guarded(
    where: object, fault: str = "it cannot be read", remedy: str = "it is damaged or of another form, write it again"
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
