"""The findings of an audit, each explained in a sentence."""

from __future__ import annotations

from typing import Literal

Finding = Literal[
    "some are unlike",
    "two groups",
    "in doubt",
    "nobody stands out",
    "nothing could be learned",
    "answered",
    "mixture",
]

FINDINGS: dict[str, str] = {
    "some are unlike": "Some demonstrations are unlike the others: the policy of those that agree explains them worse.",
    "two groups": "Two groups of demonstrations each have a policy of their own.",
    "in doubt": "Some score lower than the others, but there is a reason to doubt it; nobody is called unlike.",
    "nobody stands out": "The scores are one group: demonstrations are ranked, and nobody is called unlike.",
    "nothing could be learned": "The state does not help to predict the actions of other demonstrations.",
    "answered": "The answers given decide which demonstrations are good.",
    "mixture": "The mixture with the named adversary decides.",
}
