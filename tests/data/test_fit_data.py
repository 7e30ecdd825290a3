"""The data of one fit, by demonstration."""

from __future__ import annotations

import numpy as np

from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete

DATA = FitData(
    features=np.arange(12.0).reshape(6, 2),
    actions=np.array([0, 1, 2, 0, 1, 2]),
    offsets=np.array([0, 1, 3, 6]),
    space=Discrete(3),
    labels=np.array([1, 0, -1]),
)


def test_selected_demonstrations_keep_their_steps_and_labels():
    chosen = DATA.select(np.array([2, 0]))
    np.testing.assert_array_equal(chosen.offsets, [0, 3, 4])
    np.testing.assert_array_equal(chosen.features, DATA.features[[3, 4, 5, 0]])
    np.testing.assert_array_equal(chosen.actions, [0, 1, 2, 0])
    np.testing.assert_array_equal(chosen.labels, [-1, 1])


def test_steps_without_demonstrations_are_one_demonstration():
    data = FitData.from_steps(DATA.features, DATA.actions, DATA.space)
    assert data.n_demonstrations == 1
    assert data.lengths.tolist() == [6]
    assert not data.labels.any()
