"""The rules about whole demonstrations: whether undoing a fault mends them, and what they are made of."""

from __future__ import annotations

import itertools
from typing import ClassVar

import numpy as np

from rpil.data.text import duration
from rpil.faults import settings
from rpil.faults.lag import shifts
from rpil.faults.measured_columns import MovingBlock
from rpil.faults.motion import few
from rpil.faults.rule import Compared, ComparingRule, Fault, Learned, above
from rpil.numerics.types import Array


class Length(ComparingRule):
    name, words = "length", "it is far longer or shorter than the others, or short and ends where they do not"
    sentence = "it has {value:.0f} {noun}{seconds} ({whose}: {low:.0f} to {high:.0f} steps){end}"
    causes = ("frame rate",)

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """How far the last step is from those of the others, in columns that do not end by chance."""
        ends, states = learned.ends, ~block.columns.is_action
        if ends is None:
            return (np.zeros(len(block.offsets) - 1),)
        lasting = block.columns.memory[states] >= settings.LEAST_MEMORY
        last = np.where(lasting[:, None], block.values[states][:, block.offsets[1:] - 1], ends.centre[:, None])
        return (ends.far(last),)

    def compare(self) -> Compared:
        lengths, (far,) = self.data.lengths.astype(float), self.measured
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
        whose, (low, high), end = "usual", (self.low, self.high), ""
        noun = "step" if fault.value == 1 else "steps"
        if self.is_cut[m]:
            whose, (low, high) = "half of all", np.quantile(self.data.lengths, [0.25, 0.75])
            end = " and ends where the others do not: perhaps it is cut off"
        return super().say(fault, m, c, noun=noun, seconds=lasts, whose=whose, low=low, high=high, end=end)


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

    def usual(self) -> dict[str, str]:
        """The usual lag in words, where most demonstrations have the same."""
        if self.silent:
            return {}
        best = self.data.learned.pairs[0]
        names = [self.columns.names[c] for c in (best.action, best.state)]
        first, second = names if best.lag >= 0 else names[::-1]
        return {self.name: f"{second} follows {first} after {self.data.in_steps(abs(best.lag))}"}


class Undone(ComparingRule):
    """A demonstration fits the map between states and actions of the others once a fault is undone."""

    needs = ("map", "several")
    unknown = "these data could not show it"
    causes = ("never moves",)
    sentences: ClassVar[dict[str, str]]
    """What is said of each kind of fault that is tried."""

    @staticmethod
    def measure(block: MovingBlock, learned: Learned) -> tuple[Array, ...]:
        """The fault that `Namer` names, and the gain of undoing it, 0 where there is none."""
        namer, named = learned.namer, np.zeros((len(block.numbers), 2))
        if namer is not None:
            rows, bounds = block.values[namer.window.column].T, itertools.pairwise(block.offsets)
            for m, (number, (first, end)) in enumerate(zip(block.numbers.tolist(), bounds, strict=True)):
                named[m] = namer.name(number, rows[first:end])
        return named[:, 0].astype(int), named[:, 1]

    def compare(self) -> Compared:
        namer, (named, gain) = self.data.learned.namer, self.measured
        assert namer is not None  # the rule needs it
        every, chosen = np.array(self.columns.names), namer.window.column
        kinds, columns = namer.window.tried
        tried = np.flatnonzero(np.isin(kinds, [*self.sentences]))
        columns, limit = columns[tried], np.nan_to_num(namer.limit[tried], nan=np.inf)
        self.texts = [self.sentences[kind] for kind in kinds[tried]]
        value = np.where(named[:, None] == tried, gain[:, None], 0.0)
        if (columns < 0).any():  # a rule that knows one direction would miss the other
            self.names = ("",) * len(tried)
            return above(value, np.where(np.isinf(limit).any(), np.inf, limit))
        outside = np.delete(every, chosen)
        self.names = (*every[chosen[columns]].tolist(), *outside.tolist())
        return above(np.pad(value, ((0, 0), (0, len(outside)))), np.append(limit, np.full(len(outside), np.inf)))

    def say(self, fault: Fault, m: int, c: int, **others: object) -> str:
        return self.texts[c].format(fault.column)


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
