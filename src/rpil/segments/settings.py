"""Settings of segments; docs/segments.md says what each step does. Values without a source were chosen by hand."""

from __future__ import annotations

from rpil.data.settings_record import settings_record


@settings_record(level="(0, 0.5)", at_home="(0, 1)", rest_share="(0, 1)", window_share="(0, 1)", few="(0, 1]")
class SegmentSettings:
    """Segments of demonstrations (`rpil.segments.find`)."""

    level: float = 0.16
    """Share of its range by which a column leaves its first value, so that a hand closes or a thing is moved."""
    at_home: float = 0.25
    """Share of the rows in which a hand is as at first, at least, and in which it is not."""
    between: float = 0.1
    """Share of the rows in which a hand is on its way, at most."""
    window_share: float = 1 / 40
    """Rows within which a move is measured, relative to the median demonstration; three at least."""
    least_move: float = 0.02
    """Share of its range by which a column moves within these rows, else it rests."""
    n_folds: int = 5
    """Folds of demonstrations at most."""
    n_trees: int = 40
    """Trees of a forest."""
    max_rows: int = 5_000
    """Rows to which a forest is fitted at most."""
    few: float = 1 / 3
    """Share of the demonstrations in which something is done, up to which it can be a mistake."""
    surprise: float = 3.0
    """Robust standard deviations below the median progress from which an act is a candidate."""
