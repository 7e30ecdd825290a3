"""The errors that users meet; each message is one sentence that names the place and the remedy."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from importlib import import_module
from typing import Any

_QUOTE = re.compile(r"""((?:--[\w-]{1,40}|rpil \w{1,20}) )?(?<![\w=])(['"])((?:\\.|(?!\2)[^\\])*)(\2?)""", re.DOTALL)


class DataError(ValueError):
    """Bad input: one sentence naming the file or array, the demonstration and the remedy; see `shortened`.

    Where the remedy is an option, or several, ``<option>`` stands in their places in the sentence: the message names an
    argument of Python, and `in_shell` an option of the command.
    """

    def __init__(self, sentence: str, option: str | Sequence[str] = ()) -> None:
        options = [option] if isinstance(option, str) else option
        super().__init__(_spelt(sentence, (f"{name}={'True' * (name == 'skip_bad')}" for name in options)))
        in_shell = sentence.replace("<option>'", "<option> '")  # a value follows
        self.in_shell = _spelt(in_shell, (f"--{name.replace('_', '-')}" for name in options))


class DamagedError(DataError):
    """Bad input because of what is in a file; another file beside it may be sound."""


def _spelt(sentence: str, options: Iterable[str]) -> str:
    for option in options:
        sentence = sentence.replace("<option>", option, 1)
    return shortened(sentence)


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
