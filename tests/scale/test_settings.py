"""The sample that the judge reads."""

from __future__ import annotations

import numpy as np

from rpil.scale.settings import SampleSettings


def test_sample_holds_every_labelled_demonstration_and_unlabelled_ones():
    rng = np.random.default_rng(0)
    labels = np.zeros(5000, dtype=int)
    labels[[3, 4000]] = 1, -1
    chosen = SampleSettings().draw(np.full(5000, 200), labels, 20_000, rng)
    assert {3, 4000} <= set(chosen.tolist())
    assert len(chosen) == 2 + 100
    assert (np.diff(chosen) > 0).all()
    labels = np.repeat([1, -1, 0], 2000)
    chosen = SampleSettings().draw(np.full(6000, 100), labels, 20_000, rng)
    np.testing.assert_array_equal(np.bincount(labels[chosen] + 1), [200, 200, 200])
