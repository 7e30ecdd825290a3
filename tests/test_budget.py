"""Lines and numbers of each room: tools/budget.py counts them, and they only fall."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np

TOOL = runpy.run_path(str(Path(__file__).parents[1] / "tools" / "budget.py"))
ROOT = TOOL["ROOT"]

BUDGETS = {
    "cli": (3362, 29),
    "data": (3462, 67),
    "estimators": (2364, 19),
    "faults": (2387, 73),
    "formats": (9539, 127),
    "inference": (2755, 91),
    "mixture": (828, 24),
    "numerics": (616, 15),
    "policies": (2022, 71),
    "results": (4211, 75),
    "scale": (911, 33),
    "simulation": (1094, 29),
}
"""Lines and numbers of each room at most. They only fall; what a room gains another one gives, or an issue grants."""


def test_rooms_keep_to_their_budgets():
    sizes = {room: TOOL["size_of"](ROOT / room) for room in BUDGETS}
    assert {room: size for room, size in sizes.items() if any(np.greater(size, BUDGETS[room]))} == {}


def test_numbers_are_those_of_constants_and_fields():
    numbers_of = TOOL["numbers_of"]
    source = (
        "LIMIT, SHARES = 4, (0.1, 1 / 3)\nclass A:\n    width: float = 2.5\n    is_new: bool = True\n    name = 'b'\n"
    )
    assert numbers_of(source) == 5
    assert numbers_of("def f(limit=3):\n    return limit + 1\n") == 0
