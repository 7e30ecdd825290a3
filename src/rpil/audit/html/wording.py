"""How the report writes numbers."""

from __future__ import annotations

import math


def number(value: float) -> str:
    """A number to one decimal, to none from a thousand on, with a true minus sign and an infinity that can be read."""
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    # Adding zero to what was rounded turns -0.0 into 0.0.
    text = f"{value:,.0f}" if abs(value) >= 1000 else f"{round(value, 1) + 0.0:.1f}"
    return text.replace("-", "−")


def percent(share: float) -> str:
    """A share in whole percent; never 0 or 100 for what is merely close to it."""
    if 0 < share < 0.005:
        return "<1 %"
    if 0.995 < share < 1:
        return ">99 %"
    return f"{100 * share:.0f} %"


def count(size: int, noun: str) -> str:
    """``1 step``, ``2,000 steps``."""
    return f"{size:,} {noun}{'' if size == 1 else 's'}"
