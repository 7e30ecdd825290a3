"""The findings of an audit, each explained in a sentence."""

from __future__ import annotations

from typing import Literal

Finding = Literal[
    "some are unlike",
    "answered",
    "mixture",
    "two groups",
    "in doubt",
    "nobody stands out",
    "nothing could be learned",
]

FINDINGS: dict[str, str] = {
    "some are unlike": "Some demonstrations are unlike those that agree best.",
    "answered": "The answers given decide which demonstrations are good.",
    "mixture": "The demonstrations fall into those of an expert and those of the adversary that was named.",
    "two groups": "Two groups of demonstrations each have a policy of their own: without an answer it cannot be known "
    "which of them is good.",
    "in doubt": "Some score lower than the others, but there is a reason to doubt it; nobody is called unlike.",
    "nobody stands out": "The scores are one group: demonstrations are ranked, and nobody is called unlike.",
    "nothing could be learned": "The state does not help to predict the actions of other demonstrations.",
}
"""The sentences of the findings; first those that say most."""

DECIDED = ("some are unlike", "answered", "mixture")
"""The findings with which demonstrations get words other than "open"."""
