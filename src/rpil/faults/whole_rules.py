"""The rules about whole demonstrations: length, lag, whether undoing a fault mends them, copies, and idle ends."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from rpil.data.arrays import Id
from rpil.data.copies import Copies, digests
from rpil.data.text import counted, duration
from rpil.faults import settings
from rpil.faults.lag import shifts
from rpil.faults.measured_columns import MovingBlock
from rpil.faults.motion import few
from rpil.faults.rule import Compared, ComparingRule, Fault, Learned, Measurements, Rule, above
from rpil.numerics.types import Array, Float, Int


class Length(ComparingRule):
    name, words = "length", "it is far longer or shorter than the others, or short and ends where they do not"
    sentence = "it has {steps}{seconds} (usual: {low:.0f} to {high:.0f} steps){end}"
    needs = ("several",)
    causes = ("frame rate",)

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """The observations of the last step."""
        return (block.values[:, block.offsets[1:] - 1][~block.columns.is_action].T,)

    @property
    def far(self) -> Array:
        """Mean squared distance of each last step from the usual one, in spreads, in columns that do not end by
        chance, (M,)."""
        (last,), columns, own = self.measured, self.columns, ~self.columns.is_action
        off = last - np.median(last, axis=0)
        spread = np.median(np.abs(off), axis=0) / 0.6745 + settings.LEAST_SPREAD * columns.spread[own]
        lasting = columns.memory[own] >= settings.LEAST_MEMORY
        squares = np.minimum((off / spread) ** 2, settings.FARTHEST) * lasting
        return np.asarray(squares.sum(axis=1) / max(own.sum(), 1))

    def compare(self) -> Compared:
        lengths, far = self.data.lengths.astype(float), self.far
        self.low, self.high = low, high = self.two_fences(lengths, settings.LENGTH_FACTOR)
        short, usual_end = settings.CUT_LENGTH * np.quantile(lengths, 0.25), max(np.quantile(far, 0.75), 1.0)
        cut = np.minimum(short / lengths, far / (settings.LENGTH_FACTOR * usual_end))
        # What many demonstrations have, as those of another sampling rate, is no fault of one.
        are_few = max((lengths < low).sum(), (lengths > high).sum(), (cut > 1).sum()) <= few(len(lengths))
        is_known = np.isfinite(high) & (low != 0) & are_few
        severity = np.where(is_known, np.maximum(lengths / high, low / lengths), np.nan)
        self.is_cut = is_known & (cut > 1) & (severity <= 1)
        return lengths, np.where(lengths > high, high, low), np.where(self.is_cut, cut, severity)

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        seconds = self.data.seconds
        lasts = "" if seconds is None else f", {duration(fault.value, seconds)}"
        end = ", fewer than most, and ends where the others do not: perhaps it is cut off" if self.is_cut[m] else ""
        steps = counted(int(fault.value), "step")
        return super().say(fault, m, c, steps=steps, seconds=lasts, low=self.low, high=self.high, end=end)


class OtherLag(ComparingRule):
    name, words = "lag", "the state follows the action sooner or later than usual"
    sentence = "the state follows the action {steps} {when} than usual"
    needs = ("lag", "several")
    causes = ("frame rate", "shifted action")
    unknown = "the lag between action and state is not the same in most demonstrations"

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """Steps by which the lag is shifted from the usual one, and what that shift adds to the agreement of the
        cross-correlations, relative to the usual one."""
        return shifts(block, learned.pairs)

    def compare(self) -> Compared:
        self.shift, gain = self.measured
        steps, least_gain = np.abs(self.shift), self.fence(gain, settings.USUAL_FACTOR, settings.SMALLEST_GAIN)
        power = sum(float(pair.usual @ pair.usual) for pair in self.data.learned.pairs)
        # A correlation of n steps is off by n^-1/2.
        by_chance = settings.TAIL * np.sqrt(2.0 / (power * self.data.lengths))
        severity = np.where(steps > 0, gain / np.maximum(least_gain, by_chance), 0.0)
        are_few = (severity > 1).sum() <= few(len(steps))
        return steps, 1, severity if are_few and np.isfinite(least_gain) else np.full(len(steps), np.nan)

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        steps, when = self.data.in_steps(int(fault.value)), "later" if self.shift[m] > 0 else "sooner"
        return super().say(fault, m, c, steps=steps, when=when)

    @classmethod
    def follows(cls, fault: Fault, cause: Fault) -> bool:
        """A shift of one step is said once."""
        return cause.rule != "shifted action" or fault.value == 1

    def usual(self) -> str:
        """The usual lag in words."""
        best = self.data.learned.pairs[0]
        names = [self.columns.names[c] for c in (best.action, best.state)]
        first, second = names if best.lag >= 0 else names[::-1]
        return f"{second} follows {first} after {self.data.in_steps(abs(best.lag))}"


class Undone(ComparingRule):
    """A demonstration fits the map between states and actions of the others once a fault is undone."""

    needs = ("map", "several")
    causes = ("never moves",)
    sentences: ClassVar[dict[str, str]]
    """What is said of each kind of fault that is tried."""

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """The fault that `Namer` names, and the gain of undoing it, 0 where there is none."""
        namer, named = learned.namer, np.zeros((len(block.numbers), 2))
        if namer is not None:
            for m, (number, rows) in enumerate(zip(block.numbers.tolist(), namer.window.rows_of(block), strict=True)):
                named[m] = namer.name(number, rows)
        return named[:, 0].astype(int), named[:, 1]

    def compare(self) -> Compared:
        namer, (named, gain) = self.data.learned.namer, self.measured
        assert namer is not None  # the rule needs it
        self.kinds, columns = namer.window.tried
        tried = np.flatnonzero(np.isin(self.kinds, [*self.sentences]))
        own, limit = np.where(named[:, None] == tried, gain[:, None], 0.0), namer.limit[tried]
        if (columns[tried] < 0).any():  # a rule that knows one direction would miss the other
            self.names = ("",) * len(tried)
            return above(own, np.where(np.isnan(limit).any(), np.nan, limit))
        self.names, place = self.columns.names, namer.window.column[columns[tried]]
        value, threshold = np.zeros((len(own), len(self.names))), np.full(len(self.names), np.nan)
        value[:, place], threshold[place] = own, limit
        return above(value, threshold)

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        return self.sentences[self.kinds[self.measured[0][m]]].format(fault.column)


class Sign(Undone):
    name, words = "sign", "a column fits the others once its sign is changed"
    takes_steps = True
    sentences: ClassVar = {"sign": "{} fits the others once its sign is changed: perhaps it has the other sign"}


class Offset(Undone):
    name, words = "offset", "a column fits the others once a constant is taken off"
    sentences: ClassVar = {"offset": "{} fits the others once a constant is taken off: perhaps its zero has moved"}


class ShiftedAction(Undone):
    name, words = "shifted action", "the actions fit the others once they are moved by one step"
    sentences: ClassVar = {
        "actions late": "the actions fit the others once they are one step earlier: perhaps they are recorded late",
        "actions early": "the actions fit the others once they are one step later: perhaps they are recorded early",
    }


class FrameRate(Undone):
    name, words = "frame rate", "its frames come at another rate, or it moves in one step as the others do in two"
    sentences: ClassVar = {
        "frame rate": "it moves in one step as the others do in two: perhaps steps are missing, perhaps it is fast"
    }


class Duplicate(Rule):
    """Of each demonstration that is the same as an earlier one, or nearly: the earlier one."""

    name, words = "duplicate", "another demonstration is the same, or nearly"
    causes = ("never moves",)

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """A hash; and means over parts of each demonstration, seen from some directions, and the logarithm of its
        length."""
        offsets, lengths, spread = block.offsets, np.diff(block.offsets), block.columns.spread
        directions = np.random.default_rng(0).normal(size=(settings.DIRECTIONS, len(spread)))
        directions /= spread
        firsts = offsets[:-1, None] + (np.arange(settings.PARTS) * lengths[:, None]) // settings.PARTS
        widths = np.diff(firsts, append=offsets[1:, None]).ravel()
        means = np.add.reduceat(directions @ block.values, firsts.ravel(), axis=1) / np.maximum(widths, 1)
        parts = np.ascontiguousarray(means.T).reshape(len(lengths), -1)
        signatures = np.column_stack([parts, settings.LENGTH_WEIGHT * np.log(lengths)])
        return digests(block.block.observations, block.block.actions, offsets), signatures

    @classmethod
    def follows(cls, fault: Fault, cause: Fault) -> bool:
        """What does not move is alike, but not the same."""
        return fault.value > 0

    @classmethod
    def find(cls, data: Measurements) -> Iterator[Fault]:
        digest, signatures = data.measured[cls.measure]
        are_measured = bool(data.learned.columns.names)
        first = Copies.of(digest).copy_of
        is_copy = (first < np.arange(len(first))) & (are_measured | (data.lengths >= settings.MIN_DUPLICATE))
        twins = [(m, int(first[m]), 0.0, 0.0, 1e3, "") for m in np.flatnonzero(is_copy).tolist()]
        if are_measured and len(signatures) >= settings.FEWEST_DEMONSTRATIONS:
            distance, nearest = nearest_others(signatures)
            limit = near_limit(distance)
            for m in np.flatnonzero((distance < limit) & (nearest < np.arange(len(nearest))) & ~is_copy).tolist():
                value = float(distance[m])
                twins.append((m, int(nearest[m]), value, limit, min(limit / value, 1e3) if value else 1e3, "nearly "))
        for m, twin, value, limit, severity, how in twins:
            sentence, last = f"it is {how}the same as demonstration {data.ids[twin]!r}", int(data.lengths[m]) - 1
            yield Fault(cls.name, data.ids[m], 0, last, "", value, limit, severity, sentence)


def nearest_others(points: Float[Array, "M S"]) -> tuple[Float[Array, " M"], Int[Array, " M"]]:
    """The distance of each point to the nearest other one, and the number of that."""
    squares = np.einsum("ms,ms->m", points, points)
    nearest = np.empty(len(points), dtype=int)
    for begin in range(0, len(points), settings.NEIGHBOUR_ROWS):
        rows = np.arange(begin, min(begin + settings.NEIGHBOUR_ROWS, len(points)))
        further = squares - 2 * points[rows] @ points.T  # the squared distance less that of the point itself
        further[rows - begin, rows] = np.inf
        nearest[rows] = further.argmin(axis=1)
    return np.linalg.norm(points - points[nearest], axis=1), nearest


def near_limit(distance: Array) -> float:
    """Distance from the nearest other point below which a share `NEAR_SHARE` of independent points lie.

    Distances of nearest neighbours in k dimensions follow a Weibull distribution, whose shape is k. With their median
    q2 and upper quartile q3,

        P(d < x) = 1 - 2^(-(x / q2)^k),        k = log 2 / log(q3 / q2).
    """
    middle, high = (float(np.quantile(distance, q, method="lower")) for q in (0.5, 0.75))
    if not 0 < middle < high:
        return 0.0
    power = np.log(high / middle) / np.log(2.0)
    return middle * float(np.clip((settings.NEAR_SHARE / np.log(2.0)) ** power, *settings.NEAR_DUPLICATE))


class IdleEnd(ComparingRule):
    """Idle beginnings and ends, which may be trimmed."""

    at_head = False

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """Steps before the first and after the last step that moves, of each demonstration. Where motion grows slowly,
        or decays as that of a controller that settles, nothing is idle. A command that stays exactly the same while no
        state leaves its noise is idle, however large the noise."""
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
        held = np.array([_held(block, m) for m in range(len(head))])
        return np.maximum(head, held[:, 0]), np.maximum(tail, held[:, 1])

    def compare(self) -> Compared:
        idle, least = self.measured[0 if self.at_head else 1], settings.MIN_IDLE
        self.first, self.last = (self.first, idle - 1) if self.at_head else (self.data.lengths - idle, self.last)
        factor = settings.USUAL_FACTOR
        return above(idle, np.maximum(self.fence(idle, factor, least / factor), least))


class IdleHead(IdleEnd):
    name, words = "idle head", "nothing moves for long at the beginning"
    sentence = "nothing moves for the first {long} (usual: up to {most})"
    at_head = True


class IdleTail(IdleEnd):
    name, words = "idle tail", "nothing moves for long at the end"
    sentence = "nothing moves for the last {long} (usual: up to {most})"


def trims(data: Measurements) -> dict[Id, tuple[int, int]]:
    """The steps to keep of each demonstration with idle ends, whether they are usual or not."""
    least = settings.MIN_IDLE
    head, tail = (np.where(idle >= least, idle, 0) for idle in data.measured[IdleEnd.measure])
    end = data.lengths - tail
    idle = np.flatnonzero((head + tail > 0) & (head < end)).tolist()
    return {data.ids[m]: (int(head[m]), int(end[m])) for m in idle}


def _held(block: MovingBlock, m: int) -> tuple[int, int]:
    """Steps at the beginning, and at the end, of demonstration `m` of a block in which the action is exactly constant
    and no state leaves its noise; the step that moves next, or moved last, does not count."""
    rows, least = slice(*block.offsets[m : m + 2].tolist()), settings.MIN_IDLE
    if (actions := block.block.actions[rows]).ndim == 1:  # a code that stays the same may be a push
        return 0, 0
    same = [(actions == actions[end]).all(axis=1)[::way] for end, way in ((0, 1), (-1, -1))]
    held = [int(np.argmin(each)) for each in same]  # 0 where the action never changes, which tells nothing
    if max(held) <= least:
        return 0, 0
    columns, is_state = block.columns, ~block.columns.is_action
    states = block.values[is_state, rows]
    noise = np.median(np.abs(np.diff(states, n=3, axis=1)), axis=1) / settings.THIRD_DIFFERENCE
    band = np.maximum(settings.NOISE_BAND * noise, columns.scale[is_state])
    tells = band <= settings.LARGEST_BAND * columns.spread[is_state]
    states, band = states[tells], band[tells]
    ends = zip((states, states[:, ::-1]), held, strict=True)
    first, last = (_quiet(values[:, :n], band, least) if n > least and tells.any() else 0 for values, n in ends)
    return first, last


def _quiet(values: Float[Array, "S T"], band: Float[Array, " S"], least: int) -> int:
    """Steps but one, from the first on, in which no state is farther from where it rests."""
    at_rest = np.median(values[:, :least], axis=1)
    leaves = np.append((np.abs(values - at_rest[:, None]) > band[:, None]).any(axis=0), True)
    return max(int(np.argmax(leaves)) - 1, 0)
