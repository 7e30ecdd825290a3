"""The findings of an audit, each explained in a sentence."""

from __future__ import annotations

from typing import Literal

Finding = Literal[
    "outliers",
    "answered",
    "mixture",
    "two groups",
    "in doubt",
    "no outliers",
    "nothing could be learned",
]

FINDINGS: dict[str, str] = {
    "outliers": "Some demonstrations act differently from the rest.",
    "answered": "Your answers decide which demonstrations are good.",
    "mixture": "The demonstrations are those of an expert, and those of the adversary that was named.",
    "two groups": "Two groups act differently; without an answer nobody can say which is good.",
    "in doubt": "Low scores may have another cause; here is a ranking, and no verdicts.",
    "no outliers": "Nobody differs clearly; here is a ranking, and no verdicts.",
    "nothing could be learned": "The observations do not help to predict the actions of other demonstrations.",
}
"""The sentences of the findings; first those that say most."""

DECIDED = ("outliers", "answered", "mixture")
"""The findings with which demonstrations get verdicts other than "open"."""
