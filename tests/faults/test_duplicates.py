"""Demonstrations that are the same name the earlier one."""

from __future__ import annotations

import numpy as np
import pytest

from recordings import demonstrations, recording
from rpil.data.demonstrations import Demonstrations
from rpil.faults.checking import check

CLEAN = recording()
M = 5  # the demonstration that is copied


def test_copies_are_found_and_named():
    (found,) = check(demonstrations([*CLEAN, CLEAN[M]])).findings
    assert (found.rule, found.id) == ("duplicate", len(CLEAN))
    assert found.sentence == f"it is the same as demonstration {M}"
    assert (found.first, found.last, found.column) == (0, len(CLEAN[M][0]) - 1, "")


def test_each_copy_names_the_first():
    first, second = recording(2)
    found = check(demonstrations([first, second, first, first])).findings
    assert [(f.rule, f.id, f.sentence[-1]) for f in found] == [("duplicate", 2, "0"), ("duplicate", 3, "0")]


@pytest.mark.parametrize(("n_steps", "n_found"), [(3, 0), (49, 0), (50, 9)])
def test_short_equal_demonstrations_of_codes_are_no_duplicates(n_steps, n_found):
    moves = np.arange(n_steps)[:, None] % 3.0, np.arange(n_steps) % 2
    assert check(Demonstrations.from_episodes([moves] * 10)).counts.get("duplicate", 0) == n_found
