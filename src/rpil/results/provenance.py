"""Where a result comes from: version, command, seed, settings, and digests of the files that were read."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass
from pathlib import Path

from rpil.data.archive import rpil_version
from rpil.data.files import StrPath, is_hidden
from rpil.data.text import for_others

PROVENANCE_KEY = "rpil.provenance"
"""Key of the provenance, as JSON, among the metadata of a Parquet file."""

_MOST_DIGESTED = 256 * 2**20
"""Bytes of a file that are all read for a digest."""


@dataclass(frozen=True)
class Provenance:
    """How a result was made; `settings` are those that are not the defaults, `files` the data and then other files."""

    rpil: str
    command: str
    seed: int
    settings: Mapping[str, object]
    files: tuple[Mapping[str, str | int], ...]

    @classmethod
    def of(cls, command: str, seed: int, settings: Mapping[str, object], files: Iterable[StrPath | None]) -> Provenance:
        """The provenance of a result about these `files`, where given."""
        found = tuple(digest(path) for path in files if path is not None)
        return cls(rpil_version(), for_others(command), seed, settings, found)

    def to_dict(self) -> dict[str, object]:
        """All of it, for JSON."""
        return asdict(self)


def changed_settings(given: object, default: object, name: str = "") -> dict[str, object]:
    """The fields, by names with dots, in which two settings, records of the same kind, differ."""
    if is_dataclass(given) and type(given) is type(default):
        names = (field.name for field in fields(given))
        parts = (changed_settings(getattr(given, p), getattr(default, p), f"{name}.{p}".strip(".")) for p in names)
        return {key: value for part in parts for key, value in part.items()}
    plain = isinstance(given, str | int | None) or (isinstance(given, float) and math.isfinite(given))
    return {} if given == default else {name: given if plain else repr(given)}


def digest(path: StrPath) -> dict[str, str | int]:
    """Size and SHA-256 of a file; of a folder, the SHA-256 of the names and digests of its files.

    Files of more than 256 MiB in all count by names and sizes alone. Nothing is read of an address, or of hidden files.
    """
    place, sha256 = Path(path), hashlib.sha256()
    inside = sorted(place.rglob("*")) if place.is_dir() else [place]
    files = [file for file in inside if file.is_file() and not any(map(is_hidden, file.relative_to(place).parts))]
    n_bytes, found = sum(file.stat().st_size for file in files), sha256
    for file in files:
        found = hashlib.sha256(str(file.stat().st_size).encode())
        if n_bytes <= _MOST_DIGESTED:
            with file.open("rb") as content:
                found = hashlib.file_digest(content, "sha256")
        sha256.update(os.fsencode(file.relative_to(place).as_posix()) + b"\0" + found.digest())
    own = sha256 if place.is_dir() else found
    return {"path": for_others(str(path)), "bytes": n_bytes, "sha256": own.hexdigest() if files else ""}
