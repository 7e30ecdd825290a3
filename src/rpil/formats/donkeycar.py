"""Tubs of Donkeycar, version 2 of their form: JSON lines in catalogs, and a manifest that lists what was deleted."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.files import new_folder
from rpil.data.guard import guarded
from rpil.data.json_files import LARGEST_TABLE, Parsed, parse, parse_lines, read_json, read_text
from rpil.data.memory import check_memory
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Format, keep_by_own_ids, kept_of
from rpil.formats.recording import Recording
from rpil.formats.step_arrays import Part, from_parts
from rpil.numerics.types import Array

_TUB_MANIFEST, _IMAGE_FOLDER = "manifest.json", "images"
_RECORD, _RECORD_TIME, _SESSION_ID = "_index", "_timestamp_ms", "_session_id"
_RECORDS = "records"
_COMMANDS = "user/angle", "user/throttle"
_LAST_COMMAND = "last "
_COPIES_OF_RECORDS = 20  # bytes in memory for each of the text
_NO_TUB = "it is no tub of Donkeycar, or a damaged one", "copy or record it again"

_STRETCHES = (
    "A demonstration is a stretch of records of one session without a gap, such as records that were deleted leave."
)
_NO_SENSORS = (
    "Only images say what the driver saw, and they are not read: the last angle and throttle stand for observations; "
    "numbers of your own for the images can be added as embeddings."
)


@dataclass(frozen=True)
class _Tub:
    """What a tub holds: the lines of its manifest, and its records, without those that were deleted, as lines too."""

    manifest: list[Parsed]
    records: list[dict[str, Parsed]]
    lines: list[str]
    fields: dict[str, str]

    @property
    def stretches(self) -> dict[str, range]:
        """Where the consecutive records of each demonstration are, by their first and last numbers."""
        keys = [(record[_RECORD], record.get(_SESSION_ID)) for record in self.records]
        breaks = [k + 1 for k, (a, b) in enumerate(pairwise(keys)) if b != (a[0] + 1, a[1])]
        found = [range(*ends) for ends in pairwise([0, *breaks, len(keys)])] if keys else []
        return {f"{keys[part[0]][0]}-{keys[part[-1]][0]}": part for part in found}


def claims(path: Path) -> bool:
    """Whether `path` is a folder with a manifest and a catalog."""
    return path.is_dir() and (path / _TUB_MANIFEST).is_file() and any(path.glob("*.catalog"))


def read(path: Path, options: ColumnOptions) -> Recording:
    """Read the records that were not deleted, without images; the last command is observed where no sensor is."""
    tub = _tub(path)
    numbers = [name for name, kind in tub.fields.items() if kind in ("float", "int", "boolean", "bool")]
    lost = [name for name in _COMMANDS if name not in numbers]
    if lost and not options.action:
        raise DataError(f"{path.name}: its records have no {lost[0]!r}; name the action with <option>.", "action")
    sensors = [name for name in numbers if not name.startswith(("user/", "pilot/"))]
    seen = sensors or [_LAST_COMMAND + name for name in _COMMANDS]
    chosen = replace(options, action=options.action or _COMMANDS, observations=options.observations or seen)
    parts = [_part(tub, name, part, numbers) for name, part in tub.stretches.items()]
    notes = (_STRETCHES,) if sensors or options.observations or options.embeddings else (_STRETCHES, _NO_SENSORS)
    images = {name: "images" for name, kind in tub.fields.items() if kind.endswith("_array")}
    return from_parts(parts, _RECORDS, path.name, "Donkeycar tub", chosen, notes=notes).with_ignored(images)


def _part(tub: _Tub, name: str, part: range, numbers: Sequence[str]) -> Part:
    """A stretch without its first record, which no command comes before."""
    records = [tub.records[k] for k in part]
    arrays = {column: _numbers([record.get(column) for record in records], column, name) for column in numbers}
    last = {_LAST_COMMAND + column: arrays[column][:-1] for column in _COMMANDS if column in arrays}
    clock = {"timestamp_ms": np.array([record.get(_RECORD_TIME, 0) for record in records], dtype=np.int64)}
    clock["index"] = np.array([record[_RECORD] for record in records], dtype=np.int64)
    about: dict[str, Id] = {_RECORDS: name}
    if isinstance(session := records[0].get(_SESSION_ID), str):
        about["session_id"] = session
    return Part(len(part) - 1, {**{one: array[1:] for one, array in (arrays | clock).items()}, **last}, about)


def _numbers(values: Sequence[Parsed], column: str, name: str) -> Array:
    """The values of one field, with NaN for those that are missing."""
    if any(not isinstance(value, int | float | None) for value in values):
        raise DataError(f"demonstration {name!r}: {column!r} is not a number in every record; leave it out.")
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def keep(path: Path, output: Path, ids: Sequence[Id]) -> None:
    """Write a new tub of the records and images of the demonstrations `ids`; nothing in it is marked as deleted.

    Records keep their numbers, so that the gaps between demonstrations stay.
    """
    tub = _tub(path)
    rows = [k for name in kept_of(tub.stretches, ids, path) for k in tub.stretches[name]]
    lines = [f"{tub.lines[k]}\r\n" for k in rows]  # as Donkeycar ends them
    catalog = "catalog_0.catalog"
    about = {"created_at": tub.manifest[3].get("created_at"), "path": f"{catalog}_manifest"}
    about |= {"line_lengths": [*map(len, lines)], "start_index": tub.records[rows[0]][_RECORD]}
    last = {**tub.manifest[4], "paths": [catalog], "deleted_indexes": []}
    images = [name for name, kind in tub.fields.items() if kind.endswith("_array")]
    with new_folder(output) as folder:
        _write(folder / catalog, "".join(lines))
        _write(folder / f"{catalog}_manifest", f"{json.dumps(about)}\r\n")
        _write(folder / _TUB_MANIFEST, "".join(f"{json.dumps(line)}\r\n" for line in [*tub.manifest[:4], last]))
        if (path / _IMAGE_FOLDER).is_dir():
            (folder / _IMAGE_FOLDER).mkdir()
            names = [Path(str(tub.records[k].get(image))).name for k in rows for image in images]
            for name in dict.fromkeys(name for name in names if (path / _IMAGE_FOLDER / name).is_file()):
                shutil.copyfile(path / _IMAGE_FOLDER / name, folder / _IMAGE_FOLDER / name)


def _write(path: Path, text: str) -> None:
    path.write_bytes(text.encode())


def _tub(path: Path) -> _Tub:
    """What the tub at `path` holds; a `DataError` where a line of it cannot be read."""
    with guarded(path / _TUB_MANIFEST, *_NO_TUB):
        manifest = parse_lines(read_text(path / _TUB_MANIFEST, LARGEST_TABLE), str(path / _TUB_MANIFEST), LARGEST_TABLE)
        inputs, kinds, *_, of_catalogs = manifest[:5]
        deleted, names = {*map(int, of_catalogs["deleted_indexes"])}, [*map(str, of_catalogs["paths"])]
        fields = dict(zip(map(str, inputs), map(str, kinds), strict=True))
    catalogs = [path / Path(name).name for name in dict.fromkeys(names)]
    check_memory(_COPIES_OF_RECORDS * sum(file.stat().st_size for file in catalogs if file.is_file()), path.name)
    records, kept = [], []
    for file in catalogs:
        with guarded(file, *_NO_TUB):
            lines = [line for line in read_text(file, LARGEST_TABLE).splitlines() if line.strip()]
            _check_number(file, len(lines))
            for line in lines:
                record = parse(line, str(file), LARGEST_TABLE)
                if not isinstance(record[_RECORD], int):
                    raise DataError(f"{file}: a record has no number; record it again.")
                if record[_RECORD] not in deleted:
                    records.append(record)
                    kept.append(line)
    if any(b[_RECORD] <= a[_RECORD] for a, b in pairwise(records)):
        raise DataError(f"{path.name}: the numbers of its records do not rise; copy or record it again.")
    return _Tub(manifest, records, kept, fields)


def _check_number(catalog: Path, n_records: int) -> None:
    """A `DataError` where the text beside a catalog says that it has another number of records."""
    beside = catalog.with_name(f"{catalog.name}_manifest")
    stated = len(read_json(beside, LARGEST_TABLE)["line_lengths"]) if beside.is_file() else n_records
    if stated != n_records:
        raise DataError(
            f"{catalog}: it holds {n_records:,} records, and {beside.name} says {stated:,}; copy it again, or remove "
            f"{beside.name} to read what is there."
        )


FORMAT = Format(name="Donkeycar tub", claims=claims, read=read, keep=keep_by_own_ids(keep))
