"""The reason for a verdict, as one sentence: the part of the evidence that decided, and the steps that stand out.

Steps stand out where they are much more likely under the reference, or the named adversary, than under the policy
of the trusted: the stretch of consecutive steps with the lowest sum of log-ratios.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from rpil.numerics.types import Array, Float
from rpil.results.words import SIDES, Words

MIN_STRETCH = 5.0
"""Nats against the policy of the trusted from which a stretch is named: a hundred and fifty to one. No verdict depends
on it."""

MAX_LOG_RATIO = 50.0
"""Nats. Log-ratios of steps are bounded by this in sums: one impossible step is not all there is to say."""

GivenLabel = Literal["good", "bad", ""]
"""The label of a demonstration, or nothing."""


class Stretch(NamedTuple):
    """Consecutive steps of a demonstration, counted from its first step, and the sum of their log-ratios in nats."""

    first: int
    last: int
    nats: float

    @property
    def steps(self) -> str:
        """The subject of a sentence, and its verb."""
        return f"step {self.first} is" if self.first == self.last else f"steps {self.first} to {self.last} are"


def worst_stretch(log_ratio: Float[Array, " n"]) -> Stretch | None:
    """The stretch with the lowest sum of log-ratios; None where that is above -`MIN_STRETCH`."""
    # Of all pairs of sums of the first steps, the one that falls most (Kadane's algorithm).
    total = np.concatenate([[0.0], np.cumsum(log_ratio)])
    fall = total - np.maximum.accumulate(total)
    stop = int(np.argmin(fall))
    if fall[stop] > -MIN_STRETCH:
        return None
    return Stretch(int(np.argmax(total[: stop + 1])), stop - 1, float(fall[stop]))


@dataclass(frozen=True)
class Grounds:
    """What the reason for the verdict on one demonstration is made from."""

    finding: str
    words: Words
    verdict: str
    log_odds: float
    is_sure: bool
    """Whether its probability is one from which a word may be given."""
    from_actions: float
    from_demonstrator: float
    label: GivenLabel
    has_outcome: bool
    """Whether its outcome is known."""
    contradicts: bool
    """Whether the label contradicts the other answers."""
    doubt: str
    """The first doubt of the audit, or nothing."""
    group: str
    """The letter of its group, where two groups compete, or nothing."""
    score: float
    """Mean log-ratio of its steps, in nats."""
    trusted_score: float
    """The median score of the demonstrations with the upper word; NaN where there is none."""
    stretch: Stretch | None
    deviation: str
    """What it does in its worst steps, against what the trusted do there; or nothing."""

    def sentence(self) -> str:
        """The reason."""
        reason = self._decided()
        if self.stretch is not None and self.finding != "nothing could be learned":
            reason += f"; {self.stretch.steps} least like {self.words.upper} ones ({self.stretch.nats:+.1f} nats)"
            reason += f": {self.deviation}" if self.deviation else ""
        return f"{reason}."

    def _withheld(self) -> str:
        """Why a demonstration with a probability that is high or low enough has no word."""
        if self.words.upper != "typical":
            return "that alone gives no word"
        better = "only the better half of those that score high is called typical, if "
        return f"{better if self.log_odds > 0 else 'it is called unlike only if '}other folds agree"

    def _decided(self) -> str:
        """The first clause: the evidence with the largest part in the verdict."""
        sign = {"upper": 1, "open": 0, "lower": -1}[SIDES[self.verdict]]
        own, others = f"{self.from_actions:+.1f} nats", f"{self.from_demonstrator:+.1f} nats"
        if self.label:
            labelled = f"Labelled {self.label}"
            return f"{labelled}, which contradicts the other answers: look again" if self.contradicts else labelled
        if self.finding == "two groups":
            group = f"It acts as group {self.group} does, and only" if self.group else "Only"
            return f"{group} an answer can tell which group is good"
        if self.finding == "nothing could be learned":
            return "Nothing tells it from the others: the state does not help to predict any actions"
        if self.finding == "in doubt":
            return f"No word, because of a doubt: {self.doubt[:1].lower()}{self.doubt[1:].rstrip('.')}"
        if self.finding == "answered" and sign and self.verdict not in (self.words.upper, self.words.lower):
            return f"Called {self.verdict} without the answers, which do not contradict it"
        if self.finding == "answered" and sign and self.has_outcome:
            return f"Its outcome is among the {'highest' if sign > 0 else 'lowest'} ({self.log_odds:+.1f} nats)"
        if self.finding == "answered" and sign:
            return f"Judged by what the answers say of demonstrations like it ({self.log_odds:+.1f} nats)"
        if self.finding == "nobody stands out":
            return "Nothing tells it from the others: all scores are one group"
        if sign == 0 and self.is_sure:
            return f"Its log-odds are {self.log_odds:+.1f} nats, but {self._withheld()}"
        if sign == 0:
            either = f"{self.words.upper} or {self.words.lower}"
            return f"Its log-odds of {self.log_odds:+.1f} nats are too close to 0 to call it {either}"
        if sign * self.from_demonstrator > sign * self.from_actions:
            return f"Judged by its demonstrator's other demonstrations ({others}; {own} from its own actions)"
        # Without a trusted one the trusted score is NaN, which no score is below.
        is_lower = sign < 0 and self.score < self.trusted_score
        trusted = f", that of the {self.words.upper} ones {self.trusted_score:+.2f}" if is_lower else ""
        return f"Judged by its actions: its mean log-ratio is {self.score:+.2f} nats{trusted}"
