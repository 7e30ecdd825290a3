"""The sample that the judge reads."""

from dataclasses import replace

import numpy as np
import pytest

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


FEW = SampleSettings(min_steps=100, steps_per_coefficient=5, n_demonstrations=10, max_ratio=3.0, min_samples=4.0)


def test_a_sample_has_steps_for_each_coefficient_and_is_no_longer_than_its_ratio():
    assert [FEW.steps(n) for n in (10, 30)] == [100, 150]
    rng, few = np.random.default_rng(0), replace(FEW, min_demonstrations=2)
    assert len(few.draw(np.full(50, 60), np.zeros(50, dtype=int), 100, rng)) == 5  # 300 steps


@pytest.mark.parametrize(
    ("n", "length", "is_smaller"),
    # The bounds are four samples of 100 steps, two of ten demonstrations, and two of three times 100 steps.
    [(100, 5, True), (80, 5, False), (20, 25, False), (21, 25, True), (1, 600, False), (1, 601, True)],
)
def test_of_many_samples_one_is_read(n, length, is_smaller):
    assert FEW.is_smaller_than(np.arange(n + 1) * length, 100) == is_smaller
