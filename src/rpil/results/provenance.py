"""Where a result comes from: versions, command, seed, settings, and digests of the files that were read."""

from __future__ import annotations

import hashlib
import math
import os
import platform
import time
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from rpil.data.archive import rpil_version, stored
from rpil.data.files import StrPath
from rpil.data.folders import is_hidden
from rpil.data.privacy import for_others

PROVENANCE_KEY = "rpil.provenance"
"""Key of the provenance, as JSON, among the metadata of a Parquet file."""

_MOST_DIGESTED, _MOST_FILES, _END = 256 * 2**20, 10_000, 64 * 2**10
"""Bytes of a file that are all read for a digest, files of a folder that are opened, and bytes at the end of each."""


@stored()
@dataclass(frozen=True)
class Provenance:
    """How a result was made; `settings` are those that are not the defaults, `files` the data and then other files."""

    rpil: str
    python: str
    libraries: Mapping[str, str]
    command: str
    seed: int
    settings: Mapping[str, object]
    files: tuple[Mapping[str, str | int], ...]
    time: str
    """In UTC; ``SOURCE_DATE_EPOCH`` takes its place, so that outputs can be repeated."""

    @classmethod
    def of(cls, command: str, seed: int, settings: Mapping[str, object], files: Iterable[StrPath | None]) -> Provenance:
        """That of a result about these `files`, where given."""
        seconds = os.environ.get("SOURCE_DATE_EPOCH", "")
        moment = datetime.fromtimestamp(int(seconds) if seconds.isdecimal() else time.time(), UTC)
        return cls(
            rpil=rpil_version(),
            python=platform.python_version(),
            libraries={name: version(name) for name in ("numpy", "scipy", "scikit-learn", "pyarrow")},
            command=for_others(command),
            seed=seed,
            settings=settings,
            files=tuple(digest(path) for path in files if path is not None),
            time=moment.isoformat(timespec="seconds"),
        )

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
    """Size and SHA-256 of the bytes of a file.

    Of a file of more than 256 MiB, and of a folder, it is that of names and sizes, in order, and of the last 64 KiB of
    each file, where Parquet keeps its footer. What is at an address is not read again, nor are hidden files.
    """
    place, where, sha256 = Path(path), for_others(str(path)), hashlib.sha256()
    if not place.exists():
        return {"path": where, "bytes": 0, "sha256": "", "of": "nothing: it is an address or a pattern"}
    if place.is_file() and place.stat().st_size <= _MOST_DIGESTED:
        with place.open("rb") as content:
            sha256 = hashlib.file_digest(content, "sha256")
        return {"path": where, "bytes": place.stat().st_size, "sha256": sha256.hexdigest(), "of": "the bytes"}
    inside = [place] if place.is_file() else sorted(place.rglob("*"))
    files = [file for file in inside if file.is_file() and not any(map(is_hidden, file.relative_to(place).parts))]
    sizes = [file.stat().st_size for file in files]
    for k, (file, size) in enumerate(zip(files, sizes, strict=True)):
        sha256.update(os.fsencode(f"{file.relative_to(place).as_posix()}\0{size}\0"))
        if k < _MOST_FILES:
            with file.open("rb") as content:
                content.seek(max(size - _END, 0))
                sha256.update(content.read())
    of = "names, sizes and the last 64 KiB of each file"
    return {"path": where, "bytes": sum(sizes), "sha256": sha256.hexdigest(), "of": of}
