"""The rules about how columns move: what leaps, wraps, repeats, or has another scale."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rpil.data.text import counted
from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock, part_means
from rpil.faults.rule import ALSO, Compared, ComparingRule, Fault, Learned, above
from rpil.faults.still import largest, next_largest
from rpil.faults.tracking import misfits, parts_of, relation
from rpil.numerics.types import Array


class Leap(ComparingRule):
    """Larger than usual, than the usual largest change, and than a share of the column's spread."""

    causes: tuple[str, ...] = ("length", "two units")

    def compare(self) -> Compared:
        columns, self.names = self.columns, self.columns.names
        (size, self.last, most), self.first = self.measured[:3], self.measured[1]
        smallest, moved = settings.SMALLEST_LEAP * columns.spread, np.where(most > 0, most, np.nan)
        moved[:, np.isnan(moved).all(axis=0)] = 0.0
        large = np.quantile(most, 0.75, axis=0, method="lower"), np.nanmedian(moved, axis=0)
        least, usual = (np.maximum(settings.CHANGE_FACTOR * of, smallest) for of in large)
        limit = np.maximum(self.fence(size, settings.LEAP_FACTOR, settings.SMALLEST_SHARE * least), least)
        # Leaps that many have make their quartile large, and are far larger than the next of each.
        second, beside = (np.quantile(of_each, 0.75, axis=0) for of_each in self.measured[-2:])
        usual = np.minimum(usual, np.maximum(settings.CHANGE_FACTOR * beside, smallest))
        apart = settings.NEXT_LEAP * (second + usual)
        limit = np.where((size > apart).mean(axis=0) >= settings.MOST_FEW, np.minimum(limit, apart), limit)
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
        d_t+1 have opposite signs; its step, t; and the largest change."""
        change, size, apart = block.change, block.size, np.zeros_like(block.size)
        is_back, around = (change[:, 1:-1] < 0) != (change[:, 2:] < 0), size[:, :-2].copy()
        np.maximum(around[:, :-1], size[:, 3:], out=around[:, :-1])
        far = np.minimum(size[:, 1:-1], size[:, 2:])
        apart[:, 1:-1] = np.where(is_back & (far > around), far - around, 0.0)
        spike, step = largest(apart, block.offsets)
        others = (next_largest(values, step, block.offsets) for values in (apart, size))
        return spike, step, block.largest, *others


class Jump(Leap):
    name, words = "jump", "a column jumps from one step to the next and stays there"
    causes = ("length", "frozen sensor", "frozen action", "saturation", "two episodes", "two units")
    sentence = "{column} jumps by {value:.3g} at {last} (usual: up to {threshold:.3g})"
    sentence_of_all = "all columns jump at once at {last}: perhaps frames are missing"

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """With changes d_t to step t, the largest |d_t| - max(|d_t-1|, |d_t+1|) where |d_t| is twice as large as both;
        its step, t; and the largest change."""
        size, offsets, jump = block.size, block.offsets, np.zeros_like(block.size)
        around = np.maximum(size[:, :-2], size[:, 2:])
        jump[:, 1:-1] = np.where(size[:, 1:-1] > 2.0 * around, size[:, 1:-1] - around, 0.0)
        jump[:, offsets[:-1] + np.minimum(np.diff(offsets) - 1, 1)] = 0.0  # nothing tells how it moved before
        jump[:, offsets[1:] - 1] = 0.0
        top, step = largest(jump, offsets)
        # How much larger a change is than at the two steps before and after, in all columns together.
        change, together = block.growth, np.zeros((1, size.shape[1]))
        together[0, 2:-2] = change[2:-2] - np.max([change[:-4], change[1:-3], change[3:-1], change[4:]], axis=0)
        steps = np.arange(len(change)) - np.repeat(offsets[:-1], lengths := np.diff(offsets))
        together[:, (steps < 3) | (steps >= np.repeat(lengths, lengths) - 2)] = 0.0
        every, at = largest(together, offsets)
        second = next_largest(together, at, offsets)
        second[lengths < settings.LEAST_STEPS] = np.inf  # too few to have a next one
        others = (next_largest(values, step, offsets) for values in (jump, size))
        return top, step, block.largest, every, at, second, *others

    def compare(self) -> Compared:
        of_columns, (every, at) = super().compare(), self.measured[3:5]
        self.first = self.last - 1
        return self.with_all(of_columns, above(every, Jump.limit(self.measured) + np.log(self.pace)), at - 1, at)

    @staticmethod
    def limit(measured: tuple[Array, ...]) -> float:
        """From where on a leap of all columns is unusual, or far larger than the next of each demonstration."""
        every, _, second = measured[3:6]
        low, high = np.quantile(every, [0.25, 0.75])
        usual = high + settings.FENCE * (high - low) + settings.LEAST_OF_ALL
        beyond = settings.NEXT_FACTOR * np.quantile(second, 0.75, method="lower") + settings.BEYOND_NEXT
        return float(min(usual, beyond))

    @classmethod
    def follows(cls, fault: Fault, cause: Fault) -> bool:
        """At the ends of frozen and saturated stretches; of several columns a finding names the worst alone."""
        if cause.rule in ("length", "two episodes", "two units"):
            return super().follows(fault, cause)
        return (fault.column == cause.column or ALSO in cause.sentence) and fault.last in (cause.first, cause.last + 1)


class RepeatedFrames(ComparingRule):
    name, needs = "repeated frames", ("several",)
    words = "the time between two frames is too short, or a row equals the one before during motion"
    sentence = "{rows} the row before while all moves, most from {first} (usual: {usual})"

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """The first three of `between`; and, of rows that repeat the action as well, the others."""
        columns, offsets, size = block.columns, block.offsets, block.size[: (~block.columns.is_action).sum()]
        changed: Array = np.any(size > 0, axis=0)
        least = settings.REPEAT_MOTION * columns.motion
        of_states = RepeatedFrames.between(changed, block.motion > least, offsets)
        # A state that rests does not begin to move in the step in which the action changes, but after it.
        actions = block.block.actions.reshape(len(block.block.actions), -1)  # codes may be text
        acted = np.append(True, (actions[1:] != actions[:-1]).any(axis=1))
        moves = block.of_states > settings.LEAST_MOTION * least
        return *of_states[:3], *RepeatedFrames.between(changed | acted, moves, offsets)[1:]

    @staticmethod
    def between(changed: Array, moves: Array, offsets: Array) -> tuple[Array, ...]:
        """Repeated rows between rows that move; the first step and the length of the longest repetition; and the length
        of the next."""
        changed = changed.copy()
        changed[offsets[:-1]] = True
        starts = np.flatnonzero(changed)
        runs, bounds = np.diff(starts, append=len(changed)), np.searchsorted(starts, offsets[:-1])
        is_first = np.zeros(len(starts), dtype=bool)
        is_first[bounds] = True
        inside = ~is_first & ~np.append(is_first[1:], True) & moves[starts] & moves[np.append(starts[1:], 0)]
        repeated = np.where(inside, runs - 1, 0)
        top = np.repeat(np.maximum.reduceat(repeated, bounds), np.diff(bounds, append=len(repeated)))
        places, number = np.flatnonzero(repeated == top), np.add.reduceat(repeated, bounds)
        longest = places[np.searchsorted(places, bounds)]
        length = repeated[longest]
        repeated[longest] = 0
        return number, starts[longest] + 1 - offsets[:-1], length, np.maximum.reduceat(repeated, bounds)

    def compare(self) -> Compared:
        repeats, first, length, at, most, second = self.measured
        value, limit, severity = above(repeats, self.fence(repeats, 1.0, settings.SMALLEST_REPEAT))
        whole = most >= max(settings.REPEATED_ROWS, settings.NEXT_FACTOR * np.quantile(second, 0.75))
        self.first, self.last = np.where(whole, at, first), np.where(whole, at + most, first + length) - 1
        severity = np.where(whole, np.fmax(severity, most / settings.SMALLEST_REPEAT), severity)
        return np.where(whole, most, value), np.where(whole, 0, limit), severity

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        rows = "1 row repeats" if fault.value == 1 else f"{fault.value:,.0f} rows repeat"
        most = int(fault.threshold)
        return super().say(fault, m, c, rows=rows, usual=f"up to {most}" if most else "none")


class Scale(ComparingRule):
    """Values and changes are many times larger than elsewhere, or smaller, and so beside most columns of their kind."""

    name, words = "scale", "a column and its changes are many times larger, or smaller, than usual"
    sentence = "{column} and its changes are {times} than usual: perhaps another unit, perhaps {motion}"
    causes = ("length", "unrelated", "two units")
    takes_steps = True

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """Mean size of a value, and of a change."""
        return part_means(np.abs(block.values), block.offsets)[:, 0], part_means(block.size, block.offsets)[:, 0]

    def compare(self) -> Compared:
        columns, self.names = self.columns, self.columns.names
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
        return fault.value < 1 or cause.rule != "length"


class Wraps(ComparingRule):
    name, words, grade = "wraps", "an angle leaps by a turn where it wraps", "broken"
    needs = ("columns",)
    sentence = "{column} wraps: it leaps by {turn:.4g} {times}; unwrap it"

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """Leaps of each column, and its turn."""
        return block.leaps, block.turn * (block.leaps > 0)

    def compare(self) -> Compared:
        self.names, (leaps, _) = self.columns.names, self.measured
        return leaps, 0, 2.0 * leaps

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        return super().say(fault, m, c, turn=self.measured[1][m, c], times=counted(int(fault.value), "time"))


class CommandRule(ComparingRule):
    """A rule about `Tracked` pairs, which needs no other demonstration where actions are commands."""

    needs: tuple[str, ...] = ("commands",)
    takes_steps = True

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """Result of `relation` for each demonstration, (M, P); three quantiles of the distance of each action from its
        state, (M, P); and `misfits`."""
        pairs, gaps, turn = learned.tracked, [], block.turn[learned.tracked.action]
        parts = [*parts_of(block, pairs)]
        for actions, states in parts:
            some = np.s_[:, :: max(actions.shape[1] // 200, 1)]  # enough for quantiles
            gap = actions[some] - pairs.slope[:, None] * states[some]
            gap.sort(axis=1)
            gaps.append(gap[:, [round(q * (gap.shape[1] - 1)) for q in settings.GAP_QUANTILES]])
        gap = np.moveaxis(np.array(gaps), 2, 0)
        gap -= turn * np.rint(gap[1] / np.where(turn > 0, turn, np.inf))
        left = misfits(block, pairs) if pairs.fits.any() else np.ones((len(gaps), 2 * settings.MAX_SHIFT + 1))
        return *relation(parts, pairs.is_command), *gap, left


class ActionIsState(CommandRule):
    name, grade = "action is state", "broken"
    words = "the action is the state of the same step: a policy learns to stay"
    sentence = f"{words}; take the state of a later step"

    def compare(self) -> Compared:
        left, zero = self.measured[-1], settings.MAX_SHIFT
        beside = left[:, [zero - 1, zero + 1]].min(axis=1)
        is_known = self.data.learned.tracked.is_command & (beside > 0) & np.isfinite(beside)
        value = np.where(is_known, left[:, zero] / np.maximum(beside, 1e-300), 1.0)
        severity = np.where(is_known, np.minimum(settings.IS_STATE / (value + 1e-12), 1e6), np.nan)
        return value, settings.IS_STATE, severity


class Exchanged(CommandRule):
    name, words, grade = "exchanged", "columns are in another order", "broken"
    sentence = "{column} goes with {other}: the columns of the action, or of the state, are in another order"

    def compare(self) -> Compared:
        pairs, (own, other) = self.data.learned.tracked, self.measured[3:5]
        self.names = tuple(self.columns.names[a] for a in pairs.action)
        better = own / np.maximum(other, 1e-6) / settings.OTHER_FITS * (other <= 1.0 - settings.SURE)
        better *= (better > 1).sum(axis=1, keepdims=True) > 1  # what has its place is out of place as well
        return other, own, better

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        state = self.data.learned.tracked.state[int(self.measured[2][m, c])]
        return super().say(fault, m, c, other=self.columns.names[state])


class CommandAgainstState(CommandRule):
    name, words, grade = "offset", "a command is at another level than the state that follows it", "broken"
    causes = ("exchanged", "action is state", "never moves", "two units", "unrelated")

    def compare(self) -> Compared:
        pairs, (slope, own, _, _, _, low, gap, high) = self.data.learned.tracked, self.measured[:8]
        self.names = tuple(self.columns.names[a] for a in pairs.action)
        error, spread = (high - low) / settings.GAP_WIDTH, self.columns.spread[pairs.action]
        fits = pairs.fits | ((own >= settings.TRACKS) & (np.abs(slope - 1.0) <= settings.SAME_UNIT))
        least = np.maximum(settings.ERRORS * error, settings.LEAST_GAP * spread) + 1e-12
        level = np.where(fits, np.abs(gap) / least, 0.0)
        # What many have by little may be the load of an arm.
        is_usual = (level > 1).mean(axis=0) > settings.MOST_FEW
        level = np.where(is_usual & (np.abs(gap) < settings.LEAST_USUAL_GAP * spread), 0.0, level)
        ratio, moves = slope / pairs.slope, own >= settings.SURE
        # A pair that never fits may have a unit of its own by design, but no other sense in the same unit.
        usual = pairs.fits | ((np.abs(ratio - 1.0) <= settings.SAME_UNIT) & moves).any(axis=0)
        size = np.abs(np.log(np.maximum(np.abs(ratio), 1e-300)))
        known_unit = np.min(np.abs(size[..., None] - np.log(settings.UNITS)), axis=-1) < settings.UNIT_ERROR
        unit = np.where(moves & (usual | known_unit), size / np.log(settings.OTHER_UNIT), 0.0)
        sign = np.where(moves & (ratio < 0) & (usual | (size < settings.SAME_UNIT)), 2.0, 0.0)
        every = np.stack([level, unit, sign])
        self.kind, self.ratio = every.argmax(axis=0), ratio
        return gap, least, every.max(axis=0) if pairs.is_command else np.full(level.shape, np.nan)

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        state = self.columns.names[self.data.learned.tracked.state[c]]
        off, times = f"{abs(fault.value):.3g} {'above' if fault.value > 0 else 'below'}", abs(self.ratio[m, c])
        said = (
            f"is {off} {state} throughout: the zero of one of them has moved",
            f"changes {times:.3g} times as much as {state}, which follows it: another unit",
            f"has the other sign than {state}, which follows it",
        )
        return f"{fault.column} {said[self.kind[m, c]]}"

    def findings(self) -> Iterator[Fault]:
        """Faults of sign and unit under the names that they have where other demonstrations tell them."""
        for fault in super().findings():
            kind = int(self.kind[self.data.ids.index(fault.id), self.names.index(fault.column)])
            yield replace(fault, rule=(self.name, "scale", "sign")[kind])
