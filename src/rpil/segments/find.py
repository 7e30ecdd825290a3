"""The segments of demonstrations: acts with their progress, what is undone or done twice, and what stands before it.

An act is low that brings the state no nearer to where others end (`rpil.segments.progress`), whose things the next act
moves again, or before which a person took over. It is named where that is rare: what many do is the way to do it.
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
from rpil.segments.idle import idle_rows
from rpil.segments.progress import rows_ahead
from rpil.segments.settings import SegmentSettings
from rpil.segments.table import KINDS, Segments
from rpil.segments.taught import Label, taught

ACT, IDLE, TAKEOVER, BACK, REPEATED = range(len(KINDS))


@dataclass(frozen=True, eq=False)
class Acts:
    """Acts of a set, with what is known of each."""

    demonstration: Int[Array, " N"]
    start: Int[Array, " N"]
    end: Int[Array, " N"]
    kind: Int[Array, " N"]
    progress: Float[Array, " N"]
    """What the act leaves of the way, less; NaN where nothing is known."""
    left: Float[Array, " N"]
    """The way that is left after it."""
    moved: Float[Array, "N C"]
    """How far it moves each thing."""
    corrected: Bool[Array, " N"]
    """Whether the next act moves the same things again, or a person takes over there."""


def find_segments(
    demonstrations: Demonstrations,
    step_scores: Float[Array, " N"] | None = None,
    takeover: Bool[Array, " N"] | None = None,
    labels: Sequence[Label] = (),
    rng: np.random.Generator | None = None,
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
        Marked rows; from two on, one good and one bad, the score is P(good).
    """
    settings, rng = settings or SegmentSettings(), rng or np.random.default_rng(0)
    taken = np.zeros(demonstrations.n_steps, dtype=bool) if takeover is None else np.asarray(takeover, dtype=bool)
    acts = find_acts(demonstrations, taken, settings, rng)
    score = scores(acts)
    reasons = reasons_of(acts, score, demonstrations.n_demonstrations, settings)
    found = Segments(acts.demonstration, acts.start, acts.end, acts.kind.astype(np.int8), score, reasons)
    if labels:
        rows = np.zeros(demonstrations.n_steps) if step_scores is None else np.asarray(step_scores)
        found = taught(found, acts.moved, acts.left, rows, demonstrations.offsets, labels)
    return without_idle(found, demonstrations)


def find_acts(
    demonstrations: Demonstrations, taken: Bool[Array, " N"], settings: SegmentSettings, rng: np.random.Generator
) -> Acts:
    """Cut demonstrations into acts, and measure each."""
    columns, offsets = Columns.of(demonstrations, settings), demonstrations.offsets
    closed = columns.closed(settings)
    cuts = columns.cuts(closed)
    changes = np.flatnonzero(taken[1:] != taken[:-1]) + 1
    for m, own in enumerate(cuts):
        inside = changes[(changes > offsets[m]) & (changes < offsets[m + 1])] - offsets[m]
        cuts[m] = sorted({*own, *inside.tolist()})
    demonstration = np.repeat(np.arange(len(cuts)), [len(own) - 1 for own in cuts])
    start, end = (np.concatenate([own[part] for own in cuts]).astype(int) for part in (slice(-1), slice(1, None)))
    first, last = offsets[demonstration] + start, offsets[demonstration] + end - 1
    ahead, _ = rows_ahead(demonstrations, settings, rng)
    things = columns.values[:, columns.things(closed, settings)]
    change = things[last] - things[first]
    moved = np.where(np.abs(change) > settings.level / 2, change, 0.0)
    is_taken = taken[(first + last) // 2]
    same = np.append(demonstration[1:] == demonstration[:-1], False)
    following = np.append(moved[1:], moved[:1], axis=0)
    size, shared = np.abs(moved).sum(axis=1), np.minimum(np.abs(moved), np.abs(following)).sum(axis=1)
    again = same & (size > 0) & (2 * shared > size)
    undone = again & (np.abs(moved + following).sum(axis=1) < settings.at_home * size)
    kind = np.zeros(len(start), dtype=int)
    kind[1:] = np.where(undone[:-1], BACK, np.where(again[:-1], REPEATED, ACT))
    kind[is_taken] = TAKEOVER
    corrected = again | (same & ~is_taken & np.append(is_taken[1:], False))
    return Acts(demonstration, start, end, kind, ahead[first] - ahead[last], ahead[last], moved, corrected)


def scores(acts: Acts) -> Float[Array, " N"]:
    """Robust standard deviations of the progress from the median one; a corrected act loses two."""
    middle = np.median(acts.progress)
    spread = 1.4826 * float(np.median(np.abs(acts.progress - middle))) + 0.05
    return np.asarray((acts.progress - middle) / spread - 2.0 * acts.corrected)


def reasons_of(acts: Acts, score: Float[Array, " N"], n: int, settings: SegmentSettings) -> list[str]:
    """A sentence about each candidate, and "" of the others."""
    count = (acts.moved != 0).sum(axis=1)
    is_usual = len({*acts.demonstration[acts.corrected].tolist()}) > settings.few * n
    found = []
    for k, n_moved in enumerate(count.tolist()):
        moves = f"moves {n_moved} column{'s' * (n_moved != 1)}"
        if acts.corrected[k] and acts.kind[k + 1] == TAKEOVER:
            found.append("a person takes over after it")
        elif acts.corrected[k] and not is_usual:
            found.append(f"{moves}, and the next act {'undoes it' if acts.kind[k + 1] == BACK else 'moves them again'}")
        elif n_moved and acts.progress[k] <= 0 and score[k] < -settings.surprise:
            found.append(f"{moves} and ends no nearer to where others end")
        else:
            found.append("")
    return found


def without_idle(found: Segments, demonstrations: Demonstrations) -> Segments:
    """The same, where idle rows are segments of their own."""
    idle, parts = idle_rows(demonstrations), []
    for k, m in enumerate(found.demonstration.tolist()):
        own = idle[demonstrations.offsets[m] + found.start[k] : demonstrations.offsets[m] + found.end[k]]
        rests = spans(own)
        edges = sorted({0, len(own), *(row for rest in rests for row in rest)})
        parts += [(k, a + found.start[k], b + found.start[k], (a, b) in rests) for a, b in pairwise(edges)]
    of, start, end, rests_ = (np.array(part) for part in zip(*parts, strict=True))
    return replace(
        found,
        demonstration=found.demonstration[of],
        start=start,
        end=end,
        kind=np.where(rests_, IDLE, found.kind[of]).astype(np.int8),
        score=np.where(rests_, np.nan, found.score[of]),
        reason=["" if rest else found.reason[k] for k, rest in zip(of.tolist(), rests_.tolist(), strict=True)],
    )


def worst(segments: Segments, n: int) -> Float[Array, " M"]:
    """The lowest score among the segments of each of `n` demonstrations, NaN where nothing is known."""
    lowest = np.full(n, np.inf)
    known = np.isfinite(segments.score)
    np.minimum.at(lowest, segments.demonstration[known], segments.score[known])
    return np.where(np.isfinite(lowest), lowest, np.nan)
