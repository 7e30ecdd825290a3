"""Settings of segments; docs/segments.md says what each step does. They were chosen by hand on OCBench."""

from __future__ import annotations

from rpil.data.settings_record import settings_record
from rpil.inference.settings import AnswerSettings


@settings_record(level="(0, 0.5)", at_home="(0, 0.5)", between="(0, 1)", least_move="(0, 1)", few="(0, 1]")
class SegmentSettings:
    """Segments of demonstrations (`rpil.segments.find`)."""

    level: float = 0.16
    """Share of its range by which a column leaves its first value where a hand closes; half of it where a thing goes."""
    at_home: float = 0.25
    """Share of the rows in which a hand is as at first, at least, and in which it is not."""
    between: float = 0.1
    """Share of the rows in which a hand is on its way, at most."""
    window_share: float = 1 / 40
    """Rows within which a move is measured, relative to the median demonstration; three at least."""
    least_move: float = 0.02
    """Share of its range by which a column moves within these rows, else it rests."""
    seldom: float = 1 / 3
    """Share of what it moves while a hand is closed that a thing moves while none is, less than."""
    near: float = 0.03
    """Share of its range within which two values of a column are one place."""
    prior_acts: float = 1.0
    """Acts, spread over the range, that a density begins with."""
    least_acts: int = 8
    """Acts of others from which a density tells something."""
    again: float = 0.5
    """Share of what an act moves that the next one moves again, from which it is done again."""
    done_again: float = 1.0
    """Nats that the score of an act loses where the next one does it again."""
    taken_over: float = 3.0
    """Nats that it loses where a person takes over after it."""
    few: float = 1 / 3
    """Share of the demonstrations in which something is done again, up to which it can be a mistake."""
    shortfall: float = 3.0
    """Nats below the median from which an act is a candidate."""
    answers: AnswerSettings = AnswerSettings(precision=4.0, error=0.1)
    """Regression on marked segments: there are few, and the ranking is to stand until they are more."""
