"""Idle rows, by states and actions that rest or by the rule of openpi; ranges of rows to keep, for trainers; and a
table of segments."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError, guarded
from rpil.data.files import StrPath, check_extension, check_readable, replacing
from rpil.data.memory import read_text
from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock
from rpil.faults.rule import Learned
from rpil.faults.still import long_runs, parts, resting_rows
from rpil.formats import read_demonstrators, read_recording
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Dataset
from rpil.numerics.types import Array, Bool, Float, Int

KINDS = ("act", "idle", "takeover", "back", "repeated")


@dataclass(frozen=True)
class Segments:
    """Segments of demonstrations, sorted by demonstration and start; rows are half-open and tile each demonstration."""

    demonstration: np.ndarray  # (N,) int, its number among the ids
    start: np.ndarray  # (N,) int, first row within the demonstration
    end: np.ndarray  # (N,) int, row after the last
    kind: np.ndarray  # (N,) int8, index into KINDS
    score: np.ndarray  # (N,) float, lower is worse; NaN where nothing is known
    reason: list[str]  # (N,) "" or a short reason


def joined(parts: Sequence[Segments]) -> Segments:
    """The segments of several tasks, sorted."""
    of = {one.name: np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(Segments)[:-1]}
    order = np.lexsort((of["start"], of["demonstration"]))
    reasons = [reason for part in parts for reason in part.reason]
    return Segments(**{name: of_each[order] for name, of_each in of.items()}, reason=[reasons[k] for k in order])


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


def cut_out(demonstrations: Demonstrations, path: StrPath) -> tuple[Demonstrations, list[str], Int[Array, " n"]]:
    """The rows in a file of ranges, each a demonstration, "run-8/0"; the id of each before, and the numbers of rows."""
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
    return replace(demonstrations, **arrays, offsets=offsets, ids=tuple(ids)), [name for name, _, _ in found], rows


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


LONG_WAIT = 1.5
"""Times the usual rest after a gripper has moved, up to which the arm waits for it."""

SAME, LEAST_MOVING, LAST = 1e-3, 16, 10
"""Openpi's rule: change of an action that is none; moving rows at least; rows by which each range ends earlier."""


def idle_rows(demonstrations: Demonstrations | Dataset, rule: Literal["rest", "openpi"] = "rest") -> Bool[Array, " N"]:
    """Rows in which nothing moves, for `Audit.ranges`.

    Parameters
    ----------
    demonstrations : Demonstrations or Dataset
        With discrete actions no row is idle.
    rule : {"rest", "openpi"}
        "rest": states and actions stay the same, but for noise, for 7 rows or more, and not while a gripper closes.
        "openpi": the rows that its script for DROID leaves out: 7 or more in a row whose actions, but for those called
        gripper, differ by less than .001 from the row before; fewer than 16 rows between these; and 10 before each.
    """
    if rule not in ("rest", "openpi"):
        raise DataError(f"No rule of idle rows is called {rule!r}; choose rest or openpi.")
    if demonstrations.is_discrete:
        return np.zeros(demonstrations.n_steps, dtype=bool)
    blocks = [block for shard in demonstrations.shards(1, settings.CACHE_STEPS) for block in shard]
    if rule == "openpi":
        names = demonstrations.action_names or [""] * demonstrations.n_actions
        own = [a for a, name in enumerate(names) if "gripper" not in name.lower()]
        return np.concatenate([_left_out_by_openpi(block.actions[:, own], block.offsets) for block in blocks])
    learned, rests, turned = Learned.of(demonstrations), list[Bool[Array, " n"]](), list[Bool[Array, " n"]]()
    measured = learned.columns.number[learned.columns.is_action] - demonstrations.n_observations
    for block in blocks:
        moving = MovingBlock.of(block, np.arange(len(block.offsets) - 1), learned.columns)
        turns = np.asarray(np.diff(np.delete(block.actions, measured, axis=1), axis=0, prepend=0).any(axis=1))
        turns[block.offsets[:-1]] = False
        rests, turned = [*rests, resting_rows(moving, learned.tracked.is_command)], [*turned, turns]
    return _without_waits(np.concatenate(rests), np.flatnonzero(np.concatenate(turned)), demonstrations.offsets)


def _left_out_by_openpi(actions: Float[Array, "T A"], offsets: Int[Array, " _"]) -> Bool[Array, " T"]:
    same = np.append(False, (np.abs(np.diff(actions, axis=0)) < SAME).all(axis=1))
    left_out = np.ones(len(actions), dtype=bool)
    same[offsets[:-1]] = False
    for first, last in zip(*parts(~long_runs(same, offsets), offsets), strict=True):
        left_out[first : max(last - LAST, first)] = last - first < LEAST_MOVING
    return left_out


def _without_waits(rests: Bool[Array, " n"], turns: Int[Array, " K"], offsets: Int[Array, " M1"]) -> Bool[Array, " n"]:
    """The resting rows without those in which the arm waits for its gripper, which `turns`, as it usually does."""
    if not len(turns):
        return rests
    begins, ends = (np.append(of, len(rests)) for of in parts(rests, offsets))
    run, last = np.searchsorted(ends[:-1], turns, side="right"), offsets[np.searchsorted(offsets, turns, side="right")]
    ends = np.where(begins[run] < np.minimum(turns + settings.REST_ROWS, last), ends[run], turns)
    usual = int(np.quantile(ends - turns, 0.75))
    ends = np.where(ends - turns <= LONG_WAIT * usual, ends, np.minimum(turns + usual, last))
    for first, end in zip(turns, ends, strict=True):
        rests[first:end] = False
    return long_runs(rests, offsets)
