"""Rows to keep as ranges, for trainers, and segments as a table."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError, guarded
from rpil.data.files import StrPath, check_extension, check_readable, replacing
from rpil.data.json_files import read_text
from rpil.formats import read_demonstrators, read_recording
from rpil.formats.columns import ColumnOptions
from rpil.segments.kinds import KINDS, Segments


def keys_of(pattern: str, ids: Iterable[Hashable], source: StrPath, options: ColumnOptions) -> list[str]:
    """The key of each demonstration by a pattern with columns of the data at `source` in braces, or id. A `DataError`
    where two keys are alike."""

    def column(name: str) -> dict[str, str]:
        if name == "id":
            return dict(zip(names, names, strict=True))
        try:
            return read_demonstrators(name, read_recording(source, replace(options, operator=name)))
        except DataError as error:
            raise DataError(error.in_shell.replace("--operator", "--ranges-id")) from error

    parts = re.split(r"\{([^{}]+)\}", pattern)
    names = [*map(str, ids)]
    values = {one: column(one) for one in parts[1::2]}
    each = ((values[part].get(name, "") if k % 2 else part for k, part in enumerate(parts)) for name in names)
    keys = [*map("".join, each)]
    if len({*keys}) < len(keys):
        [(twice, _)] = Counter(keys).most_common(1)
        raise DataError(f"{pattern!r}: two have the key {twice!r:.80}; name columns in braces that differ, as {{id}}.")
    return keys


def write_ranges(path: StrPath, ranges: Mapping[str, Sequence[tuple[int, int]]]) -> None:
    """Write ``{"id": [[start, end], ...], ...}``: the rows to keep of each demonstration that is kept, half-open."""
    lines = ",\n ".join(f"{json.dumps(name)}: {json.dumps(own)}" for name, own in ranges.items())
    with replacing(check_extension(path, (".json",), "ranges")) as temporary:
        temporary.write_text(f"{{{lines}}}\n", encoding="utf-8")


def cut_out(demonstrations: Demonstrations, path: StrPath) -> tuple[Demonstrations, list[str]]:
    """The rows in a file of ranges, of which each range is a demonstration, "run-8/0"; and the id of each before."""
    file, place = check_readable(path), {str(name): m for m, name in enumerate(demonstrations.ids)}
    with guarded(file.name, "it cannot be read as JSON", "write it again"):
        given = json.loads(read_text(file), object_pairs_hook=tuple)  # in which a key may come twice
    found = list[tuple[str, int, int]]()
    for name, own in given if isinstance(given, tuple) else [("", None)]:
        n = int(demonstrations.lengths[place[name]]) if name in place else 0
        if name in {one for one, _, _ in found}:
            raise DataError(f"{file.name}: it names {name!r:.80} twice; give all of its ranges once.")
        for pair in own if isinstance(own, list) and n else [None]:
            if not (isinstance(pair, list) and [*map(type, pair)] == [int, int] and 0 <= pair[0] < pair[1] <= n):
                has = f"demonstration {name!r:.80} has {n} rows" if n else f"no demonstration is called {name!r:.80}"
                form = '{"id": [[start, end], ...]} with 0 <= start < end <= rows'
                raise DataError(f"{file.name}: {has}, and {pair!r:.80} is no range of them; write {form}.")
            found.append((name, *pair))
    if not found:
        raise DataError(f"{file.name}: it keeps no rows; write other ranges.")
    begin = [int(demonstrations.offsets[place[name]]) for name, _, _ in found]
    rows = np.concatenate([np.arange(a, b) + at for at, (_, a, b) in zip(begin, found, strict=True)])
    counts, ids = Counter[str](), list[str]()
    for name, _, _ in found:
        ids.append(f"{name}/{counts[name]}")
        counts[name] += 1
    offsets = np.cumsum([0, *(b - a for _, a, b in found)])
    arrays = {"observations": demonstrations.observations[rows], "actions": demonstrations.actions[rows]}
    return replace(demonstrations, **arrays, offsets=offsets, ids=tuple(ids)), [name for name, _, _ in found]


def segment_columns(segments: Segments, ids: Sequence[Hashable], fps: float | None) -> dict[str, Sequence[object]]:
    """The columns of a table of segments: id, start, end, seconds where the rate is known, kind, score, reason."""
    return {
        "id": [ids[m] for m in segments.demonstration.tolist()],
        "start": segments.start.tolist(),
        "end": segments.end.tolist(),
        **({"seconds": ((segments.end - segments.start) / fps).tolist()} if fps else {}),
        "kind": [KINDS[kind] for kind in segments.kind.tolist()],
        "score": [value if np.isfinite(value) else None for value in segments.score.tolist()],
        "reason": segments.reason,
    }


def subtask_columns(segments: Segments, ids: Iterable[Hashable]) -> dict[str, dict[str, object]]:
    """Segments as the tools of LeRobot hold subtasks of an episode: names, first and last frames; by ids as text."""
    names = [KINDS[kind] for kind in segments.kind.tolist()]
    columns = {"names": names, "start_frames": segments.start.tolist(), "end_frames": (segments.end - 1).tolist()}
    found: dict[str, dict[str, object]] = {f"rpil_subtask_{name}": {} for name in columns}
    for m, own in enumerate(map(str, ids)):
        first, last = np.searchsorted(segments.demonstration, (m, m + 1)).tolist()
        for name, values in columns.items():
            found[f"rpil_subtask_{name}"][own] = values[first:last]
    return found
