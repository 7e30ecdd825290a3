"""The rules about whole demonstrations: length, lag, whether undoing a fault mends them, copies, and idle ends."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rpil.data.arrays import Id
from rpil.data.copies import Copies, digests
from rpil.data.text import counted, duration
from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock
from rpil.faults.motion import CommandRule
from rpil.faults.rule import Compared, ComparingRule, Fault, Learned, Measurements, Rule, above
from rpil.faults.still import few, idle_runs
from rpil.faults.tracking import shifts
from rpil.numerics.types import Array, Bool, Int


class Length(ComparingRule):
    name, words = "length", "it is far longer or shorter than the others"
    sentence = "it has {steps}{seconds} (usual: {low:.0f} to {high:.0f} steps)"
    needs = ("several",)

    def compare(self) -> Compared:
        lengths = self.data.lengths.astype(float)
        self.low, self.high = low, high = self.two_fences(lengths, settings.LENGTH_FACTOR)
        # What many demonstrations have, as those of another sampling rate, is no fault of one.
        are_few = max((lengths < low).sum(), (lengths > high).sum()) <= few(len(lengths))
        is_known = np.isfinite(high) & (low != 0) & are_few
        severity = np.where(is_known, np.maximum(lengths / high, low / lengths), np.nan)
        return lengths, np.where(lengths > high, high, low), severity

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        lasts = "" if self.data.seconds is None else f", {duration(fault.value, self.data.seconds)}"
        steps = counted(int(fault.value), "step")
        return super().say(fault, m, c, steps=steps, seconds=lasts, low=self.low, high=self.high)


class OtherLag(ComparingRule):
    name, words = "lag", "the state follows the action sooner or later than usual, or moves before it"
    sentence = "the state follows the action {steps} {when} than usual"
    needs = ("lag", "several")
    causes = ("frame rate", "action is state", "unrelated")
    unknown = "the lag between action and state is not the same in most demonstrations"

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """As `shifts`."""
        return shifts(block, learned.pairs)

    def compare(self) -> Compared:
        tracked, n = self.data.learned.tracked, len(self.data.ids)
        self.early = np.zeros(n, dtype=int)
        if tracked.is_command:
            return self.of_commands(self.data.measured[CommandRule.measure][-1], tracked.lag)
        self.shift, gain = self.measured[:2]
        steps, least_gain = np.abs(self.shift), self.fence(gain, settings.USUAL_FACTOR, settings.SMALLEST_GAIN)
        power = sum(float(pair.usual @ pair.usual) for pair in self.data.learned.pairs)
        # A correlation of n steps is off by n^-1/2.
        by_chance = settings.TAIL * np.sqrt(2.0 / (power * self.data.lengths))
        severity = np.where(steps > 0, gain / np.maximum(least_gain, by_chance), 0.0)
        are_few = (severity > 1).sum() <= few(n)
        return steps, 1, severity if are_few and np.isfinite(least_gain) else np.full(n, np.nan)

    def of_commands(self, left: Array, lag: int) -> Compared:
        """By what is left of commands at each lag: where a few differ, and where states move before them in any."""
        zero, best, least = settings.MAX_SHIFT, left.argmin(axis=1), left.min(axis=1)
        known, enough = least < settings.LAG_FITS, settings.LAG_BETTER * least
        late = known & (left[:, [zero, zero + 1]].min(axis=1) > enough)
        self.early = np.where(late, np.maximum(zero - best - 1, 0), 0)
        self.shift, usual = best - zero - lag, left[:, zero + lag]
        times = np.where(abs(self.shift) > 1, 1.0, settings.LAG_BETTER)
        other = known & (usual > times * enough) & (self.shift != 0) & (lag > 0)  # else most are at fault
        other &= np.isfinite(usual)
        is_told = known.mean() >= settings.MOST_FEW and other.sum() <= few(len(other))
        severity = np.where(other, np.sqrt(usual / (least + 1e-12)), 0.0) if is_told else np.full(len(left), np.nan)
        steps = np.where(self.early > 0, self.early + 1, np.abs(self.shift))
        return steps, 1, np.where(self.early > 0, np.fmax(severity, 2.0 * self.early), severity)

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        steps, when = self.data.in_steps(int(fault.value)), "later" if self.shift[m] > 0 else "sooner"
        if self.early[m] > 0:
            return f"the state moves {steps} before its command: the actions are recorded late, or moved"
        return super().say(fault, m, c, steps=steps, when=when)

    def usual(self) -> str:
        """The usual lag in words."""
        tracked, pairs = self.data.learned.tracked, self.data.learned.pairs
        if tracked.is_command:
            p, lag = tracked.fits.argmax(), tracked.lag
            both = tracked.action[p], tracked.state[p]
        else:
            both, lag = (pairs[0].action, pairs[0].state), pairs[0].lag
        first, second = [self.columns.names[c] for c in both][:: 1 if lag >= 0 else -1]
        return f"{second} follows {first} after {self.data.in_steps(abs(lag))}"


class Sign(ComparingRule):
    name, words = "sign", "an action, or the state that follows it, has another sign than usual"
    sentence = "{column}, or what follows it, has the other sign"
    needs = ("lag", "several")
    causes = ("never moves", "unrelated")
    takes_steps = True
    measure = OtherLag.measure

    def compare(self) -> Compared:
        agreement, pairs = self.measured[2], self.data.learned.pairs  # of commands `CommandAgainstState` tells
        self.names = tuple(self.columns.names[pair.action] for pair in pairs)
        usual = np.array([pair.correlation for pair in pairs])
        by_chance = settings.TAIL * 2.0 / np.sqrt(self.data.lengths)[:, None]
        severity = -agreement / np.maximum(settings.OPPOSITE * usual, by_chance)
        is_usual = np.median(agreement, axis=0) > settings.OPPOSITE * usual
        are_few = (severity > 1).sum(axis=0) <= few(len(severity))
        return agreement, 0.0, np.where(is_usual & are_few, severity, np.nan)


class Duplicate(Rule):
    name, words = "duplicate", "another demonstration is the same"

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """A hash."""
        return (digests(block.block.observations, block.block.actions, block.offsets),)

    @classmethod
    def find(cls, data: Measurements) -> Iterator[Fault]:
        """Copies, each of which names the first one; short ones of codes are equal by chance."""
        first = Copies.of(data.measured[cls.measure][0]).copy_of
        is_long = data.lengths >= (0 if data.learned.columns.names else settings.MIN_DUPLICATE)
        for m in np.flatnonzero((first < np.arange(len(first))) & is_long).tolist():
            sentence, last = f"it is the same as demonstration {data.ids[first[m]]!r}", int(data.lengths[m]) - 1
            yield Fault(cls.name, data.ids[m], 0, last, "", 0.0, 0.0, 1e3, sentence)


class IdleEnd(ComparingRule):
    causes = ("two units",)
    part = 0  # of the beginning, 0, the end, 1, or between, 2

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """Steps before the first and after the last step that moves; nothing is idle where motion grows slowly, or
        decays as that of a controller that settles. Then `idle_runs`, which count as well."""
        moves, offsets = block.moves, block.offsets
        n, steps = len(moves), np.arange(len(moves))
        first = np.minimum.reduceat(np.where(moves, steps, n), offsets[:-1])
        last = np.maximum.reduceat(np.where(moves, steps, -1), offsets[:-1])
        nothing = first == n
        head = np.where(nothing, np.diff(offsets), np.maximum(first - 1 - offsets[:-1], 0))
        tail = np.where(nothing, 0, offsets[1:] - 1 - last)
        for idle, begins, way in ((head, offsets[:-1], 1), (tail, offsets[1:] - tail, -1)):
            for m in np.flatnonzero(idle >= settings.MIN_IDLE).tolist():
                motion = block.motion[begins[m] + 1 : begins[m] + idle[m]][::way]
                third = len(motion) // 3
                if 0 < settings.SETTLING * motion[1 : third + 1].mean() < motion[-third:].mean():
                    idle[m] = 0
        long_head, long_tail, first, middle = idle_runs(block, learned.tracked.is_command)
        ends = np.maximum(head, long_head), np.maximum(tail, long_tail)
        return *ends, 0 * middle, long_head, long_tail, middle, first

    def compare(self) -> Compared:
        idle, rest, lengths = self.measured[self.part], self.measured[3 + self.part], self.data.lengths
        factor, least = settings.USUAL_FACTOR, settings.MIN_IDLE
        _, limit, severity = above(idle, np.maximum(self.fence(idle, factor, least / factor), least))
        idle, long = idle_steps(self.data, self.part)
        self.first = (self.first, lengths - idle, self.measured[6])[self.part]
        self.last = self.first + idle - 1
        severity = np.where(long, np.fmax(severity, rest / settings.LONG_IDLE), severity)
        return idle, np.where(long, settings.LONG_IDLE, limit), severity


class IdleHead(IdleEnd):
    name, words, grade = "idle head", "nothing moves for long at the beginning", "odd"
    sentence = "nothing moves for the first {long}"


class IdleTail(IdleEnd):
    name, words, grade = "idle tail", "nothing moves for long at the end", "odd"
    sentence = "nothing moves for the last {long}"
    part = 1


class Pause(IdleEnd):
    name, words, grade = "pause", "nothing moves for long between the beginning and the end", "odd"
    sentence = "nothing moves for {long} from {first}"
    part = 2


def idle_steps(data: Measurements, part: int) -> tuple[Int[Array, " M"], Bool[Array, " M"]]:
    """Idle steps of a part, and whether there are so many that they are idle however usual."""
    idle, rest = (data.measured[IdleEnd.measure][part + k] for k in (0, 3))
    long = (rest >= np.maximum(settings.LONG_IDLE, settings.IDLE_SHARE[part] * data.lengths)) & (rest < data.lengths)
    return np.where(long, np.maximum(idle, rest), idle), long


def trims(data: Measurements) -> dict[Id, tuple[int, int]]:
    """The steps to keep of each demonstration with idle ends, whether they are usual or not."""
    head, tail = (n * (n >= settings.MIN_IDLE) for n, _ in (idle_steps(data, part) for part in (0, 1)))
    end = data.lengths - tail
    idle = np.flatnonzero((head + tail > 0) & (head < end)).tolist()
    return {data.ids[m]: (int(head[m]), int(end[m])) for m in idle}
