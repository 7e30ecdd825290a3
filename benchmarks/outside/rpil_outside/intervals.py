"""Half-widths of paired differences, by the deviation that all cells of a world have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import t as student


def half_widths(less: Mapping[str, Sequence[float]], cell: str) -> tuple[float | None, float | None]:
    """Half-widths of the 95 % intervals of the mean in a cell, and of the mean over cells; None of a single seed."""
    freedom = sum(len(own) - 1 for own in less.values())
    if freedom < 1:
        return None, None
    spread = np.sqrt(sum(np.var(own) * len(own) for own in less.values()) / freedom)
    wide = float(student.ppf(0.975, freedom) * spread)
    return wide / np.sqrt(len(less[cell])), wide * np.sqrt(sum(1 / len(own) for own in less.values())) / len(less)
