"""Statements of a recording beside its steps: metadata, LeRobot's ``meta``, times, operators, tasks and facts."""

from __future__ import annotations

import json
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import pyarrow as pa

from rpil.data.arrays import Id, are_whole
from rpil.data.errors import DataError, guarded
from rpil.data.files import check_inside
from rpil.data.fit_data import FILE_SESSION, Facts, outcome_of_steps
from rpil.data.memory import LARGEST_TABLE, Parsed, read_json, read_text
from rpil.data.text import EPISODE, TIMESTAMP, plain_name
from rpil.formats.columns import LENGTH, Columns
from rpil.formats.parquet_file import read_table
from rpil.formats.steps import Steps
from rpil.formats.table import BATCH_ROWS, encoded, first_rows, numbers_or_missing, order_values
from rpil.numerics.types import Array, Float

MAX_NAMES = 20
"""Tasks and operators of a description, at most."""


@dataclass(frozen=True)
class Metadata:
    """Statements of a recording on itself: attributes of a file, or LeRobot's ``meta``; empty where it says nothing."""

    version: str = ""
    fps: float | None = None
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # of the numbers in a column of lists
    tasks: Mapping[str, str] = field(default_factory=dict)  # by task_index, as text
    videos: tuple[str, ...] = ()  # observations that lie beside the table
    n_cameras: int = 0  # of videos and of images
    lengths: Mapping[Id, int] = field(default_factory=dict)  # declared steps of each demonstration


def find_facts(steps: Steps, columns: Columns, metadata: Metadata) -> Facts:
    """The facts about the M demonstrations.

    A `DataError` where the column of the session or of the outcome, which the user names, cannot be one.
    """
    table = steps.read(columns.facts)
    files, order = steps.files(steps.offsets[:-1]), None
    are_numbers = plain_name(columns.episode) == EPISODE[0] and isinstance(steps.ids[0], int)
    if files and metadata.version and are_numbers:  # LeRobot numbers them in their order
        order = np.array(steps.ids, dtype=float)
    sessions, name = tuple[str, ...](), columns.session
    if name == FILE_SESSION and name not in steps.table.schema.names:
        if not files:
            raise DataError(f"{steps.source}: its files make no sessions; name a column with --session.")
        sessions = tuple(files)
    elif name is not None:
        pairs = pairs_of(steps, name)
        counts = Counter(m for m, _ in pairs)
        if wrong := [m for m, value in pairs if value is None or counts[m] > 1]:
            place = f"{steps.source}, demonstration {wrong[0]}"
            raise DataError(f"{place}: column {name!r} changes, or has no value, within it; give it one session.")
        sessions = tuple(str(value) for _, value in pairs)
    outcomes, lengths = list[Array](), np.diff(steps.offsets).astype(float)
    for column, less in ((one.removeprefix("-"), one.startswith("-")) for one in columns.outcomes):
        values = None if column == LENGTH else numbers_or_missing(table[column])
        found = lengths if column == LENGTH else None
        if values is not None:
            found = outcome_of_steps(values.astype(float), steps.offsets, column)
        if found is None:
            kinds = "neither one number for each demonstration, nor a reward, nor a flag of 0 and 1"
            remedy = f"name another column with --outcome, or {LENGTH!r}"
            raise DataError(f"{steps.source}: column {column!r} is {kinds}; {remedy}.")
        is_flag = bool(np.isin(found[~np.isnan(found)], (0, 1)).all())  # which stays one
        outcomes.append(float(is_flag) - found if less else found)
    return Facts(order, sessions, tuple(outcomes), columns.outcomes)


def pairs_of(steps: Steps, name: str | None) -> list[tuple[str, object]]:
    """The different pairs of id, as text, and value of a column, if there is one, in the order of the file."""
    if name is None:
        return []
    values, codes = encoded(steps.read([name])[name])
    each = np.repeat(np.arange(len(steps.ids), dtype=np.int32), np.diff(steps.offsets))
    rows = first_rows(each, codes)
    values = [int(v) if isinstance(v, float) and are_whole(np.array([v])) else v for v in values] + [None]
    return [(str(steps.ids[m]), values[k]) for m, k in zip(each[rows].tolist(), codes[rows].tolist(), strict=True)]


def different(pairs: Iterable[tuple[str, object]], names: Mapping[str, str] | None = None) -> tuple[str, ...]:
    """The different values of pairs of id and value, the first ones, by their `names` if they have any."""
    values = dict.fromkeys(str(value) for _, value in pairs if value is not None)
    return tuple((names or {}).get(value, value) for value in list(values)[:MAX_NAMES])


_UNITS = {"s sec secs seconds": 1.0, "ms msec msecs": 1e-3, "us": 1e-6, "ns nsec nsecs nanosec": 1e-9}
_SECONDS = {unit: seconds for units, seconds in _UNITS.items() for unit in units.split()}
_WORDS_OF_TIME = {"t", "ts", "time", "timestamp", "timestamps", "stamp", "elapsed", "clock"}


@dataclass(frozen=True, eq=False)
class Times:
    """Statements of a recording on its times and lengths."""

    timestamps: Float[Array, " N"] | None = None  # of each step in seconds; NaN where it is missing
    fps: float | None = None  # frames a second
    frames: Mapping[Id, int] = field(default_factory=dict)  # that each demonstration should have


@dataclass(frozen=True, eq=False)
class Clock:
    """A column of time."""

    ticks: Float[Array, " N"]
    """Times of the steps, in the order of the demonstrations, from the smallest on; NaN where it is missing."""
    unit: float | None
    """Seconds in a tick, None where neither type, name nor size says it: then it is taken to be a second."""

    def seconds(self, offsets: Array) -> tuple[float | None, float | None]:
        """Duration of all demonstrations in seconds, and steps a second; None where they are not known."""
        some = range(0, len(self.ticks), BATCH_ROWS * -(-len(self.ticks) // (16 * BATCH_ROWS)))  # of very many
        steps = np.concatenate([np.diff(self.ticks[a : a + BATCH_ROWS + 1]) for a in some])
        lengths, step = self.lengths(offsets), usual_step(steps)
        if self.unit is None or step is None or not np.all(lengths >= 0):
            return None, None
        return float(lengths.sum() * self.unit), 1 / (step * self.unit)

    def lengths(self, offsets: Array) -> Float[Array, " M"]:
        """Lengths of the demonstrations, in ticks."""
        return np.asarray(self.ticks[offsets[1:] - 1] - self.ticks[offsets[:-1]])


def usual_step(steps: Array) -> float | None:
    """The mean of the usual ones among the times between two rows, to which pauses do not belong; None without any."""
    steps = steps[steps > 0]
    return float(steps[steps <= 1.5 * np.median(steps)].mean()) if len(steps) else None


def find_clock(steps: Steps, columns: Columns) -> Clock | None:
    """The first column of time whose unit is known, or else one that is called so; None where there is none."""
    named, found = [name for name in columns.all if plain_name(name) in TIMESTAMP], None
    table = steps.read([*columns.orders, *named, *columns.times])  # the likeliest first
    for name in table.column_names:
        missing = np.asarray(table[name].is_null(nan_is_null=True).to_numpy(), dtype=bool)
        values = order_values(table[name].filter(~missing) if missing.any() else table[name])
        if values is None or not len(values):
            continue
        unit, is_named = unit_of(name, table[name].type, values), plain_name(name) in TIMESTAMP
        if unit is None and (found or not is_named):
            continue
        ticks = np.full(len(missing), np.nan)
        ticks[~missing] = values - values.min()
        clock = Clock(ticks, unit)
        goes_on = is_named or ((np.diff(ticks) > 0).any() and not (clock.lengths(steps.offsets) < 0).any())
        if unit is not None and goes_on:
            return clock
        found = clock if unit is None else found
    return found


def unit_of(name: str, kind: pa.DataType, values: Array) -> float | None:
    """Seconds in one unit of a column of time; by its type, its name, or the size of a time since 1970."""
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind) or pa.types.is_time(kind):
        return _SECONDS[kind.unit]
    words = plain_name(name).split("_")
    if words[-1] in _SECONDS and len(words) > 1:
        return _SECONDS[words[-1]]
    largest = max(float(values.max()), -float(values.min()))
    for limit, unit in ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3)):
        if largest > limit:
            return unit
    if not _WORDS_OF_TIME & set(words):
        return None
    return 1.0 if values.dtype.kind == "f" and not np.array_equal(values, np.round(values)) else None


_PLACE = re.compile(r"\{(\w+)(?::(0\dd))?\}")


@dataclass(frozen=True, eq=False)
class MetaFolder:
    """The folder ``meta`` in the folder at `path`, which no link may leave."""

    path: Path

    @cached_property
    def files(self) -> list[Path]:
        """Files in it; a `DataError` where a link leads out of the folder, or to nothing."""
        inside = ((Path(folder), [*folders, *files]) for folder, folders, files in os.walk(self.path / "meta"))
        found = sorted(folder / name for folder, names in inside for name in names)
        for place in found:
            if not place.name.startswith("."):
                check_inside(place, self.path)
        return found

    @cached_property
    def info(self) -> dict[str, Parsed]:
        """The content of ``info.json``; empty where it is not there, and a `DataError` where it is damaged."""
        place, name = self.path / "meta" / "info.json", f"{self.path.name}/meta/info.json"
        if place not in self.files:
            return {}
        with guarded(name, "it does not describe a data set", "write it again, or move it away"):
            if isinstance(info := read_json(place), dict):
                return info
            raise TypeError("no object")

    @property
    def features(self) -> dict[str, dict[str, Parsed]]:
        """Facts in ``info.json`` about each feature."""
        features = self.info.get("features")
        return {m: of for m, of in features.items() if isinstance(of, dict)} if isinstance(features, dict) else {}

    def cameras(self, *kinds: str) -> tuple[str, ...]:
        """The features of these kinds, "video" or "image"."""
        return tuple(name for name, of in self.features.items() if of.get("dtype") in kinds)

    def tables(self, name: str) -> list[Path]:
        """The Parquet files of a table, in order."""
        first = (place.relative_to(self.path / "meta").parts[0] for place in self.files)
        own = (place for place, part in zip(self.files, first, strict=True) if part in (name, f"{name}.parquet"))
        return [place for place in own if place.suffix == ".parquet"]

    def rows(self, name: str, wanted: Callable[[str], bool] = lambda _: True) -> list[dict[str, Parsed]]:
        """The rows of a table: of lines of JSON before version 3.0, of Parquet files since; none where it is not there.

        Of Parquet files the columns that are `wanted` are given. Errors of reading are left as they are.
        """
        lines = self.path / "meta" / f"{name}.jsonl"
        if lines in self.files:
            text = read_text(lines, LARGEST_TABLE).replace("\r", "\n")  # the ends of lines that JSON knows
            return [json.loads(line) for line in text.split("\n") if line.strip()]
        tables = [read_table(place) for place in self.tables(name)]
        return [row for one in tables for row in one.select([*filter(wanted, one.column_names)]).to_pylist()]

    @cached_property
    def lengths(self) -> dict[Id, int]:
        """Steps by episode; empty where it does not say, and a `DataError` where it is damaged."""
        with guarded(self.path / "meta", "it does not say how long each episode is", "write it again"):
            rows = self.rows("episodes", lambda name: name in ("episode_index", "length"))
            return {int(row["episode_index"]): int(row["length"]) for row in rows}

    def tasks(self) -> dict[str, str]:
        """Task by its number; since version 3.0 its text is the index of pandas. Empty where they are damaged,
        and a `DataError` where they are not in UTF-8."""
        found, damages = {}, (pa.ArrowException, OSError, DataError, json.JSONDecodeError, KeyError, TypeError)
        place, *words = self.path / "meta", "its tasks cannot be read", "write them again in UTF-8"
        with guarded(place, *words), suppress(*damages, RecursionError):
            for row in self.rows("tasks"):
                texts = [text for name, text in row.items() if name != "task_index"]
                found[str(row["task_index"])] = str(row.get("task", *texts[:1]))
        return found


def read_metadata(paths: Sequence[str]) -> Metadata:
    """The metadata of the data set that holds the data files `paths`; empty where there are none.

    Lengths are those of all demonstrations, and empty where `paths` are some of the files only. A `DataError` where
    ``info.json`` or the table of lengths is damaged; a value of ``info.json`` that cannot be used is left out.
    """
    data = next((folder for folder in Path(paths[0]).parents if folder.name == "data"), None)
    meta = None if data is None else MetaFolder(data.parent)
    if data is None or meta is None or not meta.info:
        return Metadata()
    info = meta.info
    shown = {str(file) for file in data.rglob("*.parquet") if not file.name.startswith((".", "_"))}
    return Metadata(
        version=str(info.get("codebase_version", ""))[:40],
        fps=frame_rate(info.get("fps")),
        names={m: parts for m, one in meta.features.items() if (parts := _part_names(one))},
        tasks=meta.tasks(),
        videos=meta.cameras("video"),
        n_cameras=len(meta.cameras("video", "image")),
        lengths=meta.lengths if shown <= {*paths} else {},
    )


def frame_rate(value: Parsed) -> float | None:
    """The number that a value or a text says, as frames a second; None where it is none above 0."""
    with suppress(ValueError, TypeError, OverflowError):
        return float(value) if not isinstance(value, bool) and 0 < float(value) < 1e9 else None
    return None


def fill(template: str, chunk: int, file: int, camera: str = "") -> str:
    """A path of ``info.json``, as data/chunk-{chunk_index:03d}, with the numbers of a chunk and of a file in it."""
    values: dict[str, object] = {"chunk_index": chunk, "file_index": file, "video_key": camera}
    values |= {"episode_chunk": chunk, "episode_index": file}
    return _PLACE.sub(lambda match: format(values[match[1]], match[2] or ""), template)


def _part_names(feature: Mapping[str, object]) -> tuple[str, ...]:
    names = feature.get("names")
    if isinstance(names, dict):  # version 2 has {"motors": [...]}
        names = next(iter(names.values()), None)
    if isinstance(names, list) and len(names) == 1 and isinstance(names[0], list):  # of Unitree's converter
        names = names[0]
    return tuple(map(str, names)) if isinstance(names, list) and feature.get("shape") == [len(names)] else ()
