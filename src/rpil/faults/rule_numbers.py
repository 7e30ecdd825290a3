"""The numbers of all findings, by which tools and teams name them: RPIL-101 and so on.

A number stays with its finding for good: a new finding is added at the end of its group, and a number is not given
again.
"""

from __future__ import annotations

OF_AUDIT = {
    "outlier": "the demonstration acts differently from the rest; it need not be worse",
    "bad": "the demonstration is bad, by the answers that were given",
    "adversary": "the demonstration is like the adversary that was named",
    "two groups": "two groups act differently; without an answer nobody can say which is good",
    "in doubt": "some demonstrations have low scores, but there may be another reason",
    "nothing could be learned": "the observations do not help to predict the actions",
}
"""What an audit finds, and what that is; the rules of `rpil.faults.report.RULES` have words of their own."""

_OF_RECORDINGS = (
    "missing values, frame count, dropped frames, repeated frames, frozen sensor, frozen action, saturation, spike, "
    "jump, scale, lag, sign, exchanged, offset, shifted action, reversed, frame rate, next state, two episodes, "
    "never moves, idle head, idle tail, duplicate, length"
)
_OF_FOLDERS = "timestamps, totals, episode table, statistics, metadata"
_OF_VIDEOS = (
    "video file, video frames, frame times, black frames, frozen picture, repeated pictures, exchanged cameras, "
    "turned camera, video time, other video"
)
_GROUPS = {"RPIL-1": _OF_RECORDINGS, "RPIL-2": _OF_FOLDERS, "RPIL-3": _OF_VIDEOS, "RPIL-4": ", ".join(OF_AUDIT)}

NUMBERS: dict[str, str] = {
    name: f"{group}{k:02}" for group, names in _GROUPS.items() for k, name in enumerate(names.split(", "), start=1)
}
"""The number of each finding, by its name."""

RULE_NAMES = {number: name for name, number in NUMBERS.items()}
"""The name of the finding of each number."""
