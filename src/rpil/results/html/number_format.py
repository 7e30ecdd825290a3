"""How the report writes numbers."""

from __future__ import annotations

import math


def format_number(value: float) -> str:
    """A number with one decimal, from a thousand on with none; with a true minus sign and the sign of infinity."""
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    # Adding zero turns -0.0 into 0.0.
    text = f"{value:,.0f}" if abs(value) >= 1000 else f"{round(value, 1) + 0.0:.1f}"
    return text.replace("-", "−")


def format_percent(share: float) -> str:
    """A share in whole percent; only exactly 0 and 1 become 0 % and 100 %."""
    if 0 < share < 0.005:
        return "<1 %"
    if 0.995 < share < 1:
        return ">99 %"
    return f"{100 * share:.0f} %"
