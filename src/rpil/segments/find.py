"""The segments of demonstrations: acts and their progress, what is done again, idle rows and takeovers.

An act is low that leaves things where others do not leave them (`progress`), that the next one does
again, or after which a person takes over. It is named where that is rare: what many do is the way to do it.

A hand is a column with a home: it is as at first in a good part of the rows, elsewhere in another, seldom between, and
it returns, as a gripper that opens. An act is what one closed hand does, with the way there and the way back. The cut
between two lies where the demonstration is farthest from the end of the one and the begin of the next. Where nothing is
a hand, acts are what lies between two rests of all. What moves mainly while a hand is closed is a thing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.special import expit

from rpil.data.archive import settings_record
from rpil.data.arrays import spans
from rpil.data.demonstrations import Demonstrations
from rpil.inference.answered import answer
from rpil.inference.answers import Answers
from rpil.inference.channels import normal_scores
from rpil.inference.settings import AnswerSettings
from rpil.numerics.types import Array, Bool, Float, Int
from rpil.segments.ranges import KINDS, Segments, idle_rows

MarkedRows = tuple[int, int, int, bool]
"""The number of a demonstration, its first row, the row after the last, and whether these are good."""


@settings_record(level="(0, 0.5)", at_home="(0, 0.5)", between="(0, 1)", least_move="(0, 1)", few="(0, 1]")
class SegmentSettings:
    """Acts, their progress and their candidates. Lengths are shares of the range of a column."""

    level: float = 0.16
    """Length by which a column leaves its first value where a hand closes; half of it where a thing is moved."""
    at_home: float = 0.25
    """Share of the rows in which a hand is as at first, at least, and in which it is not."""
    between: float = 0.1
    """Share of the rows in which a hand is on its way, at most."""
    window_share: float = 1 / 40
    """Rows within which a move is measured, relative to the median demonstration; three at least."""
    least_move: float = 0.02
    """Length by which a column moves within these rows, at least; else it rests."""
    few: float = 1 / 3
    """Share of its moves that a thing does while no hand is closed, and of demonstrations with a mistake, at most."""
    near: float = 0.03
    """Length within which two values are one place."""
    least_acts: int = 8
    """Acts of others from which a density tells something."""
    again: float = 0.5
    """Share of what an act moves from which the next one, that moves it, does it again."""
    done_again: float = 1.0
    """Nats that the score of an act loses where the next one does it again."""
    shortfall: float = 3.0
    """Nats below the median from which an act is a candidate, and that it loses where a person takes over after it."""
    answers: AnswerSettings = AnswerSettings(precision=4.0, error=0.1)
    """Regression on marked segments: few, and the ranking stands until they are more."""


@dataclass(frozen=True, eq=False)
class MovedColumns:
    """Columns of a set of demonstrations laid end to end, and in which rows they move."""

    values: Float[Array, "N C"]
    """Observations and continuous actions in ranges, without their outer hundredths; those that never move are 0."""
    offsets: Int[Array, " _"]
    window: int
    """Rows within which a move is measured."""
    moves: Bool[Array, "N C"]
    is_action: Bool[Array, " C"]

    @classmethod
    def of(cls, demonstrations: Demonstrations, settings: SegmentSettings) -> MovedColumns:
        """Measure `demonstrations`."""
        actions = [] if demonstrations.is_discrete else [demonstrations.actions]
        values = np.concatenate([demonstrations.observations, *actions], axis=1).astype(float)
        low, high = np.quantile(values, [0.01, 0.99], axis=0)
        values = (values - low) / np.where(high > low, high - low, np.inf)
        window = max(3, round(settings.window_share * float(np.median(demonstrations.lengths))))
        rows, groups, offsets = np.arange(len(values)), demonstrations.groups, demonstrations.offsets
        ahead = np.minimum(rows + window - window // 2, offsets[groups + 1] - 1)
        behind = np.maximum(rows - window // 2, offsets[groups])
        moves = np.abs(values[ahead] - values[behind]) > settings.least_move
        is_action = np.arange(values.shape[1]) >= demonstrations.observations.shape[1]
        return cls(values, offsets, window, moves, is_action)

    def closed(self, settings: SegmentSettings) -> tuple[Bool[Array, " N"], bool]:
        """The rows in which the hand is away from its home, or where there is none, in which something moves; and
        whether there is one."""
        distance = np.abs(self.values - np.median(self.values[self.offsets[:-1]], axis=0))
        away, near = distance > settings.level, distance < settings.level / 2
        between = (~near & (distance < 1.5 * settings.level)).mean(axis=0)
        returns = away & ~np.roll(away, -1, axis=0)
        returns[self.offsets[1:] - 1] = False
        counts = np.median(np.add.reduceat(returns, self.offsets[:-1], axis=0), axis=0)
        is_even = (near.mean(axis=0) > settings.at_home) & (near.mean(axis=0) < 1 - settings.at_home)
        is_hand = is_even & (between < settings.between) & (counts > 0)
        has_hand = bool(is_hand.any())
        hand = int(np.argmin(np.where(is_hand, between, 1.0)))
        return np.asarray(away[:, hand] if has_hand else self.moves.any(axis=1)), has_hand

    def things(self, closed: Bool[Array, " N"], settings: SegmentSettings) -> Bool[Array, " C"]:
        """The observations that seldom move while no hand is closed."""
        shares = [self.moves[rows].sum(axis=0) / max(rows.sum(), 1) for rows in (~closed, closed)]
        return np.asarray((shares[0] < settings.few * shares[1]) & ~self.is_action)

    def cuts(self, closed: Bool[Array, " N"]) -> Int[Array, " K"]:
        """First rows of the acts, but for those of the first acts of demonstrations."""
        found = list[int]()
        for begin, end in pairwise(self.offsets.tolist()):
            own, acts = self.values[begin:end, ~self.is_action], closed[begin:end].copy()
            for a, b in spans(~acts):
                if b - a < self.window:
                    acts[a:b] = True
            for (_, a), (b, _) in pairwise(spans(acts)):
                way = own[a:b]
                away = np.linalg.norm(way - way[0], axis=1) + np.linalg.norm(way - way[-1], axis=1)
                found.append(begin + a + int(np.argmax(away)))
        return np.array(found, dtype=int)


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


def taught(
    segments: Segments, facts: Float[Array, "N F"], labels: Sequence[MarkedRows], settings: SegmentSettings
) -> Segments:
    """The same with P(good) as score, learned from the score and `facts`, where one label is good and one bad."""
    known = Answers.of_labels(marked(segments, labels))
    if not known.contrast:
        return segments
    score = np.nan_to_num(segments.score)
    columns = np.column_stack([normal_scores(np.column_stack([score, np.nan_to_num(facts)])), np.clip(score, -2, 2)])
    found = answer(columns, known, settings.answers, np.arange(len(columns)))
    is_new = ((found.verdicts < 0) & (known.labels == 0)).tolist()
    like = ["is like what was marked bad" if new else "" for new in is_new]
    reasons = [reason or other for reason, other in zip(segments.reason, like, strict=True)]
    return replace(segments, score=expit(found.log_odds), reason=reasons)


def marked(segments: Segments, labels: Sequence[MarkedRows]) -> Int[Array, " N"]:
    """1 of the segments that share half of their rows, or of those of a label, with one that says good; -1 of bad."""
    found = np.zeros(len(segments.start), dtype=np.int64)
    for m, start, end, is_good in labels:
        shared = np.minimum(segments.end, end) - np.maximum(segments.start, start)
        least = np.minimum(segments.end - segments.start, end - start) / 2
        found[(segments.demonstration == m) & (shared > 0) & (shared >= least)] = 1 if is_good else -1
    return found
