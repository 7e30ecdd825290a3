"""Tables of other kinds are ranked as by someone who knows their kind, and the script prints a line for each."""

from __future__ import annotations

import numpy as np
import pytest

import rpil
from worlds.sequences import KINDS


@pytest.mark.parametrize("name", KINDS)
def test_a_table_holds_the_demonstrations_of_its_true_kind(name):
    made, clean = KINDS[name](0), KINDS[name](0, clean=True)
    read = rpil.read(made.rows, **made.options)
    np.testing.assert_array_equal(read.lengths, made.true.demonstrations.lengths)
    own = np.sort(read.observations, axis=1)  # in which columns come in another order
    np.testing.assert_array_equal(own, np.sort(made.true.demonstrations.observations, axis=1))
    assert read.n_steps == clean.true.demonstrations.n_steps
    assert clean.true.is_good.all()
    assert not clean.bad_steps.any()
