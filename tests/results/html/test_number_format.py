"""Numbers in the report."""

from __future__ import annotations

import numpy as np
import pytest

from rpil.results.html.number_format import format_number, format_percent


@pytest.mark.parametrize(
    ("value", "text"), [(-3.14159, "−3.1"), (-0.04, "0.0"), (12345.6, "12,346"), (np.inf, "∞"), (-np.inf, "−∞")]
)
def test_format_number(value: float, text: str) -> None:
    assert format_number(value) == text


@pytest.mark.parametrize(
    ("share", "text"), [(0.0, "0 %"), (0.001, "<1 %"), (0.5, "50 %"), (0.999, ">99 %"), (1.0, "100 %")]
)
def test_format_percent(share: float, text: str) -> None:
    assert format_percent(share) == text
