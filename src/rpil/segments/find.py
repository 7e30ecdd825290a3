"""The segments of demonstrations: acts with their progress, what is undone or done again, and what stands before it.

An act is low that leaves things where others do not leave them (`rpil.segments.destinations`), whose things the next
act moves again, or after which a person took over. It is named where that is rare: what many do is the way to do it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from rpil.data.arrays import spans
from rpil.data.demonstrations import Demonstrations
from rpil.numerics.types import Array, Bool, Float, Int
from rpil.segments.cuts import Columns
from rpil.segments.destinations import progress
from rpil.segments.idle import idle_rows
from rpil.segments.kinds import KINDS, Segments
from rpil.segments.settings import SegmentSettings
from rpil.segments.taught import Label, taught

ACT, IDLE, TAKEOVER, BACK, REPEATED = range(len(KINDS))


@dataclass(frozen=True, eq=False)
class Acts:
    """Acts of a set, with what is known of each."""

    demonstration: Int[Array, " N"]
    start: Int[Array, " N"]
    end: Int[Array, " N"]
    kind: Int[Array, " N"]
    moved: Float[Array, "N C"]
    """How far it moves each thing, in ranges."""
    progress: Float[Array, "N 2"]
    """Of the states after it and before it; of one that moves nothing, those of the next that does; else NaN."""
    again: Bool[Array, " N"]
    """Whether the next act moves the same things again, or moves things where this one moves none."""
    taken: Bool[Array, " N"]
    """Whether a person takes over after it."""


def find_segments(
    demonstrations: Demonstrations,
    step_scores: Float[Array, " N"] | None = None,
    takeover: Bool[Array, " N"] | None = None,
    labels: Sequence[Label] = (),
    settings: SegmentSettings | None = None,
) -> Segments:
    """Cut each demonstration into segments, with a kind, a score and a reason.

    Parameters
    ----------
    demonstrations : Demonstrations
        Of one task.
    step_scores : (N,) array
        The held-out log-ratio of each step, from which answers learn as well.
    takeover : (N,) array of bool
        The rows in which a person had taken over.
    labels : sequence of (demonstration, start, end, good)
        Marked rows.

    Returns
    -------
    Segments
        The score is P(good) where a label says good and another one bad, and else how far the progress of an act lies
        above the median one, in nats.
    """
    settings = settings or SegmentSettings()
    columns = Columns.of(demonstrations, settings)
    taken = np.zeros(demonstrations.n_steps, dtype=bool) if takeover is None else np.asarray(takeover, dtype=bool)
    acts = find_acts(columns, taken, settings)
    score = scores(acts, settings)
    reasons = reasons_of(acts, score, demonstrations.n_demonstrations, settings)
    found = Segments(acts.demonstration, acts.start, acts.end, acts.kind.astype(np.int8), score, reasons)
    if labels:
        known = np.zeros((demonstrations.n_steps, 0)) if step_scores is None else np.asarray(step_scores)[:, None]
        is_nothing = (acts.moved == 0).all(axis=1)
        facts = [acts.progress, acts.again | acts.taken, is_nothing, means_of(known, acts, demonstrations.offsets)]
        found = taught(found, np.column_stack(facts), labels, settings)
    return without_idle(found, demonstrations)


def find_acts(columns: Columns, taken: Bool[Array, " N"], settings: SegmentSettings) -> Acts:
    """Cut demonstrations into acts, also where a person takes over, and measure each."""
    closed, offsets = columns.closed(settings), columns.offsets
    changes = np.flatnonzero(taken[1:] != taken[:-1]) + 1
    first = np.unique(np.concatenate([columns.cuts(closed), offsets[:-1], changes]))
    last, demonstration = np.append(first[1:], offsets[-1]) - 1, np.searchsorted(offsets, first, side="right") - 1
    things = columns.values[:, columns.things(closed, settings)]
    before, after = things[first], things[last]
    moved = np.where(np.abs(after - before) > settings.level / 2, after - before, 0.0)
    states = np.stack(
        [progress(at, after, before, moved != 0, demonstration, settings) for at in (after, before)], axis=1
    )
    follows, following = np.append(np.diff(demonstration) == 0, False), np.append(moved[1:], moved[:1], axis=0)
    size, shared = (np.abs(each).sum(axis=1) for each in (moved, np.minimum(np.abs(moved), np.abs(following))))
    again = follows & (shared >= settings.again * size)
    undone = again & (size > 0) & (np.abs(moved + following).sum(axis=1) < settings.again / 2 * size)
    for k in np.flatnonzero(follows & (size == 0))[::-1]:
        states[k] = states[k + 1]
    kind = np.append(ACT, np.where(undone, BACK, np.where(again, REPEATED, ACT))[:-1])
    again &= ~(states[:, 0] > np.append(states[1:, 0], 0.0) + settings.done_again)  # then the next one is at fault
    is_before = follows & ~taken[first] & np.append(taken[first][1:], False)
    start, end = first - offsets[demonstration], last + 1 - offsets[demonstration]
    return Acts(demonstration, start, end, np.where(taken[first], TAKEOVER, kind), moved, states, again, is_before)


def scores(acts: Acts, settings: SegmentSettings) -> Float[Array, " N"]:
    """Progress above the median one, in nats, less what is done again and what a person takes over."""
    known = np.where(np.isnan(acts.progress[:, 0]) & acts.taken, 0.0, acts.progress[:, 0])
    if not np.isfinite(known).any():
        return known
    return np.asarray(known - np.nanmedian(known) - settings.done_again * acts.again - settings.taken_over * acts.taken)


def reasons_of(acts: Acts, score: Float[Array, " N"], n: int, settings: SegmentSettings) -> list[str]:
    """A sentence about each candidate, and "" of the others."""
    counts, found = (acts.moved != 0).sum(axis=1).tolist(), []
    is_usual = len(np.unique(acts.demonstration[acts.again])) > settings.few * n
    is_low = (acts.progress[:, 0] < 0) & (score < -settings.shortfall)
    for k, count in enumerate(counts):
        moves = f"moves {count} column{'s' * (count != 1)}" if count else "moves nothing"
        if acts.taken[k]:
            found.append("a person takes over after it")
        elif acts.again[k] and not is_usual:
            then = "undoes it" if acts.kind[k + 1] == BACK else "does it again"
            found.append(f"{moves}, and the next act {then}")
        else:
            found.append(f"{moves} and ends no nearer to where others end" if count and is_low[k] else "")
    return found


def without_idle(found: Segments, demonstrations: Demonstrations) -> Segments:
    """The same, where idle rows are segments of their own."""
    idle, parts = idle_rows(demonstrations), []
    for k, begin in enumerate(demonstrations.offsets[found.demonstration].tolist()):
        own = idle[begin + found.start[k] : begin + found.end[k]]
        rests = spans(own)
        edges = sorted({0, len(own), *(row for rest in rests for row in rest)})
        parts += [(k, a + found.start[k], b + found.start[k], (a, b) in rests) for a, b in pairwise(edges)]
    of, start, end, is_idle = (np.array(part) for part in zip(*parts, strict=True))
    return replace(
        found,
        demonstration=found.demonstration[of],
        start=start,
        end=end,
        kind=np.where(is_idle, IDLE, found.kind[of]).astype(np.int8),
        score=np.where(is_idle, np.nan, found.score[of]),
        reason=["" if rest else found.reason[k] for k, rest in zip(of.tolist(), is_idle.tolist(), strict=True)],
    )


def means_of(values: Float[Array, "T V"], acts: Acts, offsets: Int[Array, " _"]) -> Float[Array, "N V"]:
    """Means of the rows of each act."""
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    first, last = (offsets[acts.demonstration] + row for row in (acts.start, acts.end))
    return np.asarray((total[last] - total[first]) / (last - first)[:, None])


def shortfall(segments: Segments, n: int) -> Float[Array, " M"]:
    """How far the acts of each of `n` demonstrations lie below the median one, summed up and negative."""
    below = np.minimum(np.nan_to_num(segments.score - np.nanmedian(segments.score)), 0.0)
    return np.bincount(segments.demonstration, below, n)
