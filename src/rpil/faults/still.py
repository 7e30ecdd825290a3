"""The rules about columns that stay the same: frozen, at an end of their range, or throughout; runs without a change;
and where everything rests, by how far it goes within some steps against the noise of its sensors at rest.

Arrays are (C, T), as in `rpil.faults.measured_columns`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

import numpy as np

from rpil.data.arrays import spans
from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock, not_recorded, ranges_and_zeros, window_means
from rpil.faults.rule import Compared, ComparingRule, Fault, Learned, above
from rpil.numerics.types import Array, Bool, Float, Int, Shaped


class HeldValue(ComparingRule):
    sentence = "{column} stays at {at} for {long} from {first} while others move (usual: up to {most})"
    causes = ("length", "idle tail", "pause", "two episodes")
    kinds: tuple[bool, ...] = (False, True)  # whether the columns that the rule is about are actions
    is_extreme = False

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """Of the run of one value that has most steps in motion: the number of these, its first step, its length and
        the value; and the lowest and the highest value. A column rests with its partner, as a hand that is closed:
        steps count in which that changes. Then from where on no observation changes, and in how many steps the action
        does."""
        values, offsets, changed, partner = block.values, block.offsets, block.size > 0, block.columns.partner
        counts = block.moves & np.where(partner[:, None] < 0, True, changed[partner])
        still, first, length = longest_runs(changed, counts, offsets)
        low, high = (of.reduceat(values, offsets[:-1], axis=1).T for of in (np.minimum, np.maximum))
        at = values[np.arange(len(values)), first + offsets[:-1, None]]
        is_state = ~block.columns.is_action
        together, acts = changed[is_state].any(axis=0, keepdims=True), changed[~is_state].any(axis=0, keepdims=True)
        n, since, every = (x[:, 0] for x in longest_runs(np.asarray(together), np.asarray(acts), offsets))
        ends = (since > 0) & (since + every == np.diff(offsets)) & (n >= settings.STILL_SHARE * np.diff(offsets))
        return still, first, length, at, low, high, since, n * (ends & (is_state.sum() > 1))

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
        return above(value, np.where(moving >= settings.MOVING_SHARE, limit, np.inf))

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        return super().say(fault, m, c, at=f"{self.at[m, c]:.4g}" if fault.column else "")

    @classmethod
    def follows(cls, fault: Fault, cause: Fault) -> bool:
        """What is held until the end is a part of an idle tail, whose sensors have noise, or of a pause."""
        if cause.rule == "pause":
            return max(cause.first - fault.first, fault.last - cause.last) <= settings.REST_STEPS
        return fault.last == cause.last if cause.rule == "idle tail" else super().follows(fault, cause)


class FrozenSensor(HeldValue):
    name, words = "frozen sensor", "an observation stays the same for long while others change"
    needs = "observations", "several"
    sentence_of_all = "all observations stay the same from {first} on, while the action changes"
    kinds = (False,)

    def compare(self) -> Compared:
        of_columns, (first, n) = super().compare(), self.measured[-2:]
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
    name, words = "never moves", "a column does not move, and in the others it does"
    sentence = "{column} does not move, and in the others it does"
    takes_steps = True

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """The range of each column, and the share of its steps in which it is 0."""
        return ranges_and_zeros(block.values, block.offsets)

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
    begins = np.arange(len(values))[:, None] * values.shape[1] + offsets[:-1]
    place = first_largest(values.ravel(), begins.ravel()).reshape(begins.shape)
    return values.ravel()[place].T, (place - begins).T


def next_largest(values: Float[Array, "C T"], step: Int[Array, "M C"], offsets: Int[Array, " _"]) -> Array:
    """The largest value of each demonstration but for the steps around the one that has it, (M, C)."""
    values, rows = values.copy(), np.arange(len(values))
    for off in range(-settings.WIDTH, settings.WIDTH + 1):
        values[rows, np.clip(step + off, 0, np.diff(offsets)[:, None] - 1) + offsets[:-1, None]] = 0.0
    return np.asarray(np.maximum.reduceat(values, offsets[:-1], axis=1).T)


def first_largest(values: Shaped[Array, " K"], begins: Int[Array, " P"]) -> Int[Array, " P"]:
    """Where the largest value of each part is first; the parts follow one another."""
    top = np.repeat(np.maximum.reduceat(values, begins), np.diff(begins, append=len(values)))
    places = np.flatnonzero(values == top)
    return np.asarray(places[np.searchsorted(places, begins)])


def longest_runs(
    changed: Bool[Array, "C T"], counts: Bool[Array, "C T"], offsets: Int[Array, " _"]
) -> tuple[Int[Array, "M C"], Int[Array, "M C"], Int[Array, "M C"]]:
    """The run without a change that has most steps that count, of each demonstration: the number of these steps, the
    step at which the run begins, and its length."""
    runs, starts, bounds = runs_of(changed, offsets)
    counted = np.append(0, np.cumsum(counts))
    # A run begins with the step that changed, and that step is not counted.
    weight = counted[starts + runs] - counted[starts + 1]
    run = first_largest(weight, bounds).reshape(len(changed), len(offsets) - 1).T
    return weight[run], starts[run] % changed.shape[1] - offsets[:-1, None], runs[run]


def runs_of(changed: Bool[Array, "C T"], offsets: Int[Array, " _"]) -> tuple[Array, Array, Array]:
    """Lengths and first positions, in the flattened array, of all runs without a change; and the number of the first
    run of each column and demonstration. A run ends with its demonstration."""
    changed = changed.copy()
    changed[:, offsets[:-1]] = True
    starts = np.flatnonzero(changed)
    first = np.arange(len(changed))[:, None] * changed.shape[1] + offsets[:-1]
    return np.diff(starts, append=changed.size), starts, np.searchsorted(starts, first.ravel())


def long_runs(rows: Bool[Array, " n"], least: int) -> Bool[Array, " n"]:
    """The rows without those of runs of fewer than `least`."""
    for a, b in spans(rows):
        rows[a:b] = b - a >= least
    return rows


def steady(values: Float[Array, "C n"], bands: Mapping[int, Float[Array, " C"]], least: int) -> Bool[Array, " n"]:
    """Rows of runs, of `least` or more, in which the means over W rows and over the next W lie within the band of each
    width W; a wider one, which sees slower motion, looks only at what is steady by those before."""
    found = np.ones(values.shape[1], dtype=bool)
    for w, band in bands.items():
        for a, b in spans(found):
            if b - a >= 2 * w:
                means = window_means(values[:, a:b], w)
                near = (np.abs(means[:, w:] - means[:, :-w]) <= band[:, None]).all(axis=0)
                found[a:b] = np.convolve(near, np.ones(2 * w)) > 0
        found = long_runs(found, least)
    return found


def resting_rows(block: MovingBlock, is_command: bool, by_states: bool = True) -> list[Bool[Array, " n"]]:
    """Rows of each demonstration in which states rest within the noise of their sensors, while the action stays exactly
    the same, or is 0 where it is no command; or, `by_states`, where nothing stays so, while it rests as well."""
    columns, actions, least, found = block.columns, block.block.actions, settings.REST_ROWS, []
    if actions.ndim == 1:
        return [np.zeros(n, dtype=bool) for n in np.diff(block.offsets).tolist()]
    tells = settings.REST_FAR * columns.noise <= settings.LARGEST_BAND * columns.spread
    states, noise = ~columns.is_action[tells], columns.noise[tells]
    drift = settings.REST_DRIFT * columns.spread[tells] + 1e-12
    bands = {w: settings.REST_FAR * np.sqrt(2 / w) * noise + drift * w for w in settings.REST_WIDTHS}
    of_states, reach = {w: band[states] for w, band in bands.items()}, settings.REST_FAR * (noise + drift)[:, None]
    same: Array = ((np.diff(actions, axis=0, prepend=np.nan) == 0) | ((actions == 0) & (not is_command))).all(axis=1)
    same[block.offsets[:-1]] = False
    for begin, end in itertools.pairwise(block.offsets.tolist()):
        own, rests, n = block.values[tells, begin:end], np.zeros(end - begin, dtype=bool), end - begin
        exact = [(max(a - 1, 0), b) for a, b in spans(long_runs(same[begin:end], least)) if b - a < n - 1]
        parts = [(a, b, a + c, a + d) for a, b in exact for c, d in spans(steady(own[states, a:b], of_states, least))]
        more = spans(steady(own, bands, least)) if by_states else []
        more = [(a, b) for a, b in more if not any(a < d and c < b for c, d in exact)]
        every = [(states, *part) for part in parts] + [(states | True, 0, n, *part) for part in more]
        for chosen, low, high, a, b in every:
            off = np.abs(own[chosen, a:b] - np.median(own[chosen, a:b], axis=1, keepdims=True))
            near = np.flatnonzero((off <= reach[chosen]).all(axis=0))
            if len(near) and near[-1] - near[0] >= least - 1:  # in the first it arrives
                first = 0 if low == 0 and a <= least // 2 else a + near[0] + 1  # at the ends a few rows tell little
                last = n if high == n and n - b <= least // 2 else a + near[-1] + 1
                rests[first:last] = True
        found.append(long_runs(rests, least) & states.any())
    return found


def idle_runs(block: MovingBlock, is_command: bool) -> tuple[Int[Array, " M"], ...]:
    """Steps at rest at the beginning and at the end of each demonstration, and the first step and the length of its
    longest rest between; by states alone they count where actions are commands."""
    head, tail, first, longest = (np.zeros(len(block.numbers), dtype=int) for _ in range(4))
    for m, rests in enumerate(resting_rows(block, is_command, is_command)):
        for a, b in spans(rests):
            if a == 0:
                head[m] = b - 1  # motion begins in the last
            elif b == len(rests):
                tail[m] = b - a
            elif b - a > longest[m]:
                first[m], longest[m] = a, b - a
    return head, tail, first, longest
