"""The errors that users meet; each message is one sentence that names the place and the remedy."""

from __future__ import annotations

import re
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
        super().__init__(sentence if is_command else _OPTION.sub(_as_argument, sentence))


def _as_argument(option: re.Match[str]) -> str:
    name = option[1].replace("-", "_")
    return f"{name}={'True' * (name == 'skip_bad')}"


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
