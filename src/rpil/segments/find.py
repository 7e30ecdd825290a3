"""The segments of demonstrations: acts and their progress, what is done again, idle rows and takeovers.

An act is low that leaves things where others do not leave them (`progress`), that the next one does
again, or after which a person takes over. It is named where that is rare: what many do is the way to do it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from rpil.data.arrays import spans
from rpil.data.demonstrations import Demonstrations
from rpil.numerics.types import Array, Bool, Float, Int
from rpil.segments.cuts import MovedColumns
from rpil.segments.idle import idle_rows
from rpil.segments.kinds import KINDS, Segments
from rpil.segments.settings import SegmentSettings
from rpil.segments.taught import MarkedRows, taught

ACT, IDLE, TAKEOVER, BACK, REPEATED = range(len(KINDS))


@dataclass(frozen=True, eq=False)
class Acts:
    """N acts of a set, in order."""

    first: Int[Array, " N"]
    """Its first row among all rows."""
    demonstration: Int[Array, " N"]
    kind: Int[Array, " N"]
    n_moved: Int[Array, " N"]
    """Columns of things that it moves."""
    progress: Float[Array, " N"]
    """The progress of the act; of one that moves nothing, of the next that does; else NaN."""
    again: Bool[Array, " N"]
    """Whether the next one does it again, and not worse."""
    taken: Bool[Array, " N"]
    """Whether a person takes over after it."""


def find_segments(
    demonstrations: Demonstrations,
    step_scores: Float[Array, " N"] | None = None,
    takeover: Bool[Array, " N"] | None = None,
    labels: Sequence[MarkedRows] = (),
    settings: SegmentSettings | None = None,
) -> Segments:
    """Cut demonstrations of one task into segments, with a kind, a score and a reason.

    `step_scores` are held-out log-ratios, from which answers learn as well; `takeover` holds where a person had taken
    over; `labels` are marked rows, (demonstration, start, end, good). The score is P(good) where one label is good and
    one bad, and else how far the progress of an act lies above the median one, in nats.
    """
    settings = settings or SegmentSettings()
    n, offsets = demonstrations.n_steps, demonstrations.offsets
    acts = find_acts(
        MovedColumns.of(demonstrations, settings), np.zeros(n, bool) if takeover is None else takeover, settings
    )
    start, lengths = acts.first - offsets[acts.demonstration], np.diff(acts.first, append=n)
    score, kind = scores(acts, settings), acts.kind.astype(np.int8)
    reasons = reasons_of(acts, score, settings)
    found = Segments(acts.demonstration, start, start + lengths, kind, score, reasons)
    if labels:
        ratio = np.zeros(n) if step_scores is None else np.asarray(step_scores)
        means = np.add.reduceat(ratio, acts.first) / lengths
        facts = [acts.progress, acts.again | acts.taken, acts.n_moved == 0, means, np.log(lengths)]
        found = taught(found, np.column_stack(facts), labels, settings)
    return without_idle(found, idle_rows(demonstrations), offsets)


def find_acts(columns: MovedColumns, taken: Bool[Array, " N"], settings: SegmentSettings) -> Acts:
    """Cut demonstrations into acts, also where a person takes over, and measure each."""
    (closed, has_hand), offsets = columns.closed(settings), columns.offsets
    changes = np.flatnonzero(taken[1:] != taken[:-1]) + 1
    first = np.unique(np.concatenate([columns.cuts(closed), offsets[:-1], changes]))
    demonstration = np.searchsorted(offsets, first, side="right") - 1
    things = columns.values[:, columns.things(closed, settings)]
    before, after = things[first], things[np.append(first[1:], offsets[-1]) - 1]
    moved = np.where(np.abs(after - before) > settings.level / 2, after - before, 0.0)
    states = progress(after, before, moved != 0, demonstration, settings)
    follows, following = np.append(np.diff(demonstration) == 0, False), np.append(moved[1:], moved[:1], axis=0)
    size, shared = (np.abs(each).sum(axis=1) for each in (moved, np.minimum(np.abs(moved), np.abs(following))))
    for k in np.flatnonzero(follows & (size == 0))[::-1]:
        states[k] = states[k + 1]
    again = follows & has_hand & (shared >= settings.again * size)
    worse_next = states > np.append(states[1:], 0.0) + settings.done_again  # then that one is at fault
    is_rare = len(np.unique(demonstration[again & ~worse_next])) <= settings.few * (len(offsets) - 1)
    undone = again & (size > 0) & (np.abs(moved + following).sum(axis=1) < settings.again / 2 * size)
    kind = np.append(ACT, np.where(undone, BACK, np.where(again, REPEATED, ACT))[:-1] * is_rare)
    kind = np.where(taken[first], TAKEOVER, kind)
    again &= ~worse_next
    is_before = follows & ~taken[first] & np.append(taken[first][1:], False)
    return Acts(first, demonstration, kind, np.count_nonzero(moved, axis=1), states, again, is_before)


def scores(acts: Acts, settings: SegmentSettings) -> Float[Array, " N"]:
    """Progress above the median one, in nats, less what is done again and what a person takes over."""
    known = np.where(np.isnan(acts.progress) & acts.taken, 0.0, acts.progress)
    middle = np.nanmedian(known) if np.isfinite(known).any() else 0.0
    return np.asarray(known - middle - settings.done_again * acts.again - settings.shortfall * acts.taken)


def reasons_of(acts: Acts, score: Float[Array, " N"], settings: SegmentSettings) -> list[str]:
    """A sentence about each candidate, and "" of the others."""
    is_low = (acts.progress < 0) & (score < -settings.shortfall) & (acts.n_moved > 0)
    found = [""] * len(score)
    for k in np.flatnonzero(is_low | acts.again | acts.taken).tolist():
        n = int(acts.n_moved[k])
        moves = f"moves {n} column{'s' * (n > 1)}" if n else "moves nothing"
        if acts.taken[k]:
            found[k] = "a person takes over after it"
        elif acts.again[k] and acts.kind[k + 1] in (BACK, REPEATED):
            found[k] = f"{moves}, and the next act {'undoes it' if acts.kind[k + 1] == BACK else 'does it again'}"
        elif is_low[k]:
            found[k] = f"{moves} and ends no nearer to where others end"
    return found


def without_idle(found: Segments, idle: Bool[Array, " N"], offsets: Int[Array, " _"]) -> Segments:
    """The same, where idle rows are segments of their own."""
    parts = []
    for k, begin in enumerate(offsets[found.demonstration].tolist()):
        own = idle[begin + found.start[k] : begin + found.end[k]]
        edges = np.unique([0, len(own), *(row for rest in spans(own) for row in rest)]).tolist()
        parts += [(k, found.start[k] + a, found.start[k] + b, bool(own[a])) for a, b in pairwise(edges)]
    of, start, end, is_idle = (np.array(part) for part in zip(*parts, strict=True))
    kind, score = np.where(is_idle, IDLE, found.kind[of]).astype(np.int8), np.where(is_idle, np.nan, found.score[of])
    reason = ["" if rest else found.reason[k] for k, rest in zip(of.tolist(), is_idle.tolist(), strict=True)]
    return replace(
        found, demonstration=found.demonstration[of], start=start, end=end, kind=kind, score=score, reason=reason
    )


def shortfall(segments: Segments, n: int) -> Float[Array, " M"]:
    """How far the segments of each of `n` demonstrations lie below the median one, as a negative sum."""
    known = np.isfinite(segments.score)
    below = np.minimum(segments.score[known] - np.median(segments.score[known]), 0.0) if known.any() else None
    return np.bincount(segments.demonstration[known], below, n).astype(float)


def progress(
    after: Float[Array, "N C"],
    before: Float[Array, "N C"],
    moved: Bool[Array, "N C"],
    demonstration: Int[Array, " N"],
    settings: SegmentSettings,
) -> Float[Array, " N"]:
    """Progress of N acts, sorted by demonstration, in nats: the mean of log f - log g over the columns that each moves.

    f is the density, at the value that it leaves, of the values that acts of other demonstrations leave, and g of those
    that they take; NaN where fewer than `least_acts` move any of its columns.
    """
    total, count = np.zeros(len(after)), np.zeros(len(after))
    for c in np.flatnonzero(moved.any(axis=0)):
        own = moved[:, c]
        at, of = after[own, c], demonstration[own]
        f, g = (near(at, values[own, c], of, settings.near) + 2 * settings.near for values in (after, before))
        tells = len(at) - np.bincount(of)[of] >= settings.least_acts
        total[own] += np.where(tells, np.log(f / g), 0.0)
        count[own] += tells
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def near(
    at: Float[Array, " K"], values: Float[Array, " K"], demonstration: Int[Array, " K"], width: float
) -> Int[Array, " K"]:
    """How many values of other demonstrations lie within `width` of each of `at`."""
    ordered, low, high = np.sort(values), at - width, at + width
    counts = np.searchsorted(ordered, high, side="right") - np.searchsorted(ordered, low)
    for a, b in pairwise(np.flatnonzero(np.diff(demonstration, prepend=-1, append=-1)).tolist()):
        counts[a:b] -= ((values[a:b] >= low[a:b, None]) & (values[a:b] <= high[a:b, None])).sum(axis=1)
    return counts
