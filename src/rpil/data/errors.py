"""The two errors a user meets; each message is one sentence with the place and the remedy."""

from __future__ import annotations


class DataError(ValueError):
    """Bad input: one sentence naming the file or array, the demonstration and the remedy."""


class MissingExtraError(ImportError):
    """A feature needs an optional dependency; the message names the extra to install."""

    def __init__(self, feature: str, extra: str) -> None:
        super().__init__(f"{feature} needs an optional package: install it with pip install 'rpil[{extra}]'.")
        self._told = feature, extra

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str]]:
        return type(self), self._told  # by default it would not survive the way back from another process


class AmbiguousWarning(UserWarning):
    """The data hold two groups that may each be the expert; `RPIL.audit_` says which to label."""
