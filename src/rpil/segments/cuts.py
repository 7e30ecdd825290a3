"""Where demonstrations are cut into acts.

A hand is a column with a home: it is as at first in a good part of the rows, elsewhere in another, seldom between, and
it returns, as a gripper that opens. An act is what one closed hand does, with the way there and the way back. The cut
between two lies where the demonstration is farthest from the end of the one and the begin of the next. Where nothing is
a hand, acts are what lies between two rests of all. What moves mainly while a hand is closed is a thing.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rpil.data.arrays import spans
from rpil.data.demonstrations import Demonstrations
from rpil.numerics.types import Array, Bool, Float, Int
from rpil.segments.settings import SegmentSettings


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
        returns = np.append(away[:-1] & ~away[1:], away[:1] & False, axis=0)
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
                if a > 0 and b < len(acts) and b - a < self.window:
                    acts[a:b] = True
            for (_, a), (b, _) in pairwise(spans(acts)):
                way = own[a:b]
                away = np.linalg.norm(way - way[0], axis=1) + np.linalg.norm(way - way[-1], axis=1)
                found.append(begin + a + int(np.argmax(away)))
        return np.array(found, dtype=int)
