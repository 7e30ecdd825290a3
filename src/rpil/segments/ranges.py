"""Rows to keep as ranges, for trainers, and segments as a table."""

from __future__ import annotations

import json
from collections.abc import Hashable, Mapping, Sequence
from string import Formatter

import numpy as np

from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_extension, replacing
from rpil.numerics.types import Array
from rpil.segments.table import KINDS, Segments

Ranges = Mapping[Hashable, Sequence[Sequence[int]]]
"""Half-open ranges of rows of each demonstration that is kept."""


def columns_of(pattern: str) -> list[str]:
    """The columns that a pattern of keys names in braces; a `DataError` where it is none."""
    try:
        parts = [(name, spec, way) for _, name, spec, way in Formatter().parse(pattern) if name is not None]
    except ValueError:
        parts = [("", "", None)]
    if not all(name and not spec and not way for name, spec, way in parts) or not parts:
        raise DataError(f"{pattern!r} is no pattern of keys; write columns in braces, as {{id}} or {{folder}}--{{file}}.")
    return list(dict.fromkeys(name for name, _, _ in parts))


def keys_of(pattern: str, ids: Sequence[Hashable], columns: Mapping[str, Mapping[str, str]]) -> list[str]:
    """The key of each demonstration by a pattern, whose `columns` have values by ids as text, as "id" has them itself;
    a `DataError` where a value is missing, or two keys are alike."""
    named = {str(name): name for name in ids}
    values = {"id": {name: name for name in named}, **columns}
    for column in columns_of(pattern):
        if missing := named.keys() - values[column].keys():
            raise DataError(f"{pattern!r}: the demonstration {min(missing)!r} has no {column!r}; choose another column.")
    parts = [*Formatter().parse(pattern)]
    keys = ["".join(text + (values[one][name] if one else "") for text, one, _, _ in parts) for name in named]
    if len({*keys}) < len(keys):
        twice = next(key for k, key in enumerate(keys) if key in keys[:k])
        raise DataError(f"{pattern!r}: two demonstrations have the key {twice!r:.80}; name a column that tells them apart.")
    return keys


def write_ranges(path: StrPath, ranges: Ranges) -> None:
    """Write ``{"id": [[start, end], ...], ...}``: the rows to keep of each demonstration that is kept, half-open."""
    lines = (f"{json.dumps(str(name))}: {json.dumps([*map(list, own)])}" for name, own in ranges.items())
    with replacing(check_extension(path, (".json",), "ranges")) as temporary:
        temporary.write_text("{" + ",\n ".join(lines) + "}\n", encoding="utf-8")


def segment_columns(segments: Segments, ids: Sequence[Hashable], fps: float | None) -> dict[str, Sequence[object]]:
    """The columns of a table of segments: id, start, end, seconds where steps a second are known, kind, score, reason.
    Whole numbers stay such where all ids are."""
    names = ids if all(isinstance(name, int) for name in ids) else [*map(str, ids)]
    score: list[float | None] = [value if np.isfinite(value) else None for value in segments.score.tolist()]
    lengths: Array = segments.end - segments.start
    return {
        "id": [names[m] for m in segments.demonstration.tolist()],
        "start": segments.start.tolist(),
        "end": segments.end.tolist(),
        **({"seconds": (lengths / fps).tolist()} if fps else {}),
        "kind": [KINDS[kind] for kind in segments.kind.tolist()],
        "score": score,
        "reason": segments.reason,
    }
