"""The findings of an audit, each explained in a sentence."""

from __future__ import annotations

from typing import Literal

Finding = Literal[
    "outliers", "answered", "mixture", "a group apart", "two groups", "no outliers", "nothing could be learned"
]

FINDINGS: dict[str, str] = {
    "outliers": "Some demonstrations act differently from the rest.",
    "answered": "Answers or outcomes decide which demonstrations are good.",
    "mixture": "The demonstrations are those of an expert, and those of the adversary that was named.",
    "a group apart": "A few act alike, and differ from the rest; without an answer nobody can say if they are worse.",
    "two groups": "Two groups act differently; without an answer nobody can say which is good.",
    "no outliers": "Nobody differs clearly.",
    "nothing could be learned": "The observations do not help to predict the actions of other demonstrations.",
}
"""The sentences of the findings; first those that say most."""

DECIDED = ("outliers", "answered", "mixture")
"""The findings with which demonstrations get verdicts other than "open"."""
