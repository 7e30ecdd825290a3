"""The two errors a user meets; each message is one sentence with the place and the remedy."""

from __future__ import annotations


class DataError(ValueError):
    """Bad input: one sentence naming the file or array, the demonstration and the remedy."""


class MissingExtraError(ImportError):
    """A feature needs an optional dependency; the message names the extra to install."""

    def __init__(self, feature: str, extra: str) -> None:
        super().__init__(f"{feature} needs an optional package: install it with pip install 'rpil[{extra}]'.")
