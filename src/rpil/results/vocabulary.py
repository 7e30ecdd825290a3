"""The verdicts on demonstrations: they depend on what says who is good, the anchor of an audit.

Without an anchor the data alone can tell who differs from the others, and not who is good.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import Literal

from rpil.data.text import printable

Anchor = Literal["none", "answers", "named adversary"]
"""Source of who is good: nothing; labels, answers or outcomes; or the adversary of the paper's mixture."""

Verdict = Literal["good", "expert", "open", "outlier", "bad", "adversary"]
Side = Literal["upper", "open", "lower"]


@dataclass(frozen=True)
class Vocabulary:
    """The verdicts of an audit; the third one, for demonstrations that the data do not decide, is always "open".
    Without answers nobody is called good: there the upper one is "open", too."""

    upper: Verdict
    lower: Verdict
    probability: str
    """The name of the probability in tables."""
    explanation: str
    """Meaning of the probability, one sentence."""


VOCABULARIES: dict[str, Vocabulary] = {
    "none": Vocabulary(
        "open",
        "outlier",
        "P(usual)",
        "P(usual) is the probability that a demonstration acts like most others; it says nothing of quality.",
    ),
    "answers": Vocabulary(
        "good",
        "bad",
        "P(good)",
        "P(good) is the probability that a demonstration is good, given answers about some of them, or outcomes.",
    ),
    "named adversary": Vocabulary(
        "expert",
        "adversary",
        "P(expert)",
        "P(expert) is the probability that a demonstration is an expert's, and not that of the adversary that was "
        "named.",
    ),
}
"""The vocabularies by their anchors."""

SIDES: dict[str, Side] = {"good": "upper", "expert": "upper", "open": "open"}
SIDES |= dict.fromkeys(("outlier", "bad", "adversary"), "lower")
"""The side of each verdict, whatever the vocabulary."""

WORSE = "worse than "
"""Begins what is said of the worse one of an answered pair."""

MAX_NAME = 28
"""Characters of an id in the text of an audit."""

PLURALS = {"expert": "experts", "outlier": "outliers", "adversary": "adversaries"}
"""The verdicts that are nouns."""


def short_id(name: Hashable) -> str:
    """An id in few characters: of a long one its end, which is what differs."""
    text = printable(name)
    return text if len(text) <= MAX_NAME else f"...{text[3 - MAX_NAME :]}"


def numbered(count: int, verdict: str) -> str:
    """``4 outliers``, ``1 outlier``, ``4 good``."""
    return f"{count:,} {verdict if count == 1 else PLURALS.get(verdict, verdict)}"


def in_numbers(counts: Mapping[str, int]) -> str:
    """``4 outliers, 1 open``: the numbers of the verdicts that there are."""
    return ", ".join(numbered(count, verdict) for verdict, count in counts.items() if count)


COLOURS: dict[Side, str] = {"upper": "#0072b2", "open": "#7f8790", "lower": "#d55e00"}
"""The palette of Okabe and Ito, which readers with any of the common colour deficiencies can distinguish."""
