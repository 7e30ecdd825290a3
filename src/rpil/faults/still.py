"""The rules about columns that stay the same: frozen, at an end of their range, or throughout; runs without a change;
and where everything rests, by how far it goes within some steps against the noise of its sensors at rest.

Arrays are (C, T), as in `rpil.faults.measured_columns`.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock, not_recorded, ranges_and_zeros
from rpil.faults.rule import Compared, ComparingRule, Fault, Learned, above
from rpil.numerics.types import Array, Bool, Float, Int, Shaped


class HeldValue(ComparingRule):
    sentence = "{column} stays at {at} for {long} from {first} while others move (usual: up to {most})"
    causes = ("length", "idle tail", "pause", "two episodes")
    kinds: tuple[bool, ...] = (False, True)  # whether the columns that the rule is about are actions
    is_extreme = False

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """The run of one value that has most steps in motion: the number of these, its first step, its length and
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


def resting_runs(block: MovingBlock) -> tuple[Int[Array, " M"], ...]:
    """Steps at rest at the beginning and at the end of each demonstration, and the first step and the length of its
    longest rest between. The means over W steps and over the next W lie within four standard deviations, and a share
    of the spread, in every column whose noise is smaller than its motion; those of its first and last W within twice
    that."""
    columns, w = block.columns, settings.REST_STEPS
    head, tail, first, longest = (np.zeros(len(block.numbers), dtype=int) for _ in range(4))
    band = 4.0 * np.sqrt(2.0 / w) * columns.noise + settings.REST_SHARE * columns.spread
    tells = band <= settings.LARGEST_BAND * columns.spread
    if not tells.any() or block.values.shape[1] <= 2 * w:
        return head, tail, first, longest
    band = band[tells, None]
    total = np.cumsum(np.pad(block.values[tells], ((0, 0), (1, 0))), axis=1)
    means = (total[:, w:] - total[:, :-w]) / w  # of steps t to t + w - 1
    rests = (np.abs(means[:, w:] - means[:, :-w]) <= band).all(axis=0)
    for m, (begin, end) in enumerate(itertools.pairwise(block.offsets.tolist())):
        if end - begin <= 2 * w:
            continue
        edges = np.flatnonzero(np.diff(rests[begin : end - 2 * w + 1], prepend=False, append=False))
        for a, b in edges.reshape(-1, 2).tolist():
            n = b - a + 2 * w - 1
            if (np.abs(means[:, begin + a + n - w] - means[:, begin + a]) > 2.0 * band[:, 0]).any():
                continue  # it creeps
            if a == 0:
                head[m] = n
            if a + n >= end - begin:
                tail[m] = n
            elif a and n > longest[m]:
                first[m], longest[m] = a, n
    return head, tail, first, longest


def idle_runs(block: MovingBlock, is_command: bool) -> tuple[Array, ...]:
    """The same of rests in which the action stays exactly the same, cut to that, or which are of commands, there less
    the W steps in which motion begins; a code may be a push. Then the former alone, of the beginning and the end."""
    actions, offsets, w = block.block.actions, block.offsets, settings.REST_STEPS
    if actions.ndim == 1:
        return (np.zeros(len(block.numbers), dtype=int),) * 6
    head, tail, first, middle = resting_runs(block)
    steps, begins, ends = np.arange(len(actions)), offsets[:-1], offsets[1:]
    acted = np.append(False, (np.diff(actions, axis=0) != 0).any(axis=1)) & ~np.isin(steps, begins)
    acts = np.append(0, np.cumsum(acted))
    since = np.minimum.reduceat(np.where(acted, steps, len(steps)), begins) - begins - 1
    until = ends - np.maximum.reduceat(np.where(acted, steps, -1), begins) - 1
    ever = acts[ends] > acts[begins]  # an action that never changes tells nothing
    # What is steady may go on: of speeds, the action is none.
    none = is_command | (actions == 0).all(axis=1)
    exact, idle = [], []
    for n, same, at in ((head, since, begins), (tail, until, ends - 1)):
        exact.append(np.where(ever & (same >= settings.MIN_IDLE), np.minimum(n, same), 0))
        idle.append(np.where((exact[-1] > 0) & none[at], exact[-1], np.maximum(n - w, 0) * is_command))
    middle = middle * none[np.minimum(begins + first + middle // 2, len(steps) - 1)]
    early, late = (np.clip(begins + first + at, 0, len(steps)) for at in (w, middle - w))
    still = ever & (acts[late] <= acts[early])
    middle = np.where(still, middle, np.maximum(middle - w, 0) * is_command)
    return *idle, np.where(still, first, first + w // 2), middle, *exact
