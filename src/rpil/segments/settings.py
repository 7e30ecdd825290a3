"""Settings of segments (`rpil.segments.find`), chosen by hand on OCBench; docs/segments.md says what each step does."""

from __future__ import annotations

from rpil.data.archive import settings_record
from rpil.inference.settings import AnswerSettings


@settings_record(level="(0, 0.5)", at_home="(0, 0.5)", between="(0, 1)", least_move="(0, 1)", few="(0, 1]")
class SegmentSettings:
    """Acts, their progress and their candidates. Lengths are shares of the range of a column."""

    level: float = 0.16
    """Length by which a column leaves its first value where a hand closes; half of it where a thing is moved."""
    at_home: float = 0.25
    """Share of the rows in which a hand is as at first, at least, and in which it is not."""
    between: float = 0.1
    """Share of the rows in which a hand is on its way, at most."""
    window_share: float = 1 / 40
    """Rows within which a move is measured, relative to the median demonstration; three at least."""
    least_move: float = 0.02
    """Length by which a column moves within these rows, at least; else it rests."""
    few: float = 1 / 3
    """Share of its moves that a thing does while no hand is closed, and of demonstrations with a mistake, at most."""
    near: float = 0.03
    """Length within which two values are one place."""
    least_acts: int = 8
    """Acts of others from which a density tells something."""
    again: float = 0.5
    """Share of what an act moves from which the next one, that moves it, does it again."""
    done_again: float = 1.0
    """Nats that the score of an act loses where the next one does it again."""
    shortfall: float = 3.0
    """Nats below the median from which an act is a candidate, and that it loses where a person takes over after it."""
    answers: AnswerSettings = AnswerSettings(precision=4.0, error=0.1)
    """Regression on marked segments: few, and the ranking stands until they are more."""
