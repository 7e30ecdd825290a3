"""Where a result comes from: versions, command, seed, settings, columns, and digests of the files that were read."""

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
from typing import TYPE_CHECKING

from rpil.data.archive import rpil_version
from rpil.data.demonstrations import Demonstrations
from rpil.data.files import StrPath
from rpil.data.folders import is_hidden
from rpil.data.privacy import for_others

if TYPE_CHECKING:
    from rpil.formats.recording import Recording

PROVENANCE_KEY = "rpil.provenance"
"""Key of the provenance, as JSON, among the metadata of a Parquet file."""

_MOST_DIGESTED, _MOST_FILES, _END = 256 * 2**20, 10_000, 64 * 2**10
"""More bytes than this are not read for a digest, nor more files opened; then the end of each file is."""


@dataclass(frozen=True)
class Provenance:
    """How a result was made; `settings` are those that are not the defaults, `files` the data and then other files."""

    rpil: str
    python: str
    libraries: Mapping[str, str]
    command: str
    seed: int
    settings: Mapping[str, object]
    columns: Mapping[str, object]
    files: tuple[Mapping[str, str | int], ...]
    time: str
    """In UTC; ``SOURCE_DATE_EPOCH`` takes its place, so that outputs can be repeated."""

    @classmethod
    def of(
        cls,
        recording: Recording,
        path: StrPath | None,
        command: str,
        seed: int,
        settings: Mapping[str, object],
        others: Iterable[StrPath | None],
    ) -> Provenance:
        """That of a result about the recording at a `path`, or in memory; `others` are other files, where given."""
        embeddings, seconds = recording.options.embeddings, os.environ.get("SOURCE_DATE_EPOCH", "")
        moment = datetime.fromtimestamp(int(seconds) if seconds.isdecimal() else time.time(), UTC)
        more = (digest(other) for other in (embeddings, *others) if other is not None)
        return cls(
            rpil=rpil_version(),
            python=platform.python_version(),
            libraries={name: version(name) for name in ("numpy", "scipy", "scikit-learn", "pyarrow")},
            command=for_others(command),
            seed=seed,
            settings=settings,
            columns=_columns(recording),
            files=(_in_memory(recording) if path is None else digest(path), *more),
            time=moment.isoformat(timespec="seconds"),
        )

    def to_dict(self) -> dict[str, object]:
        """All of it, for JSON."""
        return asdict(self)


def changed_settings(given: object, default: object, name: str = "") -> dict[str, object]:
    """The fields, by names with dots, in which two settings, records of the same kind, differ."""
    if is_dataclass(given) and type(given) is type(default):
        parts = (field.name for field in fields(given))
        found = (changed_settings(getattr(given, p), getattr(default, p), f"{name}.{p}".strip(".")) for p in parts)
        return {key: value for part in found for key, value in part.items()}
    plain = isinstance(given, str | int | None) or (isinstance(given, float) and math.isfinite(given))
    return {} if given == default else {name: given if plain else repr(given)}


def digest(path: StrPath) -> dict[str, str | int]:
    """Size and SHA-256 of a file, or of the files of a folder with their names, in order.

    Of more than 256 MiB, or 10,000 files, it is that of names, sizes and the last 64 KiB of each of the first 10,000
    files, where Parquet keeps its footer. What is at an address is not read again, nor are hidden files.
    """
    place, where, found = Path(path), for_others(str(path)), hashlib.sha256()
    if not place.exists():
        return {"path": where, "bytes": 0, "sha256": "", "of": "nothing: it is an address or a pattern"}
    inside = [] if place.is_file() else place.rglob("*")
    seen = (file for file in inside if file.is_file() and not any(map(is_hidden, file.relative_to(place).parts)))
    files = [place] if place.is_file() else sorted(seen)
    sizes = [file.stat().st_size for file in files]
    is_whole = sum(sizes) <= _MOST_DIGESTED and len(files) <= _MOST_FILES
    of = (
        "the last 64 KiB of each file" if not is_whole else "the bytes" if place.is_file() else "the bytes of each file"
    )
    if not (place.is_file() and is_whole):
        of = f"names, sizes and {of}"
        for file, size in zip(files, sizes, strict=True):
            found.update(os.fsencode(f"{file.relative_to(place).as_posix()}\0{size}\0"))
    for file, size in zip(files[:_MOST_FILES], sizes, strict=False):
        with file.open("rb") as content:
            content.seek(0 if is_whole else max(size - _END, 0))
            while block := content.read(2**20):
                found.update(block)
    return {"path": where, "bytes": sum(sizes), "sha256": found.hexdigest(), "of": of}


def _in_memory(recording: Recording) -> dict[str, str | int]:
    """The digest of demonstrations that come from no file, or from one whose place is not known any more."""
    data, source = recording.demonstrations, for_others(recording.description.source)
    if not isinstance(data, Demonstrations):
        return {"path": source, "bytes": 0, "sha256": "", "of": "nothing: the place of the data is not known"}
    found = hashlib.sha256(repr(data.ids).encode("utf-8", "surrogatepass"))
    for array in (data.offsets, data.observations, data.actions):
        found.update(array.tobytes())
    n_bytes = data.observations.nbytes + data.actions.nbytes
    return {"path": source, "bytes": n_bytes, "sha256": found.hexdigest(), "of": "arrays in memory"}


def _columns(recording: Recording) -> dict[str, object]:
    """The columns that were read by their roles, what was left out, and what was asked for."""
    said, options = recording.description, recording.options
    own: dict[str, object] = {"id": said.id_column, "order": said.order_column, "action_kind": said.action_kind}
    read = {"action": list(said.actions), "observations": list(said.observations), "ignored": dict(said.ignored)}
    asked = {name: getattr(options, name) for name in ("operator", "task", "session", "outcome", "only", "without")}
    given = {name: value if isinstance(value, str | int) else list(value) for name, value in asked.items() if value}
    return {**own, **read, **given}
