"""The rules about columns that stay the same: frozen, at an end of their range, or throughout; runs without a change;
and where everything rests, by how far it goes within some steps against the noise of its sensors at rest.

Arrays are (C, T), as in `rpil.faults.measured_columns`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np

from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock, not_recorded, part_means
from rpil.faults.rule import Compared, ComparingRule, Fault, Learned, above
from rpil.numerics.types import Array, Bool, Float, Int


class HeldValue(ComparingRule):
    sentence = "{column} stays at {at} for {long} from {first} while others move (usual: up to {most})"
    causes = ("length", "idle tail", "pause", "two episodes", "two units")
    kinds: tuple[bool, ...] = (False, True)  # whether the columns that the rule is about are actions
    is_extreme = False

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """The run of one value that has most steps in motion: the number of these, its first step, its length and
        the value; and the lowest and the highest value. A column rests with its partner, as a hand that is closed:
        steps count in which that changes. Then from where on no observation changes, and in how many steps the action
        does; and how far the partner is from the value as the run begins, and at most in it."""
        values, offsets, partner = block.values, block.offsets, block.columns.partner
        begins, ends, n_states = offsets[:-1], offsets[1:], (~block.columns.is_action).sum()
        stays = block.size == 0
        stays[:, begins] = False

        def counts(c: Array, t: Array) -> Array:
            return block.moves[t] & ((partner[c] < 0) | (block.size[partner[c], t] > 0))

        still, first, length = longest_runs(stays, counts, offsets)
        at = values[np.arange(len(values)), first + begins[:, None]]
        together = stays[:n_states].all(axis=0, keepdims=True) & ~np.isin(np.arange(len(block.moves)), begins)
        acts = block.size[n_states:]
        n, since, every = (
            x[:, 0] for x in longest_runs(together, lambda _, t: np.asarray((acts[:, t] > 0).any(axis=0)), offsets)
        )
        ends = (since > 0) & (since + every == ends - begins) & (n >= settings.STILL_SHARE * (ends - begins))
        far = np.zeros((2, *first.shape))
        for m, c in np.argwhere((length >= settings.MIN_FROZEN) & (partner >= 0)).tolist():
            of_partner = np.abs(values[partner[c], begins[m] + first[m, c] :][: length[m, c]] - at[m, c])
            far[:, m, c] = of_partner[0], of_partner.max()
        return still, first, length, at, block.low, block.high, since, n * (ends & (n_states > 1)), *far

    def compare(self) -> Compared:
        chosen = np.isin(self.columns.is_action, self.kinds)
        self.names = tuple(np.array(self.columns.names)[chosen].tolist())
        still, self.first, length, self.at, low, high = (of_each[:, chosen] for of_each in self.measured[:6])
        self.last = self.first + length - 1
        limit = np.maximum(self.fence(still, settings.FROZEN_FACTOR, settings.SMALLEST_RUN), settings.MIN_FROZEN)
        is_extreme = (self.at == low.min(axis=0)) | (self.at == high.max(axis=0))
        is_own = (is_extreme == self.is_extreme) & (self.first > 0)  # what has not been touched yet rests
        value = np.where(is_own, still, 0)
        moving, partner = self.columns.moving, self.columns.partner
        moving = np.where(partner < 0, moving, moving[partner])[chosen]
        limit = np.where(moving >= settings.MOVING_SHARE, limit, np.inf)
        severity = above(value, limit)[2]
        self.goes_on = np.zeros(still.shape, dtype=bool)
        if (pairs := self.data.learned.tracked).is_command and not self.is_extreme:
            begins, far = (of_each[:, chosen] for of_each in self.measured[8:])
            least = settings.LEAST_USUAL_GAP * self.columns.spread[chosen] + settings.ERRORS * begins
            stays = (self.first > 0) & np.isin(np.flatnonzero(chosen), [pairs.action, pairs.state])
            stays &= length >= np.maximum(settings.STILL_SHARE * self.data.lengths[:, None], settings.MIN_FROZEN)
            leaves = stays & is_own & (far > least)
            self.goes_on = leaves | (stays & (leaves.sum(axis=0) >= settings.MOST_FEW * len(leaves)))
            self.goes_on &= ~(severity > 1.0)
            limit, severity = np.where(self.goes_on, settings.MIN_FROZEN, limit), np.where(self.goes_on, 2.0, severity)
        return value, limit, severity

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        said = super().say(fault, m, c, at=f"{self.at[m, c]:.4g}" if fault.column else "")
        if fault.column and self.goes_on[m, c]:
            chosen = self.columns.partner[self.columns.names.index(fault.column)]
            return f"{said.split(' while')[0]} while {self.columns.names[chosen]} goes on"
        return said

    @classmethod
    def follows(cls, fault: Fault, cause: Fault) -> bool:
        """A value held until the end is a part of an idle tail, whose sensors have noise, or of a pause."""
        if cause.rule == "pause":
            return max(cause.first - fault.first, fault.last - cause.last) <= settings.REST_STEPS
        return fault.last == cause.last if cause.rule == "idle tail" else super().follows(fault, cause)


class FrozenSensor(HeldValue):
    name, words = "frozen sensor", "an observation stays the same for long while others change"
    needs = "observations", "several"
    sentence_of_all = "all observations stay the same from {first} on, while the action changes"
    kinds = (False,)

    def compare(self) -> Compared:
        of_columns, (first, n) = super().compare(), self.measured[6:8]
        of_all = n, settings.MIN_FROZEN, np.where(n >= settings.MIN_FROZEN, n, 0) / 6.0
        return self.with_all(of_columns, of_all, first, first + n)


class FrozenAction(HeldValue):
    name, words = "frozen action", "an action stays the same for long while others change"
    needs = "actions", "several"
    kinds = (True,)


class Saturation(HeldValue):
    name, words = "saturation", "a column stays at its lowest or highest value for long"
    is_extreme = True


class NeverMoves(ComparingRule):
    name, words = "never moves", "a column never moves, but moves in other demonstrations"
    sentence = "{column} does not move, and in the others it does"
    causes = ("two units",)
    takes_steps = True

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """The range of each column, and the share of its steps in which it is 0."""
        return block.high - block.low, part_means(block.values == 0, block.offsets)[:, 0]

    def compare(self) -> Compared:
        ranges, zeros = self.measured
        self.names, self.absent = self.columns.names, not_recorded(ranges, zeros)
        usual = np.nanmedian(np.where(self.absent, np.nan, ranges), axis=0)
        still = ranges <= settings.LEAST_RANGE * usual
        low, high = np.where(still, np.inf, ranges).min(axis=0), ranges.max(axis=0)
        are_few = still.sum(axis=0) <= few(len(still))
        is_known = are_few & (low >= settings.STEADY_RANGE * usual) & (settings.STEADY_RANGE * high <= usual)
        still &= (self.data.lengths > 1)[:, None]  # a single step says nothing of motion
        severity = np.where(is_known & (usual > 0), 2.0 * still, np.nan)
        pairs, far = self.data.learned.tracked, self.columns.spread
        for a, s in zip(pairs.action, pairs.state, strict=True):
            for own, other in ((a, s), (s, a)) if pairs.is_command else ():  # what goes with it moves
                severity[:, own] = np.where(still[:, own] & (ranges[:, other] > far[other]), 2.0, severity[:, own])
        alike = still * np.minimum(low, high) / np.maximum(high, 1e-300)  # the more it moves so in all others
        return still, 0.5, np.where(self.absent, 1e6, severity) + alike

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        if self.absent[m, c]:
            return f"these columns are not recorded here: {fault.column} is 0 in every step, and in the others it moves"
        return super().say(fault, m, c)


def few(n_demonstrations: int) -> float:
    """Demonstrations that may have a fault of some kinds; what more have is usual."""
    least = max(settings.FEW, math.ceil(settings.FEW_SHARE * n_demonstrations))
    return min(least, settings.MOST_FEW * n_demonstrations)


def largest(values: Float[Array, "C T"], offsets: Int[Array, " _"]) -> tuple[Float[Array, "M C"], Int[Array, "M C"]]:
    """The largest value of each demonstration, and the first step of the demonstration that has it."""
    place = np.array([values[:, a:b].argmax(axis=1) for a, b in pairwise(offsets.tolist())])
    return values[np.arange(len(values)), place + offsets[:-1, None]], place


def next_largest(values: Float[Array, "C T"], step: Int[Array, "M C"], offsets: Int[Array, " _"]) -> Array:
    """The largest value of each demonstration but for the steps around the one that has it, (M, C)."""
    near = np.arange(-settings.WIDTH, settings.WIDTH + 1)[:, None, None]
    at = np.arange(len(values)), np.clip(step + near, 0, np.diff(offsets)[:, None] - 1) + offsets[:-1, None]
    there = values[at]
    values[at] = 0.0
    found = np.maximum.reduceat(values, offsets[:-1], axis=1).T
    values[at] = there
    return np.asarray(found)


def longest_runs(
    stays: Bool[Array, "C T"], counts: Callable[[Array, Array], Array], offsets: Int[Array, " _"]
) -> tuple[Int[Array, "M C"], Int[Array, "M C"], Int[Array, "M C"]]:
    """The run of steps that stay as the one before that has most steps that count, of each demonstration: the number of
    these steps, the step before the run, and its length with that; 0, 0 and 1 where nothing counts. `counts` tells it
    of columns and steps; no first step of a demonstration stays."""
    n, first, length = (np.full((len(offsets) - 1, len(stays)), k) for k in (0, 0, 1))
    cells = np.flatnonzero(stays)
    begins = np.flatnonzero(np.append(True, np.diff(cells) != 1)[: len(cells)])
    column, step = np.divmod(cells, stays.shape[1])
    weight = np.add.reduceat(counts(column, step), begins, dtype=int) if len(cells) else begins
    sizes, column, step = np.diff(begins, append=len(cells)), column[begins], step[begins]
    order = np.lexsort((-step, weight))  # the last one of a demonstration and column stays: the first of the longest
    order = order[weight[order] > 0]
    at = np.searchsorted(offsets, step, side="right")[order] - 1, column[order]
    n[at], first[at], length[at] = weight[order], step[order] - 1 - offsets[at[0]], sizes[order] + 1
    return n, first, length


def parts(rows: Bool[Array, " T"], offsets: Int[Array, " _"]) -> tuple[Int[Array, " R"], Int[Array, " R"]]:
    """The first row of each run of True, and the one after its last; a run ends with its demonstration."""
    begins, ends = rows.copy(), rows.copy()
    begins[1:] &= ~rows[:-1]
    ends[:-1] &= ~rows[1:]
    begins[offsets[:-1]], ends[offsets[1:] - 1] = rows[offsets[:-1]], rows[offsets[1:] - 1]
    return np.flatnonzero(begins), np.flatnonzero(ends) + 1


def covered(n: int, begins: Int[Array, " R"], ends: Int[Array, " R"]) -> Bool[Array, " n"]:
    """Which of n rows lie in one of the parts."""
    edges = np.bincount(begins, minlength=n + 1) - np.bincount(ends, minlength=n + 1)
    return np.asarray(np.cumsum(edges)[:n] > 0)


def long_runs(rows: Bool[Array, " T"], offsets: Int[Array, " _"]) -> Bool[Array, " T"]:
    """The rows without those of runs of fewer than `REST_ROWS`."""
    begins, ends = parts(rows, offsets)
    long = ends - begins >= settings.REST_ROWS
    return covered(len(rows), begins[long], ends[long])


def steady(
    values: Float[Array, "C T"], bands: Mapping[int, Float[Array, " C"]], offsets: Int[Array, " _"]
) -> Bool[Array, " T"]:
    """Rows of long runs in which the means over W rows and over the next W lie within the band of each width W; a wider
    one, which sees slower motion, looks only at what is steady by those before."""
    found = np.ones(values.shape[1], dtype=bool)
    for w, band in bands.items():
        begins, ends = parts(found, offsets)
        n = ends - begins - 2 * w + 1
        begins, ends, n = begins[n > 0], ends[n > 0], n[n > 0]
        at = np.arange(n.sum()) + np.repeat(begins - np.cumsum(n) + n, n)
        found &= ~covered(len(found), begins, ends)
        for own, most in zip(values, w * band, strict=True):
            total = np.append(0.0, np.cumsum(own)) if len(at) else own
            at = at[np.abs(total[at + 2 * w] - 2.0 * total[at + w] + total[at]) <= most]
        found = long_runs(found | covered(len(found), at, at + 2 * w), offsets)
    return found


def resting_rows(block: MovingBlock, is_command: bool, by_states: bool = True) -> Bool[Array, " T"]:
    """Rows in which states rest within the noise of their sensors, while the action stays exactly the same, or is 0
    where it is no command; or, `by_states`, where nothing stays so, while it rests as well."""
    columns, actions, offsets = block.columns, block.block.actions, block.offsets
    rests = np.zeros(len(actions), dtype=bool)
    if actions.ndim == 1:
        return rests
    tells = settings.REST_FAR * columns.noise <= settings.LARGEST_BAND * columns.spread
    states, noise, own = ~columns.is_action[tells], columns.noise[tells], block.values[tells]
    if not states.any():
        return rests
    drift = settings.REST_DRIFT * columns.spread[tells] + 1e-12
    bands = {w: settings.REST_FAR * np.sqrt(2 / w) * noise + drift * w for w in settings.REST_WIDTHS}
    of_states, reach = {w: band[states] for w, band in bands.items()}, settings.REST_FAR * (noise + drift)
    same: Array = np.ones(actions.shape, dtype=bool)
    np.equal(actions[1:], actions[:-1], out=same[1:])
    same = np.asarray((same if is_command else same | (actions == 0)).all(axis=1))
    same[offsets[:-1]] = False
    begins, ends = parts(long_runs(same, offsets), offsets)
    moves = ends - begins < np.diff(offsets)[np.searchsorted(offsets, begins, side="right") - 1] - 1
    begins, ends = begins[moves] - 1, ends[moves]
    is_exact = covered(len(same), begins, ends)
    inside, bounds = np.flatnonzero(is_exact), np.append(0, np.cumsum(ends - begins))
    a, b = parts(steady(own[np.ix_(states, inside)], of_states, bounds), bounds)
    k = np.searchsorted(bounds, a, side="right") - 1
    found = [(own[states], reach[states], inside[a], inside[b - 1] + 1, begins[k], ends[k])]
    if by_states:
        a, b = parts(steady(own, bands, offsets), offsets)
        n = np.append(0, np.cumsum(is_exact))
        a, b = a[n[a] == n[b]], b[n[a] == n[b]]  # else the action tells
        k = np.searchsorted(offsets, a, side="right") - 1
        found.append((own, reach, a, b, offsets[k], offsets[k + 1]))
    for values, far, a, b, low, high in found:
        first, last = near_middle(values, far, a, b)
        long = last - first >= settings.REST_ROWS - 1  # in the first it arrives; at the ends a few rows tell little
        is_head = (a - low <= settings.REST_ROWS // 2) & (offsets[np.searchsorted(offsets, low)] == low)
        is_tail = (high - b <= settings.REST_ROWS // 2) & (offsets[np.searchsorted(offsets, high)] == high)
        begins, ends = np.where(is_head, low, first + 1), np.where(is_tail, high, last + 1)
        rests |= covered(len(rests), begins[long], ends[long])
    return long_runs(rests, offsets)


def near_middle(
    values: Float[Array, "C T"], far: Float[Array, " C"], begins: Int[Array, " R"], ends: Int[Array, " R"]
) -> tuple[Int[Array, " R"], Int[Array, " R"]]:
    """The first and the last row of each part in which every column is no further from its median there than `far`; T
    and -1 where there is none."""
    n, run = ends - begins, np.repeat(np.arange(len(begins)), ends - begins)
    starts = np.cumsum(n) - n
    rows = np.arange(len(run)) + (begins - starts)[run]
    order = (own := values[:, rows]).copy()
    for a, b in pairwise([*starts.tolist(), len(rows)]):
        order[:, a:b].sort(axis=1)
    middle = (order[:, starts + (n - 1) // 2] + order[:, starts + n // 2]) / 2
    near = (np.abs(own - middle[:, run]) <= far[:, None]).all(axis=0)
    first = np.minimum.reduceat(np.where(near, rows, values.shape[1]), starts)
    return first, np.maximum.reduceat(np.where(near, rows, -1), starts)


def idle_runs(block: MovingBlock, is_command: bool) -> tuple[Int[Array, " M"], ...]:
    """Steps at rest at the beginning and at the end of each demonstration, and the first step and the length of its
    longest rest between; by states alone they count where actions are commands."""
    head, tail, first, longest = (np.zeros(len(block.numbers), dtype=int) for _ in range(4))
    begins, ends = parts(resting_rows(block, is_command, is_command), block.offsets)
    places = np.searchsorted(block.offsets, begins, side="right") - 1
    for m, a, b in zip(places.tolist(), begins.tolist(), ends.tolist(), strict=True):
        if a == block.offsets[m]:
            head[m] = b - a - 1  # motion begins in the last
        elif b == block.offsets[m + 1]:
            tail[m] = b - a
        elif b - a > longest[m]:
            first[m], longest[m] = a - block.offsets[m], b - a
    return head, tail, first, longest
