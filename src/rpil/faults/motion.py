"""The rules about how columns move: what leaps, stays the same, repeats, or has another scale."""

from __future__ import annotations

import math

import numpy as np

from rpil.data.text import moment
from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock, means, not_recorded, ranges_and_zeros
from rpil.faults.rule import Compared, ComparingRule, Fault, Learned, above
from rpil.numerics.types import Array, Bool, Float, Int, Shaped


def few(n_demonstrations: int) -> float:
    """Demonstrations that may have a fault of some kinds; what more have is usual."""
    return min(
        max(settings.FEW, math.ceil(settings.FEW_SHARE * n_demonstrations)), settings.MOST_FEW * n_demonstrations
    )


class Leap(ComparingRule):
    """Larger than usual, than the usual largest change, and than a share of the column's spread."""

    causes: tuple[str, ...] = ("length",)

    def compare(self) -> Compared:
        columns = self.columns
        size, self.first, self.last, most = self.measured[:4]
        self.names = columns.names
        least = settings.CHANGE_FACTOR * np.quantile(most, 0.75, axis=0, method="lower")
        least = np.maximum(least, settings.SMALLEST_LEAP * columns.spread)
        limit = np.maximum(self.fence(size, settings.LEAP_FACTOR, settings.SMALLEST_SHARE * least), least)
        is_known = (columns.moving >= settings.MOVING_SHARE) & (columns.memory >= settings.LEAST_MEMORY)
        return above(size, np.where(is_known, limit, np.inf) * self.pace)

    @property
    def pace(self) -> Array:
        """How much larger the steps of each demonstration are, (M, 1): what is done in far fewer takes larger ones."""
        pace = np.median(self.data.lengths) / self.data.lengths[:, None]
        return np.where(pace > settings.LENGTH_FACTOR, pace, 1.0)


class Spike(Leap):
    name, words = "spike", "one value is far from both its neighbours"
    sentence = "{column} leaps by {value:.3g} for one step at {last} (usual: up to {threshold:.3g})"

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """With changes d_t to step t, the largest max(0, min(|d_t|, |d_t+1|) - max(|d_t-1|, |d_t+2|)) where d_t and
        d_t+1 have opposite signs; its first and last step, t; and the largest change."""
        change, size = block.change, block.size
        apart, after = np.zeros_like(size), np.pad(size[:, 3:], ((0, 0), (0, 1)))
        np.minimum(size[:, 1:-1], size[:, 2:], out=apart[:, 1:-1])
        apart[:, 1:-1] *= change[:, 1:-1] * change[:, 2:] < 0
        apart[:, 1:-1] -= np.maximum(size[:, :-2], after)
        spike, step = largest(np.maximum(apart, 0.0), block.offsets)
        return spike, step, step, block.largest


class Jump(Leap):
    name, words = "jump", "a column jumps from one step to the next and stays there"
    causes = ("length", "frozen sensor", "frozen action", "saturation")
    sentence = "{column} jumps by {value:.3g} at {last} (usual: up to {threshold:.3g})"

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """With changes d_t to step t, the largest |d_t| - max(|d_t-1|, |d_t+1|) where |d_t| is twice as large as both;
        its first and last step, t - 1 and t; and the largest change."""
        size, offsets = block.size, block.offsets
        around = np.zeros_like(size)
        np.maximum(size[:, :-2], size[:, 2:], out=around[:, 1:-1])
        jump = np.where(2.0 * around < size, size - around, 0.0)
        jump[:, offsets[:-1] + np.minimum(np.diff(offsets) - 1, 1)] = 0.0  # nothing tells how it moved before
        jump[:, offsets[1:] - 1] = 0.0
        jump, step = largest(jump, offsets)
        every, at = largest(Jump.of_all(block)[None], offsets)
        return jump, step - 1, step, block.largest, every, at

    @staticmethod
    def of_all(block: MovingBlock) -> Array:
        """How much larger the change is at a step, in all columns together, than at the two steps before and after: in
        logarithms, whose mean over the columns no single one makes large."""
        change = np.log1p(block.size / block.columns.scale[:, None]).sum(axis=0) / max(len(block.size), 1)
        apart = np.zeros_like(change)
        apart[2:-2] = change[2:-2] - np.max([change[:-4], change[1:-3], change[3:-1], change[4:]], axis=0)
        steps = np.arange(len(apart)) - np.repeat(block.offsets[:-1], lengths := np.diff(block.offsets))
        apart[(steps < 3) | (steps >= np.repeat(lengths, lengths) - 2)] = 0.0  # nothing tells how it moved before
        return np.asarray(apart)

    def compare(self) -> Compared:
        of_columns, (every, at) = super().compare(), self.measured[4:]
        low, high = np.quantile(every, [0.25, 0.75])
        limit = high + settings.FENCE * (high - low) + settings.LEAST_OF_ALL
        of_all = above(every, limit + np.log(self.pace))
        self.names += ("",)
        self.first, self.last = np.hstack([self.first, at - 1]), np.hstack([self.last, at])
        value, threshold, severity = (
            np.hstack([one, np.broadcast_to(all_, every.shape)]) for one, all_ in zip(of_columns, of_all, strict=True)
        )
        return value, threshold, severity

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        if fault.column:
            return super().say(fault, m, c)
        return f"all columns jump at once at {moment(fault.last, self.data.seconds)}: perhaps frames are missing"

    @classmethod
    def follows(cls, fault: Fault, cause: Fault) -> bool:
        """At the ends of frozen and saturated stretches."""
        if cause.rule == "length":
            return super().follows(fault, cause)
        return fault.column == cause.column and fault.last in (cause.first, cause.last + 1)


class HeldValue(ComparingRule):
    """One value for long, while others move."""

    sentence = "{column} stays at {at} for {long} from {first} while others move (usual: up to {most})"
    causes = ("length", "idle tail")
    kinds: tuple[bool, ...] = (False, True)
    """Whether the columns that the rule is about are actions."""
    is_extreme = False

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """Of the run of one value that has most steps in motion: the number of these, its first step, its length and
        the value; and the lowest and the highest value. What rests with its partner, as a hand that is closed, does
        not stand still while others move: steps count in which the partner changes."""
        values, offsets, changed, partner = block.values, block.offsets, block.size > 0, block.columns.partner
        counts = block.moves & np.where(partner[:, None] < 0, True, changed[partner])
        still, first, length = longest_runs(changed, counts, offsets)
        low, high = (of.reduceat(values, offsets[:-1], axis=1).T for of in (np.minimum, np.maximum))
        return still, first, length, values[np.arange(len(values)), first + offsets[:-1, None]], low, high

    def compare(self) -> Compared:
        chosen = np.isin(self.columns.is_action, self.kinds)
        self.names = tuple(np.array(self.columns.names)[chosen].tolist())
        still, self.first, length, self.at, low, high = (of_each[:, chosen] for of_each in self.measured)
        self.last = self.first + length - 1
        limit = np.maximum(self.fence(still, settings.FROZEN_FACTOR, settings.SMALLEST_RUN), settings.MIN_FROZEN)
        is_extreme = (self.at == low.min(axis=0)) | (self.at == high.max(axis=0))
        is_own = (is_extreme == self.is_extreme) & (self.first > 0)  # what has not been touched yet rests
        value = np.where(is_own, still, 0)
        moving, partner = self.columns.moving, self.columns.partner
        moving = np.where(partner < 0, moving, moving[partner])[chosen]
        return above(value, np.where(moving >= settings.MOVING_SHARE, limit, np.inf))

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        return super().say(fault, m, c, at=f"{self.at[m, c]:.4g}")

    @classmethod
    def follows(cls, fault: Fault, cause: Fault) -> bool:
        """What is held until the end is a part of an idle tail, whose sensors have noise."""
        return fault.last == cause.last if cause.rule == "idle tail" else super().follows(fault, cause)


class FrozenSensor(HeldValue):
    name, words = "frozen sensor", "an observation stays the same for long while others change"
    needs = "observations", "several"
    kinds = (False,)


class FrozenAction(HeldValue):
    name, words = "frozen action", "an action stays the same for long while others change"
    needs = "actions", "several"
    kinds = (True,)


class Saturation(HeldValue):
    name, words = "saturation", "a column stays at its lowest or highest value for long"
    is_extreme = True


class RepeatedFrames(ComparingRule):
    """Rows that repeat the one before while everything moves; `find_frame_times` finds times that are too short."""

    name, needs = "repeated frames", ("several",)
    words = "the time between two frames is too short, or a row repeats the one before while all moves"
    sentence = "{rows} the row before while all moves, most from {first} (usual: {usual})"

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """Number of repeated rows between rows that move, and the first step and the length of the longest
        repetition."""
        columns, offsets = block.columns, block.offsets
        changed: Array = np.any(block.size[~columns.is_action] > 0, axis=0)
        moves = block.motion > settings.REPEAT_MOTION * columns.motion
        runs, starts, bounds = runs_of(changed[None], offsets)
        is_first = np.zeros(len(starts), dtype=bool)
        is_first[bounds] = True
        after = np.append(starts[1:], 0)
        between = ~is_first & ~np.append(is_first[1:], True) & moves[starts] & moves[after]
        repeated = np.where(between, runs - 1, 0)
        longest = first_largest(repeated, bounds)
        return np.add.reduceat(repeated, bounds), starts[longest] + 1 - offsets[:-1], repeated[longest]

    def compare(self) -> Compared:
        repeats, self.first, length = self.measured
        self.last = self.first + length - 1
        return above(repeats, self.fence(repeats, 1.0, settings.SMALLEST_REPEAT))

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        rows = "1 row repeats" if fault.value == 1 else f"{fault.value:,.0f} rows repeat"
        most = int(fault.threshold)
        return super().say(fault, m, c, rows=rows, usual=f"up to {most}" if most else "none")


class Scale(ComparingRule):
    """Values and changes are many times larger than elsewhere, or smaller, and so beside most columns of their kind."""

    name, words = "scale", "a column and its changes are many times larger, or smaller, than usual"
    sentence = "{column} and its changes are {times} than usual: perhaps another unit, perhaps {motion}"
    causes = ("length",)
    takes_steps = True

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """Mean size of a value, and of a change."""
        return means(np.abs(block.values), block.offsets), means(block.size, block.offsets)

    def compare(self) -> Compared:
        columns = self.columns
        self.names = columns.names
        levels, changes = self.measured[0] + 1e-3 * columns.spread, self.measured[1] + 1e-3 * columns.scale
        (low, high), (slow, fast) = (self.two_fences(values, settings.SCALE_FACTOR) for values in (levels, changes))
        usual = np.median(levels, axis=0)
        ratio = levels / usual
        kinds = [ratio[:, columns.is_action == kind] for kind in (False, True) if (columns.is_action == kind).any()]
        beside = np.max([np.median(r, axis=1, keepdims=True) for r in kinds], axis=0) / ratio / settings.SCALE_FACTOR
        larger = np.minimum(levels / high, changes / fast)
        smaller = np.minimum(np.minimum(low / levels, slow / changes), beside)
        severity = np.where(self.measured[1] > 0, np.maximum(larger, smaller), 0.0)  # what never moves has no unit
        severity[:, ~np.isfinite(high + fast) | (low * slow == 0) | (columns.moving < settings.MOVING_SHARE)] = np.nan
        return ratio, np.where(larger > smaller, high, low) / usual, severity

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        if fault.value >= 1:
            return super().say(fault, m, c, times=f"{fault.value:.3g} times larger", motion="wild motion")
        return super().say(fault, m, c, times=f"{1 / fault.value:.3g} times smaller", motion="little motion")

    @classmethod
    def follows(cls, fault: Fault, cause: Fault) -> bool:
        """A demonstration that is cut off, or rests for long, has small values and changes in the mean."""
        return fault.value < 1


class NeverMoves(ComparingRule):
    """Columns that move in the others, about as far in each, and never in this one, which more than a few may have
    where the columns are not recorded."""

    name, words = "never moves", "a column does not move, and in the others it does"
    sentence = "{column} does not move, and in the others it does"

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
        value, threshold, severity = above(still, np.where(is_known & (usual > 0), 0.5, np.inf))
        alike = still * np.minimum(low, high) / np.maximum(high, 1e-300)  # the more it moves so in all others
        return value, threshold, np.where(self.absent, 1e6, severity) + alike

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        if self.absent[m, c]:
            return f"these columns are not recorded here: {fault.column} is 0 in every step, and in the others it moves"
        return super().say(fault, m, c)


def largest(values: Float[Array, "C T"], offsets: Int[Array, " _"]) -> tuple[Float[Array, "M C"], Int[Array, "M C"]]:
    """The largest value of each demonstration, and the first step of the demonstration that has it."""
    begins = np.arange(len(values))[:, None] * values.shape[1] + offsets[:-1]
    place = first_largest(values.ravel(), begins.ravel()).reshape(begins.shape)
    return values.ravel()[place].T, (place - begins).T


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
